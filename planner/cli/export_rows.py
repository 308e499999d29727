"""From requests and the choices of ``request-planner export`` to rows, and into a file of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from planner.cli.export_options import parse_zero_ticks

if TYPE_CHECKING:
    from planner.robot.resample import Between
    from planner.robot.schedule import Schedule


def rows_to_write(schedule: Schedule, choices: Mapping[str, Any]) -> tuple[Schedule, int]:
    """The rows to write, and how many requests are not among them."""
    from planner.robot.resample import never_sent, repeated, resampled

    if choices["joint_names"] is not None:
        schedule = schedule.renamed([name.strip() for name in choices["joint_names"].split(",")])
    schedule = repeated(schedule, choices["cycles"])
    rate = choices["rate_hz"]
    between: Between = choices["between"] or "hold"
    if rate is None:
        return schedule, 0
    return resampled(schedule, rate, between=between), never_sent(schedule, rate)


def check_rows(schedule: Schedule, choices: Mapping[str, Any]) -> None:
    """Refuse what the format chosen cannot hold, as far as that does not depend on the angles.

    Raises:
        InvalidInput: The message says why, or which extra is missing.
        click.UsageError: A zero tick cannot be understood.
    """
    from planner.files.exports.bag import TOPIC
    from planner.files.exports.possible import check_format

    check_format(
        choices["format"],
        schedule,
        ticks=parse_zero_ticks(choices) if choices["unit"] == "ticks" else None,
        lead=choices["lead_s"] or 0.0,
        topic=choices["topic"] or TOPIC,
    )


def rows_document(schedule: Schedule, skipped: int, choices: Mapping[str, Any]) -> dict[str, Any]:
    """What is written, for machines."""
    return {
        "format": choices["format"],
        "joints": list(schedule.names),
        "rows": len(schedule.requests),
        "period_s": schedule.period,
        "duration_s": schedule.duration,
        "requests_never_sent": skipped,
    }


def rows_summary(schedule: Schedule, skipped: int) -> str:
    """What is written, for people."""
    summary = (
        f"{len(schedule.requests)} rows of {', '.join(schedule.names)} at "
        f"{1.0 / schedule.period:.6g} Hz, {schedule.duration:.6g} s"
    )
    if skipped:
        summary += (
            f"\n{skipped} requests fall between the rows and are not among them: the joints will "
            "not move as planned; plan at this rate, by tick and hold of the model"
        )
    return summary


def write_schedule(file: str, schedule: Schedule, choices: Mapping[str, Any]) -> None:
    """Write rows in the format chosen; a folder where the format is one."""
    kind = choices["format"]
    if kind == "csv":
        from planner.files.exports.controller_csv import write_controller_csv

        ticks = parse_zero_ticks(choices) if choices["unit"] == "ticks" else None
        write_controller_csv(file, schedule, unit=choices["unit"] or "rad", ticks=ticks)
        return
    if kind == "lerobot":
        from planner.files.exports.lerobot import TASK, write_lerobot

        write_lerobot(file, schedule, task=choices["task"] or TASK)
        return
    from planner.files.exports.joint_trajectory import joint_trajectory

    message = joint_trajectory(
        schedule, lead=choices["lead_s"] or 0.0, velocities=choices["velocities"]
    )
    if kind == "yaml":
        from planner.files.exports.trajectory_yaml import write_trajectory_yaml

        write_trajectory_yaml(file, message)
    else:
        from planner.files.exports.bag import TOPIC, write_bag

        storage: Any = "mcap" if kind == "mcap" else "sqlite3"
        write_bag(file, message, storage=storage, topic=choices["topic"] or TOPIC)
