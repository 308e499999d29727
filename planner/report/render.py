"""From pictures to bytes: the same picture gives the same bytes."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

from planner.report.style import ROLES, applied

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESOLUTION = 200
"""Of the PNG pictures [dots per inch]."""


def to_svg(figure: Figure) -> str:
    """The picture as an SVG file, text as text, without a date."""
    stream = io.StringIO()
    with applied():
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def to_png(figure: Figure) -> bytes:
    """The picture as a PNG file."""
    stream = io.BytesIO()
    with applied():
        figure.savefig(stream, format="png", dpi=RESOLUTION, metadata={"Software": None})
    return stream.getvalue()


def to_inline_svg(figure: Figure, *, name: str, description: str) -> str:
    """The picture as an element of an HTML page, in the page's colours, light or dark.

    Args:
        figure: The picture.
        name: Prefix that keeps its identifiers apart from those of other pictures.
        description: What it shows, for those who cannot see it; plain text.
    """
    from markupsafe import escape

    svg = to_svg(figure)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    for variable, role in ROLES.items():
        svg = re.sub(role.light, f"var(--{variable})", svg, flags=re.IGNORECASE)
    opening = re.match(r"<svg[^>]*>", svg)
    assert opening is not None, "an SVG file begins with its element"
    box = re.search(r'viewBox="[^"]*"', opening[0])
    assert box is not None, "matplotlib states the size of a picture"
    start = f'<svg role="img" aria-label="{escape(description)}" {box[0]}'
    start += ' xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'
    return start + svg[opening.end() :]
