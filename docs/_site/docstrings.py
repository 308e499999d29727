"""Docstrings as they are written here, for Sphinx: by Google's convention, with bars for sizes."""

from __future__ import annotations

import re

from sphinx.ext.napoleon import Config, GoogleDocstring

CONFIG = Config(napoleon_use_rtype=False, napoleon_use_ivar=True, napoleon_attr_annotations=False)

LITERALS = {"``docs/math.md``": ":doc:`docs/math.md </math>`"}
"""Pages that docstrings name."""

VALUES = ("attribute", "data", "property")
"""What has no arguments; Sphinx would take what stands before a colon there for a type."""

RAISES = re.compile(r"^(:raises )(\w+)(?=:)")
"""Both packages have an `InvalidInput`: the one meant is that of the package itself."""


ALIASES = (
    (re.compile(r"TypeAliasForwardRef\('([\w.]+)'\)"), r"\1"),
    (re.compile(r"[~\w.]*_Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]"), "ArrayLike"),
    (re.compile(r"[~\w.]*ndarray\[[^()]*?float64\]\]"), "Array"),
)
"""How Sphinx writes aliases of types within other types, and their names."""


def _outside_literals(line):
    pieces = re.split(r"(``.*?``)", line)
    return "".join(
        LITERALS.get(p, p) if p.startswith("``") else p.replace("|", r"\|") for p in pieces
    )


def _prepare(app, what, name, obj, options, lines):
    plain = [line if line.startswith("    |") else _outside_literals(line) for line in lines]
    kind = "method" if what in VALUES else what
    package = name.partition(".")[0]
    lines[:] = [
        RAISES.sub(rf"\1~{package}.\2", line)
        for line in GoogleDocstring(plain, CONFIG, app, kind, name, obj, options).lines()
    ]


def _skip(*told):
    """Leave out the fields of named tuples, which the class has told of already."""
    _, _, _, member, *_ = told
    return True if type(member).__name__ == "_tuplegetter" else None


def _plain_types(app, what, name, obj, options, signature, returned):  # noqa: ARG001
    """Write the aliases of types by their names."""
    for pattern, alias in ALIASES:
        signature = signature and pattern.sub(alias, signature)
        returned = returned and pattern.sub(alias, returned)
    return signature, returned


def setup(app):
    """Take every docstring so."""
    app.connect("autodoc-process-signature", _plain_types)
    app.connect("autodoc-skip-member", _skip)
    app.connect("autodoc-process-docstring", _prepare)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
