"""Linear conditions that every response of the joint meets (``docs/math.md``, section 5)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import InvalidInput
from planner.inversion.arguments import Norm
from planner.model.joint import JointModel
from planner.trajectory import Array
from planner.validation import is_one_of, shown

Level = Literal["slope", "envelope", "exact"]

LEVELS: tuple[Level, ...] = ("slope", "envelope", "exact")


class BoundProblem(NamedTuple):
    """A joint and what is desired of it: what a lower bound is about.

    Attributes:
        model: The joint.
        desired: Desired angles D [rad], shape (n,).
        cyclic: Whether the trajectory repeats for ever.
        norm: Which error.
        start: From rest: where the joint rests before the first request [rad]; None for any start.
    """

    model: JointModel
    desired: Array
    cyclic: bool
    norm: Norm
    start: float | None


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


def reachable_set(
    model: JointModel,
    samples: int,
    *,
    cyclic: bool,
    level: Level,
    start: float | None = None,
) -> ReachableSet:
    """Linear conditions that every response of the joint meets, tick by tick.

    Args:
        model: The joint.
        samples: Number of requests n.
        cyclic: Whether the trajectory repeats for ever.
        level: "slope" for condition 1, otherwise conditions 1 and 2.
        start: From rest: where the joint rests before the first request [rad], for condition 3.

    Returns:
        The conditions, on the angles at every tick.
    """
    ticks = samples * model.hold if cyclic else (samples - 1) * model.hold + 1
    steps = _differences(ticks, cyclic=cyclic)  # speeds [rad/tick] from angles
    rows = [steps, -steps]
    limits = [np.full(steps.shape[0], model.v_max_per_tick)] * 2
    if level != "slope":
        kept, gain = envelope(model)
        changes = _differences_of_speed(steps, kept, cyclic=cyclic)
        rows += [changes, -changes]
        limits += [np.full(changes.shape[0], gain)] * 2
    if start is not None:
        farthest_from_start = distance_from_rest(model, ticks, level)
        near_start = sparse.eye_array(ticks, format="csr")[: len(farthest_from_start)]
        rows += [near_start, -near_start]
        limits += [farthest_from_start + start, farthest_from_start - start]
    return ReachableSet(
        sparse.csr_array(sparse.vstack(rows)),
        np.concatenate(limits),
        np.arange(0, ticks, model.hold),
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


def distance_from_rest(model: JointModel, ticks: int, level: Level) -> Array:
    """How far the first angles can be from the start [rad]: condition 3.

    The joint rests until the second request acts; then only the weights of the requests that may
    differ from the first one can carry it away. The level "slope" leaves the latter out.
    """
    resting = np.zeros(model.hold + model.window.first)  # ticks before the second request acts
    if level == "slope":
        return resting[:ticks]
    changed = np.cumsum(np.minimum(np.cumsum(model.window.weights), 1.0))
    return np.concatenate([resting, model.v_max_per_tick * changed])[:ticks]


def check_level(level: str) -> None:
    """Raise InvalidInput unless ``level`` is the name of a level."""
    if not is_one_of(level, LEVELS):
        raise InvalidInput(
            f"level: got {shown(level)}, expected one of {', '.join(map(repr, LEVELS))}"
        )
