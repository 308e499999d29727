"""Tables for a terminal: plain text, first column left, numbers right."""

from __future__ import annotations

from collections.abc import Sequence

NOTHING = "–"
"""What stands in a cell that has no value."""


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns as wide as their widest cell, two blanks apart, under a header line.

    Args:
        header: The columns' names.
        rows: Their cells, as many per row as names.
    """
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[j]) for row in cells) for j in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(width) if j == 0 else cell.rjust(width)
            for j, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    return "\n".join(lines)


def number(value: float | None, digits: int = 2) -> str:
    """A number with fixed decimals; a dash for none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def percent(share: float) -> str:
    """A share as a percentage with two decimals."""
    return f"{100.0 * share:.2f} %"
