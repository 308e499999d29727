"""The fewest segments within a largest error: the true minimum, by any other way of finding it."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from planner import Infeasible, fit_pwl
from planner.approximation.fit_problem import Problem
from planner.approximation.largest_error import minimum_link
from planner.approximation.values import attainable_error
from tests.approximation.samples import KINDS, problems, samples_of

ROUNDING = 1e-12
"""Of samples of size one: what lines through points a few hundred samples apart may be off."""


def instance(seed, least, most, *, cyclic):
    """Samples of some kind, a bound on slopes, tight or loose, and an error that can be kept."""
    rng = np.random.default_rng([seed, cyclic])
    desired = samples_of(KINDS[seed % len(KINDS)], int(rng.integers(least, most)), rng)
    desired = desired / np.ptp(desired)
    step = float(rng.choice([2.0, 5.0, 200.0])) / desired.size
    share = float(rng.choice([1e-6, 0.03, 0.1, 0.3])) * rng.uniform(0.5, 1.0)
    bound = attainable_error(desired, step, cyclic=cyclic) * (1.0 + 1e-9) + share
    return Problem(desired=desired, step=step, cyclic=cyclic), bound


def count(course, *, cyclic):
    return course.knots.size - (not cyclic)


def fewest_by_enumeration(problem, bound):
    """Least number of lines for which some deal of the samples to them has a solution.

    Once it is known which samples a line passes and which of two neighbours is the steeper one, the
    bounds on errors and slopes, and that neighbours cross between the last sample of one and the
    first of the other, are linear in the lines: a linear programme tells whether there are such.
    """
    n, cyclic = problem.samples, problem.cyclic
    if cyclic and np.ptp(problem.desired) <= 2.0 * bound:
        return 1
    for lines in range(1 + cyclic, n + 1):
        for cut in combinations(range(n if cyclic else n - 1), lines - (not cyclic)):
            ends = [*cut, cut[0] + n] if cyclic else [-1, *cut, n - 1]
            for convex in product((1.0, -1.0), repeat=lines - (not cyclic)):
                if has_lines(problem, bound, ends, convex):
                    return lines
    return n


def has_lines(problem, bound, ends, convex):
    n, lines = problem.samples, len(ends) - 1
    rows, limits = [], []

    def value(line, place):
        row = np.zeros(2 * lines)
        row[2 * line % (2 * lines)] = place + (n if line < 0 else 0)
        row[2 * line % (2 * lines) + 1] = 1.0
        return row

    for line in range(lines):
        for k in range(ends[line] + 1, ends[line + 1] + 1):
            rows += [value(line, k), -value(line, k)]
            limits += [problem.desired[k % n] + bound, bound - problem.desired[k % n]]
    first = 0 if problem.cyclic else 1
    for line, sign in zip(range(first, lines), convex, strict=True):
        for place, way in ((ends[line], sign), (ends[line] + 1, -sign)):
            rows.append(way * (value(line, place) - value(line - 1, place)))
            limits.append(0.0)
    limit = (-problem.step, problem.step)
    bounds = [limit, (None, None)] * lines
    result = linprog(np.zeros(2 * lines), np.array(rows), limits, bounds=bounds, method="highs")
    return result.status == 0


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_no_deal_of_the_samples_to_fewer_lines_has_a_solution(seed, cyclic):
    problem, bound = instance(seed, 4, 7, cyclic=cyclic)
    course, _ = minimum_link(problem, bound)
    assert count(course, cyclic=cyclic) == fewest_by_enumeration(problem, bound)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("seed", range(20))
def test_the_curve_keeps_the_error_and_the_slopes_and_has_no_short_segment(seed, cyclic):
    problem, bound = instance(seed, 10, 400, cyclic=cyclic)
    course, _ = minimum_link(problem, bound)
    n = problem.samples
    angles = np.interp(np.arange(n), course.knots, course.values, period=n if cyclic else None)
    assert np.max(np.abs(angles - problem.desired)) <= bound + ROUNDING
    if course.knots.size == 1:
        return
    knots = np.append(course.knots, course.knots[0] + n) if cyclic else course.knots
    values = np.append(course.values, course.values[0]) if cyclic else course.values
    assert np.max(np.abs(np.diff(values)) - problem.step * np.diff(knots)) <= ROUNDING
    assert np.min(np.diff(knots)) >= 1.0 - 1e-9


@settings(max_examples=60)
@given(problems(least=4), st.floats(1e-6, 0.3), st.floats(1.0, 3.0), st.integers(0, 100))
def test_the_fewest_segments_are_the_same_shifted_mirrored_and_reversed(given, share, more, shift):
    desired, step, cyclic = given
    unit = max(float(np.ptp(desired)), 1e-9)
    desired, step = (desired - np.mean(desired)) / unit, step / unit
    bound = attainable_error(desired, step, cyclic=cyclic) * (1.0 + 1e-9) + share

    def fewest(samples, error):
        course, _ = minimum_link(Problem(desired=samples, step=step, cyclic=cyclic), error)
        return count(course, cyclic=cyclic)

    own = fewest(desired, bound)
    assert fewest(-desired, bound * (1.0 + 1e-9)) <= own
    assert fewest(desired[::-1], bound * (1.0 + 1e-9)) <= own
    assert fewest(desired, more * bound * (1.0 + 1e-9)) <= own
    if cyclic:
        assert fewest(np.roll(desired, shift), bound * (1.0 + 1e-9)) <= own
    else:
        assert fewest(desired[:-1], bound * (1.0 + 1e-9)) <= own


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_required_knot_costs_one_segment_at_most_and_a_required_angle_two(cyclic):
    for seed in range(0, 10, 2):
        problem, bound = instance(seed, 30, 90, cyclic=cyclic)
        desired, settings = problem.desired, {"v_max": problem.step, "tick": 1.0, "cyclic": cyclic}
        bound = 1.2 * bound
        free = fit_pwl(desired, **settings, max_error=bound)
        place = desired.size // 3
        knot = fit_pwl(desired, **settings, max_error=bound, required=[place])
        pin = fit_pwl(desired, **settings, max_error=bound, required={place: float(free(place))})
        assert free.segments <= knot.segments <= free.segments + 1 + cyclic
        assert knot.segments <= pin.segments <= free.segments + 2
        assert place in knot.knots
        assert pin(place) == pytest.approx(float(free(place)), abs=1e-12)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_least_squares_keep_the_number_of_segments_and_lower_the_error(kind, cyclic):
    desired = samples_of(kind, 150, np.random.default_rng(3))
    step = 4.0 * float(np.ptp(desired)) / 150
    bound = 1.05 * attainable_error(desired, step, cyclic=cyclic) + 0.05 * float(np.ptp(desired))
    course, _ = minimum_link(Problem(desired=desired, step=step, cyclic=cyclic), bound)
    fit = fit_pwl(desired, v_max=step, tick=1.0, cyclic=cyclic, max_error=bound)
    assert fit.segments == fit.fewest_segments == count(course, cyclic=cyclic)
    assert fit.max_error <= bound
    period = 150 if cyclic else None
    angles = np.interp(np.arange(150.0), course.knots, course.values, period=period)
    assert fit.rms <= float(np.sqrt(np.mean((angles - desired) ** 2))) + ROUNDING


def test_too_few_segments_are_refused_with_the_number_that_is_needed():
    zigzag = np.interp(np.arange(41.0), [0, 10, 20, 30, 40], [0.0, 5.0, 0.0, 5.0, 0.0])
    settings = {"v_max": 1.0, "tick": 1.0, "cyclic": False, "max_error": 1e-6}
    np.testing.assert_allclose(fit_pwl(zigzag, **settings).knots, [0, 10, 20, 30, 40], atol=1e-4)
    with pytest.raises(Infeasible, match="at most 3 segments, but the fewest needed are 4"):
        fit_pwl(zigzag, **settings, segments=3)
