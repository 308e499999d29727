"""The curve of fewest segments within a largest error, and of these one of small squared error."""

from __future__ import annotations

import math

import numpy as np

from planner.approximation.minimum_link.cycle import fewest_links_around
from planner.approximation.minimum_link.path import LINKS, Course, Gates, fewest_links
from planner.approximation.minimum_link.tube_least_squares import least_squares_within
from planner.approximation.problem import (
    BARELY,
    Candidate,
    Problem,
    candidate,
    distances,
)
from planner.approximation.slope_projection import attainable_error
from planner.exceptions import Infeasible, angle_text

TIE = 0.25 * BARELY
"""Relative excess over the bound with which the segments are counted, so that ties are passed."""

ROUNDING = 1e-15
"""The same in units of the samples, which are of size one."""


def within_largest_error(
    problem: Problem, bound: float, most: int | None, unit: float
) -> tuple[Candidate, int]:
    """The fewest segments whose largest error is within ``bound``, as close as they come.

    Args:
        problem: What to approximate, samples of size one.
        bound: Largest error [unit of the samples]; kept with :data:`BARELY` to spare if that takes
            no more segments.
        most: Most segments; None for any number.
        unit: Unit of the samples [rad], for the messages.

    Returns:
        The curve, no error above ``bound`` (1 + :data:`BARELY`), and a lower bound on the segments
        of any: for paths their number itself.

    Raises:
        Infeasible: No curve within the slopes, or none of at most so many segments, is as close.
    """
    attainable = attainable_error(problem.desired, problem.step, cyclic=problem.cyclic)
    if bound < attainable * (1.0 - BARELY):
        raise Infeasible(
            f"max_error: got {angle_text(bound * unit)}, but with slopes within ±v_max the "
            f"smallest attainable is {angle_text(attainable * unit)}; allow that much or a larger "
            "v_max"
        )
    widest = max(bound, attainable) * (1.0 + TIE) + ROUNDING
    course = minimum_link(problem, widest)
    count = _segments(problem, course)
    if most is not None and count > most:
        known = "needed" if course.fewest > most else "found"
        raise Infeasible(
            f"max_error and the number of segments: got {angle_text(bound * unit)} with at most "
            f"{most} segments, but the fewest {known} are {count}; allow more error or more "
            "segments"
        )
    spare = bound * (1.0 - BARELY)
    tight = course
    low, high = max(attainable, _by_pins(problem)) * (1.0 + TIE) + ROUNDING, widest
    if spare > low:
        other = minimum_link(problem, spare)
        if _segments(problem, other) == count:
            tight, high = other, spare
    for _ in range(LINKS.halvings):
        middle = 0.5 * (low + high)
        other = minimum_link(problem, middle)
        if _segments(problem, other) == count:
            tight, high = other, middle
        else:
            low = middle
    kept = spare if high <= spare else high
    if tight.knots.size > 1:
        curve = candidate(problem, tight.knots, tight.values)
        return least_squares_within(problem, curve, kept), course.fewest
    middle = 0.5 * (float(np.max(problem.desired)) + float(np.min(problem.desired)))
    room = max(spare - float(np.max(np.abs(problem.desired - middle))), 0.0)
    mean = float(np.mean(problem.desired))
    value = min(max(mean, middle - room), middle + room)
    return candidate(problem, tight.knots, np.array([value])), course.fewest


def _by_pins(problem: Problem) -> float:
    """Smallest largest error of slopes within the bound through one required value."""
    pinned = np.isfinite(problem.pins)
    away = distances(problem, np.arange(problem.samples, dtype=np.float64))[:, pinned]
    apart = np.abs(problem.desired[:, np.newaxis] - problem.pins[pinned])
    return float(np.max(apart - problem.step * away, initial=0.0))


def _values_at(problem: Problem, bound: float, place: float) -> tuple[float, float]:
    """Least and largest value at a place of a cycle from which slopes can pass all gates."""
    n = problem.samples
    pinned = np.isfinite(problem.pins)
    places = np.append(np.arange(n), problem.required[pinned])
    away = np.abs(places - place)
    reach = problem.step * np.minimum(away, n - away)
    lower = np.append(problem.desired - bound, problem.pins[pinned]) - reach
    upper = np.append(problem.desired + bound, problem.pins[pinned]) + reach
    return float(np.max(lower)), float(np.min(upper))


def minimum_link(problem: Problem, bound: float) -> Course:
    """The curve of fewest segments with no error above ``bound``; O(n).

    Args:
        problem: What to approximate.
        bound: Largest error at any sample, which slopes within the bound can keep.

    Returns:
        The curve. It has as few segments as possible; a cycle with required knots at most one more.
        All segments of a path are a sample long or longer if required knots lie on samples, and
        those of a cycle nearly always.
    """
    if not problem.cyclic:
        return fewest_links(*gates_of(problem, bound))
    if problem.required.size:
        return _cut(problem, bound, float(problem.required[0]))
    gates, _ = gates_of(problem, bound)
    least, most = max(gates.lower), min(gates.upper)
    if least <= most:
        return Course(np.zeros(1), np.array([0.5 * (least + most)]), 1)
    return fewest_links_around(gates) or _cut(problem, bound, 0.0)


def gates_of(
    problem: Problem,
    bound: float,
    *,
    start: float = 0.0,
    ends: tuple[float, float] | None = None,
) -> tuple[Gates, list[int]]:
    """Gates at samples and required knots, and the numbers of the latter, ends left out.

    Args:
        problem: What to approximate.
        bound: Largest error at any sample.
        start: Of a cycle, where it is cut to be a path; the last gate is a turn later.
        ends: Least and largest value there; by default, a cycle is not cut.
    """
    n = problem.samples
    places = np.arange(n)
    required, pins = problem.required, problem.pins
    if ends is not None:
        places = np.arange(math.ceil(start), math.floor(start + n) + 1)
        required = np.where(required > start, required, required + n)
    every = np.unique(
        np.concatenate([places, required, [] if ends is None else [start, start + n]])
    )
    lower, upper = np.full(every.size, -np.inf), np.full(every.size, np.inf)
    samples, knots = np.searchsorted(every, places), np.searchsorted(every, required)
    desired = problem.desired[places % n]
    lower[samples], upper[samples] = desired - bound, desired + bound
    pinned = np.isfinite(pins)
    lower[knots[pinned]] = upper[knots[pinned]] = pins[pinned]
    if ends is not None:
        lower[[0, -1]], upper[[0, -1]] = ends
    gates = Gates(every.tolist(), lower.tolist(), upper.tolist(), problem.step)
    return gates, sorted(k for k in knots.tolist() if 0 < k < every.size - 1)


def _cut(problem: Problem, bound: float, place: float) -> Course:
    """A cycle with a knot at a place, as a path from there back to it.

    A path whose ends are free needs no more segments; one that comes back to where it began takes
    at most one more.

    Args:
        problem: What to approximate, a cycle.
        bound: Largest error at any sample.
        place: Where to cut.

    Returns:
        The cycle, its ``fewest`` for any place where no knot is required.
    """
    least, most = _values_at(problem, bound, place)
    free = fewest_links(*gates_of(problem, bound, start=place, ends=(least, most)))
    starts = [min(max(float(free.values[k]), least), most) for k in (0, -1)]
    cycles = [
        fewest_links(*gates_of(problem, bound, start=place, ends=(value, value)))
        for value in (*starts, 0.5 * sum(starts))
    ]
    best = min(cycles, key=lambda course: (course.fewest, -min(course.shortest(), 1.0)))
    here = bool(np.any(problem.required == place))
    return Course(best.knots[:-1], best.values[:-1], free.fewest - (not here))


def _segments(problem: Problem, course: Course) -> int:
    return course.knots.size if problem.cyclic else course.knots.size - 1
