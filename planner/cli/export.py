"""``request-planner export``: requests in, files for robots out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.export_options import check_options, parse_zero_ticks, to_robots
from planner.cli.say import deliver

if TYPE_CHECKING:
    from planner.robot.resample import Between
    from planner.robot.schedule import Schedule


@click.command(short_help="Write requests for robots: ROS, LeRobot, CSV.")
@click.argument("requests")
@to_robots
@options.joints
@options.as_json
def export(*, requests: str, output: str, as_json: bool, **choices: Any) -> None:
    """Write REQUESTS, a CSV as `plan` writes it, in a format that robots take; '-' is standard input.

    \b
    csv      one row at every tick of a controller, in rad, deg or a servo's ticks
    yaml     a ROS 2 message trajectory_msgs/JointTrajectory, for `ros2 topic pub`
    bag      a ROS 2 bag (SQLite) with that message, for `ros2 bag play`; a folder
    mcap     the same with MCAP inside
    lerobot  a LeRobot dataset v3.0 with the requests as actions; a folder

    \b
    Example, ten cycles for a Dynamixel at 50 Hz, and for a trajectory controller of ROS 2:
        request-planner export requests.csv --format csv --rate-hz 50 --unit ticks --cycles 10 -o ticks.csv
        request-planner export requests.csv --format yaml --lead-s 2 --joint-names lf_1,lf_2,lf_3
    """  # noqa: D301, E501
    check_options(choices, output)
    schedule, skipped = _load(requests, choices)
    document = {
        "format": choices["format"],
        "joints": list(schedule.names),
        "rows": len(schedule.requests),
        "period_s": schedule.period,
        "duration_s": schedule.duration,
        "requests_never_sent": skipped,
    }
    summary = (
        f"{len(schedule.requests)} rows of {', '.join(schedule.names)} at "
        f"{1.0 / schedule.period:.6g} Hz, {schedule.duration:.6g} s"
    )
    if skipped:
        summary += (
            f"\n{skipped} requests fall between the rows and are not among them: the joints will "
            "not move as planned; plan at this rate, by tick and hold of the model"
        )
    deliver(
        document,
        summary,
        lambda file: _write(file, schedule, choices),
        output=output,
        as_json=as_json,
    )


def _load(requests: str, choices: dict[str, Any]) -> tuple[Schedule, int]:
    """The rows to write, and how many requests are not among them."""
    from planner.exceptions import InvalidFile
    from planner.files.joint_path import read_joint_path
    from planner.robot.resample import never_sent, repeated, resampled
    from planner.robot.schedule import Schedule, check_period

    given = read_joint_path(requests, joints=choices["joints"])
    period = choices["period_s"]
    if period is not None:
        check_period(period)
        given.check_period(period)
    elif given.times is None:
        raise InvalidFile(
            requests, "no column t_s, so no time between requests; add it, or --period-s"
        )
    else:
        period = float(given.times[-1] - given.times[0]) / (len(given.times) - 1)
    schedule = Schedule(given.names, given.angles, period)
    if choices["joint_names"] is not None:
        schedule = schedule.renamed([name.strip() for name in choices["joint_names"].split(",")])
    schedule = repeated(schedule, choices["cycles"])
    rate = choices["rate_hz"]
    between: Between = choices["between"] or "hold"
    if rate is None:
        return schedule, 0
    rows = resampled(schedule, rate, between=between)
    return rows, never_sent(schedule, rate)


def _write(file: str, schedule: Schedule, choices: dict[str, Any]) -> None:
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
