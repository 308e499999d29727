"""Request periods with rounded corners, each from a state of its own, by ``kernel.periods``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.model import kernel
from planner.model.joint import JointModel, request_ages, weights_by_tick
from planner.trajectory import Array


class Periods(NamedTuple):
    """Angle and speed after n periods of a joint, and their derivatives.

    Attributes:
        states: Angles [rad] and speeds [rad/tick], (n, 2).
        by_state: Derivatives by angle and speed before each period, (n, 2, 2).
        by_request: Derivatives by the requests that act, youngest first, (n, 2, width).
        bending: Second derivatives by a request's distance from the angle, (n, 2, width).
    """

    states: Array
    by_state: Array
    by_request: Array
    bending: Array


def rounded_periods(model: JointModel, angles, windows, radius, *, speeds=None, load=None):
    """Where periods lead from angles [rad] and speeds [rad/tick], (n,), under requests (n, width).

    The radius of the corners counts in theta_0; ``load`` is a torque in each period [N m], (n,).
    """
    n, width = windows.shape
    assert width == request_ages(model).width
    torques = np.zeros(n) if load is None else load
    sags, faster = model.sag(torques), model.faster_per_tick(torques)
    rounded = (model.law.gain * max(radius, 1e-150) * model.theta_0) ** 2
    window = np.empty((3, width, n))
    window[0] = windows.T
    angles, speeds = np.array(angles), np.zeros(n) if speeds is None else np.array(speeds)
    slopes, bends = np.empty((2, 2 + width, n)), np.empty((2, width, n))
    kernel.periods(
        model.law,
        weights_by_tick(model),
        window,
        sags,
        faster,
        np.full(n, rounded),
        angles,
        speeds,
        slopes,
        bends,
    )
    slopes, bends = np.moveaxis(slopes, -1, 0), np.moveaxis(bends, -1, 0)
    return Periods(np.column_stack([angles, speeds]), slopes[:, :, :2], slopes[:, :, 2:], bends)
