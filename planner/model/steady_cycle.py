"""The response of a joint to requests, compiled: from rest, or in its steady cycle.

A steady cycle begins in the state in which it ends.

Import this module where it is used, inside functions, as ``model/kernel.py``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.compilation import compiled, inner
from planner.model.kernel import at_rest, exceeds_drive, moving_states, rest_angle, run_period
from planner.model.law import MOST_CYCLES, Law, State

CYCLE_TOLERANCE = 1e-12
"""A cycle is closed when its ends agree to this [rad], relative to angles beyond 1 rad."""

FIXED_POINT_CYCLES = 3
"""First cycles of a joint without inertia that may start where the one before ended; afterwards
bisection takes their place, or with dry friction turns with them."""


class Cycle(NamedTuple):
    """The request periods of a cycle, or of a motion from rest; see :func:`motion_of`."""

    law: Law
    weights: Array
    history: Array  # requests, oldest first [rad], (n + width - 1,)
    oldest: int  # so many of them are of the cycle before
    sags: Array
    faster: Array
    motion: Array


@compiled
def motion_of(
    law: Law,
    weights: Array,  # of each request at each tick of a period, youngest first, (hold, width)
    requests: Array,  # [rad], (n,)
    oldest: int,  # age of the oldest one that acts [requests]
    sags: Array,  # under the load in each period, kappa tau [rad], (n,)
    faster: Array,  # how much faster the joint is in the positive direction [rad/tick], (n,)
    start: float,  # angle before the first request [rad]; NaN where that one holds the joint
    cyclic: bool,
    motion: Array,  # filled with the state after each period, (3, n)
) -> float:
    """The response of a joint to requests, from rest or in the steady cycle near the start.

    Returns how far the ends of the cycle are apart [rad]; 0 where it is closed to
    :data:`CYCLE_TOLERANCE`, and from rest.
    """
    samples = len(requests)
    history = np.empty(samples + weights.shape[1] - 1)
    for i in range(len(history)):
        history[i] = requests[(i - oldest) % samples if cyclic else max(i - oldest, 0)]
    if np.isnan(start):
        start = rest_angle(law, requests[0], sags[0])
    cycle = Cycle(law, weights, history, oldest, sags, faster, motion)
    if cyclic:
        return _run_steady_cycle(cycle, start)
    run(cycle, at_rest(law, start, sags[0]), len(weights) - 1)
    return 0.0


@compiled
def run(cycle: Cycle, state: State, skipped: int) -> State:
    """The state at the end, from that before the first tick but for some that are left out."""
    law, weights, history, _, sags, faster, motion = cycle
    for k in range(motion.shape[1]):
        left_out = skipped if k == 0 else 0
        state = run_period(law, weights, history, k, sags[k], faster[k], state, left_out)
        motion[0, k], motion[1, k], motion[2, k] = state
    return state


@inner
def _run_steady_cycle(cycle: Cycle, near: float) -> float:
    """Run the cycle that repeats itself, its ends near an angle: see :func:`motion_of`."""
    law = cycle.law
    v_max = law.top if exceeds_drive(law) else law.top - law.friction
    slower, faster = ends_of(cycle.faster)
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
    lowest, highest = ends_of(cycle.history)
    least, most = ends_of(cycle.sags)
    low, high = lowest + (law.offset + least) - beyond, highest + (law.offset + most) + beyond
    tolerance = CYCLE_TOLERANCE * max(1.0, abs(low), abs(high))
    if law.friction > 0.0 and not inert:
        # There may be many, which start in one range, and the nearest one is an end of it. With a
        # sag by the pose there may be several ranges: one of them is found.
        return _closing_start(cycle, State(near, 0.0, 0.0), low, high, tolerance, True)[1]
    size = moving_states(law) if inert else 1
    return _settled_motion(cycle, near, low, high, tolerance, size)


@inner
def ends_of(values: Array) -> tuple[float, float]:
    """The least and the largest value; NumPy's reductions would take a second to compile."""
    least, most = np.inf, -np.inf
    for value in values:
        least, most = min(least, value), max(most, value)
    return least, most


@inner
def begun(cycle: Cycle, angle: float) -> State:
    """The state at the end of the first cycle from rest: the first request was always there."""
    history, oldest = cycle.history, cycle.oldest
    resting = history.copy()
    resting[:oldest] = history[oldest % cycle.motion.shape[1]]  # the first request
    law, weights, _, _, sags, faster, motion = cycle
    first = Cycle(law, weights, resting, oldest, sags, faster, motion)
    return run(first, at_rest(law, angle, sags[0]), len(weights) - 1)


@inner
def distance(start: State, end: State, size: int) -> float:
    """How far two states are apart [rad]: the largest difference of their first numbers."""
    largest = 0.0
    for s in range(size):
        largest = max(largest, abs(end[s] - start[s]))
    return largest


@inner
def _settled_motion(
    cycle: Cycle, near: float, low: float, high: float, tolerance: float, size: int
) -> float:
    """Run the steady cycle into which a joint settles from an angle, by so many numbers of a state.

    Without inertia, ``size`` 1, a step of the secant method that halves the distance of the ends is
    taken, and else bisection finds the fixed point; of several, one. With inertia the motion is
    followed from rest; near its end a step of Newton's method finishes, the shortest one, as with a
    dead band steady cycles are not isolated. Where it does not settle, any step that halves the
    distance is taken; else bisection finds the angle at which a cycle of a given speed closes, and
    the speeds follow Mann's iteration, a mean of earlier speeds and their images. (Without them 4 %
    of 2,900 random joints under random requests have no cycle, not 1 %.)
    """
    scale, inert = tolerance / CYCLE_TOLERANCE, size > 1
    state = begun(cycle, near) if inert else State(near, 0.0, 0.0)
    bisected, ratio, before = 0, np.inf, np.inf
    end = run(cycle, state, 0)
    mismatch = distance(state, end, size)
    for turn in range(MOST_CYCLES):
        if mismatch <= tolerance:
            return 0.0
        trial, settling = end, turn < (100 if inert else FIXED_POINT_CYCLES)
        ratio, ratio_before = mismatch / before if turn else np.inf, ratio
        # While inertia settles: near a cycle, where the ends approach by half twice in a row
        close = mismatch <= 1e-4 * scale and max(ratio, ratio_before) <= 0.5
        if close or not (settling and inert):
            step = 1e-7 * scale if inert else end.angle - state.angle
            trial = newton_step(cycle, state, end, step, size)
            longest = 2.0 * mismatch * ratio / (1.0 - ratio)  # for that ratio
            if settling and inert and distance(trial, end, size) > longest:
                trial = end
            ahead = (trial.angle - state.angle) * (end.angle - state.angle) > 0.0
            if not (low <= trial.angle <= high and (inert or ahead)):  # else it would fall from it
                trial = end
        reached = run(cycle, trial, 0)
        closer = distance(trial, reached, size) < mismatch / 2.0
        if not closer and settling and trial != end:
            trial = end
            reached = run(cycle, trial, 0)
        if not (closer or settling):
            bisected += 1
            faster = end.speed - state.speed if inert else 0.0
            speed = state.speed + 2.0 / (1.0 + bisected) * faster
            begin = State(state.angle, speed, end.integral)
            apart = max(tolerance, 0.01 * abs(faster))
            trial = _closing_start(cycle, begin, low, high, apart, False)[0]
            reached = run(cycle, trial, 0)
        before = mismatch
        state, end = trial, reached
        mismatch = distance(state, end, size)
    return mismatch


@inner
def newton_step(cycle: Cycle, state: State, end: State, step: float, size: int) -> State:
    """The nearest state at which a cycle closes to first order, by difference quotients."""
    matrix, right = np.empty((size, size)), np.empty(size)
    for s in range(size):
        moved = State(
            state.angle + (step if s == 0 else 0.0),
            state.speed + (step if s == 1 else 0.0),
            state.integral + (step if s == 2 else 0.0),
        )
        further = run(cycle, moved, 0)
        for t in range(size):
            matrix[t, s] = (1.0 if t == s else 0.0) - (further[t] - end[t]) / step
        right[s] = end[s] - state[s]
    turn = shortest_solution(matrix, right)
    speed = state.speed + turn[1] if size > 1 else 0.0
    integral = state.integral + turn[2] if size == 3 else 0.0
    return State(state.angle + turn[0], speed, integral)


@inner
def shortest_solution(matrix: Array, right: Array) -> Array:
    """The shortest least-squares solution, without singular values below a millionth of the first.

    The columns are made orthogonal by Jacobi rotations (M. R. Hestenes, J. Soc. Indust. Appl. Math.
    6, 1958): LAPACK would take seconds to compile, and its rounding depends on the processor.
    """
    size, turned, ways = len(right), matrix.copy(), np.zeros(matrix.shape)
    for i in range(size):
        ways[i, i] = 1.0
    for _ in range(30):  # three columns are orthogonal to rounding after a few
        for p in range(size):
            for q in range(p + 1, size):
                difference, common = 0.0, 0.0
                for i in range(size):
                    difference += (turned[i, q] - turned[i, p]) * (turned[i, q] + turned[i, p])
                    common += 2.0 * turned[i, p] * turned[i, q]
                angle = 0.5 * np.arctan2(common, difference) if common != 0.0 else 0.0
                cosine, sine = np.cos(angle), np.sin(angle)
                for i in range(size):
                    for columns in (turned, ways):
                        first, second = columns[i, p], columns[i, q]
                        columns[i, p] = cosine * first - sine * second
                        columns[i, q] = sine * first + cosine * second
    squares, along, solution = np.zeros(size), np.zeros(size), np.zeros(size)
    for j in range(size):
        for i in range(size):
            squares[j] += turned[i, j] ** 2
            along[j] += turned[i, j] * right[i]
    for j in range(size):
        if squares[j] > 1e-12 * ends_of(squares)[1]:
            for i in range(size):
                solution[i] += ways[i, j] * along[j] / squares[j]
    return solution


@inner
def _closing_start(
    cycle: Cycle, start: State, low: float, high: float, close: float, iterating: bool
) -> tuple[State, float]:
    """Run the cycle from another angle that closes, to ``close`` [rad], by bisection.

    Of several, the one nearest to ``start`` in the direction in which a cycle from there moves.
    While ``iterating``, fixed-point iteration, which where v_max <= theta_0 a tick cannot pass the
    near end of a range of such angles, takes turns. Returns the state at its start, and how far
    its ends are apart, 0 where it is closed.
    """
    angle, speed, integral = start
    end = run(cycle, start, 0).angle
    if abs(end - angle) <= close:
        return start, 0.0
    sign, far = (1.0, high) if end > angle else (-1.0, low)
    for turn in range(1, MOST_CYCLES):
        iterated = iterating and (turn <= FIXED_POINT_CYCLES or turn % 2 == 0)
        bisecting = not iterated or sign * (far - end) <= 0.0
        trial = State((angle + far) / 2.0 if bisecting else end, speed, integral)
        after = run(cycle, trial, 0).angle
        ahead = sign * (after - trial.angle)
        if ahead > close:
            angle, end = trial.angle, after
        elif abs(ahead) <= close and not bisecting:
            return trial, 0.0
        else:
            far = trial.angle
        if abs(far - angle) <= close:
            return trial, 0.0
    return State(angle, speed, integral), abs(end - angle)
