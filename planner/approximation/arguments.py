"""The arguments of a fit: checks of each, and of whether one curve can meet all of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.approximation.problem import BARELY, BARELY_SHORT, round_knots
from planner.exceptions import Infeasible, InvalidInput, InvalidTrajectory, angle_text
from planner.trajectory import LARGEST, Array, as_trajectory
from planner.validation import as_number, as_positive, as_whole, freeze, shown

Required = Iterable[float] | Mapping[float, float | None]
Ends = tuple[float | None, float | None]

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
        weights: Weights of their squared errors, shape (n,); None where all are the same.
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments, if that is given.
        max_error: Largest error at a sample [rad], if that is given.
        max_rms: Largest rms error [rad], if that is given.
        knots: All knots [samples], if they are given.
        required: Knots that there must be [samples], shape (r,), increasing.
        pins: The curve's values there [rad], shape (r,); NaN where they are free.
        shortest: Length of the shortest segment [samples].
        on_samples: Whether knots lie on samples.
        exact: Whether the answer must be proved best.
    """

    desired: Array
    weights: Array | None
    v_max: float
    tick: float
    cyclic: bool
    segments: int | None
    max_error: float | None
    max_rms: float | None
    knots: Array | None
    required: Array
    pins: Array
    shortest: float
    on_samples: bool
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
        if self.shortest < 1.0:
            raise InvalidInput(f"shortest: got {self.shortest:g}, expected 1 or more [samples]")


def checked_weights(weights: npt.ArrayLike | None, n: int) -> Array | None:
    """The weights of n samples with mean 1, shape (n,), or None where all are the same."""
    if weights is None:
        return None
    values = as_trajectory(weights, name="weights", minimum=1)
    if values.size != n:
        raise InvalidTrajectory(f"weights: got {values.size}, expected {n}, one per sample")
    if not np.all(values > 0.0):
        k = int(np.argmin(values))
        raise InvalidInput(f"weights: got {values[k]:g} at sample {k}, expected more than 0")
    if np.all(values == values[0]):
        return None
    weights = values / np.mean(values)
    freeze(weights)
    return weights


def checked_knots(
    required: Required, ends: Ends, n: int, *, cyclic: bool, name: str = "required"
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
    try:
        start, end = ends
    except (TypeError, ValueError):
        raise InvalidInput(
            f"ends: got {shown(ends)}, expected (angle or None, angle or None)"
        ) from None
    for place, angle in ((0.0, start), (last, end)):
        if angle is None:
            continue
        if cyclic:
            raise InvalidInput("ends: a cycle has none; leave them out, or give cyclic=False")
        pin = _number("ends", angle)
        other = angles.get(place, math.nan)
        if not math.isnan(other) and other != pin:
            raise Infeasible(
                f"required and ends: got {angle_text(other)} and {angle_text(pin)} at sample "
                f"{place:g}; leave one of them out"
            )
        angles[place] = pin
    places = np.array(sorted(angles))
    return places, np.array([angles[place] for place in places.tolist()])


def checked_all_knots(knots: npt.ArrayLike | None, n: int, *, cyclic: bool) -> Array | None:
    """All knots [samples], increasing, shape (k,); None where they are not given."""
    if knots is None:
        return None
    values = as_trajectory(knots, name="knots", minimum=1)
    return checked_knots(values.tolist(), (None, None), n, cyclic=cyclic, name="knots")[0]


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
        InvalidInput: A required knot lies between samples where knots must lie on them.
    """
    if arguments.on_samples:
        between = arguments.required[arguments.required != np.floor(arguments.required)]
        if between.size:
            raise InvalidInput(
                f"required: got a knot at {between[0]:g} with on_samples, expected whole numbers"
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
    n, shortest = arguments.desired.size, arguments.shortest
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
    if apart.size == 1 and length < shortest - BARELY_SHORT:
        raise Infeasible(
            f"shortest: got {shortest:g} samples, but the whole "
            f"{'cycle' if arguments.cyclic else 'path'} is {length:g} samples long; allow shorter "
            "segments"
        )
    if apart[k] < shortest - BARELY_SHORT:
        raise Infeasible(
            f"required knots at samples {places[k]:g} and {places[k + 1] % n:g}: {apart[k]:g} "
            f"samples apart, expected at least shortest = {shortest:g}; leave one out or allow "
            "shorter segments"
        )
    unit = math.ceil(shortest - BARELY_SHORT) if arguments.on_samples else shortest
    most = int(np.sum(np.floor(apart / unit + BARELY_SHORT)))
    fewest = apart.size
    segments = arguments.segments
    ceiling = arguments.max_error is not None or arguments.max_rms is not None
    if segments is not None and segments > most and not ceiling:
        raise Infeasible(
            f"segments = {segments} and shortest = {shortest:g} samples: there is room for {most} "
            f"in {length:g} samples{' between the required knots' if fewest > 1 else ''}; ask for "
            "fewer or allow shorter ones"
        )
    if segments is not None and segments < fewest:
        raise Infeasible(
            f"segments = {segments} and {arguments.required.size} required knots: they make at "
            f"least {fewest} segments; ask for more or leave some out"
        )
    constant = 2.0 * (arguments.max_error or 0.0) >= float(np.ptp(arguments.desired))
    if arguments.cyclic and most < 2 and not constant:
        raise Infeasible(
            f"shortest = {shortest:g} and a cycle of {n} samples: there is room for one segment, "
            "and a closed curve that moves needs two; allow shorter ones"
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
