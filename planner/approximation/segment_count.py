"""The number of segments: the fewest whose rms error is small enough."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from planner.approximation.problem import BARELY, Candidate
from planner.approximation.search import KnotSearch
from planner.exceptions import Infeasible, angle_text
from planner.trajectory import Array

CLOSE_TO_IDEAL = 1.02
"""Rms over the ideal's from which on more segments are not worth their corners."""

FLOOR = 0.01
"""Rms, relative to the range of the samples, below which more segments are not worth their
corners."""

ABOVE_NOISE = 1.1
"""Rms over the noise of the samples that is not worth corners either."""

ONE_BY_ONE = 16
"""Segments up to which every number is tried; beyond, a bracket grows and is halved. 8: more
segments in 5 of 99 answers; 32: no change."""

LIKELY = 1.02
"""Squared error of a rough curve over what is enough, up to which that number of segments is
searched in full at once. 1: more segments in 1 of 99 answers; 1.04: no change."""

HOPELESS = 1.75
"""The same from which on a number is not searched. Of 364 curves the full search lowered it by 1.04
in one of ten, by 1.4 in one of a hundred, by 2.4 at most."""


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

    fewest = _fewest(search, enough, close_enough, search.most)
    return search.curve(search.most) if fewest is None else fewest


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
            f"max_rms and v_max: got {angle_text(bound * unit)}, but with slopes within ±v_max no "
            f"curve comes closer than {angle_text(ideal * unit)} rms; allow that much or a larger "
            "v_max"
        )
    enough = n * (bound * (1.0 + BARELY)) ** 2 + 1e-24 * n
    if most is None and search.exact is not None and search.exact.error <= enough:
        return search.exact
    last = search.most if most is None else min(most, search.most)

    def close_enough(segments: int) -> Candidate | None:
        curve = search.curve(segments)
        if enough < curve.error <= 1.001 * enough:  # with values a little short of the best
            curve = search.valued(curve.knots)
        return curve if curve.error <= enough else None

    fewest = _fewest(search, enough, close_enough, last)
    if fewest is None:
        least = math.sqrt(search.curve(last).error / n)
        raise Infeasible(
            f"max_rms and the number of segments: got {angle_text(bound * unit)}, but with at most "
            f"{last} segments the smallest found is {angle_text(least * unit)}; allow more error "
            "or more segments"
        )
    return fewest


def _fewest(
    search: KnotSearch,
    enough: float,
    close_enough: Callable[[int], Candidate | None],
    most: int,
) -> Candidate | None:
    """The curve of fewest segments whose error is small enough; few numbers are searched in full.

    Rough curves give a number that is surely enough. From there the numbers decrease by one, each
    searched in full, until one is not enough: fewer segments are assumed to be no better. Beyond
    :data:`ONE_BY_ONE` segments the number is found by bisection.

    Args:
        search: Curves through the samples.
        enough: Squared error that is small enough.
        close_enough: The curve of a number of segments, if it is good enough.
        most: The largest number.
    """
    fewest = None
    count = search.fewest
    failed = without = count - 1  # the number before; the last searched in full and without any
    while True:
        if count == most or search.rough_error(count) <= LIKELY * enough:
            fewest = close_enough(count)
            without = without if fewest else count
        if fewest is not None or count == most:
            break
        failed = count
        count = min(most, count + 1 if count < ONE_BY_ONE else math.ceil(1.3 * count))
    if fewest is not None and count <= ONE_BY_ONE:
        while count - 1 > without and search.rough_error(count - 1) <= HOPELESS * enough:
            fewer = close_enough(count - 1)
            if fewer is None:
                break
            fewest, count = fewer, count - 1
        return fewest
    while fewest is not None and count - failed > 1 + math.floor(0.004 * count):
        middle = (failed + count) // 2
        better = close_enough(middle)
        if better is None:
            failed = middle
        else:
            fewest, count = better, middle
    return fewest
