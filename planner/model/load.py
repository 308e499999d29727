"""Loads: the torques on joints, and where joints rest under them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.model.joint import JointModel
from planner.trajectory import Array
from planner.validation import shown

Loads = Sequence[Array | None]
"""For each joint the torque on it at every sample [N m], shape (n,), or None."""


def sags(models: Sequence[JointModel], loads: Loads | None = None) -> Array:
    """Angle at rest less request beside that by the pose, c + kappa tau of (2) [rad].

    Shape (joints,) or (n, joints).
    """
    torques = [0.0 if load is None else load for load in loads or [None] * len(models)]
    each = [model.sag(load) for model, load in zip(models, torques, strict=True)]
    return np.stack(np.broadcast_arrays(*each), axis=-1)


def rest_requests(models: Sequence[JointModel], angles: Array, loads: Loads | None = None) -> Array:
    """Requests that hold joints at these angles, in the middle of the dead band [rad].

    There Equation 2 vanishes; shape (..., joints), or (n, joints) under loads.
    """
    by_pose = [model.pose_sag(angles[..., j]) for j, model in enumerate(models)]
    held: Array = angles - sags(models, loads) - np.stack(by_pose, axis=-1)
    return held


def rest_angles(models: Sequence[JointModel], requests: Array, loads: Loads | None = None) -> Array:
    """Angles at which joints rest under these requests, as :func:`rest_requests` [rad]."""
    torques = [0.0 if load is None else load for load in loads or [None] * len(models)]
    columns = zip(models, np.moveaxis(requests, -1, 0), torques, strict=True)
    each = [model.rest(column, load) for model, column, load in columns]
    return np.stack(np.broadcast_arrays(*each), axis=-1)


def load_columns(loads: Loads, samples: int) -> Array | None:
    """Loads as columns [N m], shape (samples, joints), 0 for None; None where all are None."""
    if all(load is None for load in loads):
        return None
    unloaded = np.zeros(samples)
    return np.column_stack([unloaded if load is None else load for load in loads])


def checked_load(load: npt.ArrayLike | None, model: JointModel, samples: int) -> Array | None:
    """The load at every sample [N m], shape (samples,); None where it changes nothing.

    Args:
        load: Torque on the joint in the direction of positive angles [N m], a number or one a
            sample; it acts in the request period that ends in the sample.
        model: The joint.
        samples: Number of requests.

    Raises:
        InvalidInput: The load is not finite or of another shape, or so large that the joint could
            not move against it.
    """
    if load is None:
        return None
    try:
        given = np.asarray(load)
    except ValueError:  # rows of different lengths
        given = np.asarray("ragged")
    if given.dtype.kind not in "iuf" or given.shape not in ((), (samples,)):
        got = f"shape {given.shape}" if given.dtype.kind in "iuf" else shown(load)
        raise InvalidInput(
            f"load: got {got}, expected a torque [N m], or one for each of the {samples} requests"
        )
    torques = np.array(np.broadcast_to(given, samples), dtype=np.float64)
    if not np.all(np.isfinite(torques)):
        raise InvalidInput("load: got values that are not finite, expected torques [N m]")
    low, high = model.speed_limits(torques)
    blocked = np.flatnonzero((low >= 0.0) | (high <= 0.0))
    if blocked.size:
        at = int(blocked[0])
        way = "down" if low[at] >= 0.0 else "up"
        raise InvalidInput(
            f"load: got {torques[at]:g} N m at sample {at}, against which the joint cannot move "
            f"{way}: v_max = {model.v_max:g} rad/s, v_offset = {model.v_offset:g} rad/s, "
            f"speed_per_torque = {model.speed_per_torque:g} rad/(s N m); is the load in N m?"
        )
    torques.setflags(write=False)
    return torques if model.feels_load else None
