"""``request-planner export``: requests in, files for robots out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.export_options import check_options, to_robots
from planner.cli.export_rows import rows_document, rows_summary, rows_to_write, write_schedule
from planner.cli.say import deliver

if TYPE_CHECKING:
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
        request-planner export requests.csv --format yaml --lead-s 2 --joint-names lf_hip,lf_knee
    """  # noqa: D301, E501
    check_options(choices, output)
    schedule, skipped = rows_to_write(_read(requests, choices), choices)
    deliver(
        rows_document(schedule, skipped, choices),
        rows_summary(schedule, skipped),
        lambda file: write_schedule(file, schedule, choices),
        output=output,
        as_json=as_json,
    )


def _read(requests: str, choices: Mapping[str, Any]) -> Schedule:
    """The requests of the file, at the times that it or the options say."""
    from planner.exceptions import InvalidFile
    from planner.files.joint_path import read_joint_path
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
    return Schedule(given.names, given.angles, period)
