"""CasADi Opti with IPOPT over all angles and requests, as a user writes it.

Every option is as it comes, but silent; every joint is smoothed alike.
"""

from __future__ import annotations

import contextlib

import casadi
import numpy as np

import planner

from .problem import DEGREE, Array, Limits, Solve, best_of, smoothed

OPTIONS = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}

SPEEDS = (1.0, 0.3, 0.1)  # radii of the saturation's corners, stage by stage [degrees a tick]
REGULARISATION = 1e-3  # weight on the distance of the requests from the desired angles
NO_LIMIT = 1e20  # IPOPT's infinity


def build(model: planner.JointModel, samples: int) -> Solve:
    """The cycle as a nonlinear programme, with everything that may change a parameter."""
    v_max, theta_0 = model.v_max_per_tick / DEGREE, model.theta_0 / DEGREE
    window, offset = model.window, model.offset / DEGREE
    opti = casadi.Opti()

    # unknowns
    angles, requests = opti.variable(samples), opti.variable(samples)

    # data
    desired = opti.parameter(samples)
    lower, upper, radius = opti.parameter(), opti.parameter(), opti.parameter()

    # objective
    away = requests - (desired - offset)
    opti.minimize(casadi.sumsqr(angles - desired) + REGULARISATION * casadi.sumsqr(away))

    # dynamics, closed to a cycle
    for k in range(samples):
        before = angles[(k - 1) % samples]
        after = before
        for age, weight in enumerate(window.weights.tolist(), window.first):
            error = requests[(k - age) % samples] + offset - before
            after = after + weight * smoothed(error, radius, v_max=v_max, theta_0=theta_0)
        opti.subject_to(angles[k] == after)

    # limits
    opti.subject_to(opti.bounded(lower, requests, upper))
    opti.solver("ipopt", OPTIONS)

    def solve(trajectory: Array, limits: Limits, start: Array) -> Array:
        opti.set_value(desired, trajectory / DEGREE)
        opti.set_value(lower, max(limits[0] / DEGREE, -NO_LIMIT))
        opti.set_value(upper, min(limits[1] / DEGREE, NO_LIMIT))
        opti.set_initial(requests, start / DEGREE)
        opti.set_initial(angles, planner.simulate(model, start) / DEGREE)
        candidates = [start]
        for speed in SPEEDS:
            opti.set_value(radius, speed / v_max * theta_0)
            # Opti's word for every failure; the last iterate may still do.
            with contextlib.suppress(RuntimeError):
                opti.solve()
            solution = np.asarray(opti.debug.value(requests), dtype=np.float64)
            if not np.all(np.isfinite(solution)):
                break
            candidates.append(solution * DEGREE)
            opti.set_initial(opti.x, opti.debug.value(opti.x))
        return best_of(model, trajectory, limits, candidates)

    return solve
