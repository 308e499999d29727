"""The words of pages, figures and terminals: templates, and how these write numbers and names."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from planner.report.table import Table, at_most, number, percent, two_digits

if TYPE_CHECKING:
    import jinja2


@cache
def environment(*, plain: bool = False) -> jinja2.Environment:
    """Environment of the templates: their folder, filters and, of pages, macros; it draws tables.

    ``plain`` text is not escaped.
    """
    import jinja2

    def drawn(value: Any) -> Any:
        if not isinstance(value, Table):
            return value
        return Markup(templates.get_template("table.html").render(table=value))

    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("planner.report"),
        autoescape=not plain,
        undefined=jinja2.StrictUndefined,
        finalize=drawn,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "at_most": at_most,
        "breakable": breakable,
        "degrees": math.degrees,
        "digits": lambda value, digits=3: f"{value:.{digits}g}",
        "fixed": lambda value, digits=2: f"{value:.{digits}f}",
        "heading": heading,
        "line": lambda words: " ".join(words.split()),
        "noted": _noted,
        "number": number,
        "percent": percent,
        "sentence": sentence,
        "two_digits": two_digits,
    }
    templates.tests["breaking"] = lambda cell: " " in cell and not re.search(r"\d", cell)
    if not plain:
        templates.globals |= vars(templates.get_template("macros.html").module)
    return templates


def rendered_text(template: str, **values: Any) -> str:
    """A template of plain text, for a terminal."""
    return environment(plain=True).get_template(template).render(values).rstrip()


def phrase(template: str, block: str, **values: Any) -> str:
    """A block of a template of plain text."""
    of = environment(plain=True).get_template(template)
    return "".join(of.blocks[block](of.new_context(values))).strip()


def words_of(figure: str, **values: Any) -> tuple[str, str]:
    """Title and caption of a figure: the first line of its block in ``captions.txt``, the rest."""
    title, _, caption = phrase("captions.txt", figure, **values).partition("\n")
    return title, " ".join(caption.split())


def heading(name: str) -> str:
    """An identifier as words, to begin a line with."""
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]


def sentence(words: str) -> str:
    """Words, names in them as they are, to begin a line with and to end with a stop."""
    name = not words.split(" ", 1)[0].replace("_", "A").islower()
    return f"{words}." if name else f"{words[:1].upper()}{words[1:]}."


def _noted(text: str) -> Markup:
    """Words with minus signs, and a note after a line break in small letters."""
    value, _, note = re.sub(r"(?<![\w.=])-(?=\d)", "−", text).partition("\n")
    return Markup("{} <small>{}</small>").format(value, note) if note else escape(value)


def breakable(name: str) -> Markup:
    """A name of a file that may break between its parts, not inside a word."""
    return Markup(re.sub("([/_-])", r"\1<wbr>", str(escape(name))))
