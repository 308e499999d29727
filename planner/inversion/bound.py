"""How good could any requests be? Lower bounds on the tracking error (``docs/math.md``).

A lower bound is proved by multipliers: for every trajectory x with G x <= h and every lambda >= 0,
Hölder's inequality gives ``|x - d| >= lambda (G d - h) / |G' lambda|*``. The solver proposes the
multipliers and the inequality is evaluated here, so that a bound is valid whatever the solver did.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import InvalidInput, SolverFailed
from planner.model.joint import JointModel
from planner.model.response import checked_start
from planner.trajectory import Array, as_trajectory

Norm = Literal["rms", "max"]
Level = Literal["slope", "envelope"]

NORMS: tuple[Norm, ...] = ("rms", "max")
LEVELS: tuple[Level, ...] = ("slope", "envelope")


class Reachable(NamedTuple):
    """A set that contains every trajectory the joint can make: ``matrix @ angles <= limit``.

    Attributes:
        matrix: G, shape (rows, ticks).
        limit: h [rad], shape (rows,).
        sampled: Indices of the angles that are compared with the desired ones, shape (n,).
    """

    matrix: sparse.csr_array
    limit: Array
    sampled: npt.NDArray[np.int_]


def lower_bound(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
) -> float:
    """An error that no requests whatever can go below.

    ``slope`` uses that the joint never moves faster than v_max; ``envelope`` also that its speed
    cannot change at once (``docs/math.md``, conditions 1 and 2). Each is at least the one before.

    Args:
        model: The joint.
        desired: Wanted angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        norm: "rms" for the root mean square of the errors, "max" for the largest.
        level: "slope" or "envelope".
        start: From rest: angle at which the joint rests until the plan begins [rad]. Without it the
            bound holds for every start.

    Returns:
        The bound [rad], at least 0.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: The norm or the level has another name, or a cycle is given a start.
        SolverFailed: The solver proposed no multipliers.
    """
    desired = as_trajectory(desired, name="desired")
    check_norm(norm)
    if level not in LEVELS:
        raise InvalidInput(f"level: got {level!r}, expected one of {', '.join(map(repr, LEVELS))}")
    start = checked_start(start, cyclic=cyclic)
    reachable = reachable_set(model, len(desired), cyclic=cyclic, level=level, start=start)
    middle = float(np.mean(desired))
    scale = max(float(np.ptp(desired)), model.v_max * model.period)
    centred = (desired - middle) / scale
    scaled = reachable._replace(limit=_relative(reachable, middle) / scale)
    reference, multipliers = propose(scaled, centred, norm=norm)
    slack = model.v_max * model.period / scale
    return scale * certified_error(scaled, centred, reference, multipliers, norm=norm, slack=slack)


def check_norm(norm: str) -> None:
    """Raise InvalidInput unless ``norm`` is the name of a norm."""
    if norm not in NORMS:
        raise InvalidInput(f"norm: got {norm!r}, expected one of {', '.join(map(repr, NORMS))}")


def reachable_set(
    model: JointModel,
    samples: int,
    *,
    cyclic: bool,
    level: Level,
    start: float | None = None,
) -> Reachable:
    """Linear conditions that every response of the joint meets, tick by tick.

    Args:
        model: The joint.
        samples: Number of requests n.
        cyclic: Whether the trajectory repeats for ever.
        level: "slope" for condition 1, "envelope" for conditions 1 and 2.
        start: From rest: see :func:`lower_bound`.

    Returns:
        The conditions, on the angles at every tick (``slope``: at every sample, which is the same).
    """
    stride = 1 if level == "slope" else model.hold
    ticks = samples * stride if cyclic else (samples - 1) * stride + 1
    steps = _differences(ticks, cyclic=cyclic)  # speeds [rad/tick] from angles
    farthest = model.v_max_per_tick * (model.hold if level == "slope" else 1)
    rows = [steps, -steps]
    limits = [np.full(steps.shape[0], farthest)] * 2
    if level == "envelope":
        kept, gain = envelope(model)
        changes = _differences_of_speed(steps, kept, cyclic=cyclic)
        rows += [changes, -changes]
        limits += [np.full(changes.shape[0], gain)] * 2
    if start is not None:
        farthest_from_start = _setting_off(model, ticks, level)
        near_start = sparse.eye_array(ticks, format="csr")[: len(farthest_from_start)]
        rows += [near_start, -near_start]
        limits += [farthest_from_start + start, farthest_from_start - start]
    return Reachable(
        sparse.csr_array(sparse.vstack(rows)), np.concatenate(limits), np.arange(0, ticks, stride)
    )


def envelope(model: JointModel) -> tuple[float, float]:
    """Condition 2 with its convex majorant: ``w(t+1) - kept * w(t) <= gain`` and its mirror image.

    Returns:
        kept [-] and gain [rad/tick].
    """
    v_max, weights = model.v_max_per_tick, model.window.weights
    replaced = float(np.abs(np.diff(weights, prepend=0.0, append=0.0)).sum())
    common = float(np.minimum(weights[1:], weights[:-1]).sum())
    half = v_max / model.theta_0 * common / 2.0
    return 1.0 - half, v_max * (replaced + half)


def propose(reachable: Reachable, desired: Array, *, norm: Norm) -> tuple[Array, Array]:
    """The nearest trajectory of the set and the multipliers that prove it so, as a solver has them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        norm: Which distance.

    Returns:
        Angles at every tick, and a multiplier >= 0 for every row.

    Raises:
        SolverFailed: The solver has none.
    """
    import cvxpy

    angles = cvxpy.Variable(reachable.matrix.shape[1])
    errors = angles[reachable.sampled] - desired
    distance: Any = cvxpy.sum_squares if norm == "rms" else cvxpy.norm_inf  # type: ignore[attr-defined]
    objective = distance(errors)
    conditions = reachable.matrix @ angles <= reachable.limit
    problem = cvxpy.Problem(cvxpy.Minimize(objective), [conditions])
    try:
        problem.solve(solver=cvxpy.CLARABEL)  # type: ignore[no-untyped-call]
    except cvxpy.SolverError as error:
        raise SolverFailed("lower bound", str(error)) from error
    if angles.value is None or conditions.dual_value is None:
        raise SolverFailed("lower bound", problem.status)
    return angles.value, np.maximum(conditions.dual_value, 0.0)


def certified_error(
    reachable: Reachable,
    desired: Array,
    reference: Array,
    multipliers: Array,
    *,
    norm: Norm,
    slack: float,
) -> float:
    """The lower bound that the multipliers prove, whoever proposed them.

    Args:
        reachable: The set.
        desired: Wanted angles, shape (n,).
        reference: Any angles at the ticks between samples, shape (ticks,).
        multipliers: lambda >= 0, shape (rows,).
        norm: Which error.
        slack: How far an angle between two samples can be from the sample before it.

    Returns:
        A number >= 0 that no trajectory of the set can go below.
    """
    point = reference.copy()
    point[reachable.sampled] = desired
    pull = reachable.matrix.T @ multipliers  # G' lambda, one entry per tick
    proved = float(multipliers @ (reachable.matrix @ point - reachable.limit))
    at_samples = pull[reachable.sampled]
    # Angles between samples are free, so there G' lambda should vanish; what is left of it counts.
    between = np.abs(pull)
    between[reachable.sampled] = 0.0
    nearest = np.repeat(desired, np.diff(reachable.sampled, append=len(point)))
    proved -= float(between @ (np.abs(point - nearest) + slack))
    if norm == "rms":
        size = np.sqrt(len(desired)) * (np.linalg.norm(at_samples) + between.sum())
    else:
        size = np.abs(at_samples).sum() + between.sum()
    return max(proved / float(size), 0.0) if size > 0.0 else 0.0


def _relative(reachable: Reachable, middle: float) -> Array:
    """The limits for angles measured from ``middle``."""
    shift: Array = reachable.matrix @ np.full(reachable.matrix.shape[1], middle)
    return reachable.limit - shift


def _differences(ticks: int, *, cyclic: bool) -> sparse.csr_array:
    """Rows x[t] - x[t-1]; cyclic, the first row is x[0] - x[-1]."""
    every = sparse.eye_array(ticks, format="csr")
    if cyclic:
        return sparse.csr_array(every - every[np.roll(np.arange(ticks), 1)])
    return sparse.csr_array(every[1:] - every[:-1])


def _differences_of_speed(
    steps: sparse.csr_array, kept: float, *, cyclic: bool
) -> sparse.csr_array:
    """Rows w[t+1] - kept * w[t]."""
    if cyclic:
        following = steps[np.roll(np.arange(steps.shape[0]), -1)]
        return sparse.csr_array(following - kept * steps)
    return sparse.csr_array(steps[1:] - kept * steps[:-1])


def _setting_off(model: JointModel, ticks: int, level: Level) -> Array:
    """How far the first angles can be from the start [rad]: condition 3.

    The joint rests until the second request acts; then only the weights of the requests that may
    differ from the first one can carry it away.
    """
    resting = np.zeros(model.hold + model.window.first)  # ticks before the second request acts
    if level == "slope":
        return resting[:: model.hold][:ticks]
    changed = np.cumsum(np.minimum(np.cumsum(model.window.weights), 1.0))
    return np.concatenate([resting, model.v_max_per_tick * changed])[:ticks]
