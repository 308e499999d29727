"""The options of ``request-planner export``, and which of them go together."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from planner.files.exports.controller_csv import Ticks

Command = Callable[..., Any]

ROS = ("yaml", "bag", "mcap")
"""Formats that hold a JointTrajectory."""

FOLDERS = ("bag", "mcap", "lerobot")
"""Formats that are a folder, which standard output cannot be."""

ONLY = {
    "unit": ("csv",),
    "ticks_per_turn": ("csv",),
    "zero_tick": ("csv",),
    "lead_s": ROS,
    "velocities": ROS,
    "topic": ("bag", "mcap"),
    "task": ("lerobot",),
}
"""Formats that an option has an effect on; it is refused with the others."""


OPTIONS = (
    click.option(
        "--format",
        type=click.Choice(["csv", *ROS, "lerobot"]),
        required=True,
        help="What to write; see above.",
    ),
    click.option(
        "-o",
        "--output",
        default="-",
        metavar="OUT",
        help="The file, or folder, to write; '-' is standard output.  [default: -]",
    ),
    click.option(
        "--cycles",
        type=int,
        default=1,
        show_default=True,
        metavar="N",
        help="How often to go through the requests.",
    ),
    click.option(
        "--rate-hz",
        type=float,
        metavar="HZ",
        help="Rows per second; by default one per request.",
    ),
    click.option(
        "--between",
        type=click.Choice(["hold", "linear"]),
        help="With --rate-hz: hold each request until the next one, or go there in a "
        "straight line.  [default: hold]",
    ),
    click.option(
        "--period-s",
        type=float,
        metavar="S",
        help="Time between requests, where the file has no column t_s.",
    ),
    click.option(
        "--joint-names",
        metavar="A,B,C",
        help="The joints' names on the robot, in the order of the columns.",
    ),
    click.option(
        "--unit",
        type=click.Choice(["rad", "deg", "ticks"]),
        help="csv: unit of the columns.  [default: rad]",
    ),
    click.option("--ticks-per-turn", type=int, metavar="N", help="csv: ticks.  [default: 4096]"),
    click.option(
        "--zero-tick",
        multiple=True,
        metavar="[JOINT=]N",
        help="csv: tick at angle 0, of all joints or one.  [default: 2048]",
    ),
    click.option(
        "--lead-s",
        type=float,
        metavar="S",
        help="yaml, bag, mcap: time of the first point, in which the controller leads the "
        "joints there.  [default: 0]",
    ),
    click.option(
        "--velocities",
        is_flag=True,
        help="yaml, bag, mcap: points carry velocities, and become splines.",
    ),
    click.option(
        "--topic",
        help="bag, mcap.  [default: /joint_trajectory_controller/joint_trajectory]",
    ),
    click.option("--task", help="lerobot: what the episode shows, in words."),
)
"""What is written and how, in the order of the help."""


def to_robots(command: Command) -> Command:
    """Add :data:`OPTIONS`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def check_options(choices: Mapping[str, Any], output: str) -> None:
    """Refuse options that have no effect on the format, and a folder on standard output.

    Raises:
        click.UsageError: The message says which.
    """
    kind = choices["format"]
    for name, formats in ONLY.items():
        if choices[name] not in (None, (), False) and kind not in formats:
            option = name.replace("_", "-")
            raise click.UsageError(
                f"--{option} has no effect on --format {kind}, only on {', '.join(formats)}."
            )
    for name in ("ticks_per_turn", "zero_tick"):
        if choices[name] not in (None, ()) and choices["unit"] != "ticks":
            raise click.UsageError(f"--{name.replace('_', '-')} needs --unit ticks.")
    if choices["between"] is not None and choices["rate_hz"] is None:
        raise click.UsageError("--between needs --rate-hz: without it there is a row per request.")
    if kind in FOLDERS and output == "-":
        raise click.UsageError(f"--format {kind} is a folder: name it with --output.")


def parse_zero_ticks(choices: Mapping[str, Any]) -> Ticks:
    """How the servos count, from ``--ticks-per-turn`` and ``--zero-tick``.

    Raises:
        click.UsageError: An entry cannot be understood.
        InvalidInput: A servo that cannot be.
    """
    from planner.files.exports.controller_csv import Ticks

    given: dict[str, int] = {}
    for entry in choices["zero_tick"]:
        match = re.fullmatch(r"(?:(.+)=)?(-?\d{1,9})", entry, flags=re.ASCII)
        if match is None:
            raise click.UsageError(
                f"--zero-tick: got '{entry}', expected N or JOINT=N, such as knee=2048."
            )
        given[match[1] or ""] = int(match[2])
    settings: dict[str, Any] = {}
    if "" in given:
        settings["zero"] = given.pop("")
    if choices["ticks_per_turn"] is not None:
        settings["per_turn"] = choices["ticks_per_turn"]
    return Ticks(**settings, zeros=given)
