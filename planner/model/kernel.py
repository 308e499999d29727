"""The law of a joint for numbers: section 1 of ``docs/math.md``, compiled by Numba.

One tick is ``drive`` and ``moved``; everything else here is a loop over ticks around them:
a run, a run's response to second order with rounded corners, and a run along a log with its
derivatives by the parameters. The same law in CasADi symbols is in ``model/symbolic.py``, and these
two files are all that changes with it. Units: radians and ticks.

Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import numpy as np

from planner.compilation import compiled
from planner.model.joint import Law
from planner.trajectory import Array, Indices


@compiled
def drive(law: Law, error: float, faster: float) -> tuple[float, float]:
    """Equation 2 under a load: the speed that an error calls for, friction not yet taken off.

    Args:
        law: The joint.
        error: Request plus sag minus angle [rad].
        faster: How much faster it is in the positive direction, b [rad/tick].

    Returns:
        The speed [rad/tick], and on which side it saturates: 1, -1, or 0 where it does not.
    """
    called = law.gain * error
    if called >= law.top + faster:
        return law.top + faster, 1.0
    if called <= faster - law.top:
        return faster - law.top, -1.0
    return called, 0.0


@compiled
def moved(law: Law, called: float, speed: float) -> float:
    """The speed after a tick: a motor's inertia, then Coulomb friction, implicit.

    Args:
        law: The joint.
        called: Speed that the requests call for, g(t) [rad/tick].
        speed: Speed in the tick before, w(t-1) [rad/tick].

    Returns:
        w(t) [rad/tick].
    """
    if law.share < 1.0 or law.acceleration < np.inf:
        change = law.share * (called - speed)
        called = speed + min(max(change, -law.acceleration), law.acceleration)
    held = law.share * law.friction
    if held == 0.0:
        return called
    return float(np.sign(called)) * max(abs(called) - held, 0.0)


@compiled
def run_period(
    law: Law,
    weights: Array,
    history: Array,
    first: int,
    sag: float,
    faster: float,
    angle: float,
    speed: float,
    skipped: int,
) -> tuple[float, float]:
    """One request period.

    Args:
        law: The joint.
        weights: Weight of each request at each tick of the period, youngest first, (hold, width).
        history: Requests, oldest first [rad].
        first: Number of the oldest one that acts.
        sag: Angle at rest less request [rad].
        faster: How much faster the joint is in the positive direction [rad/tick].
        angle: Angle before the period [rad].
        speed: Speed in the tick before it [rad/tick].
        skipped: Ticks that are left out.

    Returns:
        Angle [rad] and speed [rad/tick] after it.
    """
    hold, width = weights.shape
    youngest = first + width - 1
    for tick in range(skipped, hold):
        called = 0.0
        for j in range(width):
            weight = weights[tick, j]
            if weight != 0.0:
                called += weight * drive(law, history[youngest - j] + sag - angle, faster)[0]
        speed = moved(law, called, speed)
        angle += speed
    return angle, speed


@compiled
def run(
    law: Law,
    weights: Array,
    history: Array,
    sags: Array,
    faster: Array,
    angle: float,
    speed: float,
    skipped: int,
    angles: Array,
    speeds: Array,
) -> tuple[float, float]:
    """Run a joint through request periods.

    Args:
        law: The joint.
        weights: Weight of each request at each tick of a period, youngest first, (hold, width).
        history: Requests, oldest first: those acting before sample k are
            ``history[k : k + width]`` [rad], (n + width - 1,).
        sags: Angle at rest less request in each period [rad], (n,).
        faster: How much faster the joint is in the positive direction [rad/tick], (n,).
        angle: Angle before the first tick [rad].
        speed: Speed in the tick before it [rad/tick].
        skipped: Ticks of the first period that are left out.
        angles: Filled with the angle after each period [rad], (n,).
        speeds: Filled with the speed in its last tick [rad/tick], (n,).

    Returns:
        The last angle [rad] and the last speed [rad/tick].
    """
    for k in range(len(angles)):
        left_out = skipped if k == 0 else 0
        angle, speed = run_period(
            law, weights, history, k, sags[k], faster[k], angle, speed, left_out
        )
        angles[k], speeds[k] = angle, speed
    return angle, speed


@compiled
def moved_along_lines(
    law: Law, weights: Array, steps: Indices, slopes: Array, offsets: Array, faster: Array
) -> Array:
    """How far a joint without inertia moves in a period in which it is behind a line, S of (6).

    Args:
        law: The joint.
        weights: Weight of the request of each age, (m,).
        steps: Where the held line stands at each tick and age, in ticks, (hold, m).
        slopes: Slope of each line [rad/tick], (s,).
        offsets: How far the requests are ahead of it [rad], (s,).
        faster: How much faster the joint is in the positive direction [rad/tick], (s,).

    Returns:
        The distances [rad], (s,).
    """
    distances = np.empty(len(slopes))
    for i in range(len(slopes)):
        angle = 0.0
        for tick in range(len(steps)):
            called = 0.0
            for j in range(len(weights)):
                error = offsets[i] + slopes[i] * steps[tick, j] - angle
                called += weights[j] * drive(law, error, faster[i])[0]
            held = law.friction
            angle += float(np.sign(called)) * max(abs(called) - held, 0.0)
        distances[i] = angle
    return distances


@compiled
def rounded_clip(
    value: float, low: float, high: float, rounded: float
) -> tuple[float, float, float]:
    """A clip whose corners have a radius, and its first and second derivative.

    Each ``|x|`` of it becomes ``sqrt(x^2 + radius^2)``; ``rounded`` is the square of the radius.
    """
    above, below = value - low, value - high
    longer, shorter = np.sqrt(above * above + rounded), np.sqrt(below * below + rounded)
    bend = rounded * (1.0 / (longer * longer * longer) - 1.0 / (shorter * shorter * shorter))
    slope = above / longer - below / shorter
    return (low + high + longer - shorter) / 2.0, slope / 2.0, bend / 2.0


@compiled
def rounded_moved(
    law: Law, called: float, speed: float, rounded: float
) -> tuple[float, float, float, float]:
    """:func:`moved` with rounded corners.

    Returns:
        The speed after the tick [rad/tick], its derivatives by ``called`` and by ``speed``, and the
        second derivative by ``called`` [tick/rad].
    """
    now, by_called, by_speed, bend = called, 1.0, 0.0, 0.0
    rounded = rounded * law.share * law.share
    if law.share < 1.0 or law.acceleration < np.inf:
        change, slope = law.share * (called - speed), 1.0
        if law.acceleration < np.inf:
            change, slope, bend = rounded_clip(change, -law.acceleration, law.acceleration, rounded)
        now = speed + change
        by_called, by_speed = law.share * slope, 1.0 - law.share * slope
        bend *= law.share * law.share
    held = law.share * law.friction
    if held > 0.0:
        kept, slope, bent = rounded_clip(now, -held, held, rounded)
        now -= kept
        bend = (1.0 - slope) * bend - bent * by_called * by_called
        by_called *= 1.0 - slope
        by_speed *= 1.0 - slope
    return now, by_called, by_speed, bend


@compiled
def period(
    law: Law,
    weights: Array,
    window: Array,
    sag: float,
    faster: float,
    rounded: float,
    angle: float,
    speed: float,
    slopes: Array,
    bends: Array,
) -> tuple[float, float]:
    """One request period with rounded corners, to second order.

    Args:
        law: The joint.
        weights: Weight of each request at each tick, youngest first, (hold, width).
        window: Requests that act, youngest first [rad], (width,).
        sag: Angle at rest less request [rad].
        faster: How much faster the joint is in the positive direction [rad/tick].
        rounded: Square of the radius of the corners [rad^2/tick^2].
        angle: Angle before the period [rad].
        speed: Speed before it [rad/tick].
        slopes: Filled with the derivatives of the angle and the speed after the period by angle,
            speed and each request before it, (2, 2 + width).
        bends: Filled with the second derivatives of both by each request's distance from the
            angle, (2, width); where requests are held for several ticks, or several saturate
            together, an estimate. Left out where it is (2, 0).

    Returns:
        Angle [rad] and speed [rad/tick] after it.
    """
    hold, width = weights.shape
    slopes[:] = 0.0
    bends[:] = 0.0
    slopes[0, 0] = slopes[1, 1] = 1.0
    low, high = faster - law.top, faster + law.top
    values, own, bent = np.empty(width), np.empty(width), np.empty(width)
    for tick in range(hold):
        for j in range(width):  # a loop without sums, which processors do several turns of at once
            value, slope, bend = rounded_clip(
                law.gain * (window[j] + sag - angle), low, high, rounded
            )
            values[j] = weights[tick, j] * value
            own[j] = weights[tick, j] * law.gain * slope
            bent[j] = weights[tick, j] * law.gain * law.gain * bend
        called, total = 0.0, 0.0
        for j in range(width):
            called += values[j]
            total += own[j]
        speed, by_called, by_speed, bend = rounded_moved(law, called, speed, rounded)
        angle += speed
        by_angle = -by_called * total
        for c in range(2 + width):
            slopes[1, c] = by_speed * slopes[1, c] + by_angle * slopes[0, c]
        for j in range(width):
            slopes[1, 2 + j] += by_called * own[j]
        for j in range(bends.shape[1]):
            bends[1, j] = by_speed * bends[1, j] + by_angle * bends[0, j]
            bends[1, j] += by_called * bent[j] + bend * own[j] * total
            bends[0, j] += bends[1, j]
        for c in range(2 + width):
            slopes[0, c] += slopes[1, c]
    return angle, speed


@compiled
def respond(
    law: Law,
    weights: Array,
    before: Array,
    windows: Array,
    sags: Array,
    faster: Array,
    radius: float,
    unit: float,
    reached: Array,
    by_own: Array,
    by_other: Array,
    by_request: Array,
    bending: Array,
    joint: int,
    speed_at: int,
    first: int,
) -> None:
    """Where each request period of one joint leads with rounded corners, to second order.

    Args:
        law: Of :func:`run`.
        weights: Of the same.
        before: State before each period, (n, states): the joint's angle [rad], and where it has
            inertia its speed in ``unit``.
        windows: Requests that act in it, youngest first [rad], (width of all, n, joints).
        sags: Of :func:`run`.
        faster: Of the same.
        radius: Radius of the corners [rad].
        unit: Time in which a speed counts as an angle [ticks].
        reached: Filled with the states after each period.
        by_own: Filled with the derivative of each state by itself.
        by_other: Filled with that of each state by the joint's other one.
        by_request: Filled at ``[first + j, k, state]`` with the derivative by each request.
        bending: Filled with the second derivative by a request's distance from the angle [1/rad].
        joint: Number of the joint, which is that of its angle among the states.
        speed_at: Number of its speed among them; -1 where it has none.
        first: Place of its youngest request in the windows.
    """
    width = weights.shape[1]
    rounded = (law.gain * radius) ** 2
    slopes, bends, window = np.empty((2, 2 + width)), np.empty((2, width)), np.empty(width)
    for k in range(len(before)):
        for j in range(width):
            window[j] = windows[first + j, k, joint]
        speed = before[k, speed_at] / unit if speed_at >= 0 else 0.0
        angle, speed = period(
            law,
            weights,
            window,
            sags[k],
            faster[k],
            rounded,
            before[k, joint],
            speed,
            slopes,
            bends,
        )
        reached[k, joint] = angle
        by_own[k, joint] = slopes[0, 0]
        for j in range(width):
            by_request[first + j, k, joint] = slopes[0, 2 + j]
            bending[first + j, k, joint] = bends[0, j]
        if speed_at >= 0:
            reached[k, speed_at] = unit * speed
            by_own[k, speed_at] = slopes[1, 1]
            by_other[k, joint] = slopes[0, 1] / unit
            by_other[k, speed_at] = unit * slopes[1, 0]
            for j in range(width):
                by_request[first + j, k, speed_at] = unit * slopes[1, 2 + j]
                bending[first + j, k, speed_at] = unit * bends[1, j]


@compiled
def in_force(edges: Array, requests: Array, times: Array) -> Array:
    """The request in force at each of some increasing times; before the first edge the first."""
    found, at, last = np.empty(len(times)), 0, len(edges) - 1
    for t in range(len(times)):
        while at > 0 and edges[at] > times[t]:
            at -= 1
        while at < last and edges[at + 1] <= times[t]:
            at += 1
        found[t] = requests[at]
    return found


@compiled
def windows_along(
    edges: Array, requests: Array, ticks: Array, lag: float, window: float
) -> tuple[Array, Array]:
    """The requests of a log that act at each tick, those in force in [t - lag - window, t - lag].

    Args:
        edges: Times at which another request comes into force [s], increasing.
        requests: Request in force from each of them on [rad].
        ticks: Times of the ticks [s].
        lag: Lag [s].
        window: Acceleration time [s].

    Returns:
        The share of the window in which each of them is in force, and the requests [rad], oldest
        first, each (m, t).
    """
    firsts = np.empty(len(ticks), dtype=np.int64)
    width, at, last = 1, 0, len(edges) - 1
    for t in range(len(ticks)):
        young = ticks[t] - lag
        old = young - window
        while at > 0 and edges[at] > old:
            at -= 1
        while at < last and edges[at + 1] <= old:
            at += 1
        firsts[t] = final = at
        while final < last and edges[final + 1] < young:
            final += 1
        width = max(width, final - at + 1)
    weights, targets = np.zeros((width, len(ticks))), np.empty((width, len(ticks)))
    for t in range(len(ticks)):
        young = ticks[t] - lag
        old = young - window
        total, begin = 0.0, old
        for j in range(width):
            number = firsts[t] + j
            end = young if number >= last else min(max(edges[number + 1], old), young)
            weights[j, t] = end - begin
            targets[j, t] = requests[min(number, last)]
            total += end - begin
            begin = end
        for j in range(width):
            weights[j, t] /= total
    return weights, targets


@compiled
def follow(
    law: Law,
    weights: Array,
    targets: Array,
    faster: Array,
    play: float,
    states: Indices,
    angles: Array,
    speeds: Array,
) -> None:
    """Run a joint along a log.

    Args:
        law: The joint.
        weights: Weight of each request that acts at each tick, (m, t).
        targets: These requests plus sag [rad], (m, t).
        faster: How much faster the joint is in the positive direction [rad/tick], (t,).
        play: Backlash between motor and angle, 2 h [rad]: no part of the model, see
            ``identification/unmodelled.py``.
        states: State that each tick leads to, from the one before it, (t,).
        angles: Angle in each state [rad], (s,): given where a run starts, filled elsewhere.
        speeds: The same for the speed of the motor [rad/tick].
    """
    motor, half = 0.0, play / 2.0
    for t in range(len(states)):
        state = states[t]
        angle, called = angles[state - 1], 0.0
        if t == 0 or states[t - 1] != state - 1:  # a run starts
            motor = angle
        for j in range(len(weights)):
            if weights[j, t] > 0.0:
                called += weights[j, t] * drive(law, targets[j, t] - angle, faster[t])[0]
        speeds[state] = moved(law, called, speeds[state - 1])
        motor += speeds[state]
        angles[state] = min(max(angle, motor - half), motor + half) if half > 0.0 else motor


ROUNDING = 1e-15
"""A speed below this, relative to what the angles call for, is rounding: the joint is at rest."""

PARAMETERS = 11
"""Columns of :func:`slopes_along` by parameters."""


@compiled
def slopes_along(
    law: Law,
    weights: Array,
    targets: Array,
    faster: Array,
    loads: Array,
    edges: Array,
    window: float,
    states: Indices,
    angles: Array,
    speeds: Array,
    before: Indices,
    share: Array,
) -> Array:
    """Derivatives of the angles along a log by the parameters and the first angle: (16).

    Args:
        law: Of :func:`follow`.
        weights: Of the same.
        targets: Of the same.
        faster: Of the same.
        loads: Torque at each tick [N m], (t,).
        edges: Requests plus sag at the youngest and the oldest edge of each window, each a moment
            before and after it [rad], (4, t).
        window: Acceleration time [ticks].
        states: Of :func:`follow`.
        angles: As filled by :func:`follow`.
        speeds: As filled by :func:`follow`.
        before: State at or before each row of the log, increasing, (rows,).
        share: Weight of the state after it, (rows,).

    Returns:
        Derivatives at the rows by gain [1/tick], v_max [rad/tick], lag and acceleration time
        [ticks], sag [rad], dead band [rad], ``faster`` [rad/tick], sag for each N m, ``faster`` for
        each N m, the motor's share [-] and the acceleration limit [rad/tick^2], and by the angle at
        the start of the row's run, (rows, PARAMETERS + 1).
    """
    columns = PARAMETERS + 1
    slopes, drives = np.empty((len(before), columns)), np.zeros(columns)
    past, now, fast = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    row, way, band = 0, 0.0, law.friction / law.gain
    for t in range(len(states)):
        state = states[t]
        if t == 0 or states[t - 1] != state - 1:  # a run starts
            now[:] = 0.0
            fast[:] = 0.0
            now[PARAMETERS] = 1.0
        angle, speed = angles[state - 1], speeds[state - 1]
        called, inside, errors, limited, saturated = 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(len(weights)):
            weight = weights[j, t]
            if weight > 0.0:
                error = targets[j, t] - angle
                value, side = drive(law, error, faster[t])
                called += weight * value
                limited += weight * side
                saturated += weight * abs(side)
                if side == 0.0:
                    inside += weight
                    errors += weight * error
        young = drive(law, edges[0, t] - angle, faster[t])[0]
        young = (young + drive(law, edges[1, t] - angle, faster[t])[0]) / 2.0
        old = drive(law, edges[2, t] - angle, faster[t])[0]
        old = (old + drive(law, edges[3, t] - angle, faster[t])[0]) / 2.0
        # By the drive g(t)
        drives[0] = errors + band * limited  # the limits are v_max + gain * dead band
        drives[1] = limited
        drives[2] = (old - young) / window
        drives[3] = (old - called) / window
        drives[4] = law.gain * inside
        drives[5] = law.gain * limited
        drives[6] = saturated
        drives[7] = drives[4] * loads[t]
        drives[8] = drives[6] * loads[t]
        # The speed that is called for, and of the derivatives what is left of the speed before
        change, accelerated, pushed = law.share * (called - speed), 1.0, 0.0
        if abs(change) > law.acceleration:
            accelerated, pushed = 0.0, np.sign(change)
            change = pushed * law.acceleration
        free = speed + change
        if law.share == 1.0 and accelerated == 1.0:
            free = called
        if way == 0.0 or abs(free) > ROUNDING * law.share * law.gain * abs(angle):
            way = np.sign(free)  # at rest that of the side on which it came to rest
        sliding = 1.0 if law.friction == 0.0 or abs(free) > law.share * law.friction else 0.0
        by_called = law.share * accelerated
        past[:] = now
        for p in range(columns):
            fast[p] -= by_called * (fast[p] + law.gain * inside * now[p] - drives[p])
        fast[0] -= way * law.share * band
        fast[5] -= way * law.share * law.gain
        fast[9] += accelerated * (called - speed) - way * law.friction
        fast[10] += pushed
        for p in range(columns):
            fast[p] *= sliding
            now[p] += fast[p]
        while row < len(before) and before[row] == state - 1:
            for p in range(columns):
                slopes[row, p] = (1.0 - share[row]) * past[p] + share[row] * now[p]
            row += 1
    return slopes
