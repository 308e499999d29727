"""What a reader of a page sees: its text, and what its figures draw, in a line each."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from itertools import chain
from typing import Any

import numpy as np

SKIPPED = ("script", "style", "svg")
"""Elements without text for the reader."""

BLOCKS = (
    *("p", "div", "h1", "h2", "h3", "h4", "li", "tr", "table", "figure", "figcaption", "section"),
    *("dt", "dd", "header", "footer", "nav", "main", "title", "summary", "details", "pre", "aside"),
)
"""Elements that begin a line."""


class _Text(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._skipped: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in SKIPPED:
            self._skipped.append(tag)
        elif tag in BLOCKS or tag == "br":
            self.parts.append("\n")
        elif tag in ("td", "th"):
            self.parts.append(" | ")
        if tag in ("tr", "td") and (kind := dict(attrs).get("class")):
            self.parts.append(f"{{{kind}}} ")
        if tag == "figure" and (label := dict(attrs).get("aria-label")):
            self.parts.append(f"({label})")
        if tag == "a" and not self._skipped:
            self.parts.append(f"[{dict(attrs).get('href')}] ")

    def handle_endtag(self, tag: str) -> None:
        if self._skipped and tag == self._skipped[-1]:
            self._skipped.pop()
        elif tag in BLOCKS:
            self.parts.append("\n")

    def handle_data(self, data: str) -> None:
        if not self._skipped:
            self.parts.append(re.sub(r"\s+", " ", data))


def text_of(page: str) -> str:
    """The text of a page, a line for each block and for each row of a table."""
    parser = _Text()
    parser.feed(page)
    lines = (" ".join(line.split()) for line in "".join(parser.parts).split("\n"))
    return "\n".join(line for line in lines if line.strip(" |"))


def figures_of(page: str) -> str:
    """A line for each figure of a page: of each curve its name, points, ends, and two sums.

    The sums of the values, and of the values by their places, differ where any value does. They are
    rounded to what single precision keeps. The last word is a checksum of how the figure looks.
    """
    found = re.search(r'id="live-figures">(.*?)</script>', page, re.DOTALL)
    figures = json.loads(found[1]) if found else {}
    return "\n".join(
        f"figure {name}: "
        + "; ".join([*map(_curve, figure.get("data") or _moving(figure)), *_around(figure)])
        + f"; look {zlib.crc32(json.dumps(_look(figure), sort_keys=True).encode()):08x}"
        for name, figure in figures.items()
    )


def _look(of: Any) -> Any:
    """What is said of a figure but for its numbers, which processors round in their own ways."""
    if isinstance(of, dict):
        return {name: _look(value) for name, value in of.items() if name != "bdata"}
    if isinstance(of, list):
        return sorted({json.dumps(_look(each), sort_keys=True) for each in of})
    if isinstance(of, str):
        return re.sub(r"[\d.,−]+", "#", of)
    return of if isinstance(of, bool) or of is None else "#"


def _around(figure: dict[str, Any]) -> list[str]:
    """Ranges of axes, words and shades of a figure."""
    layout = figure.get("layout", {})
    ranges = [
        f"{name} {' '.join(f'{end:.4g}' for end in axis['range'])}"
        for name, axis in layout.items()
        if name.startswith(("xaxis", "yaxis")) and axis.get("range")
    ]
    words = [str(each["text"]) for each in layout.get("annotations", [])]
    shades = [
        f"shade {each['x0']:.4g} {each['x1']:.4g}"
        for each in layout.get("shapes", [])
        if isinstance(each.get("x0"), float) and each.get("type") == "rect"
    ]
    return [*ranges, *words, *shades]


def _moving(figure: dict[str, Any]) -> list[dict[str, object]]:
    """What moves in a figure, as if they were curves."""
    motions = [
        {"name": each["name"], "x": np.ravel(each["points"]).tolist(), "y": each["distances"]}
        for each in figure.get("motions", [])
    ]
    kinds = [
        {"name": each["name"], "y": list(chain(*(values or [] for values in each["values"])))}
        for each in figure.get("kinds", [])
    ]
    return [*motions, *kinds]


def _curve(data: dict[str, object]) -> str:
    words = [str(data.get("name", data.get("type", "")))]
    for axis in ("x", "y"):
        values = numbers_of(data.get(axis))
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        places = np.arange(1, len(known) + 1) / len(known)
        size = float(np.sum(np.abs(known)))
        sums = [float(np.sum(known)), float(np.sum(known * places))]
        # What cancels is rounded to the size of what was added.
        least = 10.0 ** (np.floor(np.log10(size)) - 4) if size > 0.0 else 1.0
        shown = " ".join(f"{round(each / least) * least:.6g}" for each in sums)
        words.append(f"{axis} {len(known)} {known.min():.4g} {known.max():.4g} {shown}")
    return " ".join(words)


def numbers_of(given: object) -> np.ndarray:
    """Numbers of a figure, as it packs them or in a list; none where they are no numbers."""
    if isinstance(given, dict):
        kind = np.dtype(given["dtype"]).newbyteorder("<")
        return np.frombuffer(base64.b64decode(given["bdata"]), kind).astype(float)
    try:
        return np.array(given if isinstance(given, list) else [], dtype=float)
    except (TypeError, ValueError):
        return np.empty(0)
