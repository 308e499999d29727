"""The bounds of the levels slope and envelope, stated in CVXPY as in docs/math.md.

This is the second opinion on :mod:`planner.planning.bounds.multipliers`, which solves the same
programmes many times faster. It shares the joint's window with them and nothing else.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.model.joint import JointModel
from planner.planning.bounds.reachable_set import Level
from planner.planning.task import Task


def stated_bound(joint: Task, level: Level) -> float:
    """Distance of the desired angles from the set of conditions 1 to 3 of docs/math.md [rad].

    The level "slope" has condition 1 alone.
    """
    import cvxpy

    cp: Any = cvxpy  # untyped: its atoms have no types
    (model,), (start,), (load,) = joint.nominal, joint.starts, joint.loads
    desired, cyclic = joint.desired[:, 0], joint.cyclic
    v, ratio, hold = model.v_max_per_tick, model.v_max_per_tick / model.theta_0, model.hold
    ticks = len(desired) * hold if cyclic else (len(desired) - 1) * hold + 1
    by_sample = np.zeros(len(desired)) if load is None else load
    before = np.append(by_sample[-1 if cyclic else 0], by_sample)
    # The torque at tick t is the mean of those at the samples before and after it.
    after = [math.ceil(t / hold) % len(desired) for t in range(ticks)]
    torque = np.array([(before[k] + by_sample[k]) / 2.0 for k in after])
    b = (model.v_offset + model.speed_per_torque * torque) * model.tick
    sag = model.compliance * torque
    x = cp.Variable(ticks)
    w = cp.hstack([x[:1] - x[-1:], x[1:] - x[:-1]]) if cyclic else x[1:] - x[:-1]
    moving = np.arange(0 if cyclic else 1, ticks)
    by_pose = ratio * math.hypot(model.sag_sin, model.sag_cos)
    lowest, highest = b - v - by_pose, b + v + by_pose
    if model.has_inertia:  # it keeps its speed from another load
        lowest, highest = np.full(ticks, np.min(lowest)), np.full(ticks, np.max(highest))
    conditions = [w <= highest[moving], w >= lowest[moving]]  # condition 1
    if level != "slope":
        at = moving if cyclic else moving[:-1]
        next_at = (at + 1) % ticks
        db, ds = b[next_at] - b[at], sag[next_at] - sag[at]
        ups = (w, lowest[at], highest[at], db, ds, b[next_at] + by_pose)
        downs = (-w, -highest[at], -lowest[at], -db, -ds, by_pose - b[next_at])
        for speeds, *numbers in (ups, downs):
            conditions += _conditions_of_speed(model, cyclic, speeds, *numbers)
    if start is not None:
        # Condition 3: at rest until the second request acts, then within reach of new requests,
        # and at any time within reach of a change of the sag.
        new = np.zeros(min(hold + model.window.first, ticks))
        if level != "slope" and not model.has_inertia:
            new = np.append(new, np.minimum(np.cumsum(model.window.weights), 1.0))[:ticks]
        sags = ratio * np.abs(sag - sag[0])[: len(new)]
        excess = np.abs(model.v_offset + model.speed_per_torque * torque)[: len(new)]
        fastest = v + excess * model.tick + by_pose
        if by_pose > 0.0 and np.any(by_pose >= v - excess * model.tick):  # gravity moves it
            new = np.ones(len(new))
        if model.has_inertia and np.any(sags):  # it may swing on
            sags = np.full(len(new), np.max(fastest))
        farthest = np.cumsum(new * fastest + (1.0 - new) * sags)
        conditions.append(cp.abs(x[: len(new)] - start) <= farthest)
    errors = x[::hold] - desired
    rms = cp.norm(errors, 2) / np.sqrt(len(desired))
    objective = rms if joint.norm == "rms" else cp.norm(errors, "inf")
    problem = cp.Problem(cp.Minimize(objective), conditions)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Solution may be inaccurate")
        bound = float(problem.solve(solver="CLARABEL"))
    if joint.norm == "rms" and problem.status == cp.OPTIMAL_INACCURATE:  # over thousands of ticks
        squares = cp.sum_squares(errors / model.theta_0) / len(desired)
        least = float(cp.Problem(cp.Minimize(squares), conditions).solve(solver="CLARABEL"))
        bound = model.theta_0 * math.sqrt(max(least, 0.0))
    return bound


def _conditions_of_speed(
    model: JointModel,
    cyclic: bool,
    w: Any,  # speeds [rad/tick]
    lowest: Array,  # least speed before each change [rad/tick]
    highest: Array,  # greatest speed before it
    db: Array,  # change of the top speed
    ds: Array,  # change of the sag under the load [rad]
    next_b: Array,  # how much faster the joint is after the change [rad/tick]
) -> list[Any]:
    """Condition 2 or, with inertia, 2a and 2b, in one direction."""
    import cvxpy

    cp: Any = cvxpy
    v, ratio = model.v_max_per_tick, model.v_max_per_tick / model.theta_0
    weights, friction = model.window.weights, ratio * model.dead_band
    pose = math.hypot(model.sag_sin, model.sag_cos)
    later, now = (cp.hstack([w[1:], w[:1]]), w) if cyclic else (w[1:], w[:-1])

    def line(speed: Any, at_lowest: Any, at_highest: Any) -> Any:
        share = cp.multiply(1.0 / (highest - lowest), speed - lowest)
        return at_lowest + cp.multiply(at_highest - at_lowest, share)

    def drive_change(speed: Any) -> Any:  # condition 2, with the chord of its maximum
        ends = (np.maximum(ds - end, 0.0) for end in (lowest, highest))
        turned = (pose * np.abs(end) for end in (lowest, highest))
        replaced = np.sum(np.abs(np.diff(weights, prepend=0.0, append=0.0)))
        common = np.sum(np.minimum(weights[1:], weights[:-1]))
        changed = replaced * (v + friction + db / 2.0) + common * np.maximum(db, 0.0)
        return changed + common * ratio * line(speed, *ends) + ratio * line(speed, *turned)

    if not model.has_inertia:
        return [later - now <= drive_change(now)]
    k = -math.expm1(-model.tick / model.time_constant) if model.time_constant > 0.0 else 1.0
    a, s, drive = model.max_acceleration * model.tick**2, k * friction, v + next_b + friction
    if k == 1.0:  # friction is a dead zone of the drive
        s, drive = 0.0, drive - friction
    drive = np.maximum(drive, highest - a / k)

    def free(speed: Any) -> Any:  # the largest speed that follows without friction
        demand = (1.0 - k) * speed + k * drive
        return cp.minimum(speed + a, demand) if math.isfinite(a) else demand

    def shrunk(speed: Array) -> Array:
        return np.maximum(speed - s, np.minimum(speed + s, 0.0))

    # Condition 2a: friction by its concave hull, of slope 1 up to -s, then straight to its end.
    least, largest = (free(cp.Constant(end)).value for end in (lowest, highest))
    corner = np.minimum(np.maximum(-s, least), largest)
    rise = (shrunk(largest) - shrunk(corner)) / np.where(largest > corner, largest - corner, 1.0)
    conditions = [
        later <= free(now) + s,
        later <= shrunk(corner) + cp.multiply(rise, free(now) - corner),
    ]
    # Condition 2b: the window's, through the motor; friction may turn from one side to the other.
    # An integral moves the drive without its requests.
    moved = model.position_integral_rate > 0.0
    if not moved and (math.isinf(a) or a + s <= np.min(drive_change(cp.Constant(highest)).value)):
        before = cp.hstack([w[-1:], w[:-1]]) if cyclic else w[:-2]
        released = 2.0 * s * (1.0 + cp.multiply(-1.0 / lowest, now))
        gained = (now + k * drive_change(now) + released)[0 if cyclic else 1 :]
        later, now = (each[0 if cyclic else 1 :] for each in (later, now))
        conditions.append(later - (1.0 - k) * (now - before) <= gained)
    return conditions
