"""The steady cycle of a joint: the state at which a cycle of requests ends as it starts, compiled.

Import this module where it is used, inside functions, as ``model/kernel.py``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.compilation import compiled, inner
from planner.model.kernel import run
from planner.model.law import Law
from planner.trajectory import Array

CYCLE_TOLERANCE = 1e-12
"""A cycle is closed when its ends agree to this [rad], relative to angles beyond 1 rad."""

FIXED_POINT_CYCLES = 3
"""First cycles that start where the one before ended, where the secant method has no slope;
afterwards bisection takes its place."""

SECANT_CYCLES = 10
"""Cycles of the secant method alone; afterwards every other cycle is a bisection."""

DIFFERENCE = 1e-7
"""Step of the difference quotients of a cycle's end by its start [rad, rad/tick]."""

CLOSER = 0.01
"""Tolerance of bisection on the angles at a cycle's ends, relative to the difference of speeds."""

SINGULAR = 1e-6
"""Singular values below this share of the largest one count as 0."""


class Cycle(NamedTuple):
    """The request periods of a cycle, as :func:`planner.model.kernel.run` takes them.

    Attributes:
        law: The joint.
        weights: Weight of each request at each tick of a period, youngest first, (hold, width).
        history: Requests, oldest first [rad], (n + width - 1,).
        sags: Angle at rest less request in each period [rad], (n,).
        faster: How much faster the joint is in the positive direction [rad/tick], (n,).
        angles: Filled with the angle after each period [rad], (n,).
        speeds: Filled with the speed in its last tick [rad/tick], (n,).
    """

    law: Law
    weights: Array
    history: Array
    sags: Array
    faster: Array
    angles: Array
    speeds: Array


@compiled
def run_steady_cycle(cycle: Cycle, near: float, most: int) -> float:
    """Run the cycle that repeats itself.

    Args:
        cycle: The joint and its requests; filled with its motion.
        near: Angle near which the ends of the cycle are sought [rad].
        most: Most runs of a response that still drifts.

    Returns:
        How far the ends of the cycle are apart [rad]; 0 where it is closed to
        :data:`CYCLE_TOLERANCE`.
    """
    law = cycle.law
    v_max = law.top - law.friction
    slower, faster = extremes(cycle.faster)
    by_pose = np.hypot(law.sag_sin, law.sag_cos)
    top = v_max + max(-slower, faster) + law.gain * by_pose
    # The joint overshoots a request by at most the difference of v_max and theta_0, and coasts.
    beyond = max(1.0 - 1.0 / law.gain, 0.0) * top
    inert = law.share < 1.0 or law.acceleration < np.inf
    if inert:
        beyond += 2.0 * top / law.share + top**2 / law.acceleration
    beyond += by_pose
    if law.gain * by_pose >= v_max - max(-slower, faster):
        beyond += 2.0 * np.pi  # no request holds it at some angles: it falls to others
    (low, high), (least, most_sag) = extremes(cycle.history), extremes(cycle.sags)
    low, high = low + least - beyond, high + most_sag + beyond
    tolerance = CYCLE_TOLERANCE * max(1.0, abs(low), abs(high))
    if inert:
        return _settled_motion(cycle, near, low, high, tolerance, most)
    if law.friction > 0.0:
        return _nearest_cycle(cycle, near, low, high, tolerance, most)
    return _closed_cycle(cycle, near, low, high, tolerance, most)


@inner
def extremes(values: Array) -> tuple[float, float]:
    """The least and the largest of some numbers."""
    least = most = values[0]
    for k in range(1, len(values)):
        least, most = min(least, values[k]), max(most, values[k])
    return least, most


@inner
def ended(cycle: Cycle, angle: float, speed: float) -> tuple[float, float]:
    """Angle [rad] and speed [rad/tick] at the end of a cycle, from those at its start."""
    law, weights, history, sags, faster, angles, speeds = cycle
    return run(law, weights, history, sags, faster, angle, speed, 0, angles, speeds)


@inner
def _closed_cycle(
    cycle: Cycle,
    start: float,
    low: float,
    high: float,
    tolerance: float,
    most: int,
) -> float:
    """Run the steady cycle of a joint without inertia and without a dead band.

    The angle at the end of a cycle is a continuous, piecewise linear function of the angle at its
    start, of slope within [-1, 1]: the secant method finds the fixed point, between two angles on
    either side of it. With a sag by the pose the function is curved and may be steeper; of several
    fixed points the method finds one.
    """
    earlier, ended_earlier, mismatch = np.nan, np.nan, np.inf
    for turn in range(most):
        end = ended(cycle, start, 0.0)[0]
        mismatch = abs(end - start)
        if mismatch <= tolerance:
            return 0.0
        if end > start:
            low = start
        else:
            high = start
        middle, closing = (low + high) / 2.0, np.inf
        if turn > 0:  # where start and end agree, if the end is a straight line in between
            slope = 1.0
            if start != earlier:
                slope = (end - ended_earlier) / (start - earlier)
            if slope < 1.0:
                closing = start + (end - start) / (1.0 - slope)
        earlier, ended_earlier = start, end
        if turn > SECANT_CYCLES and turn % 2:
            start = middle
        elif low < closing < high:
            start = closing
        else:
            start = end if turn < FIXED_POINT_CYCLES else middle
    return mismatch


@inner
def _nearest_cycle(
    cycle: Cycle,
    start: float,
    low: float,
    high: float,
    tolerance: float,
    most: int,
) -> float:
    """Run the steady cycle nearest to ``start``, of a joint with a dead band: there may be many.

    How much further a cycle ends than it starts does not increase with the angle where it starts.
    So the steady cycles start in one range, on the side of ``start`` to which a cycle from there
    moves. Where v_max <= theta_0 a tick the fixed-point iteration cannot pass the near end of that
    range; it is bisected. With a sag by the pose there may be several ranges: one of them is found.
    """
    end = ended(cycle, start, 0.0)[0]
    if abs(end - start) <= tolerance:
        return 0.0
    sign, far = (1.0, high) if end > start else (-1.0, low)
    for turn in range(1, most):
        bisecting = (turn > FIXED_POINT_CYCLES and turn % 2 == 1) or sign * (far - end) <= 0.0
        trial = (start + far) / 2.0 if bisecting else end
        after = ended(cycle, trial, 0.0)[0]
        ahead = sign * (after - trial)
        if ahead > tolerance:
            start, end = trial, after
        elif abs(ahead) <= tolerance and not bisecting:
            return 0.0
        else:
            far = trial
        if abs(far - start) <= tolerance:
            return 0.0
    return abs(end - start)


@inner
def _settled_motion(
    cycle: Cycle,
    near: float,
    low: float,
    high: float,
    tolerance: float,
    most: int,
) -> float:
    """Run the steady cycle of a joint with inertia, from rest near an angle.

    Newton's method on angle and speed, between two corners of the law exact. Where a step of it
    does not halve the distance of a cycle's ends, bisection finds the angle at which a cycle of a
    given speed closes; the speeds follow Mann's iteration, a mean of earlier speeds and their
    images. With a dead band steady cycles are not isolated: the step is the shortest one.
    """
    angle, speed, bisected, mismatch = near, 0.0, 0, np.inf
    end, end_speed = ended(cycle, angle, speed)
    step = DIFFERENCE * tolerance / CYCLE_TOLERANCE
    for _ in range(most):
        apart, faster = end - angle, end_speed - speed
        mismatch = max(abs(apart), abs(faster))
        if mismatch <= tolerance:
            ended(cycle, angle, speed)
            return 0.0
        further = ended(cycle, angle + step, speed)
        swifter = ended(cycle, angle, speed + step)
        turn, gain = shortest_solution(
            1.0 - (further[0] - end) / step,
            (end - swifter[0]) / step,
            (end_speed - further[1]) / step,
            1.0 - (swifter[1] - end_speed) / step,
            apart,
            faster,
        )
        trial, trial_speed = angle + turn, speed + gain
        reached = ended(cycle, trial, trial_speed)
        if not max(abs(reached[0] - trial), abs(reached[1] - trial_speed)) < mismatch / 2.0:
            bisected += 1
            trial_speed = speed + 2.0 / (1.0 + bisected) * faster
            close = max(tolerance, CLOSER * abs(faster))
            trial = _closing_angle(cycle, trial_speed, angle, low, high, close, most)
            reached = ended(cycle, trial, trial_speed)
        angle, speed = trial, trial_speed
        end, end_speed = reached
    return mismatch


@inner
def shortest_solution(
    a: float, b: float, c: float, d: float, right: float, below: float
) -> tuple[float, float]:
    """The shortest solution of ``[[a, b], [c, d]] x = [right, below]`` in least squares.

    A singular value of less than :data:`SINGULAR` of the other counts as 0.
    """
    first, across, second = a * a + c * c, a * b + c * d, b * b + d * d
    largest = (first + second) / 2.0 + np.hypot((first - second) / 2.0, across)  # squared
    determinant = a * d - b * c
    if abs(determinant) > SINGULAR * largest:
        return (d * right - b * below) / determinant, (a * below - c * right) / determinant
    if largest == 0.0:
        return 0.0, 0.0
    # the right singular vector of the largest singular value, from the better of two formulae
    x, y = largest - second, across
    if second > first:
        x, y = across, largest - first
    share = (a * x + b * y) * right + (c * x + d * y) * below
    share /= largest * (x * x + y * y)
    return share * x, share * y


@inner
def _closing_angle(
    cycle: Cycle,
    speed: float,
    near: float,
    low: float,
    high: float,
    close: float,
    most: int,
) -> float:
    """Angle at which a cycle with a given initial speed closes, to ``close`` [rad], by bisection.

    Of several, the one nearest to ``near`` in the direction in which a cycle from there moves.
    """
    angle, sign, far = near, 0.0, near
    for _ in range(most):
        ahead = ended(cycle, angle, speed)[0] - angle
        if sign == 0.0:
            sign, far = (1.0, high) if ahead > 0.0 else (-1.0, low)
        if sign * ahead > close:
            near = angle
        else:
            far = angle
        if abs(far - near) <= close:
            break
        angle = (near + far) / 2.0
    return angle
