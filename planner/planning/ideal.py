"""Where a search for one joint starts: the best trajectory within its top speeds, and its inverse.

The ideal is the least-squares trajectory that the joint's top speeds allow (section 4 of
``docs/math.md``). How little of it is below these decides which further starts are worth trying.
"""

from __future__ import annotations

import numpy as np

from planner.approximation.values import slope_bounded
from planner.model.joint import JointModel, request_ages
from planner.planning.closed_form import SAME_TIME
from planner.planning.line_inverse import interpolated_offset
from planner.planning.problem import Problem
from planner.trajectory import Array, steps

BARELY_SLOWER = 1e-3
"""Relative tolerance of a speed that counts as the top speed: the ideal is iterative."""


def initial_guess(problem: Problem) -> tuple[Array, Array]:
    """Requests within the limits by the closed form of the ideal, and the ideal [rad], both (n, 1).

    Every sample is a knot: request k is on the line from sample i = floor(k + l + a/2) on, raised
    by its C_m (section 3). From rest the ideal is clipped to the attainable range.
    """
    (model,), desired, cyclic = problem.models, problem.desired[:, 0], problem.cyclic
    count, torques = len(desired), problem.torques[0]
    ideal = nearest_within_speeds(model, desired, torques, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]), torques)
    torques = np.roll(torques, -1)  # on the way to the next
    low, high = np.multiply(model.speed_limits(torques, ideal), model.period)
    to_next = steps(np.append(ideal, ideal[:1] if cyclic else ideal[-1:]), cyclic=False)
    to_next = np.clip(to_next, low, high)
    samples = np.arange(count)
    knots = samples + int(model.switching_time / model.period + SAME_TIME)
    knots = knots if cyclic else np.minimum(knots, count - 2)
    at = knots % count
    slopes = to_next[at] / model.period
    offsets = interpolated_offset(model, slopes, rule="exact", load=torques[at], angle=ideal[at])
    requests = ideal[at] + to_next[at] * (samples - knots) + offsets - model.pose_sag(ideal[at])
    return problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis]


def nearest_within_speeds(
    model: JointModel, desired: Array, torques: Array, *, cyclic: bool
) -> Array:
    """The trajectory within the joint's top speeds that is nearest in least squares [rad], (n,).

    Either top speed is v_max away from their mean, -v^- / 2 + v^+ / 2. The trajectory less the sum
    of the means has the same bound in both directions; a cycle is cut out of three in a row. A sag
    by the pose counts as at the desired angles.
    """
    low, high = model.speed_limits(torques, desired)
    mean = (low + high) / 2.0 * model.period
    if not np.any(mean):
        return slope_bounded(desired, model.v_max * model.period, cyclic=cyclic)
    turns, count = 3 if cyclic else 1, len(desired)
    drift = np.cumsum(np.tile(mean, turns))
    sheared = np.tile(desired, turns) - drift
    bounded = slope_bounded(sheared, model.v_max * model.period, cyclic=False) + drift
    return bounded[(turns // 2) * count :][:count]


def within_attainable_range(
    model: JointModel, angles: Array, start: float, torques: Array
) -> Array:
    """Angles clipped to the attainable range of a joint at rest at the start [rad], (n,)."""
    moving = np.arange(len(angles)) > request_ages(model).youngest  # the second request acts
    limits = np.multiply(model.speed_limits(torques, angles), model.period)
    low, high = np.cumsum(limits * moving, axis=1)
    return np.clip(angles, start + low, start + high)


def below_top_speed(problem: Problem, ideal: Array) -> int:
    """Number of samples that the ideal [rad], (n, 1), reaches below the joint's top speeds."""
    (model,) = problem.models
    limits = model.speed_limits(problem.torques[0], ideal[:, 0])
    low, high = np.multiply(limits, (1.0 - BARELY_SLOWER) * model.period)
    before = ideal[-1:, 0] if problem.cyclic else ideal[:1, 0]
    moved = np.diff(ideal[:, 0], prepend=before)
    resting = 0 if problem.cyclic else request_ages(model).youngest + 1
    return int(np.count_nonzero(((moved > low) & (moved < high))[resting:]))


def without_small_reversals(angles: Array, least: float, *, cyclic: bool) -> Array:
    """The path made monotone between its deep turning points, by least squares.

    To turn back, the requests of a joint with dry friction jump from one edge of the dead band to
    the other. Along a path with noise they would do so at almost every sample, for errors that are
    small beside the dead band.

    A path (n,) of which no reversal is shallower than ``least`` [rad] is returned as it is.
    """
    from scipy.optimize import isotonic_regression  # slow to import

    first = int(np.argmax(angles)) if cyclic else 0
    turned = np.roll(angles, -first)
    if cyclic:
        turned = np.append(turned, turned[0])
    points = turning_points(turned, least)
    if not points:  # the nearest path that does not turn
        if cyclic:
            return np.full(len(angles), float(np.mean(angles)))
        both = [isotonic_regression(angles, increasing=way).x for way in (True, False)]
        return np.asarray(min(both, key=lambda path: float(np.sum((path - angles) ** 2))))
    ends = [*(sample for sample, _ in points), len(turned)]
    # Before the first turning point the path goes towards it, after each away from it.
    pieces = [(0, *points[0])]
    pieces += [(at, end, not high) for (at, high), end in zip(points, ends[1:], strict=True)]
    monotone = [
        isotonic_regression(turned[begin:end], increasing=rising).x
        for begin, end, rising in pieces
        if end > begin
    ]
    return np.roll(np.concatenate(monotone)[: len(angles)], first)


def turning_points(angles: Array, least: float) -> list[tuple[int, bool]]:
    """Where a path turns by more than ``least``: extrema with so large moves between them.

    Each is a sample, and whether it is a maximum.
    """
    points: list[tuple[int, bool]] = []
    low = high = direction = 0
    for k, angle in enumerate(angles.tolist()):
        if angle > angles[high]:
            high = k
        if angle < angles[low]:
            low = k
        if direction >= 0 and angles[high] - angle > least:
            points.append((high, True))
            direction, low = -1, k
        elif direction <= 0 and angle - angles[low] > least:
            points.append((low, False))
            direction, high = 1, k
    return points
