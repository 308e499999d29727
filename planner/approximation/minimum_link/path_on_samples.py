"""The fewest segments within a largest error, knots on samples or segments of a least length.

Dynamic programming over the samples. The values at a sample at which a path of s segments with a
knot there can end are a union of intervals, since all lines from an interval through the gates
after it (see :mod:`planner.approximation.minimum_link.path`) are a convex set.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from planner.approximation.minimum_link.path import (
    LINKS,
    Course,
    Extreme,
    Gates,
    Line,
    Link,
    next_link,
)
from planner.approximation.problem import BARELY_SHORT

INTERVAL_ROUNDING = 1e-13
"""Part of an interval, in units of the samples, that is not worth a path of its own."""


class _Piece(NamedTuple):
    """Values at a gate to which lines from one interval lead."""

    least: float
    most: float
    start: _Reached


class _Reached(NamedTuple):
    """An interval of values at a gate in which paths of so many segments end, by their last one."""

    gate: int
    least: float
    most: float
    pieces: list[_Piece]


def fewest_links_on(
    gates: Gates, breaks: Sequence[int], shortest: float, may_be: Sequence[bool]
) -> Course | None:
    """The path of fewest segments through all gates with knots at gates.

    Args:
        gates: Gates that slopes within the bound can pass.
        breaks: Numbers of the gates where there must be a knot, ends left out.
        shortest: Length of the shortest segment [samples].
        may_be: Which gates may be knots.

    Returns:
        The path, exact; None if no path has segments so long. O(gates · longest segment) where
        little more than the fewest segments of any path will do: a first search, which keeps for
        every gate only paths with at most one segment more than the first to reach it, bounds the
        number, and a second one leaves out paths that cannot have fewer.
    """
    path = _searched(gates, breaks, shortest, may_be, None)
    if path is None:
        return _searched(gates, breaks, shortest, may_be, [len(gates.places)] * len(gates.places))
    limits = [path.fewest - 1 - left for left in links_left(gates)]
    return _searched(gates, breaks, shortest, may_be, limits) or path


def _searched(
    gates: Gates,
    breaks: Sequence[int],
    shortest: float,
    may_be: Sequence[bool],
    limits: Sequence[int] | None,
) -> Course | None:
    """The path, each gate reached with so many segments at most.

    Args:
        gates: Gates that slopes within the bound can pass.
        breaks: Numbers of the gates where there must be a knot.
        shortest: Length of the shortest segment [samples].
        may_be: Which gates may be knots.
        limits: Most segments up to each gate; None for one more than the first path to it has.
    """
    last = len(gates.places) - 1
    for segments, pieces in _by_segments(gates, breaks, shortest, may_be, limits):
        if last in pieces:
            widest = max(pieces[last], key=lambda piece: piece.most - piece.least)
            end = _Reached(last, widest.least, widest.most, [widest])
            return _back(gates, end, segments)
    return None


def _by_segments(
    gates: Gates,
    breaks: Sequence[int],
    shortest: float,
    may_be: Sequence[bool],
    limits: Sequence[int] | None,
) -> Iterator[tuple[int, dict[int, list[_Piece]]]]:
    """The gates reached with one segment, with two, and so on, and the values there."""
    last = len(gates.places) - 1
    must = set(breaks)
    covered: list[list[tuple[float, float]]] = [[] for _ in range(last + 1)]
    most = [last + 1] * (last + 1) if limits is None else list(limits)
    frontier = [_Reached(0, gates.lower[0], gates.upper[0], [])]
    segments = 0
    while frontier:
        segments += 1
        pieces: dict[int, list[_Piece]] = {}
        for start in frontier:
            for gate, low, high in _onward(gates, start, shortest, must, may_be):
                if segments <= most[gate]:
                    pieces.setdefault(gate, []).append(_Piece(low, high, start))
        yield segments, pieces
        frontier = []
        for gate in sorted(pieces):
            if limits is None:
                most[gate] = min(most[gate], segments + 1)
            for reached in _intervals(gate, pieces[gate]):
                if _adds(covered[gate], reached.least, reached.most):
                    frontier.append(reached)


def path_within(
    gates: Gates, breaks: Sequence[int], left: Sequence[int], count: int
) -> Course | None:
    """The path of fewest segments with knots at gates; None if it has more than ``count``.

    Args:
        gates: Gates that slopes within the bound can pass.
        breaks: Numbers of the gates where there must be a knot, ends left out.
        left: Lower bounds on the segments from every gate to the last one.
        count: Most segments of the path.
    """
    limits = [count - number for number in left]
    return _searched(gates, breaks, 0.0, [True] * len(limits), limits)


def links_left_on(gates: Gates, breaks: Sequence[int]) -> list[int]:
    """Least number of segments from every gate to the last one, knots at gates."""
    size = len(gates.places)
    behind, must = _reversed(gates), [size - 1 - k for k in breaks]
    first: dict[int, int] = {0: 0}
    for segments, pieces in _by_segments(behind, must, 0.0, [True] * size, [size] * size):
        for gate in pieces:
            first.setdefault(gate, segments)
        if len(first) == size:
            break
    return [first.get(k, size) for k in range(size - 1, -1, -1)]


def links_left(gates: Gates) -> list[int]:
    """Least number of segments from every gate to the last one, knots anywhere."""
    last = len(gates.places) - 1
    behind = _reversed(gates)
    ends = []
    link = next_link(behind, 0, last)
    while isinstance(link, Link):
        ends.append(link.end)
        link = next_link(behind, link.touched, last, half=link.end, rising=link.rising)
    return [1 + bisect_left(ends, k) if k else 0 for k in range(last, -1, -1)]


def _reversed(gates: Gates) -> Gates:
    places = [-place for place in gates.places[::-1]]
    return Gates(places, gates.lower[::-1], gates.upper[::-1], gates.slope)


def _intervals(gate: int, pieces: list[_Piece]) -> list[_Reached]:
    """The intervals that pieces make up."""
    intervals: list[_Reached] = []
    for piece in sorted(pieces, key=lambda piece: piece.least):
        if intervals and piece.least <= intervals[-1].most + INTERVAL_ROUNDING:
            own = intervals[-1]
            own.pieces.append(piece)
            most = max(own.most, piece.most)
            intervals[-1] = _Reached(gate, own.least, most, own.pieces)
        else:
            intervals.append(_Reached(gate, piece.least, piece.most, [piece]))
    return intervals


def stride(gates: int, longest: float) -> int:
    """Distance between gates that may be knots [gates]: it bounds the work."""
    return max(1, math.ceil(gates * longest / LINKS.work))


def _onward(
    gates: Gates, start: _Reached, shortest: float, must: set[int], may_be: Sequence[bool]
) -> list[tuple[int, float, float]]:
    """Gates that lines from one interval reach, and the values there."""
    places, lowers, uppers, slope = gates
    highest, lowest = Extreme(slope), Extreme(slope)
    begin, origin = start.gate, places[start.gate]
    highest.tighten(begin, origin, start.most)
    lowest.tighten(begin, origin, -start.least)
    highest.add(begin, origin, start.least)
    lowest.add(begin, origin, -start.most)
    reached = []
    for k in range(begin + 1, len(places)):
        place, lower, upper = places[k], lowers[k], uppers[k]
        top, bottom = highest.line.at(place), -lowest.line.at(place)
        if top < lower or bottom > upper:
            break
        if upper < top:
            highest.tighten(k, place, upper)
            top = upper
        if lower > bottom:
            lowest.tighten(k, place, -lower)
            bottom = lower
        if may_be[k] and place - origin >= shortest - BARELY_SHORT:
            reached.append((k, bottom, top))
        if k in must:
            break
        if lower > -math.inf:
            highest.add(k, place, lower)
        if upper < math.inf:
            lowest.add(k, place, -upper)
    return reached


def _adds(covered: list[tuple[float, float]], least: float, most: float) -> bool:
    """Whether an interval is not within those before; it is joined to them then."""
    for low, high in covered:
        if low - INTERVAL_ROUNDING <= least and most <= high + INTERVAL_ROUNDING:
            return False
    apart = []
    for low, high in covered:
        if high < least - INTERVAL_ROUNDING or low > most + INTERVAL_ROUNDING:
            apart.append((low, high))
        else:
            least, most = min(least, low), max(most, high)
    covered[:] = [*apart, (least, most)]
    return True


def _back(gates: Gates, end: _Reached, segments: int) -> Course:
    """Knots and values of a path, from its end."""
    knots, values = [gates.places[end.gate]], [0.5 * (end.least + end.most)]
    reached = end
    while reached.pieces:
        value = values[-1]
        piece = max(reached.pieces, key=lambda one: min(value - one.least, one.most - value))
        line = _line_to(gates, piece.start, reached.gate, value)
        reached = piece.start
        knots.append(gates.places[reached.gate])
        values.append(min(max(line.at(knots[-1]), reached.least), reached.most))
    return Course(np.array(knots[::-1]), np.array(values[::-1]), segments)


def _line_to(gates: Gates, start: _Reached, end: int, value: float) -> Line:
    """A line from an interval through the gates to a value."""
    place = gates.places[end]
    slopes = -gates.slope, gates.slope
    for k in range(start.gate, end):
        lower, upper = gates.lower[k], gates.upper[k]
        if k == start.gate:
            lower, upper = start.least, start.most
        run = place - gates.places[k]
        slopes = max(slopes[0], (value - upper) / run), min(slopes[1], (value - lower) / run)
    return Line(place, value, 0.5 * (slopes[0] + slopes[1]))
