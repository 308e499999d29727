"""Runs kept as JSON, and written down as Markdown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark.table import Table

HEADING = "# Benchmark"

OPENING = """Written by `scripts/bench --markdown docs/benchmark.md`. Times are wall-clock, after a
warm-up and on one thread; compare their ratios, since machines differ. Every error is that of the
exact model."""


def as_json(circumstances: dict[str, str], tables: Sequence[Table]) -> dict[str, Any]:
    """Everything about a run."""
    return {
        "circumstances": circumstances,
        "tables": {table.title: table.as_json() for table in tables},
    }


def save(path: Path, run: dict[str, Any]) -> None:
    """Keep a run."""
    path.write_text(json.dumps(run, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def load(path: Path) -> dict[str, Any]:
    """A run that was kept.

    Raises:
        ValueError: The file is none.
    """
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not a run kept by --save: {error}") from error
    if not isinstance(run, dict) or not isinstance(run.get("tables"), dict):
        raise ValueError(f"{path}: not a run kept by --save: it holds no tables")
    return run


def compared(tables: Sequence[Table], earlier: dict[str, Any]) -> list[Table]:
    """New over old for every table that both runs have."""
    return [
        table.against(earlier["tables"][table.title])
        for table in tables
        if table.title in earlier["tables"]
    ]


def markdown(circumstances: dict[str, str], tables: Sequence[Table]) -> str:
    """A page with every table."""
    where = ", ".join(f"{name} {value}" for name, value in circumstances.items())
    return "\n".join(
        [HEADING, "", OPENING, "", f"Measured: {where}.", "", *(t.markdown() for t in tables)]
    )
