"""The blocks of a page that can be run, and what the page says that they print.

On every page, and in the README, ``python`` and ``sh`` are run, and so are indented lines that call
the program. The ``text`` blocks after one of them are all that it prints, but for what a line
``...`` stands for, and ``--rewrite-snapshots`` writes what it prints today into them. ``console``
and the rest are for the reader alone.
"""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

BLOCK = re.compile(
    r"^```(\S*)\n(.*?)^```$|^((?:^    request-planner [^\n]*\n)+)", re.DOTALL | re.MULTILINE
)


class Printed(NamedTuple):
    """What a page says that a block prints, and its first and last character on the page."""

    text: str
    place: tuple[int, int]


class Block(NamedTuple):
    """A block that is run: its line on the page, its language, itself, and what it prints."""

    line: int
    language: str
    code: str
    printed: list[Printed]


def blocks(page):
    """The blocks of a page that are run, in order."""
    text = page.read_text(encoding="utf-8")
    found, run = [], None
    for match in BLOCK.finditer(text):
        language = match[1] if match[3] is None else "sh"
        if language in ("python", "sh"):
            line = text.count("\n", 0, match.start()) + 1
            run = Block(line, language, match[2] or match[3], [])
            found.append(run)
        elif language == "text" and run is not None:
            run.printed.append(Printed(match[2], match.span(2)))
        elif language:
            run = None
    return found


def prose(page):
    """A page without its blocks, and without code in its lines."""
    text = re.sub(r"^(```|~~~).*?^\1$", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    return re.sub(r"^    .*$|`[^`\n]*`", "", text, flags=re.M)
