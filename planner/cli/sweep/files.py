"""Outputs of a sweep: a table of its points, a page, a summary."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.cli.declared import flat
from planner.cli.desired import leg_title
from planner.cli.sweep.space import origin
from planner.files.results import made_from
from planner.files.staging import MANIFEST, list_files
from planner.files.table import csv_text
from planner.files.text import to_json, write_text
from planner.report.page import linked_files, versions
from planner.report.sweep import missed, points_table, sweep_page, verdict

if TYPE_CHECKING:
    from planner.cli.sweep.space import Space
    from planner.report.sweep import Outcome, Swept

MOST_SHOWN = 10
"""Reasons that are printed, of points without a plan."""


def columns(swept: Swept) -> list[str]:
    """The columns of the table of all points."""
    speed = "speed_cm_s" if swept.speed_unit == "cm/s" else "speed_factor"
    unit = swept.error_unit
    return [
        "point", *swept.names, speed, f"error_{unit}", f"largest_error_{unit}",
        f"direct_error_{unit}", "too_fast_percent", "slowest_joint", "unreachable_samples",
        "on_front", "reason",
    ]  # fmt: skip


def rows(swept: Swept) -> list[list[Any]]:
    """A row for every point; values that a point without a plan lacks are None."""
    front = {each.point for each in swept.front}
    table = []
    for number, each in enumerate(swept.outcomes, 1):
        values = [each.speed, each.error, each.largest, each.direct, 100.0 * each.too_fast]
        table.append(
            [
                number, *each.point, *(value if math.isfinite(value) else None for value in values),
                each.slowest or None, each.unreachable, each.point in front, each.reason or None,
            ]
        )  # fmt: skip
    return table


def write_sweep(folder: Path, space: Space, swept: Swept) -> dict[str, Any]:
    """Write the table as CSV and, with the extra parquet, as Parquet, and the page.

    Returns:
        ``results.json``.
    """
    names, table = columns(swept), rows(swept)
    write_text(folder / "points.csv", csv_text(names, table))
    _write_parquet(folder / "points.parquet", names, table)
    page, run = folder / "report.html", space.settings
    files: list[tuple[str, Path | str]] = [("sweep", space.file.path)]
    files += [(Path(name).suffix[1:], folder / name) for name in list_files(folder)]
    origins = [
        ("path", run.path.file or "a half ellipse"),
        ("leg", leg_title(run.leg) or "none"),
        ("model", run.model.file),
        ("plan", run.plan.method),
        ("search", run.sweep.method),
    ]
    html = sweep_page(swept, origins=origins, files=linked_files(page, files))
    write_text(page, html)
    document = {
        "made_by": "request-planner sweep",
        "made_from": "",
        "verdict": verdict(swept),
        "missed": missed(swept) or None,
        "settings": flat(run),
        "points": [dict(zip(names, row, strict=True)) for row in table],
        "front": [swept.number(each) for each in swept.front],
        "best": None if swept.best is None else swept.number(swept.best),
        "commands": {f"{swept.number(each)}": swept.command(each) for each in swept.front},
        "versions": versions(),
        "files": list_files(folder),
    }
    document |= made_from(origin(space), document)
    write_text(folder / MANIFEST, to_json(document))
    return document


def _write_parquet(file: Path, names: list[str], table: list[list[Any]]) -> None:
    """Write the table as Parquet, if pyarrow is installed."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return
    kinds = {"point": pa.int64(), "unreachable_samples": pa.int64(), "on_front": pa.bool_()}
    kinds |= dict.fromkeys(("slowest_joint", "reason"), pa.string())
    arrays = {
        name: pa.array([row[j] for row in table], kinds.get(name, pa.float64()))
        for j, name in enumerate(names)
    }
    parquet.write_table(pa.table(arrays), file)


def summary(swept: Swept) -> str:
    """The sweep for people: the verdict, and the front."""
    planned = sum(each.planned for each in swept.outcomes)
    lines = [verdict(swept), f"{planned} of {len(swept.outcomes)} points have a plan; the front:"]
    if swept.front:
        lines.append(points_table(swept, swept.front).text())
        lines.append(f"again: {swept.command(swept.best or swept.front[-1])}")
    reasons: dict[str, list[Outcome]] = {}
    for each in swept.outcomes:
        if not each.planned:
            reasons.setdefault(each.reason, []).append(each)
    for reason, outcomes in list(reasons.items())[:MOST_SHOWN]:
        number = swept.number(outcomes[0])
        more = f" and {len(outcomes) - 1} more" if len(outcomes) > 1 else ""
        lines.append(f"point {number}{more}: {reason}")
    if len(reasons) > MOST_SHOWN:
        lines.append(f"{len(reasons) - MOST_SHOWN} more reasons in points.csv")
    return "\n".join(lines)
