"""The arguments of a fit: checks of each, and of whether one curve can meet all of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import BARELY, SHORTEST, round_knots
from planner.exceptions import Infeasible, InvalidInput, angle_text
from planner.trajectory import LARGEST, Array, as_trajectory
from planner.validation import as_number, as_positive, as_whole, shown

Required = Iterable[float] | Mapping[float, float | None]

SMALLEST = 1e-30
"""Smallest speed, time or error that is accepted, and half range of samples that are not constant:
no measurement is as exact."""

ARGUMENT_ROUNDING = 1e-13
"""Relative excess of a slope between two pins over v_max that is left to rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Arguments:
    """The arguments of :func:`planner.fit_pwl`, each checked on its own.

    Attributes:
        desired: Samples [rad], shape (n,).
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments, if that is given.
        max_error: Largest error at a sample [rad], if that is given.
        max_rms: Largest rms error [rad], if that is given.
        knots: All knots [samples], if they are given.
        required: Knots that there must be [samples], shape (r,), increasing.
        pins: The curve's values there [rad], shape (r,); NaN where they are free.
        exact: Whether the answer must be proved best.
    """

    desired: Array
    v_max: float
    tick: float
    cyclic: bool
    segments: int | None
    max_error: float | None
    max_rms: float | None
    knots: Array | None
    required: Array
    pins: Array
    exact: bool

    def __post_init__(self) -> None:
        """Refuse arguments that exclude each other."""
        if self.max_error is not None and self.max_rms is not None:
            raise InvalidInput("max_error, max_rms: got both, expected one; leave one out")
        if self.knots is not None and self.segments is not None:
            raise InvalidInput("knots, segments: got both, expected one; knots say how many")
        if self.exact and self.knots is None and self.segments is None and self.max_rms is None:
            raise InvalidInput("exact: expected segments or max_rms with it; give one of them")
        if self.exact and self.max_error is not None:
            raise InvalidInput("exact: got max_error, expected segments or max_rms with it")


def checked_knots(
    required: Required, n: int, *, cyclic: bool, name: str = "required"
) -> tuple[Array, Array]:
    """Required knots, increasing, and the required values there, NaN where free."""
    if not isinstance(required, Iterable) or getattr(required, "ndim", 1) != 1:
        raise InvalidInput(f"{name}: got {shown(required)}, expected sample indices")
    pairs = required.items() if isinstance(required, Mapping) else ((k, None) for k in required)
    last = n - 1.0
    angles: dict[float, float] = {}
    for place, angle in pairs:
        index = _number(f"{name} knots", place)
        # The sum is 0.0 where a place is rounded to -0.0.
        knot = float(round_knots(index)) + 0.0 if abs(index) < 2.0 * n else index
        inside = 0.0 <= knot < n if cyclic else 0.0 <= knot <= last
        if not inside:
            limit = f"0 up to, without, {n}" if cyclic else f"0 to {n - 1}"
            raise InvalidInput(f"{name}: got a knot at {knot:g}, expected {limit} [samples]")
        angles[knot] = math.nan if angle is None else _number(f"{name} angles", angle)
    places = np.array(sorted(angles))
    return places, np.array([angles[place] for place in places.tolist()])


def checked_all_knots(knots: npt.ArrayLike | None, n: int, *, cyclic: bool) -> Array | None:
    """All knots [samples], increasing, shape (k,); None where they are not given."""
    if knots is None:
        return None
    values = as_trajectory(knots, name="knots", minimum=1)
    return checked_knots(values.tolist(), n, cyclic=cyclic, name="knots")[0]


def positive(name: str, value: float, unit: str) -> float:
    """The number; raise InvalidInput unless it is finite, above 0 and of a plausible size."""
    number = as_positive(name, value, f"a finite number above 0 [{unit}]")
    if not SMALLEST <= number <= LARGEST:
        raise InvalidInput(
            f"{name}: got {number:g}, expected {SMALLEST:g} to {LARGEST:g} [{unit}]; check the unit"
        )
    return number


def checked_segments(segments: int | None, desired: Array, *, cyclic: bool) -> int | None:
    """The number of segments; raise InvalidInput where the samples do not allow it."""
    if segments is None:
        return None
    count = as_whole(segments)
    if count is None:
        raise InvalidInput(f"segments: got {shown(segments)}, expected a whole number")
    constant = bool(np.all(desired == desired[0]))
    fewest = 2 if cyclic and not constant else 1
    most = desired.size if cyclic else desired.size - 1
    if not fewest <= count <= most:
        raise InvalidInput(
            f"segments: got {shown(count)}, expected {fewest} to {most} for {desired.size} "
            f"{'cyclic ' if cyclic else ''}samples"
        )
    return count


def _number(name: str, value: object) -> float:
    number = as_number(value)
    if math.isnan(number):
        raise InvalidInput(f"{name}: got {shown(value)}, expected a finite number")
    return number


def check_feasible(arguments: Arguments) -> None:
    """Raise Infeasible if no curve meets all requirements, and name the two that conflict.

    Raises:
        Infeasible: Two required angles are too far apart, two required knots too close, or there is
            no room for so many or so few segments.
        InvalidInput: A knot lies between samples where the optimum is to be proved.
    """
    if arguments.exact:
        for name, places in (("required", arguments.required), ("knots", arguments.knots)):
            between = [] if places is None else places[places != np.floor(places)]
            if len(between):
                raise InvalidInput(
                    f"{name}: got a knot at {between[0]:g} with exact, expected whole numbers; an "
                    "optimum is proved for knots on samples"
                )
    _check_slopes(arguments)
    _check_lengths(arguments)
    if arguments.max_error is not None:
        _check_errors(arguments, arguments.max_error)


def _around(arguments: Arguments, places: Array) -> Array:
    """Places with the first one again at the end, a cycle later."""
    return np.append(places, places[0] + arguments.desired.size)


def _check_slopes(arguments: Arguments) -> None:
    pinned = np.isfinite(arguments.pins)
    places, angles = arguments.required[pinned], arguments.pins[pinned]
    if places.size < 2:
        return
    if arguments.cyclic:
        places, angles = _around(arguments, places), np.append(angles, angles[0])
    slopes = np.diff(angles) / (np.diff(places) * arguments.tick)
    k = int(np.argmax(np.abs(slopes)))
    if abs(slopes[k]) > arguments.v_max * (1.0 + ARGUMENT_ROUNDING):
        n = arguments.desired.size
        raise Infeasible(
            f"required angles {angle_text(angles[k])} at sample {places[k]:g} and "
            f"{angle_text(angles[k + 1])} at sample {places[k + 1] % n:g}: got a slope of "
            f"{angle_text(slopes[k])}/s between them, expected at most v_max = "
            f"{angle_text(arguments.v_max)}/s; move one of them or allow a larger v_max"
        )


def _check_lengths(arguments: Arguments) -> None:
    n = arguments.desired.size
    length = float(n if arguments.cyclic else n - 1)
    places = arguments.required
    if not arguments.cyclic:
        places = np.unique(np.concatenate([[0.0], places, [n - 1.0]]))
    elif places.size:
        places = _around(arguments, places)
    else:
        places = np.array([0.0, n])
    apart = np.diff(places)
    k = int(np.argmin(apart))
    if apart[k] < SHORTEST:
        raise Infeasible(
            f"required knots at samples {places[k]:g} and {places[k + 1] % n:g}: {apart[k]:g} "
            "samples apart, expected at least 1; leave one out"
        )
    most = int(np.sum(np.floor(apart + (1.0 - SHORTEST))))
    segments = arguments.segments
    if segments is None:
        return
    if segments > most and arguments.max_error is None and arguments.max_rms is None:
        raise Infeasible(
            f"segments = {segments} and required knots: there is room for {most} of a sample or "
            f"more in {length:g} samples between them; ask for fewer"
        )
    if segments < apart.size:
        raise Infeasible(
            f"segments = {segments} and {arguments.required.size} required knots: they make at "
            f"least {apart.size} segments; ask for more or leave some out"
        )


def _check_errors(arguments: Arguments, bound: float) -> None:
    """Raise Infeasible where the slopes keep a required angle beyond the bound from a sample."""
    n, step = arguments.desired.size, arguments.v_max * arguments.tick
    samples = np.arange(n, dtype=np.float64)
    for place, angle in zip(arguments.required, arguments.pins, strict=True):
        if not math.isfinite(angle):
            continue
        away = np.abs(samples - place)
        if arguments.cyclic:
            away = np.minimum(away, n - away)
        least = np.abs(arguments.desired - angle) - step * away
        k = int(np.argmax(least))
        if least[k] > bound * (1.0 + BARELY):
            raise Infeasible(
                f"required angle {angle_text(angle)} at sample {place:g} and max_error: with "
                f"slopes within ±v_max the error at sample {k} is at least {angle_text(least[k])}, "
                f"expected at most {angle_text(bound)}; move the angle or allow more error"
            )
