"""The blocks of a page that can be run, and what the page says that they print.

On every page, and in the README, ``python`` and ``sh`` are run, and so are indented lines that call
the program; ``text`` right after one of them is what it prints, or a part of it. ``console`` and
the rest are for the reader alone.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

BLOCK = re.compile(
    r"^```(\S*)\n(.*?)^```$|^((?:^    request-planner [^\n]*\n)+)", re.DOTALL | re.MULTILINE
)


class Block(NamedTuple):
    """A block that is run: its line on the page, its language, itself, and what it prints."""

    line: int
    language: str
    code: str
    printed: str


def blocks(page):
    """The blocks of a page that are run, in order."""
    text = page.read_text(encoding="utf-8")
    found = [
        (text.count("\n", 0, match.start()) + 1, match[1] or "sh", match[2] or match[3])
        for match in BLOCK.finditer(text)
        if match[1] or match[3]
    ]
    followers = [*found, (0, "", "")][1:]
    return [
        Block(line, language, code, after[2] if after[1] == "text" else "")
        for (line, language, code), after in zip(found, followers, strict=True)
        if language in ("python", "sh")
    ]
