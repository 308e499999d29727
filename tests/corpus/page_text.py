"""What a reader of a page sees: its text, and the numbers of its plots."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from typing import Any

import numpy as np

SKIPPED = ("script", "style", "svg")
"""Elements without text for the reader; figures speak by their data."""

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


def plots_of(page: str) -> str:
    """The curves of a page, a line for each array of numbers: figure, curve, axis, numbers."""
    found = re.search(r'<script type="application/json" id="live-figures">(.*?)</script>', page)
    figures = json.loads(found[1]) if found else {}
    lines = []
    for name, figure in figures.items():
        curves = figure.get("data", figure.get("motions", [figure]))
        for number, curve in enumerate(curves):
            called = curve.get("name", number)
            for place, values in _arrays(curve):
                shown = " ".join(f"{value:.9g}" for value in values)
                lines.append(f"{name} | {called} | {place}: {shown}")
    return "\n".join(lines)


def _arrays(value: Any, place: str = "") -> Iterator[tuple[str, list[float]]]:
    """Every array of numbers in JSON, nested ones as one, with the keys that lead there."""
    if isinstance(value, dict) and "bdata" in value:
        array = np.frombuffer(base64.b64decode(value["bdata"]), dtype=value["dtype"])
        yield place, array.astype(float).tolist()
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _arrays(item, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list):
        try:
            array = np.array(value, dtype=float)  # None becomes NaN
        except (TypeError, ValueError):
            return
        if array.size > 2:
            yield place, array.ravel().tolist()
