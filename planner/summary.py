"""Answers in a few lines: as text in Python and as a table in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import NamedTuple


class Summary(NamedTuple):
    """A heading, and a table with a unit beside every number or title.

    Attributes:
        head: The heading, in one line.
        columns: Titles of the columns; that of the first may be empty.
        rows: Their cells.
    """

    head: str
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()

    def text(self) -> str:
        """The table below the heading, columns aligned."""
        cells = [self.columns, *self.rows] if self.rows else []
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            for row in cells
        ]
        return "\n".join([self.head, *(line.rstrip() for line in lines)])

    def html(self) -> str:
        """The same for a notebook."""
        if not self.rows:
            return f"<p>{escape(self.head, quote=False)}</p>"
        rows = [
            "".join(f"<{tag}>{escape(cell, quote=False)}</{tag}>" for cell in row)
            for tag, row in [("th", self.columns), *(("td", row) for row in self.rows)]
        ]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<p>{escape(self.head, quote=False)}</p><table>{body}</table>"


class Summarised:
    """An answer that Python and a notebook show by its summary."""

    def _summarised(self) -> Summary:
        """The summary."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._summarised().text()

    def _repr_html_(self) -> str:
        return self._summarised().html()
