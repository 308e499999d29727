"""From requests and the settings of an export to rows, and into a file for robots."""

from __future__ import annotations

from typing import Any, Literal

from planner.cli.faults import BadSetting, Key
from planner.cli.settings import Export
from planner.files.columns import PULSE_ZERO, PULSES_PER_TURN
from planner.files.exports import (
    TOPIC,
    Ticks,
    check_format,
    joint_trajectory,
    write_bag,
    write_controller_csv,
    write_trajectory_yaml,
)
from planner.files.lerobot_export import TASK, write_lerobot
from planner.robot.schedule import Schedule, never_sent, repeated, resampled

FOLDERS = ("bag", "mcap", "lerobot")
"""Formats that are a folder, which standard output cannot be."""

COUNTED = {"ticks": (2048, 4096), "us": (PULSE_ZERO, PULSES_PER_TURN)}
"""Units in which servos count: the count at angle 0, and counts of a turn."""


def check_export(export: Export) -> None:
    """Refuse settings that have no effect on the format.

    Raises:
        BadSetting: The message says which.
    """
    chosen = Key("export.format", export.format)
    for name, formats in export.without_effect(export.format).items():
        parts = (Key(f"export.{name}"), " has no effect on ", chosen)
        raise BadSetting(*parts, f", only on {', '.join(formats)}")
    for name in ("ticks_per_turn", "zero_tick", "zero_ticks", "reverse"):
        if getattr(export, name) not in (None, {}) and export.unit not in COUNTED:
            raise BadSetting(Key(f"export.{name}"), " needs ", Key("export.unit", "ticks"))
    if export.between is not None and export.rate_hz is None:
        rate = Key("export.rate_hz")
        raise BadSetting(
            Key("export.between"), " needs ", rate, ": without it there is a row per request"
        )


def rows_of(export: Export, schedule: Schedule) -> tuple[Schedule, int]:
    """The rows to write, and the number of requests that are not among them."""
    if export.joint_names is not None:
        schedule = schedule.renamed(export.joint_names)
    schedule = repeated(schedule, export.cycles)
    if export.rate_hz is None:
        return schedule, 0
    rows = resampled(schedule, export.rate_hz, between=export.between or "hold")
    return rows, never_sent(schedule, export.rate_hz)


def check_rows(export: Export, rows: Schedule) -> None:
    """Refuse rows that the format cannot hold, as far as that does not depend on the angles.

    Raises:
        InvalidInput: The message says why, or which extra is missing.
    """
    check_format(
        export.format,
        rows,
        ticks=_ticks(export),
        lead=export.lead_s or 0.0,
        topic=export.topic or TOPIC,
    )


def rows_document(export: Export, rows: Schedule, skipped: int) -> dict[str, Any]:
    """The written rows, for machines."""
    return {
        "format": export.format,
        "joints": list(rows.names),
        "rows": len(rows.requests),
        "period_s": rows.period,
        "duration_s": rows.duration,
        "requests_never_sent": skipped,
    }


def rows_summary(rows: Schedule, skipped: int) -> str:
    """The written rows, for people."""
    summary = (
        f"{len(rows.requests)} rows of {', '.join(rows.names)} at "
        f"{1.0 / rows.period:.6g} Hz, {rows.duration:.6g} s"
    )
    if skipped:
        summary += (
            f"\n{skipped} requests fall between the rows and are not among them: the joints will "
            "not move as planned; plan at this rate, with --rate-hz"
        )
    return summary


def write_rows(file: str, export: Export, rows: Schedule) -> None:
    """Write rows in the chosen format; a folder where the format is one."""
    if export.format == "csv":
        write_controller_csv(file, rows, unit=export.unit or "rad", ticks=_ticks(export))
    elif export.format == "lerobot":
        write_lerobot(file, rows, task=export.task or TASK)
    else:
        velocities = bool(export.velocities)
        message = joint_trajectory(rows, lead=export.lead_s or 0.0, velocities=velocities)
        if export.format == "yaml":
            write_trajectory_yaml(file, message)
        else:
            storage: Literal["mcap", "sqlite3"] = "mcap" if export.format == "mcap" else "sqlite3"
            write_bag(file, message, storage=storage, topic=export.topic or TOPIC)


def _ticks(export: Export) -> Ticks | None:
    """Ticks of the servos; None if the rows are not in ticks."""
    if export.unit not in COUNTED:
        return None
    zero, per_turn = COUNTED[export.unit]
    return Ticks(
        zero=zero if export.zero_tick is None else export.zero_tick,
        per_turn=export.ticks_per_turn or per_turn,
        zeros=export.zero_ticks or {},
        reversed=export.reverse or (),
        unit=export.unit,
    )
