"""Linear conditions that every response of the joint meets (``docs/math.md``, section 5)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.arrays import Array
from planner.model.joint import JointModel
from planner.model.law import Law
from planner.model.response import load_by_period
from planner.planning.task import Task

Level = Literal["slope", "envelope", "exact"]

LEVELS: tuple[Level, ...] = ("slope", "envelope", "exact")


def ticks_of(joint: Task) -> int:
    """Number of ticks at which the angle of a task's one joint is an unknown."""
    samples, hold = len(joint.desired), joint.nominal[0].hold
    return samples * hold if joint.cyclic else (samples - 1) * hold + 1


@dataclass(frozen=True, eq=False)
class ReachableSet:
    """A set that contains every trajectory the joint can make: ``matrix @ angles <= limits``."""

    of_angles: sparse.csr_array  # what the angles at the ticks count, shape (rows, ticks)
    of_speeds: sparse.csr_array  # what the speeds between them count, shape (rows, speeds)
    steps: sparse.csr_array  # the speeds of angles [rad/tick], shape (speeds, ticks)
    limits: Array  # b [rad], shape (rows,)
    # indices of the angles that are compared with the desired ones, shape (n,)
    sampled: npt.NDArray[np.int_]
    # 0 where all rows hold exactly; else the last ones, of each speed in either direction, are
    # linearised at the desired angles: half of the largest second derivative by the angle [1/rad]
    curvature: float = 0.0

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """G, shape (rows, ticks)."""
        return sparse.csr_array(self.of_angles + self.of_speeds @ self.steps)


def reachable_set(
    joint: Task,
    level: Level,
    angles: tuple[float, float] | None = None,
    *,
    linearised: bool = False,
) -> ReachableSet:
    """Linear conditions on the angles at every tick that every response of the joint meets.

    The level "slope" has condition 1, others conditions 1 and 2, and from a given start 3.
    ``angles`` are the least and greatest one that the joint attains [rad], for the sag by the pose,
    None for any. Condition 1 may also be ``linearised`` at the desired angles, (7c) and (9c), for a
    joint that sags by its pose and has no inertia: without this the bounds of 24 random cycles are
    0.3 of what they are, in the median.
    """
    (model,), (start,), cyclic = joint.nominal, joint.starts, joint.cyclic
    ticks, pose = ticks_of(joint), pose_sags(model, angles)
    load, by_period = np.zeros(ticks), load_by_period(joint.loads[0], cyclic=cyclic)
    if by_period is not None:  # that in the tick that ends in each tick's angle
        following = -(-np.arange(ticks) // model.hold)  # the sample that is next
        load = np.asarray(by_period[following % len(by_period)])
    moved = np.arange(0 if cyclic else 1, ticks)
    every = sparse.eye_array(ticks, format="csr")
    unknowns = sparse.eye_array(ticks + len(moved), format="csr")
    speeds = unknowns[ticks:]
    low, high = speed_ranges(model, load, pose)
    # With inertia 2a keeps every speed within condition 1 if the first one is.
    needed = 1 if level != "slope" and model.has_inertia else len(moved)
    rows = [speeds[:needed], -speeds[:needed]]
    limits = [high[moved][:needed], -low[moved][:needed]]
    if level != "slope":
        for sign, now, before, most in speed_conditions(model, load[moved], pose, cyclic=cyclic):
            at = np.arange(0 if cyclic or before == 0.0 else 1, len(most))
            kept = sparse.diags_array(now[at]) @ speeds[at] + before * speeds[at - 1]
            rows.append(sign * (speeds[(at + 1) % len(moved)] - kept))
            limits.append(most[at])
    if start is not None:
        farthest = distance_from_rest(model, load, level)
        near = unknowns[: len(farthest)]
        rows += [near, -near]
        limits += [farthest + start, farthest - start]
    if linearised:
        gain, friction, earlier = model.law.gain, model.law.friction, (moved - 1) % ticks
        there = joint.desired[earlier // model.hold, 0]  # instead of the angles gravity depends on
        slope = gain * (model.sag_sin * np.cos(there) - model.sag_cos * np.sin(there))
        shift = gain * model.gravity(there) - slope * there
        posed = speeds - sparse.diags_array(slope) @ unknowns[earlier]
        by_pose = gain * model.most_pose_sag
        for sign, limit in zip((-1.0, 1.0), model.speed_limits(load[moved]), strict=True):
            top = sign * model.tick * limit
            rows.append(sign * posed)
            limits.append(top + np.clip(by_pose - top, 0.0, 2.0 * friction) + sign * shift)
    matrix = sparse.csr_array(sparse.vstack(rows))
    return ReachableSet(
        matrix[:, :ticks],
        matrix[:, ticks:],
        sparse.csr_array(every[moved] - every[moved - 1]),  # a cycle's first is x[0] - x[-1]
        np.concatenate(limits),
        np.arange(0, ticks, model.hold),
        model.law.gain * model.most_pose_sag / 2.0 if linearised else 0.0,
    )


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


def speed_ranges(
    model: JointModel, load: Array, pose: tuple[float, float], *, kept: bool = True
) -> tuple[Array, Array]:
    """Least and largest speed in each tick [rad/tick]: condition 1.

    A joint with inertia keeps its speed from another load, (m,) [N m], unless speeds are not to be
    ``kept``. ``pose`` is the least and largest sag by the pose [rad].
    """
    low, high = (limit * model.tick for limit in model.speed_limits(load))
    if model.most_pose_sag > 0.0:
        least = 1e-3 * model.v_max_per_tick  # weaker, where gravity overcomes the joint
        low = np.minimum(low + model.law.gain * pose[0], -least)
        high = np.maximum(high + model.law.gain * pose[1], least)
    if kept and model.has_inertia:
        return np.full_like(low, np.min(low)), np.full_like(high, np.max(high))
    return low, high


def speed_conditions(
    model: JointModel, load: Array, pose: tuple[float, float], *, cyclic: bool
) -> Iterator[tuple[float, Array, float, Array]]:
    """Bounds on the speed after a tick: condition 2 or, with inertia, 2a and where derived 2b.

    Under the load in the ticks whose speeds are known [N m], (m,): a direction, 1 or -1, and the
    numbers of ``w(t+1) <= now * w(t) + before * w(t-1) + most`` for speeds positive in it.
    """
    law, first, next_load = model.law, slice(None if cyclic else -1), np.roll(load, -1)
    low, high = (limit[first] for limit in speed_ranges(model, load, pose))
    following = speed_ranges(model, next_load, pose, kept=False)
    next_low, next_high = (limit[first] for limit in following)
    for sign, slowest, fastest, drive in (
        (1.0, low, high, next_high + law.friction),
        (-1.0, -high, -low, law.friction - next_low),
    ):
        slope, most = drive_change(model, slowest, fastest, sign * (next_load - load)[first])
        if not model.has_inertia:
            yield sign, 1.0 - slope, 0.0, most
            continue
        for now, constant in _motor_conditions(law, slowest, fastest, drive):
            yield sign, now, 0.0, constant
        # Condition 2b is derived where the acceleration limit is below what the window allows, and
        # no integral term moves the drive.
        limited = law.acceleration + law.braking <= np.min(most - slope * fastest)
        limited = limited or np.isinf(law.acceleration)
        if limited and model.position_integral_rate == 0.0:
            kept, released = 1.0 - law.share, 2.0 * law.braking
            now = 1.0 + kept - law.share * slope + released / -slowest
            yield sign, now, -kept, law.share * most + released


def drive_change(
    model: JointModel, slowest: Array, fastest: Array, change: Array
) -> tuple[Array, Array]:
    """Slope s and constant p of ``p - s * w(t)``, an upper bound on the drive's gain in a tick.

    The right-hand side of (7a), with chords of ``max(0, c - w)``, c the change of the sag under the
    load, and of ``|w|``. ``change`` is that of the torque in the direction of the speeds [N m].
    """
    weights, gain, by_pose = model.window.weights, model.law.gain, model.most_pose_sag
    replaced = float(np.abs(np.diff(weights, prepend=0.0, append=0.0)).sum())
    common = float(np.minimum(weights[1:], weights[:-1]).sum())
    sagged, faster = model.compliance * change, model.speed_per_torque * model.tick * change
    most = np.maximum(sagged - slowest, 0.0)
    least = np.maximum(sagged - fastest, 0.0)
    turned = by_pose * (np.abs(slowest) - np.abs(fastest))
    slope = gain * (common * (most - least) + turned) / (fastest - slowest)
    constant = gain * (common * most + by_pose * np.abs(slowest)) + slope * slowest
    changed = common * np.maximum(faster, 0.0) + replaced * (model.law.top + faster / 2.0)
    return slope, constant + changed


def _motor_conditions(
    law: Law, slowest: Array, fastest: Array, drive: Array
) -> list[tuple[Array, Array]]:
    """Condition 2a: the speed after a tick at the largest drive and the acceleration limit."""
    friction = law.braking
    drive = drive if law.share < 1.0 else drive - law.friction  # less the dead zone
    drive = np.maximum(drive, fastest - law.acceleration / law.share)
    ones = np.ones_like(drive)
    lines = [((1.0 - law.share) * ones, law.share * drive)]
    if np.isfinite(law.acceleration):
        lines.append((ones, law.acceleration * ones))
    if friction == 0.0:
        return lines
    least, largest = (
        np.min([now * speed + most for now, most in lines], axis=0) for speed in (slowest, fastest)
    )
    # The concave hull of the friction's shrink between the two: through (-friction, 0), slope 1,
    # and from there, or from the least, to the largest.
    corner = np.clip(-friction, least, largest)
    below, above = (np.sign(u) * np.maximum(np.abs(u) - friction, 0.0) for u in (corner, largest))
    ratio = (above - below) / np.maximum(largest - corner, np.finfo(np.float64).tiny)
    hull = [(ones, friction * ones), (ratio, below - ratio * corner)]
    return [(factor * now, factor * most + added) for factor, added in hull for now, most in lines]


def distance_from_rest(model: JointModel, load: Array, level: Level) -> Array:
    """Largest distances of the first angles from the start [rad]: condition 3.

    The joint rests until the second request acts; then the weights of the requests that may differ
    from the first carry it away, and at any time a change of the sag. The level "slope" ignores the
    time after the second request. The load is the torque in each tick [N m].
    """
    resting = np.zeros(model.hold + model.window.first)  # ticks before the second request acts
    changed = np.minimum(np.cumsum(model.window.weights), 1.0)
    follows = level != "slope" and not model.has_inertia
    new = np.concatenate([resting, changed if follows else []])[: len(load)]
    low, high = model.speed_limits(load[: len(new)])
    fastest = np.maximum(high, -low) * model.tick
    by_pose = model.law.gain * model.most_pose_sag
    if by_pose > 0.0:
        fastest = fastest + by_pose
        if np.any(by_pose >= model.tick * np.minimum(high, -low)):  # no request surely holds it
            new = np.ones_like(new)
    sagged = model.law.gain * model.compliance * np.abs(load[: len(new)] - load[0])
    if model.has_inertia and np.any(sagged):  # overshoot is not bounded here
        sagged = np.full_like(fastest, np.max(fastest))
    more = (fastest - model.v_max_per_tick) * new + (1.0 - new) * sagged
    return np.asarray(model.v_max_per_tick * np.cumsum(new) + np.cumsum(more))
