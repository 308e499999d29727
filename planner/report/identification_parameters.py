"""The parameters of an identification: unit, interval, and how well each is known."""

from __future__ import annotations

import math
from typing import NamedTuple

from planner.identification.result import Identification, Interval
from planner.report.identification_numbers import between, figure, percent_of, two_figures

NAMES = {
    "v_max": "top speed",
    "theta_0": "error that calls for top speed",
    "gain": "speed per error below that",
    "lag": "lag",
    "acceleration_time": "acceleration time",
    "offset": "static sag",
}
"""What the parameters are called in words, in the order of tables."""

ROUGH = 0.2
"""Beyond this part of the estimate the half width of an interval is called rough; the lag is held
against itself and the acceleration time, the static sag against theta_0."""

HARDLY = 10.0
"""Beyond this many times the estimate its half width says nothing any more."""


class Units(NamedTuple):
    """How what is in radians inside is told outside.

    Attributes:
        factor: What one radian is.
        angle: Its unit.
        speed: Unit of speeds.
        si: Whether it is worth telling in SI too: not for shares of a range.
    """

    factor: float
    angle: str
    speed: str
    si: bool


def units_of(identification: Identification) -> Units:
    """Degrees for angles; percent for shares of a range."""
    if identification.unit == "rad":
        return Units(math.degrees(1.0), "deg", "deg/s", True)
    return Units(100.0, "% of range", "%/s", False)


def unit_of(identification: Identification, name: str) -> tuple[float, str]:
    """What one SI unit of a parameter is in the unit in which it is told, and that unit."""
    units = units_of(identification)
    return {
        "v_max": (units.factor, units.speed),
        "gain": (1.0, "1/s"),
        "lag": (1e3, "ms"),
        "acceleration_time": (1e3, "ms"),
    }.get(name, (units.factor, units.angle))


class Parameter(NamedTuple):
    """One row of the table of parameters, ready to be printed.

    Attributes:
        name: As in the model's file; ``gain`` for v_max / theta_0.
        words: What it is.
        value: The estimate, with its unit.
        interval: The 95 % interval in the same unit.
        si: Both in SI.
        judgement: How well it is known.
        known: Whether it is bounded on both sides.
        rough: Whether it is not, or only within a wide interval.
    """

    name: str
    words: str
    value: str
    interval: str
    si: str
    judgement: str
    known: bool
    rough: bool


def parameters(identification: Identification) -> list[Parameter]:
    """Every parameter with its interval, in the order of :data:`NAMES`."""
    units = units_of(identification)
    inside = {"v_max": "rad/s", "theta_0": "rad", "offset": "rad"}
    rows = []
    for name, words in NAMES.items():
        factor, unit = unit_of(identification, name)
        value, interval = estimate(identification, name)
        scaled = Interval(factor * interval.lower, factor * interval.upper)
        si = ""
        if units.si and name in inside:
            si = f"{figure(value, interval)} {inside[name]}, {between(interval)}"
        rows.append(
            Parameter(
                name=name,
                words=words,
                value=f"{figure(factor * value, scaled)} {unit}",
                interval=between(scaled),
                si=si,
                judgement=judgement(identification, name, factor, unit),
                known=interval.bounded,
                rough=is_rough(identification, name),
            )
        )
    return rows


def estimate(identification: Identification, name: str) -> tuple[float, Interval]:
    """A parameter, ``gain`` among them, and its interval, in SI."""
    if name == "gain":
        return identification.gain, identification.gain_interval
    return getattr(identification.model, name), identification.intervals[name]


def judgement(identification: Identification, name: str, factor: float, unit: str) -> str:
    """How well a parameter is known, in words.

    Args:
        identification: What was found.
        name: The parameter.
        factor: What one of its SI unit is in ``unit``.
        unit: The unit in which to tell it.
    """
    value, interval = estimate(identification, name)
    lower, upper = (math.isfinite(end) for end in interval)
    if not lower and not upper:
        return "not determined"
    if not lower or not upper:
        return f"only bounded from {'below' if lower else 'above'}"
    half = 0.5 * (interval.upper - interval.lower)
    only = "only " if is_rough(identification, name) else ""
    if name in ("lag", "offset"):  # may be 0, which no percentage is of
        return f"{only}± {two_figures(factor * half)} {unit}"
    if half > HARDLY * abs(value):
        return "hardly at all"
    return f"{only}± {percent_of(half, value)}"


def is_rough(identification: Identification, name: str) -> bool:
    """Whether an interval is wide, beside the parameter or what it adds to."""
    value, interval = estimate(identification, name)
    model = identification.model
    scale = {"lag": model.lag + model.acceleration_time, "offset": model.theta_0}.get(name, value)
    return not 0.5 * (interval.upper - interval.lower) <= ROUGH * abs(scale)
