"""What a reader of a page sees: its text."""

from __future__ import annotations

import re
from html.parser import HTMLParser

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
