"""Loads that depend on the pose: plan, predict the angles, and plan again under their load."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, SolverFailed, angle_text
from planner.planning.plan import Plan
from planner.trajectory import Array
from planner.validation import as_reals

LoadOfPose = Callable[[Array], npt.ArrayLike]
"""Torques on the joints [N m], shape (n, k), by their angles [rad], shape (n, k)."""


MOVED, MOVED_SHARE = 1e-4, 0.01
"""Allowed change of a prediction [rad], or as a share of its largest distance from the desired
angles, when the load at the angles before is replaced by the load at its own: a fifteenth of a step
of an encoder with 12 bits; where joints cannot follow, another round brings little."""

ROUNDS = 50
"""Most plans, and most simulations of one; two plans suffice where the joints can follow."""

SLOW, LEAST_SHARE = 0.7, 0.125
"""If a simulation converges by less than this factor, the next one moves half as far towards its
answer, down to this share: on a fast path a pose that swings too far leads to a load that makes it
swing too far the other way."""


def settled(plan_under: Callable[[Array], Plan], load: LoadOfPose, desired: Array) -> Plan:
    """A plan whose load is the load at its predicted angles.

    With the load tau(q) of a pose, round i plans under tau(q_{i-1}), q_0 = D, and simulates the
    requests under the load at the simulated angles,

    ``q_i = M(R_i, tau(q_i))``,

    by fixed-point iteration, which converges where a change of the angles changes the sag by less:
    ``kappa |d tau / d q| < 1``. It ends when that simulation agrees with the plan's prediction.

    Args:
        plan_under: Makes a plan under torques [N m], shape (n, k).
        load: The load of a pose.
        desired: Desired angles D [rad], shape (n, k).

    Returns:
        The plan, its prediction with the load at the predicted angles.

    Raises:
        InvalidInput: The load is not a finite array (n, k).
        SolverFailed: The load does not settle.
    """
    torques, moved = _torques(load, desired), np.inf
    for _ in range(ROUNDS):
        plan = plan_under(torques)
        expected = plan.predicted
        plan, torques = _at_simulated_angles(plan, load)
        moved = float(np.max(np.abs(plan.predicted - expected)))
        far = MOVED_SHARE * float(np.max(np.abs(plan.predicted - desired)))
        if moved <= max(MOVED, far):
            return plan
    raise _unsettled(f"{ROUNDS} plans", moved)


def _at_simulated_angles(plan: Plan, load: LoadOfPose) -> tuple[Plan, Array]:
    """The plan under the load at its own simulated angles, and that load [N m], shape (n, k)."""
    angles, moved, share = plan.predicted, np.inf, 1.0
    for _ in range(ROUNDS):
        torques = _torques(load, angles)
        plan = plan.under(torques)
        before, moved = moved, float(np.max(np.abs(plan.predicted - angles)))
        if moved <= 1e-9:  # rounding [rad]
            return plan, torques
        if moved > SLOW * before:
            share = max(share / 2.0, LEAST_SHARE)
        angles = angles + share * (plan.predicted - angles)
    raise _unsettled(f"{ROUNDS} simulations", moved)


def _torques(load: LoadOfPose, angles: Array) -> Array:
    """The torques of a load of the pose [N m], shape (n, k), checked."""
    answer = load(angles)
    try:
        torques = np.broadcast_to(as_reals(answer), angles.shape)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: the function answered {np.shape(answer)}, expected torques [N m] of shape "
            f"{angles.shape}, that of the angles"
        ) from error
    if not np.all(np.isfinite(torques)):
        raise InvalidInput("load: the function answered torques that are not finite")
    return torques


def _unsettled(after: str, moved: float) -> SolverFailed:
    return SolverFailed(
        "a load that depends on the pose",
        f"the prediction still moves by {angle_text(moved)} after {after}",
    )
