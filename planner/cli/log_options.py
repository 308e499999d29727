"""The options with which a user says what a log leaves open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from planner.files.logs.options import LogOptions

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = {
    "joint": click.option(
        "--joint", metavar="NAME", help="The joint to read where a log has several, or 'all'."
    ),
    "time": click.option(
        "--time", metavar="COLUMN", help="CSV: the column of times; clock:ms says its unit."
    ),
    "requested": click.option(
        "--requested", metavar="COLUMN", help="CSV: the column of requested angles."
    ),
    "actual": click.option("--actual", metavar="COLUMN", help="CSV: the column of actual angles."),
    "torque": click.option(
        "--torque", metavar="COLUMN", help="CSV: the column that is 1 while the torque is on."
    ),
    "unit": click.option(
        "--unit",
        metavar="UNIT",
        help="Unit of the angles where the log does not say: rad, deg, ticks, turns, range (0..1), "
        "percent or range_m100_100; 'rad,Jaw=range' where joints differ.",
    ),
    "ticks_per_turn": click.option(
        "--ticks-per-turn",
        type=float,
        metavar="N",
        help="Ticks of one turn, such as 4096, for angles in ticks.",
    ),
    "topic": click.option("--topic", metavar="TOPIC", help="Bags: the topic of actual angles."),
    "command_topic": click.option(
        "--command-topic", metavar="TOPIC", help="Bags: the topic of requested angles."
    ),
    "episodes": click.option(
        "--episodes", metavar="LIST", help="LeRobot: the episodes to read, such as 0-3,7."
    ),
}


def log_options(command: Command) -> Command:
    """Give a command the options that :func:`to_log_options` takes."""
    for option in reversed(_OPTIONS.values()):
        command = option(command)
    return command


def to_log_options(choices: Mapping[str, Any]) -> LogOptions:
    """What a command's options say about its logs; options of other kinds are left alone.

    Raises:
        InvalidInput: An option holds what no log can be read by.
    """
    from planner.files.logs.options import LogOptions

    return LogOptions(**{name: choices[name] for name in _OPTIONS})
