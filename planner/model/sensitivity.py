"""How the angles change with the requests.

Where the angle before each request period is given, the periods do not wait for one another: all
samples are evaluated together, with their derivatives and with rounded corners. The optimised
inversion, which has the angles among its unknowns, needs no more than that; the derivatives of a
run follow by one recursion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.model.joint import (
    JointModel,
    RequestAges,
    acting,
    checked_model,
    request_ages,
    weights_by_tick,
)
from planner.model.load import Loads, checked_load
from planner.model.response import motion_under, simulate
from planner.trajectory import Array, as_trajectory
from planner.validation import freeze

LEAST_RADIUS = 1e-12
"""Least radius of the corners [theta_0]: a square of it is still a number beside one."""


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
        cyclic: Whether the requests repeat for ever; then the derivatives are those of the cycle.
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
    requests = as_trajectory(requests, name="requests")
    simulate(model, requests, cyclic=cyclic, start=start, load=load)  # checks the arguments
    n, torques = len(requests), checked_load(load, model, len(requests))
    motion = motion_under(model, requests, cyclic=cyclic, start=start, torques=torques)
    numbers = np.maximum(acting(request_ages(model), n, cyclic=cyclic), 0)
    evaluate = periods((model,), n) if torques is None else Periods((model,), n, (torques,))
    before = evaluate.states(motion.angles[:, np.newaxis], motion.speeds[:, np.newaxis])
    windows = requests[numbers.T, np.newaxis]
    response = evaluate(np.roll(before, 1, axis=0), windows, 0.0)
    size = before.shape[1]  # the angle, and with inertia the speed
    kept = np.zeros((n, size, size))
    kept[:, range(size), range(size)] = response.by_own
    if response.by_other is not None:
        kept[:, [0, 1], [1, 0]] = response.by_other
    driven = np.zeros((n, size, n))
    place = np.arange(n)[:, np.newaxis, np.newaxis], np.arange(size), numbers[:, :, np.newaxis]
    np.add.at(driven, place, response.by_request.transpose(1, 0, 2))
    if cyclic:
        begin = np.zeros((size, n))
        closing = np.eye(size) - _product(kept)
        if np.linalg.det(closing) > 0.0:
            begin = np.linalg.solve(closing, _recursion(kept, driven, begin)[-1])
        elif model.dead_band:
            begin[0, 0] = 1.0
        else:
            raise NoSteadyCycle(0.0, 1)
        rows = _recursion(kept, driven, begin)[:, 0]
    else:
        first = np.zeros((size, n))
        first[0, 0] = 1.0
        if start is not None:
            torque = 0.0 if torques is None else float(torques[0])
            first[:, 0] = _slope(model, requests[0] - start, torque)
            first[1:] *= evaluate.units[0]
        later = _recursion(kept[1:], driven[1:], first)[:, 0]
        rows = np.vstack([first[:1], later])
    rows = np.ascontiguousarray(rows)
    freeze(rows)
    return rows


def _slope(model: JointModel, error: float, load: float) -> float:
    """Derivative of the first speed from rest by the request; at a corner the mean of both sides.

    Args:
        model: The joint.
        error: First request minus angle [rad].
        load: Torque on the joint [N m].
    """
    error = float(error + model.sag(load))
    sides = np.sign(error - model.corners(load))
    slope = float(model.gain_per_tick * (sides[0] - sides[1] + sides[2] - sides[3]) / 2.0)
    most = model.law.acceleration / model.law.share
    drive = abs(float(model.speed(error, load)) * model.tick) + model.law.friction
    beyond = float(np.sign(drive - most))
    return model.law.share * slope * (1.0 - beyond) / 2.0


def _product(kept: Array) -> Array:
    """The product of all matrices, the last one leftmost."""
    product = np.eye(kept.shape[1])
    for each in kept:
        product = each @ product
    return product


def _recursion(kept: Array, driven: Array, before: Array) -> Array:
    """Derivatives of a run's states, given those of the state before it, (samples, states, n)."""
    rows = driven.copy()
    for row, each in zip(rows, kept, strict=True):
        row += each @ before
        before = row
    return rows


class Response(NamedTuple):
    """Where each period leads, and to second order how that changes.

    The states are the joints' angles [rad] and, where a joint has inertia, after all angles the
    joints' speeds, times :attr:`Periods.units`; the other state of an angle is the joint's speed,
    and that of a speed its angle. ``d reached[k] = by_own[k] d before[k] + by_other[k] d other[k]
    + sum_j by_request[j, k] d requests[acting[j, k]]`` and half of ``bending[j, k]`` times the
    square of ``d requests[acting[j, k]] - d angle before[k]``: an estimate where requests are held
    for several ticks, or friction or an acceleration limit act on the sum of several.
    """

    reached: Array  # (n, states)
    by_own: Array  # (n, states)
    by_other: Array | None  # (n, states); None without inertia
    by_request: Array  # (width, n, states)
    bending: Array  # (width, n, states) [1/rad]


class Periods:
    """The request periods of joints that are sent their requests together."""

    def __init__(
        self,
        models: Sequence[JointModel],
        samples: int,
        loads: Loads | None = None,
    ) -> None:
        """Work out which request counts how much at each tick of a period.

        Args:
            models: The joints.
            samples: Number of samples.
            loads: For each joint the torque on it in the period that ends in each sample [N m],
                shape (samples,), or None.
        """
        self.ages = request_ages_of_all(models)
        self._models = tuple(models)
        self.has_speeds = any(model.has_inertia for model in models)
        torques = [
            np.zeros(samples) if load is None else np.asarray(load)
            for load in loads or [None] * len(models)
        ]
        pairs = list(zip(models, torques, strict=True))
        self._sags = [model.sag(load) for model, load in pairs]
        self._faster = [model.faster_per_tick(load) for model, load in pairs]
        # A speed counts as the angle through which the joint coasts.
        self.units = np.array([max(1.0 / model.law.share, model.hold) for model in models])

    def states(self, angles: Array, speeds: Array) -> Array:
        """Angles [rad] and, with inertia, speeds [rad/tick], both (n, joints), as states."""
        return np.hstack([angles, self.units * speeds]) if self.has_speeds else angles

    def __call__(self, before: Array, windows: Array, radius: float) -> Response:
        """The response to requests.

        Args:
            before: States before each sample, shape (n, states).
            windows: Requests that act before each sample, youngest first [rad], (width, n, joints).
            radius: Radius of the corners of f [theta_0].
        """
        from planner.model import kernel

        joints = len(self._models)
        reached, by_own, by_other = (np.empty(before.shape) for _ in range(3))
        by_request, bending = np.zeros((2, len(windows), *before.shape))
        for joint, model in enumerate(self._models):
            kernel.respond(
                model.law,
                weights_by_tick(model),
                before,
                windows,
                self._sags[joint],
                self._faster[joint],
                max(radius, LEAST_RADIUS) * model.theta_0,
                float(self.units[joint]),
                reached,
                by_own,
                by_other,
                by_request,
                bending,
                joint,
                joints + joint if self.has_speeds else -1,
                request_ages(model).youngest - self.ages.youngest,
            )
        others = by_other if self.has_speeds else None
        return Response(reached, by_own, others, by_request, bending)


def request_ages_of_all(models: Sequence[JointModel]) -> RequestAges:
    """The ages of the requests that act on any of the joints between two samples."""
    ages = [request_ages(model) for model in models]
    return RequestAges(min(r.youngest for r in ages), max(r.oldest for r in ages))


@lru_cache(maxsize=32)
def periods(models: tuple[JointModel, ...], samples: int) -> Periods:
    """The periods of these joints and this many samples: worked out once, then kept."""
    return Periods(models, samples)
