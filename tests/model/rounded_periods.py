"""Request periods with rounded corners, each from a state of its own, by ``kernel.periods``."""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.model import kernel
from planner.model.joint import JointModel, acting_requests


class Periods(NamedTuple):
    """The states after n periods of a joint, and their derivatives."""

    states: Array  # angles [rad], speeds and, where the joint has one, integrals [rad/tick], (n, s)
    by_state: Array  # derivatives by the state before each period, (n, s, s)
    by_request: Array  # derivatives by the requests that act, youngest first, (n, s, width)
    bending: Array  # second derivatives by a request's distance from the angle, (n, s, width)


def rounded_periods(model: JointModel, angles, windows, radius, *, moving=None, load=None):
    """Where periods lead from angles [rad], (n,), under requests (n, width).

    ``moving`` is the speeds and, where the joint has one, the integrals before, (s - 1, n). The
    radius of the corners counts in theta_0; ``load`` is a torque in each period [N m], (n,).
    """
    n, width = windows.shape
    assert width == acting_requests(model).width
    torques = np.zeros(n) if load is None else load
    sags, faster = model.compliance * torques, model.faster_per_tick(torques)
    rounded = (model.law.gain * max(radius, 1e-150) * model.theta_0) ** 2
    window = np.empty((3, width, n))
    window[0] = windows.T
    own = max(model.states, 2)
    states = np.vstack([angles, np.zeros((own - 1, n)) if moving is None else moving])
    derivatives = np.empty((own, own + 2 * width, n))
    kernel.periods(
        model.law,
        acting_requests(model).weights[0],
        window,
        sags,
        faster,
        np.full(n, rounded),
        states,
        derivatives,
    )
    each = np.split(np.moveaxis(derivatives, -1, 0), [own, own + width], axis=2)
    return Periods(states.T, *each)
