"""Mathematics as MathML, made when the site is: browsers draw it themselves, without a script."""

from __future__ import annotations

import html
import itertools
import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging

LOG = logging.getLogger(__name__)

TAG = re.compile(r"\\tag\{(.+?)\}")
BAR = re.compile(r"<mo[^>]*>(&#x0007C;|&#x02016;)</mo>")

SPACING = (
    # a slash in a line of text stands close
    (re.compile(r"<mo>&#x0002F;</mo>"), r'<mo lspace="0.1em" rspace="0.1em">/</mo>'),
    # a minus behind a bracket, a comma or a relation is a sign
    (
        re.compile(r"((?:[([,]|&#x0(?:0028|005B|002C|003D|2264|2265);)</mo>)<mo>&#x02212;</mo>"),
        r'\1<mo form="prefix">&#x02212;</mo>',
    ),
    # primes are high by themselves
    (
        re.compile(r"<msup>(<mi>\w</mi>)<mi>(&#x0203[23];)</mi></msup>"),
        r'<mrow>\1<mo lspace="0" rspace="0">\2</mo></mrow>',
    ),
    (re.compile(r"<mi>log</mi>"), '<mi>log</mi><mspace width="0.17em"/>'),
)
"""What the converter leaves to the browser, and the browser cannot know."""


def tag_of(node: nodes.math_block) -> str | None:
    """The number of an equation, as its LaTeX has it, or None."""
    found = TAG.search(node.astext())
    return found[1] if found else None


def anchor_of(tag: str) -> str:
    """Where on its page an equation is."""
    return f"equation-{tag}"


def mathml(latex: str, *, display: str = "inline") -> str:
    """The MathML of LaTeX; bars open and close in turn."""
    forms = itertools.cycle(("prefix", "postfix"))
    drawn = BAR.sub(
        lambda bar: (
            f'<mo form="{next(forms)}" stretchy="false" lspace="0" rspace="0">{bar[1]}</mo>'
        ),
        convert(re.sub(r"\\[bB]ig+[lr]\\\|", r"\\|", latex), display=display),
    )
    for pattern, replacement in SPACING:
        drawn = pattern.sub(replacement, drawn)
    if "\\" in drawn:
        LOG.warning("cannot draw %s", latex)
    return drawn


def _inline(self, node):
    self.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _displayed(self, node):
    tag = tag_of(node)
    number = f'<span class="number">({html.escape(tag)})</span>' if tag else ""
    place = f' id="{anchor_of(tag)}"' if tag else ""
    drawn = mathml(TAG.sub("", node.astext()).strip(), display="block")
    self.body.append(f'<div class="equation"{place}><div>{drawn}</div>{number}</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Draw every equation so."""
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
