"""The option ``--limits-deg``: the range of the requests, for every joint or joint by joint."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import click

Limits = Mapping[str, tuple[float, float]]

option = click.option(
    "--limits-deg",
    "--limits",
    "limits",
    multiple=True,
    metavar="[JOINT=]LOW:HIGH",
    help="Range of the requests [deg], of all joints or one; by default that of the leg.",
)


def parse_limits(given: Sequence[str], joints: Sequence[str], from_leg: Limits) -> Limits:
    """Limits by joint [rad]; those of the leg, overruled by what the option says.

    Raises:
        click.UsageError: An entry cannot be understood, or names a joint that is not planned.
    """
    limits = dict(from_leg)
    for entry in sorted(given, key=lambda entry: "=" in entry):  # single joints have the last word
        match = re.fullmatch(r"(?:(.+)=)?([^:=]+):([^:=]+)", entry)
        low, high = (finite(match[2]), finite(match[3])) if match else (math.nan, math.nan)
        if match is None or not low < high:
            raise click.UsageError(
                f"--limits-deg: got '{entry}', expected LOW:HIGH or JOINT=LOW:HIGH in degrees with "
                "LOW below HIGH, such as knee=-27:147."
            )
        if match[1] is not None and match[1] not in joints:
            raise click.UsageError(
                f"--limits-deg: no joint '{match[1]}' in the path; joints: {', '.join(joints)}."
            )
        for joint in joints if match[1] is None else [match[1]]:
            limits[joint] = (math.radians(low), math.radians(high))
    return {joint: limits[joint] for joint in joints if joint in limits}


def finite(text: str) -> float:
    """The number that a text stands for; NaN where it stands for none, or not for a finite one."""
    try:
        angle = float(text)
    except ValueError:
        return math.nan
    return angle if math.isfinite(angle) else math.nan
