"""CasADi Opti with IPOPT over all angles and requests: as a user writes it, and made faster."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import casadi
import numpy as np

import planner

from .problem import DEGREE, PULL, RADII, Array, Limits, Solve, best_of, smoothed

SILENT = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}


class Recipe(NamedTuple):
    """How the programme is set up.

    Attributes:
        options: What Opti's solver is told.
        speeds: Radii of the saturation's corners, stage by stage [degrees a tick], for a joint of
            ``top_speed``; the same for every joint where that is None.
        top_speed: [degrees a tick]
        pull: Weight on the distance of the requests from the desired angles.
        at_once: Whether the dynamics are one condition on vectors, or one condition a tick, in a
            loop, as in CasADi's own examples.
    """

    options: dict[str, Any]
    speeds: tuple[float, ...]
    top_speed: float | None
    pull: float
    at_once: bool


PLAIN = Recipe(SILENT, (1.0, 0.3, 0.1), None, 1e-3, at_once=False)
"""What most users would write: every option as it comes, but silent; one smoothing for all."""

TUNED = Recipe(
    {**SILENT, "expand": True, "ipopt": {**SILENT["ipopt"], "max_iter": 300}},
    tuple(2.5 * share for share in RADII),
    2.5,
    PULL,
    at_once=True,
)
"""Scalar operations in place of CasADi's matrices, fewer iterations, corners that fit the joint."""

NO_LIMIT = 1e20
"""IPOPT's infinity."""


def build(model: planner.JointModel, samples: int, *, recipe: Recipe) -> Solve:
    """The cycle as a nonlinear programme, with everything that may change a parameter."""
    v_max, theta_0 = model.v_max_per_tick / DEGREE, model.theta_0 / DEGREE
    window = model.window
    opti = casadi.Opti()

    # unknowns
    angles = opti.variable(samples)
    requests = opti.variable(samples)

    # data
    desired = opti.parameter(samples)
    lower, upper = opti.parameter(), opti.parameter()
    radius = opti.parameter()

    # objective
    resting = desired - model.offset / DEGREE
    opti.minimize(casadi.sumsqr(angles - desired) + recipe.pull * casadi.sumsqr(requests - resting))

    # dynamics, closed to a cycle
    offset = model.offset / DEGREE

    def moved(before: Any, aged: Callable[[int], Any]) -> Any:
        after = before
        for age, weight in enumerate(window.weights.tolist(), window.first):
            error = aged(age) + offset - before
            after = after + weight * smoothed(error, radius, v_max=v_max, theta_0=theta_0)
        return after

    if recipe.at_once:
        before = casadi.vertcat(angles[-1], angles[:-1])
        every = range(samples)
        opti.subject_to(
            angles == moved(before, lambda age: requests[[(k - age) % samples for k in every]])
        )
    else:
        for k in range(samples):
            one = partial(lambda k, age: requests[(k - age) % samples], k)
            opti.subject_to(angles[k] == moved(angles[(k - 1) % samples], one))

    # limits
    opti.subject_to(opti.bounded(lower, requests, upper))
    opti.solver("ipopt", recipe.options)

    def solve(wanted: Array, limits: Limits, start: Array) -> Array:
        opti.set_value(desired, wanted / DEGREE)
        opti.set_value(lower, max(limits[0] / DEGREE, -NO_LIMIT))
        opti.set_value(upper, min(limits[1] / DEGREE, NO_LIMIT))
        opti.set_initial(requests, start / DEGREE)
        opti.set_initial(angles, planner.simulate(model, start) / DEGREE)
        candidates = [start]
        for speed in recipe.speeds:
            opti.set_value(radius, speed / (recipe.top_speed or v_max) * theta_0)
            # Opti's word for every failure; the last iterate may still do.
            with contextlib.suppress(RuntimeError):
                opti.solve()
            found = np.asarray(opti.debug.value(requests), dtype=np.float64)
            if not np.all(np.isfinite(found)):
                break
            candidates.append(found * DEGREE)
            opti.set_initial(opti.x, opti.debug.value(opti.x))
        return best_of(model, wanted, limits, candidates)

    return solve
