"""Responses of joints to requests, and angles at rest under loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import (
    LARGEST,
    MOST_TURNS,
    SAME,
    TURN,
    Array,
    Mask,
    as_flag,
    as_number,
    as_reals,
    as_trajectory,
    shown,
    steps,
    turns_words,
)
from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle, angle_text
from planner.model.joint import JointModel, acting_requests, checked_model
from planner.model.law import MOST_CYCLES

Loads = Sequence[Array | None]
"""For each joint the torque on it at every sample [N m], shape (n,), or None."""

MOST_TICKS = 20_000_000
"""Longest simulation [ticks]: more than two days at 100 Hz."""


def simulate(
    model: JointModel,
    requests: npt.ArrayLike,
    *,
    cyclic: bool = True,
    start: float | None = None,
    load: npt.ArrayLike | None = None,
) -> Array:
    """Angles of the joint under ``requests``: the exact model, Equation 3, which judges every plan.

    Cyclic, the answer is the steady cycle, whose ends agree to 1e-12 rad. Without inertia it is
    found by the secant method on the angle at which a cycle starts; with a dead band there may be
    many, and the answer is the one nearest to where the first request holds the joint. With inertia
    it is the one into which the motion from rest there settles (``docs/math.md``, section 1). From
    rest, the requests before the first equal the first.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the requests repeat for ever.
        start: From rest only: angle one tick before the first request [rad], at rest. By
            default the joint rests where the first request holds it, at request + offset, in the
            middle of the dead band.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape
            (n,), at the samples; in a request period the mean of the two at its ends acts.

    Returns:
        Angles [rad], shape (n,), read-only; sample k is taken right after request k.

    Raises:
        InvalidTrajectory: ``requests`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: ``start`` is given for a cycle, or not finite; ``load`` is of another shape,
            not finite, or so large that the joint could not move against it.
        NoSteadyCycle: The response does not settle.

    Example:
        >>> import numpy as np
        >>> joint = JointModel.ers210a()
        >>> angles = simulate(joint, np.radians([0.0] + 20 * [30.0]), cyclic=False)
        >>> [round(float(each), 1) for each in np.degrees(angles[[1, 4, 8, 20]])]
        [0.0, 0.0, 2.2, 28.1]
    """
    model = checked_model(model)
    requests = as_trajectory(requests, name="requests")
    start = checked_start(start, float(requests[0]), cyclic=cyclic)
    if requests.size * model.hold > MOST_TICKS:
        raise InvalidTrajectory(
            f"requests: got {requests.size}, each held for {model.hold} ticks, expected at most "
            f"{MOST_TICKS} ticks; simulate them part by part"
        )
    torques = load_by_period(checked_load(load, model, len(requests)), cyclic=cyclic)
    motion = motion_under(model, requests, cyclic=cyclic, start=start, torques=torques)
    sampled: Array = motion[0].copy()
    sampled.setflags(write=False)
    return sampled


def motion_under(
    model: JointModel,
    requests: Array,
    *,
    cyclic: bool,
    start: float | None = None,
    torques: Array | None = None,
) -> Array:
    """:func:`simulate` of checked arguments, torques by :func:`load_by_period`: states, (3, n)."""
    from planner.model.steady_cycle import motion_of

    if torques is None:
        torques = np.zeros(len(requests))
    motion, acting = np.empty((3, len(requests))), acting_requests(model)
    apart = motion_of(
        model.law,
        acting.weights[0],
        np.array(requests),  # writeable: compiled once for all
        acting.oldest,
        model.compliance * torques,
        model.faster_per_tick(torques),
        np.nan if start is None else start,
        cyclic,
        motion,
    )
    if apart:
        raise NoSteadyCycle(apart, MOST_CYCLES)
    return motion


def simulate_joints(
    models: Sequence[JointModel],
    requests: Array,
    *,
    cyclic: bool,
    starts: Sequence[float | None] | Array | None = None,
    loads: Array | Loads | None = None,
) -> Array:
    """Angles of joints [rad], each by :func:`simulate`, (n, joints); loads (n, joints) or each."""
    none = [None] * len(models)
    each_load = loads.T if isinstance(loads, np.ndarray) else loads or none
    each_start = none if starts is None else starts
    columns = zip(models, requests.T, each_start, each_load, strict=True)
    return np.column_stack(
        [
            simulate(model, column, cyclic=cyclic, start=start, load=load)
            for model, column, start, load in columns
        ]
    )


class PathSpeeds(NamedTuple):
    """Speeds of a path, and the joint's top speeds in the same direction."""

    speeds: Array  # from each sample to the next [rad/s], (m,), with the sign of the motion
    # in that direction, under the load and, with a sag by the pose, at the sample's angle [rad/s]
    limits: Array

    @property
    def shares(self) -> Array:
        """The speeds over the top speeds [-], shape (m,), 0 or more."""
        return np.asarray(self.speeds / self.limits)

    @property
    def too_fast(self) -> Mask:
        """Where the path exceeds the joint's top speed, shape (m,)."""
        return np.asarray(self.shares > 1.0 + SAME)

    @property
    def highest(self) -> tuple[float, float]:
        """Speed and top speed where their ratio is largest [rad/s], both 0 or more."""
        k = int(np.argmax(self.shares))
        return abs(float(self.speeds[k])), abs(float(self.limits[k]))


def path_speeds(
    model: JointModel, desired: Array, *, cyclic: bool, load: Array | None = None
) -> PathSpeeds:
    """The speeds of a path [rad], (n,); their limits are -v^- or v^+ of (1a), with gravity."""
    speeds = steps(desired, cyclic=cyclic) / model.period
    acting = load_by_period(load, cyclic=cyclic)
    torques = 0.0 if acting is None else np.roll(acting, -1)[: len(speeds)]
    low, high = model.speed_limits(torques, desired[: len(speeds)])
    if model.most_pose_sag > 0.0:  # where gravity overcomes the joint, any speed is too high
        least = SAME * model.v_max
        low, high = np.minimum(low, -least), np.maximum(high, least)
    return PathSpeeds(speeds, np.where(speeds < 0.0, low, high))


def checked_start(start: float | None, first: float, *, cyclic: bool) -> float | None:
    """The start as a float [rad]; InvalidInput for a cycle, or far from the ``first`` sample."""
    if as_flag("cyclic", cyclic) and start is not None:
        raise InvalidInput("start: a cycle has none; leave it out, or say cyclic=False")
    if start is None:
        return None
    angle = as_number(start)
    if not abs(angle) <= LARGEST:
        raise InvalidInput(
            f"start: got {shown(start)}, expected an angle of at most {LARGEST:g} rad either way"
        )
    if abs(angle - first) > MOST_TURNS * TURN:
        raise InvalidInput(
            f"start: {turns_words(angle)}, where the path begins at {angle_text(first)}; if this "
            "is in degrees, convert it with numpy.radians"
        )
    return angle


def of_joints(
    of: Callable[[JointModel, Array, Any], Array],
    models: Sequence[JointModel],
    values: Array,
    loads: Loads | Array | None = None,
) -> Array:
    """A function of a model, its value and its load, for each joint, (..., joints).

    It is ``JointModel.rest``, or ``JointModel.request_at``.
    """
    columns = []
    for j, model in enumerate(models):
        load = None if loads is None else loads[j]
        columns.append(of(model, values[..., j], 0.0 if load is None else load))
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def load_columns(loads: Loads, samples: int) -> Array | None:
    """Loads as columns [N m], shape (samples, joints), 0 for None; None where all are None."""
    if all(load is None for load in loads):
        return None
    unloaded = np.zeros(samples)
    return np.column_stack([unloaded if load is None else load for load in loads])


def checked_load(load: npt.ArrayLike | None, model: JointModel, samples: int) -> Array | None:
    """The load at every sample [N m], (samples,), which it can move against; None for no effect."""
    if load is None:
        return None
    try:
        torques = np.broadcast_to(as_reals(load), samples).copy()
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: got {shown(load)}, expected a torque [N m], or one for each of the {samples} "
            "requests"
        ) from error
    if not np.all(np.isfinite(torques)):
        raise InvalidInput("load: got values that are not finite, expected torques [N m]")
    low, high = model.speed_limits(torques)
    blocked = np.flatnonzero((low >= 0.0) | (high <= 0.0))
    if blocked.size:
        at = int(blocked[0])
        way = "down" if low[at] >= 0.0 else "up"
        raise InvalidInput(
            f"load: got {torques[at]:g} N m at sample {at}, against which the joint cannot move "
            f"{way}: v_max = {model.v_max:g} [rad/s], v_offset = {model.v_offset:g} [rad/s], "
            f"speed_per_torque = {model.speed_per_torque:g} [rad/(s N m)]; is the load in N m?"
        )
    torques.setflags(write=False)
    return torques if model.feels_load else None


def load_by_period(load: Array | None, *, cyclic: bool) -> Array | None:
    """The torque in the period that ends in each sample [N m], (..., n): the mean at its ends."""
    if load is None:
        return None
    first = load[..., -1:] if cyclic else load[..., :1]
    return np.asarray((np.concatenate([first, load[..., :-1]], axis=-1) + load) / 2.0)


def farthest_per_period(model: JointModel, load: Array | None = None) -> float:
    """Farthest that the joint moves between two requests, in either direction [rad]."""
    low, high = model.speed_limits(0.0 if load is None else load)
    by_pose = model.law.gain * model.most_pose_sag * model.hold
    return float(max(np.max(high), np.max(-low))) * model.period + by_pose
