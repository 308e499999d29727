"""How many segments: as few as do what was asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planner.approximation.descent import descend
from planner.approximation.ideal import attainable_error
from planner.approximation.objective import Candidate, Problem, candidate, residuals
from planner.approximation.search import MANY_SAMPLES, Search
from planner.approximation.swing import swung
from planner.exceptions import Infeasible
from planner.trajectory import Array

CLOSE_TO_IDEAL = 1.02
"""Automatic: rms over the ideal's from which on more segments are not worth their corners."""

FLOOR = 0.01
"""Automatic: rms, relative to the range of the samples, that is too small to spend corners on."""

ABOVE_NOISE = 1.1
"""Automatic: rms over the noise of the samples that is not worth corners either."""

ONE_BY_ONE = 16
"""Segments up to which every number is tried; beyond, a bracket grows and is halved."""

WIDER = 1.3
"""Factor by which a bracket of many segments grows."""

COARSE = 0.004
"""Width of a bracket, relative to its segments, that is not halved any further."""

FEWER = 0.75
"""Segments tried first, relative to those of a curve that is found in one pass."""

FEW_SAMPLES = 300
"""Samples up to which every number of segments is tried from the fewest on."""

FLATTENINGS = 12
"""Times that the weights of the largest errors are raised in search of a smaller one."""

BARELY = 1e-9
"""Relative distance from a bound on the error that rounding cannot cross."""

ROUNDING = 1e-24
"""Mean squared error of samples of size one that is left to rounding."""

NEARLY = 1.001
"""Squared error over its bound up to which the values at a curve's knots are sought anew."""

HOPEFUL = 3.0
"""Largest error over its bound beyond which raising weights is not tried."""


def automatic(search: Search) -> Candidate:
    """The fewest segments that come close to the ideal, or the exact curve if there is one."""
    if search.exact is not None:
        return search.exact
    desired = search.problem.desired
    negligible = max(2.0 * FLOOR, ABOVE_NOISE * noise(desired))  # the samples span 2 units
    enough = max(CLOSE_TO_IDEAL**2 * search.ideal_error, desired.size * negligible**2)

    def close_enough(segments: int) -> Candidate | None:
        curve = search.curve(segments)
        return curve if curve.error <= enough else None

    found = _fewest(close_enough, search.fewest, search.most, long=_is_long(search))
    return search.curve(search.most) if found is None else found


def noise(desired: Array) -> float:
    """Standard deviation of white noise on smooth samples, from their median second difference."""
    bend = np.abs(np.diff(desired, n=2))
    return float(np.median(bend)) / (0.6745 * math.sqrt(6.0))  # of a normal variable: median, Δ²


def within_rms(search: Search, bound: float, most: int | None, unit: float) -> Candidate:
    """The fewest segments whose rms error is within ``bound``.

    Args:
        search: Curves through the samples.
        bound: Largest rms error [unit of the search].
        most: Most segments; None for any number.
        unit: Unit of the search [rad], for the message.

    Raises:
        Infeasible: No curve within the slopes, or none of at most so many segments, is as close.
    """
    n = search.problem.samples
    ideal = math.sqrt(search.ideal_error / n)
    if bound < ideal * (1.0 - BARELY):
        raise Infeasible(
            f"max_rms and v_max: got {bound * unit:.6g} rad, but with slopes within ±v_max no "
            f"curve comes closer than {ideal * unit:.6g} rad rms; allow that much or a larger v_max"
        )
    enough = n * (bound * (1.0 + BARELY)) ** 2 + ROUNDING * n
    if most is None and search.exact is not None and search.exact.error <= enough:
        return search.exact
    last = search.most if most is None else min(most, search.most)

    def close_enough(segments: int) -> Candidate | None:
        curve = search.curve(segments)
        if enough < curve.error <= NEARLY * enough:  # with values a little short of the best
            curve = search.valued(curve.knots)
        return curve if curve.error <= enough else None

    found = _fewest(close_enough, search.fewest, last, long=_is_long(search))
    if found is None:
        least = math.sqrt(search.curve(last).error / n)
        raise Infeasible(
            f"max_rms and the number of segments: got {bound * unit:.6g} rad, but with at most "
            f"{last} segments the smallest found is {least * unit:.6g} rad; allow more error or "
            "more segments"
        )
    return found


def within(search: Search, bound: float, most: int | None, unit: float) -> Candidate:
    """The fewest segments whose largest error is within ``bound``.

    Args:
        search: Curves through the samples.
        bound: Largest error [unit of the search]; kept with :data:`BARELY` to spare if that is
            attainable.
        most: Most segments; None for any number.
        unit: Unit of the search [rad], for the message.

    Returns:
        A curve with no error above ``bound``.

    Raises:
        Infeasible: No curve within the slopes, or none of at most so many segments, is as close.
    """
    problem = search.problem
    attainable = attainable_error(problem.desired, problem.step, cyclic=problem.cyclic)
    if bound < attainable * (1.0 - BARELY):
        raise Infeasible(
            f"max_error: got {bound * unit:.6g} rad, but with slopes within ±v_max the smallest "
            f"attainable is {attainable * unit:.6g} rad; allow that much or a larger v_max"
        )
    bound = max(attainable * (1.0 + 1e-12), bound * (1.0 - BARELY))
    closest = math.inf

    def close_enough(segments: int) -> Candidate | None:
        nonlocal closest
        curve, worst = flattened(problem, search.curve(segments), bound)
        closest = min(closest, worst)
        return curve if worst <= bound else None

    last = search.most if most is None else min(most, search.most)
    if problem.shortest <= 1.0 and not problem.required.size and problem.samples > FEW_SAMPLES:
        one_pass = swung(problem, bound)
        count = one_pass.knots.size - (not problem.cyclic)
        if count <= last:
            fewer = math.floor(FEWER * count)
            return _fewest(close_enough, search.fewest, count - 1, fewer) or one_pass
    found = _fewest(close_enough, search.fewest, last)
    if found is None and last == search.most:
        found = search.closest_everywhere()
    if found is None:
        raise Infeasible(
            f"max_error: got {bound * unit:.6g} rad, but with at most {last} segments the smallest "
            f"found is {closest * unit:.6g} rad ({attainable * unit:.6g} rad is attainable with "
            "enough of them); allow more error or more segments"
        )
    return found


def flattened(problem: Problem, curve: Candidate, bound: float) -> tuple[Candidate, float]:
    """A curve near ``curve`` with a smaller largest error, at least until it is within ``bound``.

    Weights grow where errors are large and the weighted curve is followed (Lawson's algorithm).
    """
    error = np.abs(residuals(problem, curve.knots, curve.values))
    best, least = curve, float(error.max())
    if least > HOPEFUL * bound:
        return best, least
    weights = problem.weights
    for _ in range(FLATTENINGS):
        if least <= bound:
            break
        weights = weights * (error / error.mean()) + 1e-6
        weights = weights / weights.mean()
        weighted = replace(problem, weights=weights)
        start = candidate(weighted, curve.knots, curve.values)
        curve = descend(weighted, start, rounds=3, only=error > bound)
        error = np.abs(residuals(problem, curve.knots, curve.values))
        if error.max() < least:
            best, least = curve, float(error.max())
    return candidate(problem, best.knots, best.values), least


def _is_long(search: Search) -> bool:
    """Whether one number of segments more takes long."""
    return search.problem.samples > MANY_SAMPLES


def _fewest(
    found_with: Callable[[int], Candidate | None],
    fewest: int,
    most: int,
    guess: int = 0,
    *,
    long: bool = False,
) -> Candidate | None:
    """The curve of the first number of segments that has one; few are tried where it is large.

    Args:
        found_with: The curve of a number of segments, if it is good enough.
        fewest: The least number.
        most: The largest number.
        guess: Where to begin, if it is many.
        long: Whether to leave some numbers out from the fewest on.
    """
    one_by_one = 0 if long else ONE_BY_ONE
    failed, count = fewest - 1, max(fewest, min(guess, most) if guess > ONE_BY_ONE else fewest)
    found = found_with(count)
    while found is not None and count > max(fewest, ONE_BY_ONE):  # the guess was high
        lower = max(fewest, ONE_BY_ONE, math.floor(count / WIDER))
        better = found_with(lower)
        if better is None:
            failed = lower
            break
        found, count = better, lower
    while found is None and count < most:
        failed = count
        count = min(most, count + 1 if count < one_by_one else math.ceil(WIDER * count))
        found = found_with(count)
    while found is not None and count - failed > 1 + math.floor(COARSE * count):
        middle = (failed + count) // 2
        better = found_with(middle)
        if better is None:
            failed = middle
        else:
            found, count = better, middle
    return found
