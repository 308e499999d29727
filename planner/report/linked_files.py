"""Links from a page to the files that it is about: relative, so that they may move together."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote


class LinkedFile(NamedTuple):
    """A file that a page links to.

    Attributes:
        role: What it is, such as "requests".
        name: Its path from the page's folder.
        href: Where it is as seen from the page, as a browser takes it.
    """

    role: str
    name: str
    href: str


def linked_files(
    page: Path | str, files: Iterable[tuple[str, Path | str | None]]
) -> list[LinkedFile]:
    """The files of a run as its page links to them.

    Args:
        page: Where the page will stand.
        files: What each file is, and where; those that are standard input or output ("-"), or not
            there at all (None, ""), are left out, and so are those named twice.
    """
    folder = Path(page).resolve().parent
    found: dict[str, LinkedFile] = {}
    for role, file in files:
        if not file or str(file) == "-":
            continue
        name, href = _seen_from(folder, Path(file).resolve())
        found.setdefault(href, LinkedFile(role, name, href))
    return list(found.values())


def _seen_from(folder: Path, file: Path) -> tuple[str, str]:
    """The file's path from the folder, and the same as a browser takes it."""
    try:
        relative = Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return str(file), file.as_uri()
    address = quote(relative)
    return relative, f"./{address}" if ":" in relative.split("/")[0] else address
