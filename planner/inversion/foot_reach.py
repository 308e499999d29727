"""Where the joints of a leg can be at all under requests within limits (math.md, (13a))."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.model.joint import JointModel
from planner.trajectory import Array


def within_reach(
    models: Sequence[JointModel],
    limits: tuple[Array, Array],
    samples: int,
    *,
    start: Array | None,
) -> tuple[Array, Array]:
    """Angles between which every joint stays under requests within limits [rad], (n, k) both.

    A joint overshoots a request by v - theta_0 a tick at most, and by nothing where that is
    negative. Turning by 2 pi changes nothing for the foot, so that a cycle may be thought to have
    its least angle within a turn of the lower limit, or of -pi; and it goes only so far.

    Args:
        models: The joints.
        limits: Smallest and largest requests [rad], two arrays (k,).
        samples: Number of samples n.
        start: From rest: where the joints rest at the first sample [rad], (k,); None for a cycle.
    """
    beyond = np.array([max(model.v_max_per_tick - model.theta_0, 0.0) for model in models])
    offsets = np.array([model.offset for model in models])
    farthest = np.array([model.v_max * model.period for model in models])
    lower, upper = limits[0] + offsets - beyond, limits[1] + offsets + beyond
    if start is not None:
        away = np.arange(samples)[:, np.newaxis] * farthest
        return np.maximum(lower, start - away), np.minimum(upper, start + away)
    turn = 2.0 * math.pi
    span = turn + samples / 2.0 * farthest  # a cycle goes there and back
    nowhere = np.isinf(lower) & np.isinf(upper)
    lower = np.where(nowhere, -turn / 2.0, lower)
    lower = np.where(np.isinf(lower), upper - span, lower)
    upper = np.minimum(upper, lower + span)
    return np.tile(lower, (samples, 1)), np.tile(upper, (samples, 1))


def how_far_apart(models: Sequence[JointModel], samples: int, *, cyclic: bool) -> Array:
    """How far every joint's angle can be from the one at the middle sample [rad], (n, k)."""
    apart = np.abs(np.arange(samples) - samples // 2)
    if cyclic:
        apart = np.minimum(apart, samples - apart)
    farthest: Array = apart[:, np.newaxis] * np.array([m.v_max * m.period for m in models])
    return farthest
