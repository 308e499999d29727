"""A log written row by row, so that no measured row is lost when the process ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from planner.files.clock import TIME
from planner.files.staging import cannot_write
from planner.trajectory import Array

UNFINISHED = ".part"
"""Ending of a log that is being measured, or whose measurement was cut short."""


class GrowingLog:
    """A CSV of requested and actual angles that has every row as soon as it was measured.

    It is written as ``NAME.part``, and gets its name when it is complete: other outputs appear
    whole or not at all, but no measured row may be lost.
    """

    def __init__(
        self,
        path: Path | str,
        names: Sequence[str],
        *,
        kinds: Sequence[str] = ("requested", "actual"),
    ) -> None:
        """Begin a log of these joints, with a column for each kind of angle.

        Raises:
            InvalidFile: It cannot be written.
        """
        self.path, self.rows = Path(path), 0
        self.unfinished = self.path.with_name(self.path.name + UNFINISHED)
        columns = ["_".join(filter(None, (name, kind, "deg"))) for name in names for kind in kinds]
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file: TextIO = self.unfinished.open("w", encoding="utf-8", newline="\n")
            self._write(",".join([TIME, *columns]))
        except OSError as error:
            raise cannot_write(self.unfinished, error) from error

    def keep(self, time: float, *kinds: Array) -> None:
        """Write a row: a time [s], and of each kind the angles [rad], NaN where there is none.

        Raises:
            InvalidFile: The disk is full.
        """
        angles = np.degrees(np.column_stack(kinds)).round(6) + 0.0  # no negative zero
        cells = ("" if math.isnan(each) else f"{each:.6f}" for each in angles.ravel().tolist())
        try:
            self._write(",".join([f"{time:.6f}", *cells]))
        except OSError as error:
            raise cannot_write(self.unfinished, error) from error
        self.rows += 1

    def finish(self) -> None:
        """Give the log its name."""
        self._file.close()
        self.unfinished.replace(self.path)

    def __enter__(self) -> GrowingLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if not self.rows and self.unfinished.exists():
            self.unfinished.unlink()

    def _write(self, line: str) -> None:
        self._file.write(line + "\n")
        self._file.flush()
