"""What the command line says of options, said of the keys of a run file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from planner.files.schema import Settings

KEYS = {
    "--leg": "leg.name",
    "--urdf": "leg.urdf",
    "--base": "leg.base",
    "--foot": "leg.foot",
    "--lock": "leg.lock",
    "--near": "leg.near",
    "--unreachable nearest": "leg.unreachable = 'nearest'",
    "--unreachable": "leg.unreachable",
    "--model": "model.file",
    "--report": "output.report",
    "--joint": "path.joints",
    "--method": "plan.method",
    "--no-cyclic": "plan.cyclic = false",
    "--norm": "plan.norm",
    "--solver": "plan.solver",
    "--weights": "plan.weights",
    "--segments": "plan.segments",
    "--rule": "plan.rule",
    "--limits-deg": "limits.deg",
    "--start-deg": "start.deg",
    "--tolerance-deg": "tolerance.deg",
    "--tolerance-cm": "tolerance.cm",
    "unreachable='nearest'": "leg.unreachable = 'nearest'",
    "cyclic=False": "plan.cyclic = false",
}
"""Keys by the options, and by the arguments of the library, that messages speak of."""

EXPORT_KEYS = {
    "--joint-names": "joint_names",
    "--rate-hz": "rate_hz",
    "--ticks-per-turn": "ticks_per_turn",
    "--zero-tick": "zero_tick",
    "--lead-s": "lead_s",
    "--output": "file",
}
"""The same inside [[export]], but for options that are spelt as their keys."""


def in_keys(message: str) -> str:
    """A message with keys where it has options."""
    for option, key in KEYS.items():
        message = re.sub(rf"{re.escape(option)}(?![\w-])", key, message)
    return message


def in_export_keys(message: str) -> str:
    """The same inside [[export]]."""
    for option, key in EXPORT_KEYS.items():
        message = message.replace(option, key)
    return re.sub(r"--([a-z]+)", r"\1", message)


@contextmanager
def speaking_of_keys(settings: Settings) -> Iterator[None]:
    """Turn what is said of options inside the block into what is to be said of keys.

    Raises:
        InvalidFile: Options contradict each other or do not suffice.
    """
    from kinematics.exceptions import KinematicsError
    from planner.exceptions import InvalidFile, PlannerError

    try:
        yield
    except click.UsageError as error:
        message = in_keys(error.message).rstrip(".")
        raise InvalidFile(settings.file.path, message, line=_line(settings, message)) from error
    except click.ClickException as error:
        raise click.ClickException(in_keys(error.message)) from error
    except (PlannerError, KinematicsError) as error:
        error.args = (in_keys(str(error)),)
        raise


def _line(settings: Settings, message: str) -> int | None:
    """The line of the first key that a message speaks of and the file sets."""
    spoken = re.findall(r"\b[a-z_]+\.[a-z_]+\b", message)
    lines = (settings.file.line_of(name.split(".")) for name in spoken)
    return next((line for line in lines if line is not None), None)
