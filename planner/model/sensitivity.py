"""How the angles change with the requests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.given import freeze
from planner.model.joint import JointModel, checked_model
from planner.model.response import simulate
from planner.model.transition import Linearised, acting, reach, transitions
from planner.trajectory import Array, as_trajectory


def sensitivities(
    model: JointModel,
    requests: npt.ArrayLike,
    *,
    cyclic: bool = True,
    start: float | None = None,
) -> Array:
    """Derivatives of the angles with respect to the requests.

    They follow from the derivatives of one request period, which CasADi writes, by one forward
    recursion; at a corner of the saturation they are the mean of the two one-sided derivatives.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,).
        cyclic: Whether the requests repeat for ever; then the derivatives are those of the cycle.
        start: From rest: see :func:`planner.simulate`. By default the start moves with the first
            request, which holds the joint there.

    Returns:
        d angles[k] / d requests[j], shape (n, n). Memory grows with n squared.

    Raises:
        InvalidTrajectory, InvalidInput, NoSteadyCycle: as :func:`planner.simulate`; NoSteadyCycle
            also where a cycle has no derivative because no tick of it is unsaturated.
    """
    model = checked_model(model)
    requests = as_trajectory(requests, name="requests")
    n = len(requests)
    angles = simulate(model, requests, cyclic=cyclic, start=start)
    numbers = np.maximum(acting(reach(model), n, cyclic=cyclic), 0)
    if not cyclic:
        first = np.zeros((1, n))
        first[0, 0] = 1.0 if start is None else _slope(model, requests[0] + model.offset - start)
        run = transitions(model, n - 1).run(float(angles[0]), requests[numbers[1:]], 0.0)
        rows = np.vstack([first, _recursion(run, numbers[1:], first[0])])
        freeze(rows)
        return rows
    run = transitions(model, n).run(float(angles[-1]), requests[numbers], 0.0)
    contraction = float(np.prod(run.by_angle))
    if contraction >= 1.0:
        raise NoSteadyCycle(0.0, 1)
    open_ended = _recursion(run, numbers, np.zeros(n))
    rows = _recursion(run, numbers, open_ended[-1] / (1.0 - contraction))
    freeze(rows)
    return rows


def _slope(model: JointModel, error: float) -> float:
    """Derivative of f of Equation 2; at a corner the mean of those on either side."""
    inside = np.sign(error + model.theta_0) - np.sign(error - model.theta_0)
    return float(model.v_max_per_tick / model.theta_0 * inside / 2.0)


def _recursion(run: Linearised, numbers: npt.NDArray[np.int_], before: Array) -> Array:
    """Derivatives of the run's angles, given those of the angle before it, (samples, n)."""
    rows = np.zeros((len(numbers), len(before)))
    np.add.at(rows, (np.arange(len(numbers))[:, np.newaxis], numbers), run.by_request)
    for row, kept in zip(rows, run.by_angle, strict=True):
        row += kept * before
        before = row
    return rows
