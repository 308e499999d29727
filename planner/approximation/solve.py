"""From a checked question to knots and values: the search in a unit of its own, and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.approximation.arguments import KNOT_UNIT, Question, check_feasible
from planner.approximation.branch_and_bound import LARGEST_EXACT, proved_best
from planner.approximation.knot_search import KnotSearch
from planner.approximation.largest_error import BARELY, within_largest_error
from planner.approximation.problem import Problem, even_knots, with_pins
from planner.approximation.qp import values_within, within_slopes
from planner.approximation.segment_count import automatic, within_rms
from planner.exceptions import Infeasible, InvalidInput
from planner.trajectory import Array


def knots_and_values(question: Question) -> tuple[Array, Array, int | None]:
    """The answer: knots [samples] and values [rad], slopes within ±v_max to the last digit.

    With a largest error, the third is a lower bound on the segments of any curve that keeps it.

    Raises:
        Infeasible: There is none; names the pair of requirements that contradict each other.
        SolverFailed: A solver stopped short.
    """
    check_feasible(question)
    pins = question.pins[np.isfinite(question.pins)]
    given = np.concatenate([question.desired, pins])
    middle = 0.5 * (float(given.max()) + float(given.min()))
    half_range = float(np.max(np.abs(given - middle)))
    in_rad = Problem(
        desired=question.desired,
        step=question.v_max * question.tick,
        cyclic=question.cyclic,
        weights=np.ones(question.desired.size) if question.weights is None else question.weights,
        shortest=question.shortest,
        required=question.required,
        pins=question.pins,
        on_samples=question.on_samples,
    )
    if half_range == 0.0:
        return *_constant(in_rad, question), None if question.max_error is None else 1
    problem = replace(
        in_rad,
        desired=(in_rad.desired - middle) / half_range,
        step=in_rad.step / half_range,
        pins=(in_rad.pins - middle) / half_range,
    )
    fewest = None
    if question.max_error is None or question.knots is not None:
        knots, values = _found(problem, question, half_range)
    else:
        search = KnotSearch(problem)
        bound = question.max_error / half_range
        curve, fewest = within_largest_error(search.given, bound, question.segments, half_range)
        knots, values = search.form.restore(curve)
    knots = _snapped(in_rad, knots)
    lengths = np.diff(np.append(knots, knots[0] + in_rad.samples) if question.cyclic else knots)
    values = within_slopes(
        with_pins(in_rad, knots, middle + half_range * values),
        question.v_max * (lengths * question.tick),
        cyclic=question.cyclic,
        towards=_pinned_course(in_rad, knots) if pins.size else None,
    )
    return knots, values, fewest


def _found(problem: Problem, question: Question, unit: float) -> tuple[Array, Array]:
    """Knots and values of the curve that answers the question, in the search's unit [rad]."""
    if question.knots is not None:
        return _at_given_knots(problem, question, unit)
    search = KnotSearch(problem)
    if question.exact:
        return _exact(search, question, unit)
    if question.max_rms is not None:
        curve = within_rms(search, question.max_rms / unit, question.segments, unit)
    elif question.segments is None:
        curve = automatic(search)
    else:
        curve = search.curve(question.segments)
    return search.settled(curve)


def _exact(search: KnotSearch, question: Question, unit: float) -> tuple[Array, Array]:
    """The proved best curve of so many segments, or of the fewest that keep the rms error."""
    n = search.problem.samples
    if n > LARGEST_EXACT:
        raise InvalidInput(
            f"exact: got {n} samples, expected at most {LARGEST_EXACT}; fit without it, or thin "
            "the samples out"
        )
    if question.max_rms is None:
        assert question.segments is not None, "an exact question says one of the two"
        best = proved_best(search.problem, search.curve(question.segments))
        return search.settled(best)
    last = search.most if question.segments is None else min(question.segments, search.most)
    least = math.inf
    for segments in range(search.fewest, last + 1):
        best = proved_best(search.problem, search.curve(segments))
        least = math.sqrt(best.error / n) * unit
        if least <= question.max_rms * (1.0 + BARELY):
            return search.settled(best)
    raise Infeasible(
        f"max_rms and the number of segments: got {question.max_rms:.6g} rad, but {last} segments "
        f"with knots on samples reach {least:.6g} rad at best; allow more error or more segments"
    )


def _at_given_knots(problem: Problem, question: Question, unit: float) -> tuple[Array, Array]:
    assert question.knots is not None, "asked for given knots"
    knots = np.union1d(question.knots, question.required)
    if not question.cyclic:
        knots = np.union1d(knots, [0.0, problem.samples - 1.0])
    _check_given(problem, knots)
    bound = None if question.max_error is None else question.max_error / unit
    values = values_within(problem, knots, bound, unit)
    if question.max_rms is not None:
        residual = np.interp(
            np.arange(problem.samples),
            knots,
            values,
            period=problem.samples if problem.cyclic else None,
        )
        square = np.average((residual - problem.desired) ** 2, weights=problem.weights)
        least = float(np.sqrt(square)) * unit
        if least > question.max_rms * (1.0 + BARELY):
            raise Infeasible(
                f"knots and max_rms: got {question.max_rms:.6g} rad, but with these knots the "
                f"smallest rms error is {least:.6g} rad; add knots or allow more error"
            )
    return knots, values


def _check_given(problem: Problem, knots: Array) -> None:
    ends = np.append(knots, knots[0] + problem.samples) if problem.cyclic else knots
    k = int(np.argmin(np.diff(ends)))
    if ends[k + 1] - ends[k] < problem.shortest - 1e-9:
        raise Infeasible(
            f"knots at samples {ends[k]:g} and {ends[k + 1] % problem.samples:g}: "
            f"{ends[k + 1] - ends[k]:g} samples apart, expected at least shortest = "
            f"{problem.shortest:g}; leave one away or allow shorter segments"
        )
    if problem.on_samples and np.any(knots != np.floor(knots)):
        between = knots[knots != np.floor(knots)][0]
        raise InvalidInput(f"knots: got {between:g} with on_samples, expected whole numbers")


def _constant(problem: Problem, question: Question) -> tuple[Array, Array]:
    """Samples and pins that are all the same."""
    if question.knots is not None:
        knots = np.union1d(question.knots, question.required)
        if not question.cyclic:
            knots = np.union1d(knots, [0.0, problem.samples - 1.0])
        _check_given(problem, knots)
    else:
        segments = question.segments if question.max_error is None else None
        knots = even_knots(problem, 1 if segments is None else segments)
    return knots, np.full(knots.size, problem.desired[0])


def _snapped(problem: Problem, knots: Array) -> Array:
    """The knots, required ones to the last digit."""
    snapped = np.array(knots)
    for place in problem.required:
        snapped[np.abs(snapped - place) < 8.0 / KNOT_UNIT] = place
    return snapped


def _pinned_course(problem: Problem, knots: Array) -> Array:
    """Straight from pin to pin."""
    pinned = np.isfinite(problem.pins)
    places, pins = problem.required[pinned], problem.pins[pinned]
    return np.interp(knots, places, pins, period=problem.samples if problem.cyclic else None)
