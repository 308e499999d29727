"""Linear conditions that every response of the joint meets (``docs/math.md``, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.model.joint import JointModel
from planner.model.response import load_by_period
from planner.planning.task import Norm
from planner.trajectory import Array

Level = Literal["slope", "envelope", "exact"]

LEVELS: tuple[Level, ...] = ("slope", "envelope", "exact")


class BoundProblem(NamedTuple):
    """The joint, the desired angles and the norm of a lower bound."""

    model: JointModel
    desired: Array  # desired angles D [rad], shape (n,)
    cyclic: bool  # whether the trajectory repeats for ever
    norm: Norm
    # from rest: where the joint rests before the first request [rad]; None for any start
    start: float | None
    load: Array | None = None  # torque on the joint at each sample [N m], shape (n,), if any


class Curvature(NamedTuple):
    """By how much trajectories with an error may exceed linearised conditions, (9c).

    Such a condition holds up to ``factor * (|error of the sample| + between)**2``.
    """

    rows: npt.NDArray[np.int_]  # which conditions, (r,)
    factors: Array  # half of the largest second derivative [1/rad], (r,)
    samples: npt.NDArray[np.int_]  # sample whose error counts, (r,)
    between: Array  # largest distance of the angle from the one at that sample [rad], (r,)


@dataclass(frozen=True, eq=False)
class ReachableSet:
    """A set that contains every trajectory the joint can make: ``matrix @ angles <= limits``."""

    # what the angles at the ticks count in each row, shape (rows, ticks)
    of_angles: sparse.csr_array
    # what the speeds between ticks count, ``steps @ angles``, shape (rows, speeds)
    of_speeds: sparse.csr_array
    steps: sparse.csr_array  # the speeds of angles [rad/tick], shape (speeds, ticks)
    limits: Array  # b [rad], shape (rows,)
    # indices of the angles that are compared with the desired ones, shape (n,)
    sampled: npt.NDArray[np.int_]
    # rows that are linearised at the desired angles; None where all hold exactly
    curvature: Curvature | None = None

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """G, shape (rows, ticks)."""
        return sparse.csr_array(self.of_angles + self.of_speeds @ self.steps)

    def with_rows(
        self, of_angles: sparse.csr_array, of_speeds: sparse.csr_array, limits: Array
    ) -> ReachableSet:
        """The set with further conditions."""
        return replace(
            self,
            of_angles=sparse.csr_array(sparse.vstack([self.of_angles, of_angles])),
            of_speeds=sparse.csr_array(sparse.vstack([self.of_speeds, of_speeds])),
            limits=np.concatenate([self.limits, limits]),
        )


def reachable_set(
    problem: BoundProblem, level: Level, angles: tuple[float, float] | None = None
) -> ReachableSet:
    """Linear conditions on the angles at every tick that every response of the joint meets.

    The level "slope" has condition 1, others conditions 1 and 2, and from a given start 3. Desired
    angles do not count; ``angles`` are the least and greatest one that the joint attains [rad], for
    the sag by the pose, None for any.
    """
    model, start = problem.model, problem.start
    level = proved_level(model, level)
    ticks = ticks_of(problem)
    load = load_by_tick(problem, ticks)
    moved = np.arange(0 if problem.cyclic else 1, ticks)
    speeds = sparse.eye_array(len(moved), format="csr")
    every = sparse.eye_array(ticks, format="csr")
    pose = pose_sags(model, angles)
    low, high = speed_ranges(model, load, pose)
    # With inertia 2a keeps every speed within condition 1 if the first one is.
    needed = 1 if level != "slope" and model.has_inertia else len(moved)
    rows = [speeds[:needed], -speeds[:needed]]
    limits = [high[moved][:needed], -low[moved][:needed]]
    if level != "slope":
        for side in sides(model, load[moved], pose, cyclic=problem.cyclic):
            for condition in speed_conditions(model, side):
                changes, at = _speed_rows(speeds, condition, cyclic=problem.cyclic)
                rows.append(side.sign * changes)
                limits.append(np.broadcast_to(condition.most, side.faster.shape)[at])
    of_speeds = sparse.csr_array(sparse.vstack(rows))
    conditions = ReachableSet(
        sparse.csr_array((of_speeds.shape[0], ticks)),
        of_speeds,
        sparse.csr_array(every[moved] - every[moved - 1]),  # a cycle's first is x[0] - x[-1]
        np.concatenate(limits),
        np.arange(0, ticks, model.hold),
    )
    if start is None:
        return conditions
    farthest = distance_from_rest(model, load, level)
    near_start = every[: len(farthest)]
    of_no_speed = sparse.csr_array((len(farthest), len(moved)))
    conditions = conditions.with_rows(near_start, of_no_speed, farthest + start)
    return conditions.with_rows(-near_start, of_no_speed, farthest - start)


def linearised_set(problem: BoundProblem, level: Level) -> ReachableSet:
    """The reachable set, with condition 1 also linearised at the desired angles: (7c) and (9c).

    The further conditions are those of a joint that sags by its pose and has no inertia. Where
    gravity overcomes the joint, friction holds or slows it, so that it is faster than its limit.
    Without these the bounds of 24 random cycles are 0.3 of what they are, in the median.
    """
    reachable, model = reachable_set(problem, level), problem.model
    if model.most_pose_sag == 0.0 or model.has_inertia:
        return reachable
    ticks, gain, hold = ticks_of(problem), model.gain_per_tick, model.hold
    moved = np.arange(0 if problem.cyclic else 1, ticks)
    low, high = (limit * model.tick for limit in model.speed_limits(load_by_tick(problem, ticks)))
    before = (moved - 1) % ticks  # the tick whose angle gravity depends on
    at = problem.desired[before // hold]
    sag = gain * model.gravity(at)
    slope = gain * (model.sag_sin * np.cos(at) - model.sag_cos * np.sin(at))
    shape = (len(moved), ticks)
    by_angle = sparse.csr_array((slope, (np.arange(len(moved)), before)), shape=shape)
    speeds = sparse.eye_array(len(moved), format="csr")
    shift = sag - slope * at
    most, friction = gain * model.most_pose_sag, model.law.friction
    upper, lower = (limit[moved] for limit in (high, -low))
    upper, lower = (each + np.clip(most - each, 0.0, 2.0 * friction) for each in (upper, lower))
    count = len(reachable.limits)
    farthest = farthest_per_period(model, problem.load) / hold
    curvature = Curvature(
        count + np.arange(2 * len(moved)),
        np.full(2 * len(moved), gain * model.most_pose_sag / 2.0),
        np.tile(before // hold, 2),
        np.tile(before % hold * farthest, 2),
    )
    reachable = reachable.with_rows(-by_angle, speeds, upper + shift)
    reachable = reachable.with_rows(by_angle, -speeds, lower - shift)
    return replace(reachable, curvature=curvature)


def pose_sags(model: JointModel, angles: tuple[float, float] | None = None) -> tuple[float, float]:
    """Least and largest sag by the pose over a range of angles, or over all [rad]."""
    most = model.most_pose_sag
    if most == 0.0 or angles is None or not np.all(np.isfinite(angles)):
        return -most, most
    low, high = angles
    ends = model.gravity(np.array([low, high]))
    turn, top = 2.0 * math.pi, math.atan2(model.sag_sin, model.sag_cos)  # its largest value
    least, largest = float(np.min(ends)), float(np.max(ends))
    if math.ceil((low - top) / turn) <= math.floor((high - top) / turn):
        largest = most
    if math.ceil((low - top - math.pi) / turn) <= math.floor((high - top - math.pi) / turn):
        least = -most
    return least, largest


def proved_level(model: JointModel, level: Level) -> Level:
    """The strongest level, this one at most, whose conditions hold for a joint.

    "exact" needs a speed that is the sum of the requests' contributions. Friction and inertia
    change that sum, and so does a sag by the angle.
    """
    follows = model.dead_band == 0.0 and model.most_pose_sag == 0.0 and not model.has_inertia
    return level if follows or level != "exact" else "envelope"


def ticks_of(problem: BoundProblem) -> int:
    """Number of ticks at which the joint's angle is an unknown."""
    samples, hold = len(problem.desired), problem.model.hold
    return samples * hold if problem.cyclic else (samples - 1) * hold + 1


def farthest_per_period(model: JointModel, load: Array | None = None) -> float:
    """Farthest that the joint moves between two requests, in either direction [rad]."""
    low, high = model.speed_limits(0.0 if load is None else load)
    by_pose = model.gain_per_tick * model.most_pose_sag * model.hold
    return float(max(np.max(high), np.max(-low))) * model.period + by_pose


def load_by_tick(problem: BoundProblem, ticks: int) -> Array:
    """The torque in the tick that ends in each tick's angle [N m], shape (ticks,)."""
    by_period = load_by_period(problem.load, cyclic=problem.cyclic)
    if by_period is None:
        return np.zeros(ticks)
    samples = -(-np.arange(ticks) // problem.model.hold)  # at each tick the sample that is next
    by_tick: Array = by_period[samples % len(by_period)]
    return by_tick


def speed_ranges(model: JointModel, load: Array, pose: tuple[float, float]) -> tuple[Array, Array]:
    """Least and largest speed in each tick [rad/tick]: condition 1.

    A joint with inertia keeps its speed from another load, (m,) [N m]. ``pose`` is the least and
    largest sag by the pose [rad].
    """
    low, high = _speed_limits(model, load, pose)
    if model.has_inertia:
        return np.full_like(low, np.min(low)), np.full_like(high, np.max(high))
    return low, high


def _speed_limits(model: JointModel, load: Array, pose: tuple[float, float]) -> tuple[Array, Array]:
    """Least and largest speed under the load in each tick [rad/tick]."""
    low, high = (limit * model.tick for limit in model.speed_limits(load))
    if model.most_pose_sag == 0.0:
        return low, high
    least = 1e-3 * model.v_max_per_tick  # weaker, where gravity overcomes the joint
    low = np.minimum(low + model.gain_per_tick * pose[0], -least)
    return low, np.maximum(high + model.gain_per_tick * pose[1], least)


class Side(NamedTuple):
    """Speeds and drive of a joint in one direction, for each pair of ticks t, t + 1, shape (m,)."""

    sign: float  # the direction; speeds, sags and drives are positive in it
    slowest: Array  # least speed at t [rad/tick]
    fastest: Array  # largest speed at t [rad/tick]
    faster: Array  # change of the top speed from t to t + 1 [rad/tick]
    sagged: Array  # change of the sag under the load [rad]
    drive: Array  # largest drive at t + 1 [rad/tick]


def sides(
    model: JointModel, load: Array, pose: tuple[float, float], *, cyclic: bool
) -> tuple[Side, Side]:
    """Both directions of a joint under the load in the ticks whose speeds are known [N m], (m,).

    Unless the first of these follows the last, there is one pair less.
    """
    first = slice(None if cyclic else -1)
    next_load = np.roll(load, -1)
    low, high = (limit[first] for limit in speed_ranges(model, load, pose))
    next_low, next_high = (limit[first] for limit in _speed_limits(model, next_load, pose))
    faster = model.speed_per_torque * model.tick * (next_load - load)[first]
    sagged = model.compliance * (next_load - load)[first]
    friction = model.law.friction
    return (
        Side(1.0, low, high, faster, sagged, next_high + friction),
        Side(-1.0, -high, -low, -faster, -sagged, friction - next_low),
    )


class SpeedCondition(NamedTuple):
    """``w(t+1) <= now * w(t) + before * w(t-1) + most`` in one direction."""

    now: Array | float  # factor of the speed at t [-], a number or one for each pair of ticks
    before: float  # factor of the speed at t - 1 [-]; 0 where it does not count
    most: Array | float  # constant term [rad/tick], a number or one for each pair of ticks


def speed_conditions(model: JointModel, side: Side) -> list[SpeedCondition]:
    """Bounds on the speed after a tick: condition 2 or, with inertia, 2a and where derived 2b."""
    slope, most = drive_change(model, side)
    if not model.has_inertia:
        return [SpeedCondition(1.0 - slope, 0.0, most)]
    conditions = _motor_conditions(model, side)
    law = model.law
    friction = law.braking
    # Condition 2b is derived where the acceleration limit is below what the window allows, and
    # no integral term moves the drive.
    least = np.min(most - slope * side.fastest)
    limited = law.acceleration + friction <= least or np.isinf(law.acceleration)
    if limited and model.position_integral_rate == 0.0:
        kept = 1.0 - law.share
        released = 2.0 * friction / -side.slowest
        now = 1.0 + kept - law.share * slope + released
        conditions.append(SpeedCondition(now, -kept, law.share * most + 2.0 * friction))
    return conditions


def drive_change(model: JointModel, side: Side) -> tuple[Array, Array]:
    """Slope s and constant p of ``p - s * w(t)``, an upper bound on the drive's gain in a tick.

    It is the right-hand side of (7a), in which the chord between the least and the greatest speed
    replaces ``max(0, c - w)``, with c the change of the sag under the load, and ``p |w|``, the
    largest change of the sag by the pose, p being its largest slope.
    """
    weights, gain, by_pose = model.window.weights, model.gain_per_tick, model.most_pose_sag
    replaced = float(np.abs(np.diff(weights, prepend=0.0, append=0.0)).sum())
    common = float(np.minimum(weights[1:], weights[:-1]).sum())
    slowest, fastest = side.slowest, side.fastest
    most = np.maximum(side.sagged - slowest, 0.0)
    least = np.maximum(side.sagged - fastest, 0.0)
    slope = gain * common * (most - least) / (fastest - slowest)
    changed = common * np.maximum(side.faster, 0.0) + replaced * side.faster / 2.0
    constant = replaced * model.law.top + gain * common * most + slope * slowest + changed
    if by_pose > 0.0:
        turned = gain * by_pose * (np.abs(slowest) - np.abs(fastest)) / (fastest - slowest)
        slope = slope + turned
        constant = constant + gain * by_pose * np.abs(slowest) + turned * slowest
    return slope, constant


def _motor_conditions(model: JointModel, side: Side) -> list[SpeedCondition]:
    """Condition 2a: the speed after a tick at the largest drive and the acceleration limit."""
    law = model.law
    friction = law.braking
    drive = side.drive if law.share < 1.0 else side.drive - law.friction  # less the dead zone
    drive = np.maximum(drive, side.fastest - law.acceleration / law.share)
    lines = [(1.0 - law.share, law.share * drive)]
    if np.isfinite(law.acceleration):
        lines.append((1.0, np.full_like(drive, law.acceleration)))
    if friction == 0.0:
        return [SpeedCondition(now, 0.0, most) for now, most in lines]
    least, largest = (
        np.min([now * speed + most for now, most in lines], axis=0)
        for speed in (side.slowest, side.fastest)
    )
    # The concave hull of the friction's shrink between the two: through (-friction, 0), slope 1,
    # and from there, or from the least, to the largest.
    corner = np.clip(-friction, least, largest)
    below, above = (np.sign(u) * np.maximum(np.abs(u) - friction, 0.0) for u in (corner, largest))
    ratio = (above - below) / np.maximum(largest - corner, np.finfo(np.float64).tiny)
    hull = [(np.ones_like(ratio), np.full_like(ratio, friction)), (ratio, below - ratio * corner)]
    return [
        SpeedCondition(factor * now, 0.0, factor * most + added)
        for factor, added in hull
        for now, most in lines
    ]


def _speed_rows(
    speeds: sparse.csr_array, condition: SpeedCondition, *, cyclic: bool
) -> tuple[sparse.csr_array, slice]:
    """Rows w[t+1] - now * w[t] - before * w[t-1], and which pairs of ticks they are about."""
    count = speeds.shape[0]
    first = 0 if cyclic or condition.before == 0.0 else 1
    at = np.arange(first, count if cyclic else count - 1)
    now = np.broadcast_to(condition.now, (count if cyclic else count - 1,))[at]
    rows = speeds[(at + 1) % count] - sparse.diags_array(now) @ speeds[at]
    if condition.before != 0.0:
        rows -= condition.before * speeds[at - 1]
    return sparse.csr_array(rows), slice(first, None)


def distance_from_rest(model: JointModel, load: Array, level: Level) -> Array:
    """Largest distances of the first angles from the start [rad]: condition 3.

    The joint rests until the second request acts; then only the weights of the requests that may
    differ from the first one can carry it away, and at any time a change of the sag. The level
    "slope", and every level of a joint with inertia, ignores the time after the second request. The
    load is the torque in each tick [N m].
    """
    resting = np.zeros(model.hold + model.window.first)  # ticks before the second request acts
    changed = np.minimum(np.cumsum(model.window.weights), 1.0)
    follows = level != "slope" and not model.has_inertia
    new = np.concatenate([resting, changed if follows else []])[: len(load)]
    low, high = model.speed_limits(load[: len(new)])
    fastest = np.maximum(high, -low) * model.tick
    by_pose = model.gain_per_tick * model.most_pose_sag
    if by_pose > 0.0:
        fastest = fastest + by_pose
        if np.any(by_pose >= model.tick * np.minimum(high, -low)):  # no request surely holds it
            new = np.ones_like(new)
    sagged = model.gain_per_tick * model.compliance * np.abs(load[: len(new)] - load[0])
    if model.has_inertia and np.any(sagged):  # overshoot is not bounded here
        sagged = np.full_like(fastest, np.max(fastest))
    more = (fastest - model.v_max_per_tick) * new + (1.0 - new) * sagged
    return np.asarray(model.v_max_per_tick * np.cumsum(new) + np.cumsum(more))
