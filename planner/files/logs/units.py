"""Units of logged angles and times: from a name or from the user, never guessed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from planner.exceptions import InvalidInput

ANGLE_NAMES: Mapping[str, str] = {
    "rad": "rad",
    "radian": "rad",
    "radians": "rad",
    "deg": "deg",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "tick": "ticks",
    "ticks": "ticks",
    "us": "us",
    "µs": "us",
    "usec": "us",
    "count": "counts",
    "counts": "counts",
    "adc": "counts",
    "turn": "turns",
    "turns": "turns",
    "range": "range",
    "percent": "percent",
    "%": "percent",
    "range_0_100": "percent",
    "range_m100_100": "range_m100_100",
}
"""Names of the units of an angle, and the unit of each."""

ANGLE_UNITS = tuple(dict.fromkeys(ANGLE_NAMES.values()))
"""The units of an angle."""

PULSE_ZERO, PULSES_PER_TURN = 1500, 4000
"""Pulse of a hobby servo at angle 0, and pulses of a full turn [us]: most turn by 180 degrees over
2000 us."""

COUNTS = "counts"
"""Unit of a sensor of unknown scale, such as a potentiometer at a converter."""

SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time, in seconds."""

TIME_NAMES: Mapping[str, str] = {
    **{unit: unit for unit in SECONDS},
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "millis": "ms",
    "usec": "us",
    "µs": "us",
    "nsec": "ns",
    "nanosec": "ns",
}
"""Names of the units of time, and the unit of each."""

_BRACKETED = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()\s]+)\s*[\])]$")


class Scale(NamedTuple):
    """How a logged number becomes an angle: ``factor * number + shift``.

    Attributes:
        name: The unit of the logged number.
        factor: Size of the logged unit, in ``unit``.
        shift: Its zero, in ``unit``.
        unit: "rad", or "1" for a share of the joint's range.
    """

    name: str
    factor: float
    shift: float
    unit: str


def scale(name: str, ticks_per_turn: float | None) -> Scale:
    """The scale of an angle's unit.

    Args:
        name: One of :data:`ANGLE_UNITS`.
        ticks_per_turn: Steps of the sensor in one turn; needed for ticks. Of hobby servos the
            microseconds of a turn, by default 4000.

    Returns:
        The scale; NaN for counts, whose scale is fitted to the log.

    Raises:
        InvalidInput: Ticks without their number in a turn.
    """
    if name == "ticks":
        if ticks_per_turn is None:
            raise InvalidInput(
                "angles in ticks without the ticks of a turn; give --ticks-per-turn, such as 4096 "
                "for Dynamixel X and Feetech STS servos"
            )
        return Scale(name, 2.0 * math.pi / ticks_per_turn, 0.0, "rad")
    pulse = 2.0 * math.pi / (ticks_per_turn or PULSES_PER_TURN)
    return {
        "us": Scale("us", pulse, -PULSE_ZERO * pulse, "rad"),
        COUNTS: Scale(COUNTS, math.nan, math.nan, "rad"),
        "rad": Scale("rad", 1.0, 0.0, "rad"),
        "deg": Scale("deg", math.pi / 180.0, 0.0, "rad"),
        "turns": Scale("turns", 2.0 * math.pi, 0.0, "rad"),
        "range": Scale("range", 1.0, 0.0, "1"),
        "percent": Scale("percent", 1e-2, 0.0, "1"),
        "range_m100_100": Scale("range_m100_100", 5e-3, 0.5, "1"),
    }[name]


def split_name(name: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    """A column's name without its unit, and the unit where the name ends in one.

    ``knee_deg``, ``knee [deg]`` and ``knee (deg)`` all are ``knee`` in ``deg``.
    """
    match = _BRACKETED.match(name)
    if match:
        stem, word = match.groups()
    else:
        stem, _, word = name.rpartition("_")
    unit = units.get(word.lower())
    return (stem, unit) if stem and unit is not None else (name, None)
