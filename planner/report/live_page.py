"""What a page needs for live figures: their data, the scripts that draw them, and the library.

Everything stands in the page, once; it asks nobody for anything, and its security policy keeps it
from doing so. Plotly is packed, which makes a page of 5 MB one of 2 MB. A browser without scripts,
or too old to unpack it, shows the still pictures, and so does print.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markupsafe import Markup

SCRIPTS = ("live.js", "plots.js", "leg.js", "tables.js")
"""In the order in which they run."""

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)
"""What the browser lets a page do: run what stands in it, and load nothing."""


def live_head() -> Markup:
    """The elements of a page's head that keep it from the network."""
    from markupsafe import Markup

    return Markup(f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">')


def live_scripts(figures: Mapping[str, Mapping[str, Any]]) -> Markup:
    """The elements at the end of a page's body that bring its figures to life.

    Args:
        figures: By the identifier of a ``figure`` element that holds a still picture, what replaces
            it: from :func:`planner.report.live_plot.time_plot` or
            :func:`planner.report.live_leg.moving_leg`.
    """
    from markupsafe import Markup

    # Within a script no "<" may stand that could end it.
    data = json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = [f'<script type="application/json" id="live-figures">{data}</script>']
    if any(figure["kind"] == "plot" for figure in figures.values()):
        parts.append(f'<script type="text/plain" id="plotly">{_library()}</script>')
    parts += [f"<script>\n{_source(name)}</script>" for name in SCRIPTS]
    return Markup("\n".join(parts))  # our own, and JSON without markup


def _source(name: str) -> str:
    return files("planner.report").joinpath("scripts", name).read_text("utf-8")


@cache
def _library() -> str:
    """Plotly's script, packed; the same bytes every time."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()
