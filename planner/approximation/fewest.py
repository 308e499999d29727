"""The path and the cycle of fewest segments through gates: minimum-link paths.

A gate is an interval of values at a place, and the path must pass all of them with slopes within
±v. The greedy algorithm is exact (docs/math.md, section 4): of the lines that pass the gates as far
as any line can, the one that comes closest to the gate that all of them miss is kept, and the next
line begins where it crosses that one. All lines lie between two extreme ones, the highest and the
lowest at all later gates. Each touches a convex hull of ends of gates behind it, so
that a gate costs O(1) on average. All decisions compare numbers one by one; none hangs on a sum.

The path through the same gates over and over keeps some line that misses a gate above it after one
that misses a gate below it, or the reverse, since a curve that always bends the same way cannot
come back. Every cycle crosses the second of these lines three times, on different segments, so that
some cycle of fewest segments contains it: it is an eave. From an eave on, the cycle is a path
again.

Sources: Suri (1986), Imai and Iri (1986), and Guibas, Hershberger, Mitchell and Snoeyink (1993),
whose ordered stabbing this is, for minimum-link paths; O'Rourke (1981) for the extreme lines; Ghosh
and Maheshwari (1990), who sought polygons between two others, for eaves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.approximation.values import envelope_below
from planner.trajectory import Array


class Course(NamedTuple):
    """A curve of few lines.

    Attributes:
        knots: Its knots, shape (K,); of a cycle without the first one again.
        values: Its values there, shape (K,).
        fewest: Lower bound on the segments of any such curve.
    """

    knots: Array
    values: Array
    fewest: int

    def shortest(self, period: float | None = None) -> float:
        """Length of its shortest segment; of a cycle, with its period [samples]."""
        end = [] if period is None else [self.knots[0] + period]
        return float(np.min(np.diff(np.append(self.knots, end)), initial=math.inf))


class Gates(NamedTuple):
    """Intervals that a curve must pass, by place.

    Attributes:
        places: Where the gates are, increasing [samples].
        lower: Least value of the curve at each.
        upper: Largest value of the curve at each.
        slope: Largest rise per sample, v.
    """

    places: Sequence[float]
    lower: Sequence[float]
    upper: Sequence[float]
    slope: float


class Line(NamedTuple):
    """A line through a point."""

    place: float
    value: float
    slope: float

    def at(self, place: float) -> float:
        """Its value at a place."""
        return self.value + self.slope * (place - self.place)

    @property
    def mirrored(self) -> Line:
        """The line upside down."""
        return Line(self.place, -self.value, -self.slope)


class Link(NamedTuple):
    """An extreme line, kept until the next one crosses it.

    They cross between gates ``touched`` and ``end`` + 1.

    Attributes:
        line: The line.
        rising: Whether it is the highest one, below gate ``end`` + 1; else the lowest, above it.
        touched: The gate whose far end it touches last: its upper end if rising, else its lower.
        before: The earlier gate whose opposite end it touches; -1 if its slope is at the bound.
        end: The last gate that it passes.
    """

    line: Line
    rising: bool
    touched: int
    before: int
    end: int


class LastLines(NamedTuple):
    """The highest and the lowest line at the last gate, where no gate is missed."""

    highest: Line
    lowest: Line


def fewest_links(gates: Gates, breaks: Sequence[int] = ()) -> Course:
    """The path of fewest segments through all gates; O(number of gates).

    A path that must have a knot at a gate falls into two parts there. The first part keeps its own
    fewest segments, since one more would save the second part one at most.

    Args:
        gates: Gates that slopes within the bound can pass.
        breaks: Numbers of the gates where there must be a knot, increasing, ends left out.

    Returns:
        The path; ``fewest`` is its number of segments. Where gates are one sample apart or more,
        so are its knots.
    """
    ends = [*breaks, len(gates.places) - 1]
    lower, upper = list(gates.lower), list(gates.upper)
    gates = gates._replace(lower=lower, upper=upper)
    if breaks:  # values there from which slopes can pass all the others
        ramp = gates.slope * np.array(gates.places)
        least, most = -envelope_below(-np.array(lower), ramp), envelope_below(np.array(upper), ramp)
        for k in breaks:
            lower[k], upper[k] = float(least[k]), float(max(most[k], least[k]))
    parts: list[tuple[list[Link], LastLines]] = []
    first = 0
    for last in ends:
        links, lines = _links_from(gates, next_link(gates, first, last), last)
        parts.append((links, lines))
        place = gates.places[last]
        lower[last] = min(max(lines.lowest.at(place), lower[last]), upper[last])
        upper[last] = max(min(lines.highest.at(place), upper[last]), lower[last])
        first = last
    knots, values = [gates.places[-1]], list[float]()
    for (links, lines), first, last in zip(
        parts[::-1], [*ends[-2::-1], 0], ends[::-1], strict=True
    ):
        if values:
            lower[last] = upper[last] = values[-1]
            lines = _pinned(gates, first, last, links, lines)
        final = _final(links, lines, gates.places[first])
        if not values:
            values.append(final.at(knots[0]))
        lines_of = [link.line for link in links] + [final]
        for link, line in zip(links[::-1], lines_of[:0:-1], strict=True):
            touched, missed = gates.places[link.touched], gates.places[link.end + 1]
            place = meeting(link.line, line, touched, missed)
            knots.append(place)
            values.append(link.line.at(place))
        knots.append(gates.places[first])
        values.append(min(max(lines_of[0].at(knots[-1]), lower[first]), upper[first]))
    return Course(np.array(knots[::-1]), np.array(values[::-1]), len(knots) - 1)


def fewest_links_around(gates: Gates) -> Course | None:
    """The cycle of fewest segments; O(number of gates).

    Args:
        gates: Gates of one turn, one sample apart, which no constant passes.

    Returns:
        The cycle from the first eave, its segments a sample long or longer if some choice of its
        last line makes them so; None if rounding hides all eaves.
    """
    n = len(gates.places)
    around = Gates(
        [float(k) for k in range(5 * n)], list(gates.lower) * 5, list(gates.upper) * 5, gates.slope
    )
    end = 5 * n - 1
    before: Link | None = None
    link = next_link(around, 0, end)
    turn = 0
    while isinstance(link, Link) and turn < 3:
        link = _later(link, n * turn)
        if before is not None and link.rising != before.rising:
            eave = _later(link, n * (1 - link.before // n))
            lines, joints, last = _closed(around, n, eave)
            choices = (last.highest, last.lowest, line_between(last, joints[-1].touched, 0.5))
            cycles = [_joined([*lines, line, _later(eave, n).line], joints, n) for line in choices]
            return max(cycles, key=lambda cycle: min(cycle.shortest(n), 1.0))
        turn, before = link.touched // n, link
        link = link_after(around, _later(link, -n * turn), end)
    return None


def _closed(around: Gates, n: int, eave: Link) -> tuple[list[Line], list[Link], LastLines]:
    """The lines from an eave until it can be joined a turn later, where they cross, and the last.

    A line joins it between the gate that it misses and the one that it touches first. Of the gates
    in between, only the ends away from the missed one count.

    Args:
        around: Gates of several turns.
        n: Gates of a turn.
        eave: The line, the gate that it touches first in the second turn.
    """
    missed = eave.before - 1
    while around.lower[missed] <= eave.line.at(missed) <= around.upper[missed]:
        missed -= 1
    target = _later(eave, n)
    last, free = target.before, slice(missed + n + 1, target.before + 1)
    lower, upper = list(around.lower[: last + 1]), list(around.upper[: last + 1])
    ends, far = (upper, math.inf) if target.rising else (lower, -math.inf)
    ends[free] = [far] * (free.stop - free.start)
    joined = around._replace(lower=lower, upper=upper)
    links, outcome = _links_from(joined, eave, last)
    joint = Link(target.line, target.rising, missed + n, -1, last - 1)
    return [link.line for link in links], [*links, joint], outcome


def _joined(lines: list[Line], links: list[Link], n: int) -> Course:
    """The cycle of lines that cross one after the other, the last of them the first one again."""
    places = [
        meeting(line, after, float(link.touched), float(link.end + 1))
        for line, after, link in zip(lines[:-1], lines[1:], links, strict=True)
    ]
    values = [line.at(place) for line, place in zip(lines[:-1], places, strict=True)]
    return Course(np.array(places) - n * math.floor(places[0] / n), np.array(values), len(links))


def _later(link: Link, shift: int) -> Link:
    """A line and the numbers of its gates, so many samples later."""
    line = link.line._replace(place=link.line.place + shift)
    before = link.before + shift if link.before >= 0 else -1
    return Link(line, link.rising, link.touched + shift, before, link.end + shift)


def _links_from(gates: Gates, outcome: Link | LastLines, last: int) -> tuple[list[Link], LastLines]:
    """The lines kept from one on, up to a gate, and those that remain for the last segment."""
    links: list[Link] = []
    while isinstance(outcome, Link):
        links.append(outcome)
        outcome = link_after(gates, outcome, last)
    return links, outcome


def _pinned(gates: Gates, first: int, last: int, links: list[Link], lines: LastLines) -> LastLines:
    """The last lines through the one value that is left at the last gate."""
    outcome = link_after(gates, links[-1], last) if links else next_link(gates, first, last)
    if isinstance(outcome, LastLines):
        return outcome
    place = gates.places[last]  # missed by a rounding error
    top, bottom = lines.highest.at(place), lines.lowest.at(place)
    share = (gates.lower[last] - bottom) / (top - bottom) if top > bottom else 0.5
    through = line_between(lines, gates.places[first], min(max(share, 0.0), 1.0))
    return LastLines(through, through)


def _final(links: list[Link], lines: LastLines, place: float) -> Line:
    """The last line: the one that crosses the line before it first, else that in the middle."""
    if links:
        return lines.lowest if links[-1].rising else lines.highest
    return line_between(lines, place, 0.5)


def line_between(lines: LastLines, place: float, share: float) -> Line:
    """The line at a share of the way from the lowest to the highest one."""
    top, bottom = lines
    value = (1.0 - share) * bottom.at(place) + share * top.at(place)
    return Line(place, value, (1.0 - share) * bottom.slope + share * top.slope)


def meeting(first: Line, second: Line, least: float, most: float) -> float:
    """Where two lines cross, which is known to be between two places."""
    place, value, slope = first
    turn = slope - second.slope
    if turn == 0.0:
        return least
    return min(max(place + (second.at(place) - value) / turn, least), most)


def next_link(
    gates: Gates, start: int, last: int, *, half: int = -1, rising: bool = False
) -> Link | LastLines:
    """The line kept next, or the last ones if a line passes all gates from ``start`` to ``last``.

    Args:
        gates: All gates.
        start: The first gate that counts, the one that the link before touched last.
        last: The last gate that counts.
        half: The last gate that the link before passes. Up to it, only the ends away from that link
            count: on the near side the line is beyond it before they cross.
        rising: Whether the link before is rising.
    """
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
            return Link(lowest.line.mirrored, False, lowest.touched, lowest.before, k - 1)
        if upper < top:
            highest.tighten(k, place, upper)
        if lower > bottom:
            lowest.tighten(k, place, -lower)
        if lower > -math.inf:
            highest.add(k, place, lower)
        if upper < math.inf:
            lowest.add(k, place, -upper)
    return LastLines(highest.line, lowest.line.mirrored)


def link_after(gates: Gates, link: Link, last: int) -> Link | LastLines:
    """The line kept after another one."""
    return next_link(gates, link.touched, last, half=link.end, rising=link.rising)


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
