"""An identification in words and figures, for the terminal and for the page alike."""

from __future__ import annotations

import math
from typing import NamedTuple

from planner.identification.identification import Alternative, Identification, Interval
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

ALTERNATIVES = {
    "raw": "the request itself",
    "delay": "best pure delay",
    "first_order": "delay and first-order lag",
}
"""What the simpler descriptions are called in words."""

MODEL = "the joint model"

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
    outside = {
        "v_max": (units.factor, units.speed),
        "theta_0": (units.factor, units.angle),
        "gain": (1.0, "1/s"),
        "lag": (1e3, "ms"),
        "acceleration_time": (1e3, "ms"),
        "offset": (units.factor, units.angle),
    }
    inside = {"v_max": "rad/s", "theta_0": "rad", "offset": "rad"}
    rows = []
    for name, words in NAMES.items():
        factor, unit = outside[name]
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


class Error(NamedTuple):
    """How far off one description of the joint is.

    Attributes:
        words: The description.
        detail: Its parameters, as far as it has any worth telling.
        rms: Error over all rows [rad].
        held_out: Error on the rows held out [rad]; None where there are none.
        ours: Whether it is the joint model.
    """

    words: str
    detail: str
    rms: float
    held_out: float | None
    ours: bool


def errors(identification: Identification) -> list[Error]:
    """The errors of the simpler descriptions, and of the joint model at the end."""
    made = []
    for other in identification.alternatives:
        times = [
            f"{1e3 * other.parameters[name]:.0f} ms"
            for name in ("delay", "time_constant")
            if name in other.parameters
        ]
        words = ALTERNATIVES.get(other.name, other.name)
        made.append(Error(words, " + ".join(times), other.rms, other.held_out_rms, False))
    made.append(Error(MODEL, "", identification.rms, identification.held_out_rms, True))
    return made


def verdict(identification: Identification) -> str:
    """Whether the model holds, and what it adds, in one sentence."""
    units = units_of(identification)
    error, where = telling_error(identification)
    told = f"{units.factor * error:.3g} {units.angle} rms {where}"
    others = {other.name: held_out_or_all(other) for other in identification.alternatives}
    compared = []
    if others.get("raw", 0.0) > 0.0:
        compared.append(f"{percent_of(error, others['raw'])} of the raw error")
    if "delay" in others and error > 0.0:
        compared.append(f"{compared_with(error, others['delay'])} the best pure delay")
    tail = f": {told}" + (f", {' and '.join(compared)}" if compared else "")
    return ("the model holds" if identification.accepted else "THE MODEL DOES NOT FIT") + tail


def known(identification: Identification) -> str:
    """Which parameters the logs determine, in a sentence; nothing of a model that does not fit."""
    if not identification.accepted:
        return "Its parameters say little about the joint."
    rows = parameters(identification)
    missing = {row.name: row.words for row in rows if not row.known}
    rough = ", ".join(row.words for row in rows if row.known and row.rough)
    if set(missing) == {"v_max", "theta_0"}:
        told = "The logs do not reach the top speed: they determine v_max / theta_0, but neither "
        told += "of the two alone"
    elif missing:
        told = f"The logs do not determine: {', '.join(missing.values())}"
    elif not rough:
        return "The logs determine every parameter."
    else:
        return f"The logs determine every parameter, but some only roughly: {rough}."
    return f"{told}; only roughly known: {rough}." if rough else f"{told}."


def telling_error(identification: Identification) -> tuple[float, str]:
    """The error that tells most [rad], and on which rows it was measured."""
    if identification.held_out_rms is not None:
        return identification.held_out_rms, "on rows held out"
    return identification.rms, "on the rows it was fitted to"


def held_out_or_all(other: Alternative) -> float:
    """Its error on the rows held out where there are any, on all otherwise [rad]."""
    return other.rms if other.held_out_rms is None else other.held_out_rms


def compared_with(error: float, other: float) -> str:
    """How an error compares with another one, as in "2.5 times closer than"."""
    if error <= 0.0:
        return "infinitely closer than"
    ratio = other / error
    if ratio >= 1.05:
        return f"{ratio:.{1 if ratio < 10 else 0}f} times closer than"
    return "no closer than" if ratio > 0.95 else f"{1.0 / ratio:.1f} times farther off than"
