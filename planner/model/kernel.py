"""The law of a joint for numbers: section 1 of ``docs/math.md``, compiled by Numba.

One tick is ``drive`` and ``moved``; everything else here is a loop over ticks around them:
a run, the derivatives of request periods with rounded corners, and a run along a log with its
derivatives by the parameters. The same law in CasADi symbols is in ``model/symbolic.py``. Speeds
that follow from it are in ``model/joint.py``, its bounds in ``planning/bounds/reachable_set.py``.
Units: radians and ticks.

Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Indices
from planner.compilation import compiled, inner
from planner.model.law import REST_STEPS, Law, State


@inner
def law_of(row: Array) -> Law:
    """The law from the first ten numbers of a row."""
    return Law(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])


@inner
def drive(law: Law, error: float, faster: float) -> tuple[float, float]:
    """Equation 2: the speed that an error demands [rad/tick], and where it saturates, 1, -1 or 0.

    The error is request plus sag minus angle, but for the sag by the pose, which is added after the
    limits, times the gain [rad]; ``faster`` is b [rad/tick].
    """
    demand = law.gain * error
    if demand >= law.top + faster:
        return law.top + faster, 1.0
    if demand <= faster - law.top:
        return faster - law.top, -1.0
    return demand, 0.0


@inner
def moved(
    law: Law, demand: float, by_sags: float, speed: float, integral: float
) -> tuple[float, float]:
    """The speed and the integral after a tick: a motor's inertia, then Coulomb friction, implicit.

    Without a time constant friction is a dead zone of the drive, before the acceleration limit;
    while that is active the integral is held, against windup. ``demand`` is the drive g(t),
    ``by_sags`` what of it is by gravity and a torque; all are in rad/tick.
    """
    friction, limited = law.share * law.friction, False
    aim = aimed(law, demand, integral)
    if law.share == 1.0:
        aim, friction = shrunk(aim, friction), 0.0
    if law.share < 1.0 or law.acceleration < np.inf:
        change = law.share * (aim - speed)
        limited = abs(change) > law.acceleration
        aim = speed + min(max(change, -law.acceleration), law.acceleration)
    now = shrunk(aim, friction)
    if law.integral_share > 0.0 and not limited:
        integral += law.integral_share * (demand - by_sags - fed_back(law, now, integral))
    return now, integral


@inner
def aimed(law: Law, demand: float, integral: float) -> float:
    """The speed that a motor follows: the demanded one, and a speed loop's integral."""
    return demand if law.integral_inside > 0.0 else demand + integral


@inner
def fed_back(law: Law, speed: float, integral: float) -> float:
    """What an integral subtracts from the servo's demand: the speed, or the integral itself."""
    return integral if law.integral_inside > 0.0 else speed


@inner
def at_rest(law: Law, angle: float, sag: float) -> State:
    """The state at rest at an angle [rad], under a load's sag [rad]: integrals make up for sags."""
    integral = 0.0
    if law.integral_share > 0.0:
        integral -= law.gain * (sag + pose_sag(law, angle))
    return State(angle, 0.0, integral)


@inner
def left_at_rest(law: Law, sag: float) -> float:
    """What of a sag under a load or by the pose is left at rest: with an integral nothing [rad]."""
    return 0.0 if law.integral_share > 0.0 else sag


@inner
def rest_angle(law: Law, request: float, sag: float) -> float:
    """The angle at which a request holds the joint [rad]: :meth:`JointModel.rest` for a number."""
    level = request + (law.offset + left_at_rest(law, sag))
    angle = level
    if law.integral_share == 0.0 and (law.sag_sin != 0.0 or law.sag_cos != 0.0):
        for _ in range(REST_STEPS):  # Newton's method
            slope = 1.0 - pose_sag_slope(law, angle)
            angle -= (angle - pose_sag(law, angle) - level) / slope
    return angle


@inner
def exceeds_drive(law: Law) -> bool:
    """Whether the speed may exceed the limits of the drive: with the integral of a speed loop."""
    return law.integral_share > 0.0 and law.integral_inside == 0.0


@inner
def lifted(law: Law, integral: float) -> float:
    """By how much the integral of a position controller shifts the error of its drive [rad]."""
    return law.integral_inside * integral / law.gain if law.integral_inside > 0.0 else 0.0


@inner
def shrunk(speed: float, friction: float) -> float:
    """A speed less what friction takes of it; 0 where that is more."""
    if friction == 0.0:
        return speed
    return float(np.copysign(max(abs(speed) - friction, 0.0), speed))


@inner
def pose_sag(law: Law, angle: float) -> float:
    """How far gravity holds the joint beside its request at an angle, s sin q + c cos q [rad]."""
    if law.sag_sin == 0.0 and law.sag_cos == 0.0:
        return 0.0
    return float(law.sag_sin * np.sin(angle) + law.sag_cos * np.cos(angle))


@inner
def pose_sag_slope(law: Law, angle: float) -> float:
    """The derivative of :func:`pose_sag` by the angle [-]."""
    if law.sag_sin == 0.0 and law.sag_cos == 0.0:
        return 0.0
    return float(law.sag_sin * np.cos(angle) - law.sag_cos * np.sin(angle))


@inner
def moving_states(law: Law) -> int:
    """Numbers in the state of a joint that moves on: angle and speed, and the integral if any."""
    return 3 if law.integral_share > 0.0 else 2


@inner
def run_period(
    law: Law,
    weights: Array,
    history: Array,
    first: int,
    sag: float,
    faster: float,
    state: State,
    skipped: int,
) -> State:
    """The state after one request period, whose first ``skipped`` ticks are left out.

    ``weights`` are those of each request at each tick, youngest first, (hold, width); ``first`` is
    the number of the oldest one that acts in the history of requests [rad]. The load makes the sag
    kappa tau [rad], and the joint b ``faster`` [rad/tick].
    """
    angle, speed, integral = state
    hold, width = weights.shape
    youngest = first + width - 1
    for tick in range(skipped, hold):
        demand, level = 0.0, law.offset + sag + lifted(law, integral)
        by_pose = pose_sag(law, angle)
        for j in range(width):
            weight = weights[tick, j]
            if weight != 0.0:
                demand += weight * drive(law, history[youngest - j] + level - angle, faster)[0]
        demand += law.gain * by_pose
        speed, integral = moved(law, demand, law.gain * (sag + by_pose), speed, integral)
        angle += speed
    return State(angle, speed, integral)


@compiled
def moved_along_lines(
    law: Law, weights: Array, youngest: int, slopes: Array, ahead: Array, faster: Array
) -> Array:
    """How far a joint moves in a period behind each line, S of (6) [rad]: (s,).

    Requests, the youngest of which has an age, are on lines of ``slopes`` [rad/tick], by ``ahead``
    [rad] before the joint.
    """
    distances, (hold, width) = np.empty(len(slopes)), weights.shape
    history = np.empty(width)
    for i in range(len(slopes)):
        for j in range(width):
            history[width - 1 - j] = ahead[i] + slopes[i] * (hold * (1 - youngest - j))
        state = State(0.0, 0.0, 0.0)
        distances[i] = run_period(law, weights, history, 0, 0.0, faster[i], state, 0).angle
    return distances


@inner
def rounded_clip(
    value: float, low: float, high: float, rounded: float
) -> tuple[float, float, float]:
    """A clip of which each ``|x|`` is ``sqrt(x^2 + rounded)``, and its first two derivatives."""
    above, below = value - low, value - high
    longer, shorter = np.sqrt(above * above + rounded), np.sqrt(below * below + rounded)
    by_longer, by_shorter = 1.0 / longer, 1.0 / shorter  # divisions take most of the time
    bend = rounded * (by_longer * by_longer * by_longer - by_shorter * by_shorter * by_shorter)
    slope = above * by_longer - below * by_shorter
    return (low + high + longer - shorter) / 2.0, slope / 2.0, bend / 2.0


@inner
def rounded_moved(
    law: Law, demand: float, speed: float, rounded: float
) -> tuple[float, float, float, float, float, float]:
    """:func:`moved` with rounded corners; derivatives by demand and speed, the second by demand.

    Further the first and second derivative of the limited acceleration by the unlimited one.
    """
    now, by_demand, by_speed, bend, slope, bent = demand, 1.0, 0.0, 0.0, 1.0, 0.0
    rounded = rounded * law.share * law.share
    friction = law.share * law.friction
    if law.share == 1.0 and friction > 0.0:
        kept, held, more = rounded_clip(now, -friction, friction, rounded)
        now, by_demand, bend, friction = now - kept, 1.0 - held, -more, 0.0
    if law.share < 1.0 or law.acceleration < np.inf:
        change = law.share * (now - speed)
        if law.acceleration < np.inf:
            change, slope, bent = rounded_clip(change, -law.acceleration, law.acceleration, rounded)
        now = speed + change
        bend = law.share * (slope * bend + law.share * bent * by_demand * by_demand)
        by_demand, by_speed = law.share * slope * by_demand, 1.0 - law.share * slope
    if friction > 0.0:
        kept, held, more = rounded_clip(now, -friction, friction, rounded)
        now -= kept
        bend = (1.0 - held) * bend - more * by_demand * by_demand
        by_demand *= 1.0 - held
        by_speed *= 1.0 - held
    return now, by_demand, by_speed, bend, slope, bent


@compiled
def periods(
    law: Law,
    weights: Array,  # of each request at each tick, youngest first, (hold, width)
    window: Array,  # requests that act, youngest first [rad], then work space, (3, width, n)
    sags: Array,  # under the load, kappa tau [rad], (n,)
    faster: Array,  # how much faster it is in the positive direction [rad/tick], (n,)
    rounded: Array,  # square of the radius of the corners [rad^2/tick^2], (n,)
    states: Array,  # before each period, replaced by the one after it, (2, n), with integral (3, n)
    # filled with those of the state after by the state before, by each request, and with the second
    # ones by each request's distance from the angle, (2, 2 + 2 width, n) or (3, 3 + 2 width, n)
    derivatives: Array,
) -> None:
    """Request periods with rounded corners, to second order, each from its own initial state.

    All periods go through a tick together, in loops without sums over the periods: processors do
    several turns of them at once. Where requests are held for several ticks, or several saturate
    together, second derivatives are an estimate; without their columns they are left out.
    """
    (hold, width), count, size = weights.shape, states.shape[1], len(states)
    gain, top, inside = law.gain, law.top, law.integral_inside
    derivatives[:] = 0.0
    for s in range(size):
        derivatives[s, s] = 1.0
    flat = window.reshape(3 * width, count)
    own, bent = flat[width : 2 * width], flat[2 * width :]
    angles, speeds, integrals = states[0], states[1], states[size - 1]
    demand, restoring, by_demand, by_speed, bend = np.empty((5, count))
    opened, closing, raising, turning, zero, extra = np.zeros((6, count))
    level = law.offset + sags
    for tick in range(hold):
        demand[:] = 0.0
        restoring[:] = 0.0
        for k in range(count if inside > 0.0 else 0):
            level[k] = law.offset + sags[k] + lifted(law, integrals[k])
        for j in range(width):
            weight = weights[tick, j]
            for k in range(count):
                low, high = faster[k] - top, faster[k] + top
                error = gain * (window[0, j, k] + level[k] - angles[k])
                value, slope, bending = rounded_clip(error, low, high, rounded[k])
                own[j, k] = weight * gain * slope
                bent[j, k] = weight * gain * gain * bending
                demand[k] += weight * value
                restoring[k] += own[j, k]
        for k in range(count):
            by_pose, turning[k] = pose_sag(law, angles[k]), gain * pose_sag_slope(law, angles[k])
            driven = demand[k] + gain * by_pose
            raising[k] = inside * restoring[k] / gain
            restoring[k] -= turning[k]
            integral = integrals[k] if size == 3 else 0.0
            speeds[k], by_demand[k], by_speed[k], bend[k], opened[k], bent_limit = rounded_moved(
                law, aimed(law, driven, integral), speeds[k], rounded[k]
            )
            angles[k] += speeds[k]
            if size == 3:  # the integral is held by the share by which the limit is active
                fed = driven - gain * (sags[k] + by_pose) - fed_back(law, speeds[k], integral)
                change = law.integral_share * fed
                integrals[k] = integral + opened[k] * change
                closing[k] = law.share * bent_limit * change
        for c in range(derivatives.shape[1]):
            # A state before has no part in the drive, and a first derivative no second one.
            part, second = flat[width + c - size] if c >= size else zero, zero
            if c >= size + width:
                j, second = c - size - width, extra
                for k in range(count):
                    extra[k] = bend[k] * own[j, k] * restoring[k]
            by_angle, by_rate = derivatives[0, c], derivatives[1, c]
            by_sum = derivatives[size - 1, c]
            for k in range(count if size == 2 else 0):
                driven = part[k] - restoring[k] * by_angle[k]
                by_rate[k] = by_speed[k] * by_rate[k] + by_demand[k] * driven + second[k]
                by_angle[k] += by_rate[k]
            for k in range(count if size == 3 else 0):
                driven = part[k] + raising[k] * by_sum[k] - restoring[k] * by_angle[k]
                aim = aimed(law, driven, by_sum[k])
                change = by_speed[k] * by_rate[k] + by_demand[k] * aim + second[k]
                fed = driven - turning[k] * by_angle[k] - fed_back(law, change, by_sum[k])
                by_sum[k] += closing[k] * (aim - by_rate[k]) + opened[k] * law.integral_share * fed
                by_rate[k] = change
                by_angle[k] += change


class Servo(NamedTuple):
    """A joint along a log: its times in seconds, its law in ticks."""

    law: Law
    lag: float  # [s]
    window: float  # acceleration time [s]
    sag_by_load: float  # [rad/(N m)]
    faster: float  # how much faster the joint is in the positive direction [rad/tick]
    faster_by_load: float  # [rad/(N m tick)]
    play: float  # backlash between motor and angle, 2 h [rad]: no part of the model


class Track(NamedTuple):
    """The requests of a log and the ticks on which a joint runs along it."""

    edges: Array  # times at which another request comes into force [s], increasing, (e,)
    requests: Array  # request in force from each of them on [rad], (e,)
    tick: float  # time step [s]
    ticks: Array  # times of the ticks [s], (t,)
    loads: Array  # torque at each tick [N m], (t,)
    states: Indices  # state that each tick leads to, from the one before it, (t,)
    before: Indices  # state at or before each row of the log, increasing, (rows,)
    share: Array  # weight of the state after it, (rows,)


ROUNDING = 1e-15
"""A speed below this, relative to the demand of the angles, is rounding: the joint is at rest."""

FADED = 1e-200
"""A derivative below this is 0."""

GAIN, V_MAX, LAG, WINDOW, SAG, BAND, FASTER, SAG_LOAD, FASTER_LOAD = range(9)
SHARE, ACCELERATION, PLAY, SAG_SIN, SAG_COS, INTEGRAL = range(9, 15)
START = 15
"""Parameters by which :func:`along` takes derivatives: gain [1/tick], v_max [rad/tick], lag and
acceleration time [ticks], sag and dead band [rad], ``faster`` [rad/tick], both by load, a motor's
share [-], acceleration limit [rad/tick^2], play [rad], sag by sine and cosine of the angle [rad],
the integral's share [-], and the angle at which the run of a row starts."""


@inner
def later_in_force(edges: Array, number: int, time: float) -> int:
    """The number of the request in force at a time, which is not before that of another number."""
    while number < len(edges) - 1 and edges[number + 1] <= time:
        number += 1
    return number


@compiled
def numbers_in_force(edges: Array, times: Array, late: float) -> Indices:
    """The number of the request in force so long before each of increasing times."""
    found, number = np.empty(len(times), dtype=np.int_), 0
    for k in range(len(times)):
        number = later_in_force(edges, number, times[k] - late)
        found[k] = number
    return found


@compiled
def along(
    servo: Servo,
    track: Track,
    columns: Indices,  # requested derivatives, from GAIN to START, (c,); much quicker without any
    apart: float,  # distance from the window's edges of the requests for its derivatives [s]
    angles: Array,  # in each state [rad], (s,): given where a run starts, filled elsewhere
    # filled with the least and the largest request that acts at each tick, plus sag but for that by
    # the pose, less the angle before it [rad], (t, 2)
    errors: Array,
    predicted: Array,  # filled with the angle at each row [rad], (rows,)
    slopes: Array,  # filled with the derivatives of these, (rows, c)
) -> None:
    """Run a joint along a log, with the requested derivatives: (16) of ``docs/math.md``.

    At each tick the requests act that are in force in [t - lag - window, t - lag], each by its
    share of that time.
    """
    law, states, before, share = servo.law, track.states, track.before, track.share
    count, half = len(columns), servo.play / 2.0
    has_integral = law.integral_share > 0.0
    has_sag_columns = bool(np.any((columns == SAG_SIN) | (columns == SAG_COS)))
    edges, requests, last = track.edges, track.requests, len(track.edges) - 1
    window, by_window = servo.window / track.tick, 1.0 / servo.window
    # requests a little before and after the window's edges, of the youngest and the oldest request
    far = servo.lag + servo.window
    shifts = np.array([servo.lag + apart, servo.lag - apart, far + apart, far - apart])
    beside, at_edges = np.zeros(4, dtype=np.int_), np.zeros(4)
    # by all columns: derivatives of the drive, of friction and limit, of what is by gravity and a
    # torque; of the angle, of the motor's, of the speed, of the integral
    drives, kinks, by_sag, now, motion, fast, summed = np.zeros((7, START + 1))
    row, way, band, speed, motor = 0, 0.0, law.friction / law.gain, 0.0, 0.0
    integral, beyond, oldest = 0.0, 0.0 if exceeds_drive(law) else 1.0, 0
    for t in range(len(states)):
        state = states[t]
        angle = angles[state - 1]
        load_sag, by_pose = servo.sag_by_load * track.loads[t], pose_sag(law, angle)
        starts = t == 0 or states[t - 1] != state - 1
        if starts:
            motor, speed, integral = at_rest(law, angle, load_sag)
            for c in columns:
                fast[c] = summed[c] = 0.0
                now[c] = motion[c] = 1.0 if c == START else 0.0
        raised, held_integral = lifted(law, integral), integral
        sag = law.offset + load_sag + raised
        faster = servo.faster + servo.faster_by_load * track.loads[t]
        least, most = np.inf, -np.inf
        demand, inside, mean, limited, saturated = 0.0, 0.0, 0.0, 0.0, 0.0
        young = track.ticks[t] - servo.lag
        begin = young - servo.window
        oldest = later_in_force(edges, oldest, begin)
        number = oldest
        while True:
            end = young if number == last else min(edges[number + 1], young)
            weight, error = (end - begin) * by_window, requests[number] + sag - angle
            value, side = drive(law, error, faster)
            demand += weight * value
            least, most = min(least, error), max(most, error)
            if side == 0.0:
                inside += weight
                mean += weight * (error - raised)
            else:
                limited += weight * side
                saturated += weight
            if end >= young:
                break
            begin, number = end, number + 1
        errors[t, 0], errors[t, 1] = least, most
        driven = demand
        demand += law.gain * by_pose
        # ``free`` is what friction acts on, ``aim`` what the speed follows
        by_sags, slid, aim = law.gain * (load_sag + by_pose), speed, aimed(law, demand, integral)
        free = aim
        if law.share == 1.0:
            aim = shrunk(aim, law.friction)
        else:
            change = law.share * (aim - speed)
            free = speed + min(max(change, -law.acceleration), law.acceleration)
        speed, integral = moved(law, demand, by_sags, speed, integral)
        motor += speed
        angle_now, side, follows = motor, 0.0, True
        if half > 0.0:
            side = 1.0 if motor > angle else -1.0
            follows = abs(motor - angle) > half
            angle_now = motor - side * half if follows else angle
        angles[state], first = angle_now, row
        while row < len(before) and before[row] == state - 1:
            predicted[row] = (1.0 - share[row]) * angle + share[row] * angle_now
            for p in range(count):
                slopes[row, p] = (1.0 - share[row]) * now[columns[p]]
            row += 1
        if count == 0:
            continue
        for k in range(4):
            beside[k] = later_in_force(edges, beside[k], track.ticks[t] - shifts[k])
            at_edges[k] = drive(law, requests[beside[k]] + sag - angle, faster)[0]
        side_young, side_old = (at_edges[0] + at_edges[1]) / 2.0, (at_edges[2] + at_edges[3]) / 2.0
        # By the drive g(t)
        # The limits are v_max + gain * dead band, in a speed loop v_max, and shifted by gain * the
        # sag by the pose.
        drives[GAIN] = mean + by_pose + beyond * band * limited
        drives[V_MAX] = limited
        drives[LAG] = (side_old - side_young) / window
        drives[WINDOW] = (side_old - driven) / window
        drives[SAG] = law.gain * inside
        drives[BAND] = beyond * law.gain * limited
        drives[FASTER] = saturated
        drives[SAG_LOAD] = drives[SAG] * track.loads[t]
        drives[FASTER_LOAD] = saturated * track.loads[t]
        if has_sag_columns:
            drives[SAG_SIN], drives[SAG_COS] = law.gain * np.sin(angle), law.gain * np.cos(angle)
        # By the demanded speed, and by the speed before
        accelerated = 1.0
        kinks[ACCELERATION] = 0.0
        if abs(law.share * (aim - slid)) > law.acceleration:
            accelerated = 0.0
            kinks[ACCELERATION] = np.sign(aim - slid)
        if way == 0.0 or abs(free) > ROUNDING * law.share * law.gain * abs(angle):
            way = np.sign(free)  # at rest: the direction in which it came to rest
        sliding = 1.0 if law.friction == 0.0 or abs(free) > law.share * law.friction else 0.0
        kinks[GAIN] = -way * law.share * band
        kinks[BAND] = -way * law.share * law.gain
        kinks[SHARE] = accelerated * (aim - slid) - way * law.friction
        kept = sliding * (1.0 - law.share * accelerated)
        by_demand = sliding * law.share * accelerated
        if law.share == 1.0 and accelerated == 0.0:  # friction comes before the limit
            kinks[GAIN] = kinks[BAND] = kinks[SHARE] = 0.0
            kept = sliding = 1.0
        by_pose_slope = pose_sag_slope(law, angle)
        by_angle = law.gain * (inside - by_pose_slope)
        if has_integral:
            by_sag[GAIN], by_sag[SAG_LOAD] = load_sag + by_pose, law.gain * track.loads[t]
            by_sag[SAG_SIN], by_sag[SAG_COS] = drives[SAG_SIN], drives[SAG_COS]
            for c in columns:
                sag_change = by_sag[c] + law.gain * by_pose_slope * now[c]
                if starts:
                    summed[c] = -sag_change
                pushed = drives[c] - by_angle * now[c] + law.integral_inside * inside * summed[c]
                fast[c] = kept * fast[c] + by_demand * aimed(law, pushed, summed[c])
                fast[c] += sliding * kinks[c]
                back = fed_back(law, fast[c], summed[c])
                summed[c] += accelerated * law.integral_share * (pushed - sag_change - back)
                motion[c] += fast[c]
            held = demand - by_sags - fed_back(law, speed, held_integral)
            summed[INTEGRAL] += accelerated * held
        else:
            for c in columns:
                pushed = by_demand * (drives[c] - by_angle * now[c])
                fast[c] = kept * fast[c] + pushed + sliding * kinks[c]
                motion[c] += fast[c]
        if follows:
            for c in columns:
                now[c] = motion[c]
            now[PLAY] -= side / 2.0
        for r in range(first, row):
            for p in range(count):
                c = columns[p]
                slopes[r, p] += share[r] * now[c]
                # numbers below the least normal one take a hundred times as long
                fast[c] = fast[c] if abs(fast[c]) > FADED else 0.0
                motion[c] = motion[c] if abs(motion[c]) > FADED else 0.0
