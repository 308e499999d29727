"""A pattern search for the knots of a closed form, by the simulated tracking error.

A pattern search (R. Hooke, T. A. Jeeves, "Direct search" solution of numerical and statistical
problems, Journal of the ACM 8, 1961) on the simulated error. The approximation nearest to the
desired trajectory is not the one whose inverse tracks it best: a joint rounds corners, and it
cannot follow a segment shorter than its acceleration time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.planning.line_inverse import (
    AT_TOP_SPEED,
    Rule,
    advanced_load,
    interpolated_offset,
    slope_limits,
)
from planner.planning.problem import Problem
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class PatternSearchOptions:
    """What steers the search.

    In brackets what half and twice the value do to the tracking error of 22 closed forms of six
    segments: mean and worst change in per cent. Not to search at all costs 8 and 35.

    Attributes:
        coarsest: First size of a move [samples]; values move by as much as the joint can in that
            time (-0.7 and 1.7; -0.7 and 0.1).
        finest: Size of a move below which the search ends [samples] (-0.4 and 0, for 20 % more
            time; 0.8 and 3.3).
        most_work: Samples simulated in one search, so that its cost does not grow with the number
            of knots (0.6 and 6.9; 0 and 0).
    """

    coarsest: float = 2.0
    finest: float = 0.2
    most_work: int = 80_000


OPTIONS = PatternSearchOptions()

LOWER = 1.0 - 1e-4
"""Share of the squared error down to which a move must bring it to be kept [-]."""


class Move(NamedTuple):
    """A change of knots and values, for a size of one sample."""

    knots: Array  # [samples]
    values: Array  # [rad]


class TrackingError:
    """Squared tracking error of the inverse of a piecewise linear curve, as its knots move."""

    def __init__(self, problem: Problem, curve: PiecewiseLinear, rule: Rule, ahead: float) -> None:
        """Take what stays the same for every move."""
        self.problem = problem
        self.curve = curve
        self.ahead = ahead
        self.moments = np.arange(curve.samples, dtype=np.float64) + ahead
        (self.model,) = problem.models
        self.rule = rule
        load = problem.loads[0]
        low, high = slope_limits(self.model, load)
        self.limits = low * (1.0 + AT_TOP_SPEED), high * (1.0 + AT_TOP_SPEED)
        self.load = None if load is None else advanced_load(load, ahead, cyclic=curve.cyclic)
        self.work = 0

    def __call__(self, knots: Array, values: Array) -> float:
        """Sum of squared errors [rad^2]; inf beyond v_max, or below a sample a segment."""
        curve = self.curve
        ends, heights = knots, values
        if curve.cyclic:
            ends = np.concatenate([knots, knots[:1] + curve.samples])
            heights = np.concatenate([values, values[:1]])
        lengths = ends[1:] - ends[:-1]
        if lengths.min() < 1.0:
            return np.inf
        slopes = (heights[1:] - heights[:-1]) / (lengths * curve.tick)
        low, high = self.limits
        if slopes.max() > high or slopes.min() < low:
            return np.inf
        since = self.moments - knots[0]
        if curve.cyclic:
            since %= curve.samples
        places = knots - knots[0]
        segment = places.searchsorted(since, side="right") - 1
        segment = np.minimum(np.maximum(segment, 0), len(slopes) - 1)
        past = (since - places[segment] - self.ahead) * curve.tick
        if self.load is None:
            offsets = interpolated_offset(self.model, slopes, rule=self.rule)[segment]
        else:
            in_force = slopes[segment]
            offsets = interpolated_offset(self.model, in_force, rule=self.rule, load=self.load)
        requests = heights[segment] + slopes[segment] * past + offsets
        if self.model.most_pose_sag > 0.0:
            acting = heights[segment] + slopes[segment] * (past + self.ahead * curve.tick)
            requests -= self.model.pose_sag(acting)
        self.work += curve.samples
        angles = self.problem.exact_angles(self.problem.admissible(requests[:, np.newaxis]))
        if angles is None:
            return np.inf
        return float(self.problem.squares(angles).sum())


def refined_curve(
    problem: Problem,
    curve: PiecewiseLinear,
    *,
    rule: Rule,
    ahead: float,
) -> PiecewiseLinear:
    """Move the knots of ``curve`` until its inverse makes the joint track no better.

    A pattern search: every knot moves up and down and along the lines that meet there, every
    segment up and down and to and fro; moves that lower the simulated error are kept, and when none
    does they become smaller.

    Args:
        problem: What to follow.
        curve: Where to start.
        rule: How lines are inverted.
        ahead: How long before a knot the requests change line [samples].

    Returns:
        A curve with as many segments, slopes within ±v_max and none shorter than a sample.
    """
    evaluate = TrackingError(problem, curve, rule, ahead)
    knots, values = np.array(curve.knots), np.array(curve.values)
    least = evaluate(knots, values)
    size = OPTIONS.coarsest
    while size >= OPTIONS.finest and evaluate.work < OPTIONS.most_work:
        kept = False
        for number in range(moves_of(curve)):
            for sign in (size, -size):
                move = make_move(number, knots, values, curve, evaluate.model.v_max)
                moved = knots + sign * move.knots, values + sign * move.values
                error = evaluate(*moved)
                if error < LOWER * least:
                    (knots, values), least, kept = moved, error, True
                    break
            if evaluate.work >= OPTIONS.most_work:
                break
        if not kept:
            size /= 2.0
    return replace(curve, knots=knots, values=values)


def moves_of(curve: PiecewiseLinear) -> int:
    """How many moves there are: four a knot, two a segment."""
    return 4 * curve.knots.size + 2 * curve.segments


def make_move(
    number: int, knots: Array, values: Array, curve: PiecewiseLinear, v_max: float
) -> Move:
    """The move of this number, below :func:`moves_of`, at the present knots.

    Args:
        number: Four a knot (up, along, along the line that ends there, along that which begins),
            then two a segment (up, along).
        knots: Knots [samples], shape (k,).
        values: Values there [rad], shape (k,).
        curve: The curve whose knots move.
        v_max: Top speed of the joint, which scales moves of values [rad/s].
    """
    size = len(knots)
    along, lift = np.zeros(size), np.zeros(size)
    segment, kind = divmod(number - 4 * size, 2)
    moved = [segment, (segment + 1) % size]
    if number < 4 * size:
        knot, kind = divmod(number, 4)
        moved = [knot]
    if kind == 0:
        lift[moved] = v_max * curve.tick
    else:
        along[moved] = 1.0
    if kind >= 2:  # along the line that ends, or that begins, at the knot
        lift[moved] = _slope(knots, values, moved[0] - (kind == 2), curve)
    if not curve.cyclic:
        along[[0, -1]] = 0.0  # the ends stay where they are
    return Move(along, lift)


def _slope(knots: Array, values: Array, segment: int, curve: PiecewiseLinear) -> float:
    """Slope of a segment [rad/sample]; of the nearest one beyond the ends."""
    if curve.cyclic:
        size = len(knots)
        before, after = segment % size, (segment + 1) % size
        length = (knots[after] - knots[before]) % curve.samples or float(curve.samples)
        return float((values[after] - values[before]) / length)
    before = min(max(segment, 0), len(knots) - 2)
    return float((values[before + 1] - values[before]) / (knots[before + 1] - knots[before]))
