"""The cycle of fewest segments with knots on samples, and a lower bound on their number.

Some knot of every cycle lies in a window that no segment spans. So the fewest segments K are the
least over the samples s of the window of the closed paths from s to s a turn later. For each number
of segments, beginning with a lower bound, it is asked whether such a path exists: a path whose ends
lie in the same interval of values is looked for (:mod:`.path_on_samples`); if there is none, no
cycle has a value of the interval at s; if there is one, its end values are tried for a cycle, and
the interval is split between them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from planner.approximation.minimum_link.path import LINKS, Course, Gates, Link, next_link
from planner.approximation.minimum_link.path_on_samples import (
    links_left,
    links_left_on,
    path_within,
)


class Cut(NamedTuple):
    """A turn of a cycle as a path.

    Attributes:
        gates: Its gates, the first and the last one being the same place of the cycle.
        breaks: Numbers of the gates where there must be a knot, ends left out.
    """

    gates: Gates
    breaks: Sequence[int]


def shortest_window(gates: Gates) -> range:
    """The fewest samples in a row of which one is a knot of every cycle; O(n · longest segment).

    Args:
        gates: Gates of one turn, one sample apart, which no constant passes.

    Returns:
        Their indices; those of the second turn from n on.
    """
    n = len(gates.places)
    twice = Gates(
        [float(k) for k in range(2 * n)], list(gates.lower) * 2, list(gates.upper) * 2, gates.slope
    )
    shortest = range(n)
    for start in range(n):
        link = next_link(twice, start, min(start + len(shortest) + 1, 2 * n - 1))
        if isinstance(link, Link) and link.end - start < len(shortest):
            shortest = range(start + 1, link.end + 1)
    return shortest


def fewest_links_on_cycle(
    cuts: Sequence[Cut], order: Sequence[int], least: int, searches: int
) -> tuple[Course | None, int]:
    """The cycle of fewest segments with a knot where one of the cuts is.

    Args:
        cuts: The cycle cut at places of which one is a knot of every cycle, one sample apart.
        order: Numbers of the cuts, the most promising ones first.
        least: Lower bound on the segments.
        searches: Most searches for a path with the same number of segments.

    Returns:
        The cycle, None if none was found, and a lower bound on the segments of any. They are equal
        unless so many searches left a number of segments open; then the cycle has one more, and
        none is found if that number is left open, too.
    """
    likely, first = cuts[order[0]], cuts[0]
    cycle, _ = _cycle_within([likely], [links_left(likely.gates)], least, LINKS.trials)
    if cycle is not None:
        return cycle, least
    left = links_left_on(first.gates, first.breaks)
    if left[0] >= len(left):  # by rounding: knots at all samples can pass
        return None, least
    least = max(least, left[0] - (len(cuts) > 1))
    limits = [[max(number, 1) for number in left[k:-1]] + [1] * k + [0] for k in order]
    ordered = [cuts[k] for k in order]
    for count in range(least, len(left)):
        cycle, complete = _cycle_within(ordered, limits, count, searches)
        if cycle is not None:
            return cycle, least
        if count > least:
            break
        if complete:
            least = count + 1
    return None, least


def _cycle_within(
    cuts: Sequence[Cut], left: Sequence[Sequence[int]], count: int, searches: int
) -> tuple[Course | None, bool]:
    """A cycle of at most so many segments, and whether there is none if none is found.

    Args:
        cuts: Where it may be cut.
        left: Of each cut, lower bounds on the segments from every gate to the last one.
        count: Most segments.
        searches: Most searches for a path.
    """
    intervals = deque(
        (cut, limits, cut.gates.lower[0], cut.gates.upper[0])
        for cut, limits in zip(cuts, left, strict=True)
    )
    while intervals and searches > 0:
        cut, limits, low, high = intervals.popleft()
        path = _path_between(cut, limits, count, low, high)
        searches -= 1
        if path is None:
            continue
        ends = float(path.values[0]), float(path.values[-1])
        middle = min(max(0.5 * sum(ends), low), high)
        for value in dict.fromkeys((middle, *ends)):
            cycle = _path_between(cut, limits, count, value, value)
            searches -= 1
            if cycle is not None:
                return Course(cycle.knots[:-1], cycle.values[:-1], cycle.fewest), True
        intervals += [(cut, limits, low, middle), (cut, limits, middle, high)]
    return None, not intervals


def _path_between(
    cut: Cut, left: Sequence[int], count: int, low: float, high: float
) -> Course | None:
    """A path from an interval of values to the same a turn later."""
    gates = cut.gates
    lower, upper = [low, *gates.lower[1:-1], low], [high, *gates.upper[1:-1], high]
    return path_within(gates._replace(lower=lower, upper=upper), cut.breaks, left, count)
