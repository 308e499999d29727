"""The path and the cycle of fewest segments through gates: minimum-link paths.

A gate is an interval of values at a place, and the path must pass all of them with slopes within
±v. The greedy algorithm, Guibas, Hershberger, Mitchell and Snoeyink's ordered stabbing (1993), is
exact (docs/math.md, section 4). All lines lie between two extreme ones (O'Rourke 1981), the highest
and the lowest at all later gates, each of which touches a convex hull of ends of gates behind it,
so that a gate costs O(1) on average.

The path through the same gates over and over keeps some line that misses a gate above it after one
that misses a gate below it, or the reverse. Every cycle crosses the second of these lines three
times, so that some cycle of fewest segments contains it: it is an eave (Ghosh and Maheshwari 1990).
From an eave on, the cycle is a path again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planner.approximation.values import envelope_below
from planner.arrays import Array
from planner.exceptions import SolverFailed

REACHED = 1e-13
"""Width of a gate that lines are known to reach, so that rounding does not keep them from it."""


class Gates(NamedTuple):
    """Intervals that a curve must pass, by place."""

    places: Sequence[float]  # increasing [samples]
    lower: Sequence[float]  # least value of the curve at each
    upper: Sequence[float]  # largest value of the curve at each
    slope: float  # largest rise per sample, v

    def reachable(self) -> tuple[Array, Array]:
        """Least and largest value at each from which slopes can pass all others."""
        ramp = self.slope * np.array(self.places)
        least = -envelope_below(-np.array(self.lower), ramp)
        return least, np.maximum(envelope_below(np.array(self.upper), ramp), least)


class Line(NamedTuple):
    """A line through a point."""

    place: float
    value: float
    slope: float

    def at(self, place: float) -> float:
        """Its value at a place."""
        return self.value + self.slope * (place - self.place)

    def __neg__(self) -> Line:
        """The line of the opposite values."""
        return Line(self.place, -self.value, -self.slope)


class Link(NamedTuple):
    """An extreme line, kept until the next one crosses it, between gates ``touched``, ``end`` + 1.

    Of the gates that it touches, it does so at opposite ends.
    """

    line: Line
    rising: bool  # whether it is the highest one, below gate end + 1; else the lowest, above it
    touched: int  # the last gate that it touches: at its upper end if rising, else at its lower
    before: int  # the gate that it touches before; -1 if its slope is at the bound
    end: int  # the last gate that it passes


def fewest_links(gates: Gates, breaks: Sequence[int] = ()) -> tuple[Array, Array]:
    """Knots and values of the path of fewest segments through all gates; O(number of gates).

    The path must have a knot at the gates whose numbers are ``breaks``, increasing, ends left out:
    it falls into parts there. A part keeps its own fewest segments, since one more would save the
    next part one at most. Where gates are one sample apart or more, so are the knots.
    """
    lower, upper = list(gates.lower), list(gates.upper)
    gates = gates._replace(lower=lower, upper=upper)
    parts = list(pairwise([0, *breaks, len(lower) - 1]))
    if breaks:
        least, most = gates.reachable()
        for first, last in parts[:-1]:
            lower[last], upper[last] = float(least[last]), float(most[last])
            ends = [each.at(gates.places[last]) for each in links_from(gates, last, start=first)[1]]
            highest, lowest = (min(max(each, lower[last]), upper[last]) for each in ends)
            lower[last], upper[last] = min(lowest, highest), highest
    knots, values = list[float](), list[float]()
    for first, last in reversed(parts):
        links, lines = links_from(gates, last, start=first)
        start, end = gates.places[first], gates.places[last]
        if links:  # the last line: the one that crosses the line before it first
            final = lines[links[-1].rising]
        else:
            top, bottom = lines
            middle = 0.5 * (top.at(start) + bottom.at(start))
            final = Line(start, middle, 0.5 * (top.slope + bottom.slope))
        places, heights = joints(gates, links, final)
        begin = min(max((links[0].line if links else final).at(start), lower[first]), upper[first])
        if not knots:
            knots, values = [end], [final.at(end)]
        knots, values = [start, *places, *knots], [begin, *heights, *values]
        lower[first], upper[first] = begin - REACHED, begin + REACHED
    return np.array(knots), np.array(values)


def fewest_links_around(gates: Gates) -> tuple[Array, Array]:
    """Likewise for a cycle, from an eave on.

    From the first eave on it is a path to the same line a turn later, which passes both gates that
    the eave touches. Gates are one sample apart, and no constant passes them. SolverFailed is
    raised where rounding hides all eaves, which it did for none of 30,000 random cycles.
    """
    n = len(gates.places)
    places = [float(k) for k in range(8 * n)]
    around = Gates(places, list(gates.lower) * 8, list(gates.upper) * 8, gates.slope)
    before, link = None, next_link(around, 8 * n - 1)
    while isinstance(link, Link) and link.touched < 4 * n:
        if before is not None and link.rising != before.rising:
            break
        before, link = link, next_link(around, 8 * n - 1, after=link)
    else:
        raise SolverFailed("fewest segments of a cycle", "no eave")
    line, size, first = link.line, link.touched - link.before, link.before
    turn = slice(first, first + n)
    lower = [*around.lower[turn], *[-math.inf] * (size + 1)]
    upper = [*around.upper[turn], *[math.inf] * (size + 1)]
    for k in (0, size):
        lower[n + k] = line.at(first + k) - REACHED
        upper[n + k] = line.at(first + k) + REACHED
    path = Gates(places[: n + size + 1], lower, upper, gates.slope)
    eave = Link(line._replace(place=line.place - first), link.rising, size, 0, link.end - first)
    links = [eave, *links_from(path, n + size, after=eave)[0]]
    again = eave.line._replace(place=eave.line.place + n)
    knots, values = joints(path, links, again)
    shift = first - n * math.floor((first + knots[0]) / n)
    return np.array(knots) + shift, np.array(values)


def joints(gates: Gates, links: Sequence[Link], final: Line) -> tuple[list[float], list[float]]:
    """Where lines cross one after the other, and the final one at last, and their values there."""
    following = [*(link.line for link in links[1:]), final]
    places = []
    for link, line in zip(links, following, strict=False):  # without links nothing crosses
        (place, value, slope), least = link.line, gates.places[link.touched]
        away = line.at(place) - value
        crossing = place + away / (slope - line.slope) if slope != line.slope else least
        places.append(min(max(crossing, least), gates.places[link.end + 1]))
    return places, [link.line.at(place) for link, place in zip(links, places, strict=True)]


def links_from(
    gates: Gates, last: int, *, start: int = 0, after: Link | None = None
) -> tuple[list[Link], tuple[Line, Line]]:
    """The lines kept one after the other, and those that remain for the last segment."""
    links, outcome = list[Link](), next_link(gates, last, start=start, after=after)
    while isinstance(outcome, Link):
        links.append(outcome)
        outcome = next_link(gates, last, after=outcome)
    return links, outcome


def next_link(
    gates: Gates, last: int, *, start: int = 0, after: Link | None = None
) -> Link | tuple[Line, Line]:
    """The line kept next, or the highest and the lowest one if some pass all gates to ``last``.

    After a link the first gate is the one that it touched last; up to the last gate that it passes,
    only the ends away from it count: on the near side the line is beyond it before they cross.
    """
    half, rising = -1, False
    if after is not None:
        start, half, rising = after.touched, after.end, after.rising
    places, lowers, uppers, slope = gates
    highest, lowest = Extreme(slope), Extreme(slope)
    for k in range(start, last + 1):
        place, lower, upper = places[k], lowers[k], uppers[k]
        if k <= half:
            lower, upper = (-math.inf, upper) if rising else (lower, math.inf)
        top, bottom = highest.line.at(place), -lowest.line.at(place)
        if top < lower and highest.before < 0:  # by rounding: slopes within the bound can pass
            lower = top
        if bottom > upper and lowest.before < 0:
            upper = bottom
        if top < lower:
            return Link(highest.line, True, highest.touched, highest.before, k - 1)
        if bottom > upper:
            return Link(-lowest.line, False, lowest.touched, lowest.before, k - 1)
        if upper < top:
            highest.tighten(k, place, upper)
        if lower > bottom:
            lowest.tighten(k, place, -lower)
        if lower > -math.inf:
            highest.add(k, place, lower)
        if upper < math.inf:
            lowest.add(k, place, -upper)
    return highest.line, -lowest.line


class Extreme:
    """Of the lines above all lower ends and below all upper ends, the one that is highest later on.

    It goes through an upper end and, unless its slope is the largest, through a lower end before
    it. Mirrored, the same serves for the lowest.
    """

    def __init__(self, slope: float) -> None:
        """No gate so far: it is infinitely high."""
        self.line = Line(0.0, math.inf, 0.0)
        self.touched, self.before = -1, -1
        self._slope = slope
        self._hull: list[tuple[float, float, int]] = []  # lower ends, a concave chain
        self._first = 0  # ends before it will not be touched again

    def tighten(self, gate: int, place: float, upper: float) -> None:
        """Turn the line down to an upper end below it."""
        hull, k = self._hull, self._first
        slope, before = self._slope, -1
        if k < len(hull):
            x, y, _ = hull[k]
            tangent = (upper - y) / (place - x)
            while k + 1 < len(hull):
                x, y, _ = hull[k + 1]
                further = (upper - y) / (place - x)
                if further > tangent:
                    break
                tangent, k = further, k + 1
            self._first = k
            if tangent < slope:
                slope, before = tangent, hull[k][2]
        self.line = Line(place, upper, slope)
        self.touched, self.before = gate, before

    def add(self, gate: int, place: float, lower: float) -> None:
        """Keep a lower end for later tangents."""
        hull = self._hull
        while len(hull) - self._first >= 2:
            (x1, y1, _), (x2, y2, _) = hull[-2], hull[-1]
            if (y2 - y1) * (place - x2) > (lower - y2) * (x2 - x1):
                break
            hull.pop()
        hull.append((place, lower, gate))
