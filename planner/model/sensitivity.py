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
from planner.model.load import Loads, checked_load, sags
from planner.model.response import simulate
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
    n = len(requests)
    angles = simulate(model, requests, cyclic=cyclic, start=start, load=load)
    torques = checked_load(load, model, n)
    numbers = np.maximum(acting(request_ages(model), n, cyclic=cyclic), 0)
    windows = requests[numbers.T, np.newaxis]
    evaluate = periods((model,), n) if torques is None else Periods((model,), n, (torques,))
    response = evaluate(np.roll(angles, 1)[:, np.newaxis], windows, 0.0)
    by_angle, by_request = response.by_angle[:, 0], response.by_request[:, :, 0].T
    if cyclic:
        contraction = float(np.prod(by_angle))
        before = np.zeros(n)
        if contraction < 1.0:
            open_ended = _recursion(by_angle, by_request, numbers, before)
            before = open_ended[-1] / (1.0 - contraction)
        elif model.dead_band:
            before[0] = 1.0
        else:
            raise NoSteadyCycle(0.0, 1)
        rows = _recursion(by_angle, by_request, numbers, before)
    else:
        first = np.zeros((1, n))
        torque = 0.0 if torques is None else float(torques[0])
        first[0, 0] = 1.0 if start is None else _slope(model, requests[0] - start, torque)
        later = _recursion(by_angle[1:], by_request[1:], numbers[1:], first[0])
        rows = np.vstack([first, later])
    freeze(rows)
    return rows


def _slope(model: JointModel, error: float, load: float) -> float:
    """Derivative of f of Equation 2; at a corner the mean of those on either side."""
    sides = np.sign(error + model.sag(load) - model.corners(load))
    return float(model.gain_per_tick * (sides[0] - sides[1] + sides[2] - sides[3]) / 2.0)


def _recursion(
    by_angle: Array, by_request: Array, numbers: npt.NDArray[np.int_], before: Array
) -> Array:
    """Derivatives of a run's angles, given those of the angle before it, (samples, n)."""
    rows = np.zeros((len(numbers), len(before)))
    np.add.at(rows, (np.arange(len(numbers))[:, np.newaxis], numbers), by_request)
    for row, kept in zip(rows, by_angle, strict=True):
        row += kept * before
        before = row
    return rows


class Response(NamedTuple):
    """Where each period leads, and to second order how that changes.

    ``d reached[k] = by_angle[k] d before[k] + sum_j by_request[j, k] d requests[acting[j, k]]``
    and half of ``bending[j, k]`` times the square of ``d requests[acting[j, k]] - d before[k]``;
    where requests are held for several ticks, the bending is an estimate.
    """

    reached: Array  # (n, joints) [rad]
    by_angle: Array  # (n, joints)
    by_request: Array  # (width, n, joints)
    bending: Array  # (width, n, joints) [1/rad]


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
        ticks = max(model.hold for model in models)
        weights = np.zeros((ticks, self.ages.width, len(models)))
        for joint, model in enumerate(models):
            own = request_ages(model)
            first = own.youngest - self.ages.youngest
            weights[: model.hold, first : first + own.width, joint] = weights_by_tick(model)
        theta_0 = np.array([model.theta_0 for model in models])
        speeds = np.array([model.v_max_per_tick for model in models])
        shape = (self.ages.width, samples, len(models))
        # Spelled out for every sample, so that no array below is stretched to fit another.
        self._gains = _repeated(weights[:, :, np.newaxis] * speeds / (2.0 * theta_0), shape)
        self._theta_0 = _repeated(theta_0[np.newaxis, np.newaxis, np.newaxis], shape)[0]
        torques = [
            np.zeros(1) if load is None else load for load in (loads or [None] * len(models))
        ]
        each = [model.corners(load) for model, load in zip(models, torques, strict=True)]
        corners = np.stack([np.broadcast_to(own, (4, samples)) for own in each], axis=-1)
        if not any(model.dead_band for model in models):
            corners = corners[[0, 3]]  # the inner two are one
        self._corners = _repeated(-corners[:, np.newaxis], shape)
        self._sags = np.broadcast_to(sags(models, loads), shape[1:])
        # Half the sum of the least and the largest speed, in each tick of a period.
        limits = [
            sum(m.speed_limits(load)) * m.tick for m, load in zip(models, torques, strict=True)
        ]
        middle = np.stack([np.broadcast_to(both / 2.0, samples) for both in limits], axis=-1)
        running = weights.sum(axis=1)[:, np.newaxis]  # 0 where a joint has fewer ticks
        self._middles = running * middle if np.any(middle) else None

    def __call__(self, before: Array, windows: Array, radius: float) -> Response:
        """The response to requests.

        Args:
            before: Angle before each sample [rad], shape (n, joints).
            windows: Requests that act before each sample, youngest first [rad], (width, n, joints).
            radius: Radius of the corners of f [theta_0].
        """
        rounded = (max(radius, LEAST_RADIUS) * self._theta_0) ** 2
        reached = before
        for number, gains in enumerate(self._gains):
            errors = windows - (reached - self._sags)
            speeds, slopes, bends = _rounded_law(errors, self._corners, rounded, gains)
            moved = speeds.sum(axis=0)
            if self._middles is not None:
                moved += self._middles[number]
            kept = 1.0 - slopes.sum(axis=0)
            reached = reached + moved
            if number == 0:
                by_angle, by_request, bending = kept, slopes, bends
            else:
                by_angle = by_angle * kept
                by_request = by_request * kept + slopes
                bending = bending * kept + bends
        return Response(reached, by_angle, by_request, bending)


def _rounded_law(
    errors: Array, corners: Array, rounded: Array, gains: Array
) -> tuple[Array, Array, Array]:
    """Equation 2 with rounded corners, and its first and second derivative by the error.

    ``f(x) = g sum_i ±sqrt((x - k_i)^2 + e^2)`` with signs that alternate, plus half the sum of the
    least and the largest speed: :func:`planner.model.joint.speed_law` with
    :func:`planner.model.joint.rounded_clip`, multiplied out.

    Args:
        errors: Request plus sag minus angle x [rad].
        corners: The negative corners -k_i of f, increasing in i, two or four of them, shape
            (corners, ...) [rad].
        rounded: Square of the radius e [rad^2].
        gains: Factor g: gain / 2 times the request's weight.
    """
    beyond = corners + errors  # of each corner
    squares = beyond * beyond
    squares += rounded
    lengths = np.sqrt(squares)
    beyond /= lengths
    squares *= lengths
    np.divide(rounded, squares, out=squares)
    return (
        _alternating(lengths) * gains,
        _alternating(beyond) * gains,
        _alternating(squares) * gains,
    )


def _alternating(values: Array) -> Array:
    """The sum of two or four values, of alternating sign."""
    first = values[0] - values[1]
    return np.asarray(first if len(values) == 2 else first + (values[2] - values[3]))


def _repeated(array: Array, shape: tuple[int, ...]) -> Array:
    """The array, repeated to this shape along all axes but its first."""
    return np.ascontiguousarray(np.broadcast_to(array, (len(array), *shape)))


def request_ages_of_all(models: Sequence[JointModel]) -> RequestAges:
    """The ages of the requests that act on any of the joints between two samples."""
    ages = [request_ages(model) for model in models]
    return RequestAges(min(r.youngest for r in ages), max(r.oldest for r in ages))


@lru_cache(maxsize=32)
def periods(models: tuple[JointModel, ...], samples: int) -> Periods:
    """The periods of these joints and this many samples: worked out once, then kept."""
    return Periods(models, samples)
