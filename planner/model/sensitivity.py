"""How the angles change with the requests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.model.transition import acting, transitions
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
    requests = as_trajectory(requests, name="requests")
    n = len(requests)
    angles = simulate(model, requests, cyclic=cyclic, start=start)
    compiled = transitions(model, n)
    numbers = acting(compiled.reach, n, cyclic=cyclic)
    resting = requests[0] + model.offset if start is None else start
    seam = float(angles[-1]) if cyclic else float(resting)
    run = compiled.run(seam, requests[np.maximum(numbers, 0)], 0.0)
    direct = np.zeros((n, n))
    np.add.at(direct, (np.arange(n)[:, np.newaxis], np.maximum(numbers, 0)), run.by_request)
    before = np.zeros(n)
    if not cyclic and start is None:
        before[0] = 1.0
    derivatives = _recursion(run.by_angle, direct, before)
    if cyclic:
        contraction = float(np.prod(run.by_angle))
        if contraction >= 1.0:
            raise NoSteadyCycle(0.0, 1)
        derivatives = _recursion(run.by_angle, direct, derivatives[-1] / (1.0 - contraction))
    return derivatives


def _recursion(by_angle: Array, direct: Array, before: Array) -> Array:
    """Rows x[k] = by_angle[k] x[k-1] + direct[k], with x[-1] = before."""
    rows = np.empty_like(direct)
    for k, (kept, added) in enumerate(zip(by_angle, direct, strict=True)):
        before = kept * before + added
        rows[k] = before
    return rows
