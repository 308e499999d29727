"""Tables of numbers: as text, as Markdown, as JSON, and against an earlier run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any


class Table:
    """Rows of numbers under a heading each.

    Args:
        title: Title of the table.
        head: Meaning of the names, then of each number with its unit, between vertical bars.
        note: How it was measured.
    """

    def __init__(self, title: str, head: str, note: str = "") -> None:
        self.title, self.head, self.note = title, head, note
        self.columns = head.split(" | ")[1:]
        self.rows: dict[str, Sequence[float]] = {}

    def add(self, name: str, *numbers: float) -> None:
        """Append a row; nan where there is no number."""
        self.rows[name] = [float(n) for n, _ in zip(numbers, self.columns, strict=True)]

    def __str__(self) -> str:
        """The table in columns of equal width."""
        widths = [max(map(len, column)) for column in zip(*self._written(), strict=True)]
        lines = [
            "  ".join(
                cell.rjust(width) if k else cell.ljust(width)
                for k, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in self._written()
        ]
        return "\n".join([self.title, *filter(None, [self.note]), *lines])

    def markdown(self) -> str:
        """The table under a heading of its own."""
        head, *rows = (f"| {' | '.join(row)} |" for row in self._written())
        rule = f"|{'---|' * (1 + len(self.columns))}"
        note = [self.note, ""] if self.note else []
        return "\n".join([f"## {self.title}", "", *note, head, rule, *rows, ""])

    def as_json(self) -> dict[str, Any]:
        """The numbers by row and column."""
        return {
            name: {
                column: number if math.isfinite(number) else None
                for column, number in zip(self.columns, numbers, strict=True)
            }
            for name, numbers in self.rows.items()
        }

    def against(self, earlier: dict[str, Any]) -> Table:
        """New over old, wherever both have a number."""
        ratios = Table(f"{self.title}: new over old", self.head)
        for name, numbers in self.rows.items():
            old = map(earlier.get(name, {}).get, self.columns)
            row = [*map(_ratio, numbers, old)]
            if not all(map(math.isnan, row)):
                ratios.add(name, *row)
        return ratios

    def _written(self) -> list[list[str]]:
        rows = ([name, *map(written, numbers)] for name, numbers in self.rows.items())
        return [self.head.split(" | "), *rows]


def written(number: float) -> str:
    """The number with about four digits, and no more than it deserves."""
    if math.isnan(number):
        return "–"
    if math.isinf(number) or number == int(number):
        return f"{number:.0f}"
    size = abs(number)
    if size < 1e-3:
        return f"{number:.1e}"
    return f"{number:.{max(0, min(4, 3 - math.floor(math.log10(size))))}f}"


def _ratio(new: float, old: float | None) -> float:
    if old is None or not math.isfinite(new):
        return math.nan
    return new / old if old else (1.0 if new == old else math.nan)
