"""Responses of joints to requests, their derivatives, and angles at rest under loads."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.model.joint import JointModel, acting, checked_model, request_ages, weights_by_tick
from planner.trajectory import LARGEST, SAME, Array, Mask, as_trajectory, steps
from planner.validation import as_flag, as_number, freeze, shown

Loads = Sequence[Array | None]
"""For each joint the torque on it at every sample [N m], shape (n,), or None."""

MOST_CYCLES = 200
"""Most cycles of a response that still drifts; bisection ends well before."""

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
            (n,); entry k acts in the request period that ends in sample k.

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
    start = checked_start(start, cyclic=cyclic)
    if requests.size * model.hold > MOST_TICKS:
        raise InvalidTrajectory(
            f"requests: got {requests.size}, each held for {model.hold} ticks, expected at most "
            f"{MOST_TICKS} ticks; simulate them part by part"
        )
    torques = checked_load(load, model, len(requests))
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
    """:func:`simulate` of arguments that have been checked: the states at the samples, (3, n).

    Raises:
        NoSteadyCycle: The response does not settle.
    """
    from planner.model.steady_cycle import motion_of

    if torques is None:
        torques = np.zeros(len(requests))
    motion = np.empty((3, len(requests)))
    apart = motion_of(
        model.law,
        weights_by_tick(model)[0],
        np.ascontiguousarray(requests),
        request_ages(model).oldest,
        model.compliance * torques,
        model.faster_per_tick(torques),
        np.nan if start is None else start,
        cyclic,
        MOST_CYCLES,
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
    """Angles of several joints under their requests, each by :func:`simulate`.

    Args:
        models: The joints.
        requests: Requests [rad], shape (n, joints).
        cyclic: Whether they repeat for ever.
        starts: From rest: angle of each joint one tick before the first request [rad], or None.
        loads: Torques on the joints [N m], shape (n, joints), or for each joint shape (n,) or None.

    Returns:
        Angles [rad], shape (n, joints).
    """
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
    """Speeds of a path, and the joint's top speeds in the same direction.

    Attributes:
        speeds: Speed from each sample to the next [rad/s], shape (m,), with the sign of the motion.
        limits: The joint's top speed in that direction, under its load and, with a sag by the pose,
            at the angle of the sample [rad/s], shape (m,).
    """

    speeds: Array
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
    """The speeds of a path; their limits are -v^- or v^+ of (1a), gravity of the pose included.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,).
        cyclic: Whether the path repeats: then the step from the last sample to the first counts.
        load: Torque on the joint in the period that ends in each sample [N m], shape (n,).
    """
    speeds = steps(desired, cyclic=cyclic) / model.period
    torques = 0.0 if load is None else np.roll(load, -1)[: len(speeds)]
    low, high = model.speed_limits(torques, desired[: len(speeds)])
    if model.most_pose_sag > 0.0:  # where gravity overcomes the joint, any speed is too high
        least = SAME * model.v_max
        low, high = np.minimum(low, -least), np.maximum(high, least)
    return PathSpeeds(speeds, np.where(speeds < 0.0, low, high))


def checked_start(start: float | None, *, cyclic: bool) -> float | None:
    """The start as a float [rad]; raise InvalidInput for a cycle, or where it is no angle."""
    if as_flag("cyclic", cyclic) and start is not None:
        raise InvalidInput("start: a cycle has none; leave it out, or say cyclic=False")
    if start is None:
        return None
    angle = as_number(start)
    if not abs(angle) <= LARGEST:
        raise InvalidInput(
            f"start: got {shown(start)}, expected an angle of at most {LARGEST:g} rad either way"
        )
    return angle


def rest_requests(models: Sequence[JointModel], angles: Array, loads: Loads | None = None) -> Array:
    """Requests that hold joints at these angles, in the middle of the dead band [rad].

    There Equation 2 vanishes; shape (..., joints), or (n, joints) under loads.
    """
    torques = [0.0 if load is None else load for load in loads or [None] * len(models)]
    columns = zip(models, np.moveaxis(angles, -1, 0), torques, strict=True)
    each = [column - model.sag(load) - model.pose_sag(column) for model, column, load in columns]
    return np.stack(np.broadcast_arrays(*each), axis=-1)


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
    """The load at every sample [N m], shape (samples,); None where it has no effect.

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
        array = np.asarray(load)
    except ValueError:  # rows of different lengths
        array = np.asarray("ragged")
    if array.dtype.kind not in "iuf" or array.shape not in ((), (samples,)):
        got = f"shape {array.shape}" if array.dtype.kind in "iuf" else shown(load)
        raise InvalidInput(
            f"load: got {got}, expected a torque [N m], or one for each of the {samples} requests"
        )
    torques = np.array(np.broadcast_to(array, samples), dtype=np.float64)
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


LEAST_RADIUS = 1e-12
"""Least radius of the corners [theta_0]: its square is not lost in rounding."""


def sensitivities(
    model: JointModel,
    requests: npt.ArrayLike,
    *,
    cyclic: bool = True,
    start: float | None = None,
    load: npt.ArrayLike | None = None,
) -> Array:
    """Derivatives of the angles with respect to the requests.

    They follow from the derivatives of one request period by one forward recursion; at a corner of
    f they are the mean of the two one-sided derivatives.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,).
        cyclic: Whether the requests repeat for ever; then the steady cycle is differentiated.
        start: From rest: see :func:`planner.simulate`. By default the start moves with the first
            request, which holds the joint there.
        load: Torque on the joint [N m]: see :func:`planner.simulate`.

    Returns:
        d angles[k] / d requests[j], shape (n, n). Memory grows with n squared.

    Raises:
        InvalidTrajectory, InvalidInput, NoSteadyCycle: as :func:`planner.simulate`; NoSteadyCycle
            also where a cycle has no derivative because no tick of it is unsaturated. With a dead
            band the cycle then moves with the first request, beside which it was sought.

    Example:
        >>> import numpy as np
        >>> requests = np.radians(20.0 * np.sin(2 * np.pi * np.arange(50) / 50))
        >>> sensitivities(JointModel.ers210a(), requests).shape  # angles by requests
        (50, 50)
    """
    model = checked_model(model)
    from planner.model import kernel

    requests = as_trajectory(requests, name="requests")
    simulate(model, requests, cyclic=cyclic, start=start, load=load)  # checks the arguments
    n, torques = len(requests), checked_load(load, model, len(requests))
    motion = motion_under(model, requests, cyclic=cyclic, start=start, torques=torques)
    ages, load_at = request_ages(model), np.zeros(n) if torques is None else torques
    weights, numbers = weights_by_tick(model)[0], np.maximum(acting(ages, n, cyclic=cyclic), 0)
    own = max(model.law.states, 2)

    def of_periods(weights: Array, states: Array) -> Array:
        """Derivatives of the first periods from these states on, by them and by the requests."""
        count = states.shape[1]
        window, slopes = np.empty((3, ages.width, count)), np.empty((own, own + ages.width, count))
        window[0] = requests[numbers[:count].T]
        kernel.periods(
            model.law,
            weights,
            window,
            model.compliance * load_at[:count],
            model.faster_per_tick(load_at[:count]),
            np.full(count, (model.law.gain * LEAST_RADIUS * model.theta_0) ** 2),
            states,
            slopes,
            np.empty((own, 0, count)),
        )
        return np.moveaxis(slopes, -1, 0)

    size, each = model.law.states, of_periods(weights, np.roll(motion[:own], 1, axis=1))
    kept, by_request = each[:, :size, :size], each[:, :size, own:]
    driven = np.zeros((n, size, n))
    place = np.arange(n)[:, np.newaxis, np.newaxis], np.arange(size), numbers[:, :, np.newaxis]
    np.add.at(driven, place, by_request.transpose(0, 2, 1))
    if cyclic:
        begin = np.zeros((size, n))
        closing = np.eye(size) - reduce(lambda product, each: each @ product, kept, np.eye(size))
        if np.linalg.det(closing) > 0.0:
            begin = np.linalg.solve(closing, _recursion(kept, driven, begin)[-1])
        elif model.dead_band:
            begin[0, 0] = 1.0
        else:
            raise NoSteadyCycle(0.0, 1)
        rows = _recursion(kept, driven, begin)[:, 0]
    else:
        first = np.zeros((size, n))
        angle = motion[0, 0]
        sag = model.sag_sin * np.cos(angle) - model.sag_cos * np.sin(angle)  # its derivative
        if model.has_integral:
            first[0, 0], first[2, 0] = 1.0, -model.law.gain * sag
        else:
            first[0, 0] = 1.0 / (1.0 - sag)
        if start is not None:  # the last tick of the period before, from rest at the start
            integral = float(model.rest_integral(start, load_at[0]))
            rest = np.array([[start], [0.0], [integral]])[:own]
            first[:, 0] = of_periods(weights[-1:], rest)[0, :size, own:].sum(axis=1)
        later = _recursion(kept[1:], driven[1:], first)[:, 0]
        rows = np.vstack([first[:1], later])
    rows = np.ascontiguousarray(rows)
    freeze(rows)
    return rows


def _recursion(kept: Array, driven: Array, before: Array) -> Array:
    """Derivatives of a run's states from those of the initial state, (samples, states, n)."""
    rows = driven.copy()
    for row, each in zip(rows, kept, strict=True):
        row += each @ before
        before = row
    return rows
