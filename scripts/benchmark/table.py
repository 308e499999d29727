"""Tables of numbers: as text, as Markdown, as JSON, and against an earlier run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Table:
    """Rows of numbers under a heading each.

    Attributes:
        title: Title of the table.
        columns: Meaning of each number, with its unit.
        note: How it was measured.
        rows: Numbers by name; nan where there is none.
        stub: Heading of the names.
    """

    title: str
    columns: tuple[str, ...]
    note: str = ""
    rows: dict[str, tuple[float, ...]] = field(default_factory=dict)
    stub: str = ""

    def add(self, name: str, *numbers: float) -> None:
        """Append a row."""
        if len(numbers) != len(self.columns):
            raise ValueError(f"row {name!r}: got {len(numbers)}, expected {len(self.columns)}")
        self.rows[name] = tuple(float(number) for number in numbers)

    def __str__(self) -> str:
        """The table in columns of equal width."""
        lines = [(self.stub, *self.columns), *self._written_rows()]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        padded = [
            "  ".join(
                [
                    name.ljust(widths[0]),
                    *(c.rjust(w) for c, w in zip(cells, widths[1:], strict=True)),
                ]
            ).rstrip()
            for name, *cells in lines
        ]
        note = [self.note] if self.note else []
        return "\n".join([self.title, *note, *padded])

    def markdown(self) -> str:
        """The table under a heading of its own."""
        head = f"| {' | '.join([self.stub, *self.columns])} |"
        rule = f"|{'---|' * (1 + len(self.columns))}"
        rows = [f"| {' | '.join(row)} |" for row in self._written_rows()]
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
        ratios = Table(f"{self.title}: new over old", self.columns, stub=self.stub)
        for name, numbers in self.rows.items():
            old = earlier.get(name, {})
            row = [
                _ratio(number, old.get(column))
                for column, number in zip(self.columns, numbers, strict=True)
            ]
            if not all(map(math.isnan, row)):
                ratios.add(name, *row)
        return ratios

    def _written_rows(self) -> list[tuple[str, ...]]:
        return [(name, *map(written, numbers)) for name, numbers in self.rows.items()]


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
