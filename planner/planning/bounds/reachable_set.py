"""Linear conditions that every response of the joint meets (``docs/math.md``, section 5)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import InvalidInput
from planner.model.joint import JointModel
from planner.planning.arguments import Norm
from planner.trajectory import Array
from planner.validation import is_one_of, shown

Level = Literal["slope", "envelope", "exact"]

LEVELS: tuple[Level, ...] = ("slope", "envelope", "exact")


class BoundProblem(NamedTuple):
    """The joint, the desired angles and the norm of a lower bound.

    Attributes:
        model: The joint.
        desired: Desired angles D [rad], shape (n,).
        cyclic: Whether the trajectory repeats for ever.
        norm: Which error.
        start: From rest: where the joint rests before the first request [rad]; None for any start.
        load: Torque on the joint in the period that ends in each sample [N m], shape (n,), if any.
    """

    model: JointModel
    desired: Array
    cyclic: bool
    norm: Norm
    start: float | None
    load: Array | None = None


class ReachableSet(NamedTuple):
    """A set that contains every trajectory the joint can make: ``matrix @ angles <= limits``.

    Attributes:
        matrix: G, shape (rows, ticks).
        limits: b [rad], shape (rows,).
        sampled: Indices of the angles that are compared with the desired ones, shape (n,).
    """

    matrix: sparse.csr_array
    limits: Array
    sampled: npt.NDArray[np.int_]


def reachable_set(problem: BoundProblem, level: Level) -> ReachableSet:
    """Linear conditions that every response of the joint meets, tick by tick.

    Args:
        problem: The joint, its load and the number of samples; what is desired does not count.
        level: "slope" for condition 1, otherwise conditions 1 and 2, and from a given start 3, as
            far as they hold: see :func:`proved_level`.

    Returns:
        The conditions, on the angles at every tick.
    """
    model, start = problem.model, problem.start
    level = proved_level(model, level)
    ticks = ticks_of(problem)
    load = load_by_tick(problem, ticks)
    steps = _differences(ticks, cyclic=problem.cyclic)  # speeds [rad/tick] from angles
    low, high = (limit * model.tick for limit in model.speed_limits(load))
    if model.has_inertia:  # it keeps the speed that it had under another load
        low, high = np.full(ticks, np.min(low)), np.full(ticks, np.max(high))
    moved = np.arange(0 if problem.cyclic else 1, ticks)
    rows, limits = [steps, -steps], [high[moved], -low[moved]]
    if level != "slope":
        kept, gain = envelope(model, load[moved], cyclic=problem.cyclic)
        for sign, keeping, gaining in zip((1.0, -1.0), kept, gain, strict=True):
            changes = _differences_of_speed(steps, keeping, cyclic=problem.cyclic)
            rows.append(sign * changes)
            limits.append(gaining)
    if start is not None:
        farthest_from_start = distance_from_rest(model, load, level)
        near_start = sparse.eye_array(ticks, format="csr")[: len(farthest_from_start)]
        rows += [near_start, -near_start]
        limits += [farthest_from_start + start, farthest_from_start - start]
    return ReachableSet(
        sparse.csr_array(sparse.vstack(rows)),
        np.concatenate(limits),
        np.arange(0, ticks, model.hold),
    )


def proved_level(model: JointModel, level: Level) -> Level:
    """The strongest level, this one at most, whose conditions hold for a joint.

    With inertia the speed changes by what the motor allows and not by what the window does, so that
    "slope" is left; "exact" follows requests through the window to a speed that is their sum, which
    friction makes another one, and a sag by the angle another one at every angle.
    """
    if model.has_inertia:
        return "slope"
    follows = model.dead_band == 0.0 and model.most_pose_sag == 0.0
    return level if follows or level != "exact" else "envelope"


def ticks_of(problem: BoundProblem) -> int:
    """Number of ticks at which the joint's angle is an unknown."""
    samples, hold = len(problem.desired), problem.model.hold
    return samples * hold if problem.cyclic else (samples - 1) * hold + 1


def farthest_per_period(model: JointModel, load: Array | None = None) -> float:
    """Farthest that the joint moves between two requests, in either direction [rad]."""
    low, high = model.speed_limits(0.0 if load is None else load)
    return float(max(np.max(high), np.max(-low))) * model.period


def load_by_tick(problem: BoundProblem, ticks: int) -> Array:
    """The torque in the tick that ends in each tick's angle [N m], shape (ticks,)."""
    if problem.load is None:
        return np.zeros(ticks)
    samples = -(-np.arange(ticks) // problem.model.hold)  # at each tick the sample that is next
    by_tick: Array = problem.load[samples % len(problem.load)]
    return by_tick


def envelope(model: JointModel, load: Array, *, cyclic: bool) -> tuple[Array, Array]:
    """Condition 2 with its convex majorant, ``w(t+1) - kept * w(t) <= gain``, and its mirror image.

    The majorant of ``max(0, s - w + p |w|)``, with s the change of the sag and p the largest slope
    of the sag by the angle, is the chord between the least and the greatest speed w, which are
    2 v_max apart.

    Args:
        model: The joint.
        load: Torque in the ticks whose speeds are known [N m], shape (m,).
        cyclic: Whether the first of them follows the last.

    Returns:
        kept [-] and gain [rad/tick], each of shape (2, changes): upwards, and of the mirror image.
    """
    v_max, top, weights = model.v_max_per_tick, model.law.top, model.window.weights
    replaced = float(np.abs(np.diff(weights, prepend=0.0, append=0.0)).sum())
    common = float(np.minimum(weights[1:], weights[:-1]).sum())
    low, high = (limit * model.tick for limit in model.speed_limits(load))
    following, count = np.roll(np.arange(len(load)), -1), len(load) - (not cyclic)
    sagging = model.compliance * (load[following] - load)
    faster = high[following] - high
    by_pose, kept, gain = model.most_pose_sag, [], []
    for sign, slowest, fastest in ((1.0, low, high), (-1.0, -high, -low)):
        # Upwards the least w leaves most to be gained; the mirror image turns all signs.
        most = np.maximum(sign * sagging - slowest + by_pose * np.abs(slowest), 0.0)
        least = np.maximum(sign * sagging - fastest + by_pose * np.abs(fastest), 0.0)
        slope = model.gain_per_tick * common * ((most - least) / (2.0 * v_max))
        beyond = slope * (fastest - v_max) + model.gain_per_tick * common * least
        changed = common * np.maximum(sign * faster, 0.0) + replaced * sign * faster / 2.0
        kept.append((1.0 - slope)[:count])
        gain.append((top * replaced + v_max * slope + beyond + changed)[:count])
    return np.stack(kept), np.stack(gain)


def _differences(ticks: int, *, cyclic: bool) -> sparse.csr_array:
    """Rows x[t] - x[t-1]; cyclic, the first row is x[0] - x[-1]."""
    every = sparse.eye_array(ticks, format="csr")
    if cyclic:
        return sparse.csr_array(every - every[np.roll(np.arange(ticks), 1)])
    return sparse.csr_array(every[1:] - every[:-1])


def _differences_of_speed(
    steps: sparse.csr_array, kept: Array, *, cyclic: bool
) -> sparse.csr_array:
    """Rows w[t+1] - kept[t] * w[t]."""
    last = steps.shape[0] if cyclic else -1
    following = steps[np.roll(np.arange(steps.shape[0]), -1)][:last]
    scaled = steps[:last]
    scaled.data *= np.repeat(kept, np.diff(scaled.indptr))
    return sparse.csr_array(following - scaled)


def distance_from_rest(model: JointModel, load: Array, level: Level) -> Array:
    """How far the first angles can be from the start [rad]: condition 3.

    The joint rests until the second request acts; then only the weights of the requests that may
    differ from the first one can carry it away, and before and after what the sag changes by. The
    level "slope" leaves out what follows the second request.

    Args:
        model: The joint.
        load: Torque in each tick [N m], shape (ticks,).
        level: "slope" or another.
    """
    resting = np.zeros(model.hold + model.window.first)  # ticks before the second request acts
    changed = np.minimum(np.cumsum(model.window.weights), 1.0)
    new = np.concatenate([resting, changed if level != "slope" else []])[: len(load)]
    low, high = model.speed_limits(load[: len(new)])
    fastest = np.maximum(high, -low) * model.tick
    sagged = model.gain_per_tick * model.compliance * np.abs(load[: len(new)] - load[0])
    if model.has_inertia and np.any(sagged):  # how it rings is not bounded here
        sagged = np.full_like(fastest, np.max(fastest))
    more = (fastest - model.v_max_per_tick) * new + (1.0 - new) * sagged
    return np.asarray(model.v_max_per_tick * np.cumsum(new) + np.cumsum(more))


def check_level(level: str) -> None:
    """Raise InvalidInput unless ``level`` is the name of a level."""
    if not is_one_of(level, LEVELS):
        raise InvalidInput(
            f"level: got {shown(level)}, expected one of {', '.join(map(repr, LEVELS))}"
        )
