"""How many segments: as few as do what was asked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from planner.approximation.knot_search import SEARCH, KnotSearch
from planner.approximation.largest_error import BARELY
from planner.approximation.problem import Candidate
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

ROUNDING = 1e-24
"""Mean squared error of samples of size one that is left to rounding."""

NEARLY = 1.001
"""Squared error over its bound up to which the values at a curve's knots are sought anew."""


def automatic(search: KnotSearch) -> Candidate:
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


def within_rms(search: KnotSearch, bound: float, most: int | None, unit: float) -> Candidate:
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


def _is_long(search: KnotSearch) -> bool:
    """Whether one number of segments more takes long."""
    return search.problem.samples > SEARCH.many_samples


def _fewest(
    found_with: Callable[[int], Candidate | None],
    fewest: int,
    most: int,
    *,
    long: bool = False,
) -> Candidate | None:
    """The curve of the first number of segments that has one; few are tried where it is large.

    Args:
        found_with: The curve of a number of segments, if it is good enough.
        fewest: The least number.
        most: The largest number.
        long: Whether to leave some numbers out from the fewest on.
    """
    one_by_one = 0 if long else ONE_BY_ONE
    failed, count = fewest - 1, fewest
    found = found_with(count)
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
