"""Derivatives of the angles by the requests, by one recursion over the request periods."""

from __future__ import annotations

from functools import reduce

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.model.joint import (
    JointModel,
    acting,
    checked_model,
    request_ages,
    weights_by_tick,
)
from planner.model.response import checked_load, motion_under, simulate
from planner.trajectory import Array, as_trajectory
from planner.validation import freeze

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
    weights, numbers = weights_by_tick(model), np.maximum(acting(ages, n, cyclic=cyclic), 0)
    own = max(model.law.states, 2)
    window, slopes = np.empty((3, ages.width, n)), np.empty((own, own + ages.width, n))
    window[0] = requests[numbers.T]
    kernel.periods(
        model.law,
        weights,
        window,
        model.sag(load_at),
        model.faster_per_tick(load_at),
        np.full(n, (model.law.gain * LEAST_RADIUS * model.theta_0) ** 2),
        np.roll(motion[:own], 1, axis=1),
        slopes,
        np.empty((own, 0, n)),
    )
    size = model.law.states
    each = np.moveaxis(slopes, -1, 0)
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
        first[0, 0] = 1.0 / (1.0 - sag)
        if start is not None:
            torque = 0.0 if torques is None else float(torques[0])
            first[:, 0] = _slopes(model, requests[0], start, torque)[:size]
        later = _recursion(kept[1:], driven[1:], first)[:, 0]
        rows = np.vstack([first[:1], later])
    rows = np.ascontiguousarray(rows)
    freeze(rows)
    return rows


def _slopes(model: JointModel, request: float, start: float, load: float) -> Array:
    """Derivatives of the first state from rest by the request; at a corner the mean of both sides.

    Args:
        model: The joint.
        request: First request [rad].
        start: Angle at which the joint rests before it [rad].
        load: Torque on the joint [N m].
    """
    error = float(request + model.pose_sag(start) - start + model.sag(load))
    sides = np.sign(error - model.corners(load, start))
    slope = float(model.gain_per_tick * (sides[0] - sides[1] + sides[2] - sides[3]) / 2.0)
    most = model.law.acceleration / model.law.share
    drive = abs(float(model.speed(error, load, start)) * model.tick)
    drive += model.law.friction if model.law.share < 1.0 else 0.0
    within = (1.0 - float(np.sign(drive - most))) / 2.0  # the acceleration limit
    speed = model.law.share * slope * within
    demand = float(model.gain_per_tick * (sides[0] - sides[3]) / 2.0)
    return np.array([speed, speed, model.law.integral * (demand - speed) * within])


def _recursion(kept: Array, driven: Array, before: Array) -> Array:
    """Derivatives of a run's states from those of the initial state, (samples, states, n)."""
    rows = driven.copy()
    for row, each in zip(rows, kept, strict=True):
        row += each @ before
        before = row
    return rows
