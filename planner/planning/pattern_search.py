"""A pattern search (Hooke and Jeeves 1961) for the knots of a closed form, by the simulated error.

The approximation nearest to the desired trajectory is not the one whose inverse tracks it best: a
joint rounds corners, and cannot follow a segment shorter than its acceleration time.

Import this module where it is used, inside functions, as ``model/kernel.py``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.arrays import Array
from planner.compilation import compiled, inner
from planner.model.kernel import law_of, left_at_rest, pose_sag
from planner.model.law import MOST_CYCLES, Law
from planner.planning.gauss_newton import Spec, limit, simulate_all
from planner.planning.line_inverse import (
    AT_TOP_SPEED,
    LEAST_SHARE,
    Rule,
    advanced,
    offset_table,
    slope_limits,
)
from planner.planning.problem import Problem


class Lines(NamedTuple):
    """Data for the inversion of lines."""

    ahead: float  # time by which requests change line before a knot [samples]
    low: float  # least slope [rad/sample]
    high: float  # largest slope [rad/sample]
    sag: float  # sag without a load [rad]
    dead_band: float  # of the joint [rad]
    table: Array  # slopes, rising [rad/sample], and their offsets without a load [rad], (2, m)
    by_pose: float  # change of the top speeds by the sag by the pose, gamma h [1/sample]
    least: float  # least top speed with gravity [rad/sample]
    most: float  # largest top speed with gravity [rad/sample]
    # factors by which the load changes the top speeds down and up [-], and the sag under it [rad],
    # (3, n); (3, 0) without a load
    by_load: Array


def refined_curve(problem: Problem, curve: PiecewiseLinear, *, rule: Rule) -> PiecewiseLinear:
    """Move the knots of ``curve`` until its inverse makes the joint track no better.

    Knots move up and down and along the lines that meet there, segments up and down and to and fro,
    none shorter than a sample or steeper than the joint's speeds. Moves that lower the simulated
    error are kept; when none does they become smaller.
    """
    knots, values = np.array(curve.knots), np.array(curve.values)
    # Half and twice of these sizes [samples], and of the work, change the errors of 22 closed forms
    # of six segments by 0.8 % in the mean and 6.9 % at worst; without a search they are 8 and 35 %
    # larger. The work, samples simulated, bounds the cost of many knots.
    steps = 2.0, 0.2, problem.nominal[0].v_max * curve.tick
    search(*tracked(problem, curve, rule), knots, values, steps, 80_000)
    return replace(curve, knots=knots, values=values)


def tracked(problem: Problem, curve: PiecewiseLinear, rule: Rule) -> tuple[Spec, Lines]:
    """The first arguments of :func:`search`."""
    (model,), load = problem.drives, problem.load_of_drives[0]
    ahead = model.switching_time / model.period
    low, high = slope_limits(model, load)
    slopes, offsets = offset_table(model, rule)
    by_load = np.empty((3, 0))
    if load.any():
        torques = advanced(load, ahead, cyclic=curve.cyclic)
        scales = np.array(model.speed_limits(torques)) / np.array(model.speed_limits())[:, None]
        by_load = np.vstack([scales, model.sag(torques)])
    lines = Lines(
        ahead,
        low * (1.0 + AT_TOP_SPEED) * curve.tick,
        high * (1.0 + AT_TOP_SPEED) * curve.tick,
        model.offset,
        model.steady.dead_band,
        np.array([slopes * curve.tick, offsets]),
        0.0 if model.exceeds_v_max else model.law.gain * model.hold,
        LEAST_SHARE * model.v_max * curve.tick,
        (2.0 - LEAST_SHARE) * model.v_max * curve.tick,
        by_load,
    )
    return problem.spec, lines


@compiled
def search(
    spec: Spec,
    lines: Lines,
    knots: Array,
    values: Array,
    steps: tuple[float, float, float],
    most_work: int,
) -> float:
    """The pattern search; the sum of squared errors at its end [rad^2], inf without a curve.

    Knots [samples] and the values there [rad] are moved in place. ``steps`` are the size of the
    first moves, the least size [samples], and the move of values for a size of one sample [rad].
    """
    (size, finest, lift), count, samples = steps, len(knots), len(spec.goal)
    requests, angles = np.empty((2, samples, 1))
    along, up = np.empty(count), np.empty(count)
    moved, moved_values = np.empty(count), np.empty(count)
    moves = 4 * count + 2 * (count if spec.cyclic else count - 1)
    least, work = squared_error(spec, lines, requests, angles, knots, values), samples
    if least < 0.0:  # any curve that can be followed is better
        least = math.inf
    while size >= finest and work < most_work:
        kept = False
        for number in range(moves):
            set_move(number, knots, values, lift, spec.cyclic, samples, along, up)
            for turn in range(2):
                sign = -size if turn else size
                for k in range(count):
                    moved[k], moved_values[k] = knots[k] + sign * along[k], values[k] + sign * up[k]
                error = squared_error(spec, lines, requests, angles, moved, moved_values)
                if error >= 0.0:
                    work += samples * (MOST_CYCLES if error == math.inf else 1)
                if 0.0 <= error < (1.0 - 1e-4) * least:
                    for k in range(count):
                        knots[k], values[k] = moved[k], moved_values[k]
                    least, kept = error, True
                    break
            if work >= most_work:
                break
        if not kept:
            size /= 2.0
    return least


@inner
def squared_error(
    spec: Spec, lines: Lines, requests: Array, angles: Array, knots: Array, values: Array
) -> float:
    """Sum of squared tracking errors [rad^2], inf where the joint has no steady cycle.

    -1 where a slope is beyond the top speed, or a segment is shorter than a sample.
    """
    if not set_requests(lines, law_of(spec.drives[0]), spec.cyclic, knots, values, requests):
        return -1.0
    limit(spec, requests)
    if not simulate_all(spec, requests, angles):
        return math.inf
    total = 0.0
    for k in range(len(requests)):
        total += (angles[k, 0] - spec.goal[k, 0]) ** 2
    return float(total)


@inner
def set_requests(
    lines: Lines, law: Law, cyclic: bool, knots: Array, values: Array, requests: Array
) -> bool:
    """Set the requests [rad]; False where the curve is too steep or too fine."""
    count, size = len(requests), len(knots)
    segments = size if cyclic else size - 1
    for s in range(segments):
        if not lines.low <= slope_of(knots, values, s, count) <= lines.high:
            return False
    for k in range(count):
        since = k + lines.ahead - knots[0]
        if cyclic:
            since %= count
        s = segments - 1
        while s > 0 and knots[s] - knots[0] > since:
            s -= 1
        slope = slope_of(knots, values, s, count)
        past = since - (knots[s] - knots[0]) - lines.ahead
        acting = values[s] + slope * (past + lines.ahead)
        by_pose = pose_sag(law, acting)
        if lines.by_load.shape[1] == 0 and by_pose == 0.0:
            offset = interpolated(slope, lines.table)
        else:
            scale, sag = 1.0, lines.sag
            if lines.by_load.shape[1] > 0:
                scale, sag = lines.by_load[0 if slope < 0.0 else 1, k], lines.by_load[2, k]
            if by_pose != 0.0:
                end = lines.table[0, 0 if slope < 0.0 else -1]
                top = scale * abs(end) + math.copysign(lines.by_pose, end) * by_pose
                scale = min(max(top, lines.least), lines.most) / abs(end)
            band = 0.0 if slope == 0.0 else math.copysign(lines.dead_band, slope)
            offset = interpolated(slope / scale, lines.table) + lines.sag - band
            offset = band + scale * offset - sag
        requests[k, 0] = values[s] + slope * past + offset - left_at_rest(law, by_pose)
    return True


@inner
def slope_of(knots: Array, values: Array, s: int, samples: int) -> float:
    """Slope of a segment [rad/sample]; NaN where it is shorter than a sample."""
    size = len(knots)
    end = knots[s + 1] if s + 1 < size else knots[0] + samples
    length = end - knots[s]
    if length < 1.0:
        return math.nan
    return float((values[(s + 1) % size] - values[s]) / length)


@inner
def interpolated(place: float, table: Array) -> float:
    """Linear interpolation in a table of rising places and their values, (2, m)."""
    low, high = 0, table.shape[1] - 1
    if place <= table[0, low]:
        return float(table[1, low])
    if place >= table[0, high]:
        return float(table[1, high])
    while high - low > 1:
        middle = (low + high) // 2
        if table[0, middle] <= place:
            low = middle
        else:
            high = middle
    slope = (table[1, high] - table[1, low]) / (table[0, high] - table[0, low])
    return float(slope * (place - table[0, low]) + table[1, low])


@inner
def set_move(
    number: int,
    knots: Array,
    values: Array,
    lift: float,
    cyclic: bool,
    samples: int,
    along: Array,
    up: Array,
) -> None:
    """Set the move of this number, by knots [samples] and values [rad] for a size of one sample.

    Four for each knot (up, along, along the line that ends there, along the one that begins), then
    two for each segment (up, along).
    """
    size = len(knots)
    for k in range(size):
        along[k] = up[k] = 0.0
    first, kind = number // 4, number % 4
    second = first
    if number >= 4 * size:
        first, kind = (number - 4 * size) // 2, number % 2
        second = (first + 1) % size
    if kind == 0:
        up[first] = up[second] = lift
    else:
        along[first] = along[second] = 1.0
    if kind >= 2:
        segment = first - 1 if kind == 2 else first
        segment = segment % size if cyclic else min(max(segment, 0), size - 2)
        up[first] = slope_of(knots, values, segment, samples)
    if not cyclic:  # the ends stay where they are
        along[0] = along[-1] = 0.0
