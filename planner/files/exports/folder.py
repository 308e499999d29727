"""A folder that an export fills, with the manifest by which a later export may replace it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planner.files.output_folder import MANIFEST, list_files, output_folder
from planner.files.text import write_text


@contextmanager
def export_folder(path: Path | str, *, export: str) -> Iterator[Path]:
    """Hand out an empty folder and put it in place once it is filled; see :func:`output_folder`.

    Args:
        path: The folder.
        export: Name of the format, for the manifest.

    Raises:
        InvalidFile: ``path`` is a file, holds something else, or cannot be written.
    """
    with output_folder(path) as folder:
        yield folder
        manifest = {"export": export, "files": list_files(folder)}
        write_text(folder / MANIFEST, json.dumps(manifest, indent=2) + "\n")
