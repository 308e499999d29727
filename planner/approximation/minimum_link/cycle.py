"""The cycle of fewest segments through periodic gates.

The path through the same gates over and over (:func:`.path.fewest_links`) keeps some line that
misses a gate above it after one that misses a gate below it, or the reverse, since a curve that
always bends the same way cannot come back. Every cycle crosses the second of these lines three
times, on different segments, so that some cycle of fewest segments contains it: it is an eave. From
an eave on, the cycle is a path again (docs/math.md, section 4).

Source: Ghosh and Maheshwari (1990), for polygons between two others.
"""

from __future__ import annotations

import math

import numpy as np

from planner.approximation.minimum_link.path import (
    LINKS,
    Course,
    Gates,
    LastLines,
    Line,
    Link,
    line_between,
    meeting,
    next_link,
)
from planner.approximation.problem import SHORTEST


def fewest_links_around(gates: Gates) -> Course | None:
    """The cycle of fewest segments; O(number of gates).

    Args:
        gates: Gates of one turn, one sample apart, which no constant passes.

    Returns:
        The cycle. Of those of several eaves, one whose segments are a sample long or longer if one
        of the first ``LINKS.eaves`` has such a cycle. None if rounding hides all eaves.
    """
    n = len(gates.places)
    around = Gates(
        [float(k) for k in range(5 * n)], list(gates.lower) * 5, list(gates.upper) * 5, gates.slope
    )
    end = 5 * n - 1
    cycles: list[Course] = []
    before: Link | None = None
    link = next_link(around, 0, end)
    turn = 0
    while isinstance(link, Link) and turn < 3 and len(cycles) < 3 * LINKS.eaves:
        link = _later(link, n * turn)
        if before is not None and link.rising != before.rising:
            eave = _later(link, n * (1 - link.before // n))
            lines, joints, last = _closed(around, n, eave)
            for line in (last.highest, last.lowest, line_between(last, joints[-1].touched, 0.5)):
                cycle = _around([*lines, line, _later(eave, n).line], joints, n)
                cycles.append(_turned(cycle, n))
                if cycles[-1].shortest(n) >= SHORTEST:
                    return cycles[-1]
        turn, before = link.touched // n, link
        own = _later(link, -n * turn)
        link = next_link(around, own.touched, end, half=own.end, rising=own.rising)
    return max(cycles, key=lambda cycle: cycle.shortest(n), default=None)


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
    links: list[Link] = []
    found: Link | LastLines = eave
    while isinstance(found, Link):
        links.append(found)
        found = next_link(joined, found.touched, last, half=found.end, rising=found.rising)
    joint = Link(target.line, target.rising, missed + n, -1, last - 1)
    return [link.line for link in links], [*links, joint], found


def _around(lines: list[Line], links: list[Link], n: int) -> Course:
    """The cycle of lines that cross one after the other, the last of them the first one again."""
    knots, values = [], []
    for line, after, link in zip(lines[:-1], lines[1:], links, strict=True):
        place = meeting(line, after, float(link.touched), float(link.end + 1))
        knots.append(place)
        values.append(line.at(place))
    start = n * math.floor(knots[0] / n)
    return Course(np.array(knots) - start, np.array(values), len(links))


def _turned(cycle: Course, n: int) -> Course:
    """The cycle, segments shorter than a sample turned about the one gate that they pass.

    One is turned until it meets the line before it at the gate before, or the line after it at the
    gate after, if that line is not too short then.
    """
    rounding = 1.0 - SHORTEST
    knots, values = cycle.knots.copy(), cycle.values.copy()
    size = knots.size
    for k in np.flatnonzero(np.diff(np.append(knots, knots[0] + n)) < SHORTEST):
        number = np.arange(k - 1, k + 3)  # knots of the line before, of this one, of that after
        x = knots[number % size] + n * (number // size)
        y = values[number % size]
        gate = math.ceil(x[1] - rounding)
        if size < 4 or gate > x[2] + rounding:
            continue
        before, after = (Line(x[i], y[i], (y[i + 1] - y[i]) / (x[i + 1] - x[i])) for i in (0, 2))
        pivot = float(np.interp(gate, x, y))
        for place, kept, other in ((gate - 1.0, before, after), (gate + 1.0, after, before)):
            value = kept.at(place)
            line = Line(gate, pivot, (pivot - value) / (gate - place))
            turn = line.slope - other.slope
            met = gate + (other.at(gate) - pivot) / turn if turn else math.inf
            ends = sorted([place, met])
            crosses = abs(2.0 * met - 3.0 * gate + place) <= 1.0  # from the gate to the next
            if crosses and min(ends[0] - x[0], ends[1] - ends[0], x[3] - ends[1]) >= SHORTEST:
                inner = number[1:3]
                knots[inner % size] = np.array(ends) - n * (inner // size)
                values[inner % size] = [line.at(end) for end in ends]
                break
    return Course(knots, values, cycle.fewest)


def _later(link: Link, shift: int) -> Link:
    """A line and the numbers of its gates, so many samples later."""
    line = link.line._replace(place=link.line.place + shift)
    before = link.before + shift if link.before >= 0 else -1
    return Link(line, link.rising, link.touched + shift, before, link.end + shift)
