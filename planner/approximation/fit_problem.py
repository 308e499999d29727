"""Approximation problem: samples, slope bound, required knots; checks that a curve exists.

A search works in units of its own: samples of size one, time counted in samples. The ends of a path
and required knots are fixed, and at required knots values may be, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from planner.arrays import LARGEST, Array, Indices, Mask, as_count, as_number, as_positive, shown
from planner.exceptions import Infeasible, InvalidInput, angle_text

Required = Iterable[float] | Mapping[float, float | None]

SMALLEST = 1e-30
"""Smallest speed, time or error that is accepted, and half range of samples that are not constant:
no measurement is as exact."""

SAME_PLACE = 1e-6  # distance [samples] at which a knot counts as one that is required
SHORTEST = 1.0 - 1e-9  # length of the shortest segment [samples]: a sample, less rounding
BARELY = 1e-9  # relative distance from a bound on the error that rounding cannot cross


class Problem(NamedTuple):
    """An approximation problem, in a unit of its own; compiled functions take it as it is."""

    desired: Array  # samples D, (n,)
    step: float  # largest change per sample v
    cyclic: bool  # whether the first sample follows the last
    required: Array = np.zeros(0)  # where there must be a knot [samples], (r,), increasing
    pins: Array = np.zeros(0)  # the curve's values there, (r,); NaN where they are free
    bound: float = math.inf  # error beyond which descents add a penalty
    penalty: float = 0.0  # weight of the squared excess

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return self.desired.size

    def ends(self, knots: Array) -> Array:
        """Ends of the segments [samples]: the knots, and of a cycle the first a period later."""
        return np.append(knots, knots[0] + self.samples) if self.cyclic else knots

    def segments(self, knots: Array) -> int:
        """Number of segments between these knots."""
        return knots.size if self.cyclic else knots.size - 1


class Question(NamedTuple):
    """How many segments, how close, and which knots; each None if unspecified."""

    segments: int | None
    max_error: float | None  # [rad]
    max_rms: float | None  # [rad]
    knots: Array | None  # [samples]
    exact: bool


class Candidate(NamedTuple):
    """A candidate curve and its squared error."""

    knots: Array  # (K,)
    values: Array  # (K,)
    error: float


def candidate(problem: Problem, knots: Array, values: Array) -> Candidate:
    """A curve with its squared error Σ (P - D)²; O(n + K)."""
    residual = residuals(problem, knots, values)
    return Candidate(knots, values, float(residual @ residual))


def residuals(problem: Problem, knots: Array, values: Array) -> Array:
    """Curve minus samples, P - D, shape (n,)."""
    index = np.arange(problem.samples, dtype=np.float64)
    period = problem.samples if problem.cyclic else None
    return np.interp(index, knots, values, period=period) - problem.desired


def required_knots(problem: Problem, knots: Array) -> tuple[Mask, Array]:
    """Which knots are required or the ends of a path, and their pins, NaN where free, each (K,)."""
    required, pins = np.zeros(knots.size, dtype=bool), np.full(knots.size, np.nan)
    if not problem.cyclic:
        required[[0, -1]] = True
    if problem.required.size:
        away = distances(problem, knots)
        which = np.argmin(away, axis=1)
        there = away[np.arange(knots.size), which] <= SAME_PLACE
        required |= there
        pins[there] = problem.pins[which[there]]
    return required, pins


def distances(problem: Problem, places: Array) -> Array:
    """Time between places and required knots [samples], the shorter way round, shape (m, r)."""
    away = np.abs(places[:, None] - problem.required[None, :])
    if problem.cyclic:
        away = np.mod(away, problem.samples)
        away = np.minimum(away, problem.samples - away)
    return np.asarray(away)


def feasible_values(problem: Problem, knots: Array) -> Array:
    """The course straight from pin to pin, within the slopes, at knots: (k,); the mean without."""
    pinned = np.isfinite(problem.pins)
    if not pinned.any():
        return np.full(knots.size, float(np.mean(problem.desired)))
    period = problem.samples if problem.cyclic else None
    course = np.interp(knots, problem.required[pinned], problem.pins[pinned], period=period)
    return with_pins(problem, knots, course)


def with_pins(problem: Problem, knots: Array, values: Array) -> Array:
    """Values at knots [unit of the samples], shape (k,), those of pins exactly as required."""
    pins = required_knots(problem, knots)[1]
    return np.where(np.isfinite(pins), pins, values)


def nearest_samples(required: Array) -> Indices:
    """The samples that stand for required knots on grids of samples."""
    return np.floor(required + 0.5).astype(np.intp)


def with_required(problem: Problem, knots: Array) -> Array | None:
    """Knots on samples, (K,), moved to required ones nearby; None if some segment is too short."""
    moved = np.array(knots, dtype=np.float64)
    for node, place in zip(nearest_samples(problem.required), problem.required, strict=True):
        away = knots - node
        there = np.mod(away, problem.samples) == 0.0 if problem.cyclic else away == 0.0
        moved[there] += place - node
    return moved if np.min(np.diff(problem.ends(moved))) >= SHORTEST else None


def segment_capacity(problem: Problem) -> tuple[Array, Indices]:
    """Places that are knots in any case, ends included, and most segments between them."""
    n, fixed = problem.samples, problem.required
    if problem.cyclic:
        first = fixed if fixed.size else np.zeros(1)
        places = np.append(first, first[0] + n)
    else:
        places = np.unique(np.concatenate([[0.0], fixed, [n - 1.0]]))
    most = np.floor(np.diff(places) + (1.0 - SHORTEST)).astype(np.intp)
    return places, most


def even_knots(problem: Problem, segments: int | None = None) -> Array:
    """Knots as evenly spread as required ones allow, by default as many as possible: (K,)."""
    places, most = segment_capacity(problem)
    length, parts = np.diff(places), np.array(most)
    if segments is not None:
        parts = np.ones_like(most)
        for _ in range(min(segments, int(np.sum(most))) - length.size):
            parts[np.argmax(np.where(parts < most, length / parts, -np.inf))] += 1
    pieces = [
        start + size * np.arange(count) / count
        for start, size, count in zip(places[:-1], length, parts, strict=True)
    ]
    knots = np.concatenate(pieces)
    return knots if problem.cyclic else np.append(knots, places[-1])


def checked_knots(
    required: Required, n: int, *, cyclic: bool, name: str = "required"
) -> tuple[Array, Array]:
    """Required knots, increasing, and the required values there, NaN where free."""
    if not isinstance(required, Iterable) or getattr(required, "ndim", 1) != 1:
        raise InvalidInput(f"{name}: got {shown(required)}, expected sample indices")
    pairs = required.items() if isinstance(required, Mapping) else ((k, None) for k in required)
    angles: dict[float, float] = {}
    for place, angle in pairs:
        # Rounded, as places are often times over a period; the sum is 0.0 for -0.0.
        knot = round(_number(f"{name} knots", place), 9) + 0.0
        if not (0.0 <= knot < n if cyclic else 0.0 <= knot <= n - 1.0):
            limit = f"or later and before sample {n}" if cyclic else f"to sample {n - 1}"
            raise InvalidInput(f"{name}: got a knot at sample {knot:g}, expected sample 0 {limit}")
        if knot in angles:
            words = "expected each knot once; leave one out"
            raise InvalidInput(f"{name}: got two knots at sample {knot:g}, {words}")
        angles[knot] = math.nan if angle is None else _number(f"{name} angles", angle)
    places = np.array(sorted(angles))
    return places, np.array([angles[place] for place in places.tolist()])


def _number(name: str, value: object) -> float:
    number = as_number(value)
    if math.isnan(number):
        raise InvalidInput(f"{name}: got {shown(value)}, expected a finite number")
    return number


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
    fewest = 1 if not cyclic or np.all(desired == desired[0]) else 2
    most = desired.size if cyclic else desired.size - 1
    of = f"{desired.size} {'cyclic ' if cyclic else ''}samples"
    expected = f"a whole number, {fewest} to {most} for {of}"
    return as_count("segments", segments, expected, least=fewest, most=most)


def check_feasible(problem: Problem, question: Question, tick: float) -> None:
    """Raise Infeasible where no curve meets all requirements, and name the two that exclude it."""
    segments, max_error, max_rms, knots, _ = question
    n, (fixed, most) = problem.samples, segment_capacity(problem)
    every = fixed if knots is None else problem.ends(knots)
    for name, places in (("required knots", fixed), ("knots", every)):
        apart = np.diff(places)
        k = int(np.argmin(apart))
        if apart[k] < SHORTEST:
            raise Infeasible(
                f"{name} at sample {places[k]:g} and sample {places[k + 1] % n:g}: they are less "
                "than one sample apart; leave one out"
            )
    pinned = np.isfinite(problem.pins)
    places, angles = problem.required[pinned], problem.pins[pinned]
    if places.size > 1:
        if problem.cyclic:
            places, angles = np.append(places, places[0] + n), np.append(angles, angles[0])
        rises = np.diff(angles) / np.diff(places)
        k = int(np.argmax(np.abs(rises)))
        if abs(rises[k]) > problem.step * (1.0 + 1e-13):
            raise Infeasible(
                f"required angles {angle_text(angles[k])} at sample {places[k]:g} and "
                f"{angle_text(angles[k + 1])} at sample {places[k + 1] % n:g}: got a slope of "
                f"{angle_text(rises[k] / tick)}/s between them, expected at most v_max = "
                f"{angle_text(problem.step / tick)}/s; move one of them or allow a larger v_max"
            )
    if segments is not None and segments > np.sum(most) and max_error is max_rms is None:
        raise Infeasible(
            f"segments, required: got {segments}, but at most {np.sum(most)} segments, each of a "
            "sample or more, fit between the required knots; ask for fewer"
        )
    if segments is not None and segments < most.size:
        raise Infeasible(
            f"segments, required: got {segments}, but {problem.required.size} required knots make "
            f"at least {most.size} segments; ask for more or leave some out"
        )
    if max_error is None:
        return
    least = error_at_pins(problem)
    if np.max(least, initial=-np.inf) > max_error * (1.0 + BARELY):
        k, pin = map(int, np.unravel_index(int(np.argmax(least)), least.shape))
        raise Infeasible(
            f"required angle {angle_text(problem.pins[pin])} at sample {problem.required[pin]:g} "
            f"and max_error: with slopes within ±v_max the error at sample {k} is at least "
            f"{angle_text(least[k, pin])}, expected at most {angle_text(max_error)}; move the "
            "angle or allow more error"
        )


def error_at_pins(problem: Problem) -> Array:
    """Least error at every sample beside each required angle, shape (n, r); negative for none."""
    away = distances(problem, np.arange(problem.samples, dtype=np.float64))
    least = np.abs(problem.desired[:, np.newaxis] - problem.pins) - problem.step * away
    return np.where(np.isfinite(problem.pins), least, -np.inf)
