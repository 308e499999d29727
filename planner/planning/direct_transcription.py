"""The optimised inversion as a nonlinear programme, transcribed for IPOPT by CasADi.

Direct transcription: all angles M and all requests R are unknowns, and the model is a condition on
them (J. T. Betts, *Practical Methods for Optimal Control Using Nonlinear Programming*, 2010, ch. 4;
``docs/math.md``, section 6). With D the desired angles, c the offset and theta_0 the unit of angle:

    minimise    sum_k (M_k - D_k)^2 + alpha sum_k (R_k - D_k + c)^2        norm "rms"
                n r^2 + alpha sum_k (R_k - D_k + c)^2,  |M_k - D_k| <= r   norm "max"
    subject to  M_k = F(M_(k-1), R_(k-first), ..., R_(k-last))             Equation 3
                lower <= R_k <= upper,  |R_k - R_(k-1)| <= max_step
                M_(-1) = M_(n-1),  R_(-j) = R_(n-j)                        cyclic
                M_(-1) = start,    R_(-j) = R_0 = start - c                from rest

with c + kappa tau_k for c under a load. F is one request period of the joint, with the corners of
Equation 2 rounded, and first and last are the ages of the requests that act. The programme is
solved for smaller and smaller radii of the corners, each time from the answer before. With sharp
corners IPOPT fails, or reports success at two or three times the error; therefore every answer is
judged by the exact model, and the best one is kept.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.exceptions import SolverFailed, angle_text
from planner.model.joint import acting, request_ages
from planner.model.symbolic import period_function
from planner.planning.problem import Problem
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class TranscriptionOptions:
    """How the programme is set up and solved.

    Measured on 14 instances of the benchmark: the rms is 0.02 % above that of the solver
    "gauss-newton" on average, 0.2 % at worst; the figures below are changes of this excess.

    Attributes:
        radii: Radii of the rounded corners [theta_0], a programme each. Of the first three, half
            gives 0.06 % on average and 0.7 % at worst, twice 0.2 and 1.2 %. The fourth wins 0.01 %,
            and 0.3 % in the norm "max", for half as much time again.
        weight: Weight alpha on the distance of the requests from those that hold the desired
            angles. At half of it the average is 0.04 %, at twice 0.06 %; at a tenth and at ten
            times the worst is 0.7 and 1.4 %.
        iterations: Most iterations for each radius. At half of them the answers are the same, but
            0.3 % worse in the norm "max".
    """

    radii: tuple[float, ...] = (0.4, 0.12, 0.04, 0.013)
    weight: float = 1e-4
    iterations: int = 300


OPTIONS = TranscriptionOptions()


def transcribed_requests(problem: Problem, first: Array, ideal: Array) -> Array:
    """The best requests that IPOPT finds for one joint.

    Args:
        problem: Joint, boundary, limits and norm.
        first: Requests to set out from [rad], (n, 1); the answer is at least as good.
        ideal: Angles to set out from [rad], (n, 1).

    Returns:
        Requests within the limits [rad], shape (n, 1).

    Raises:
        SolverFailed: No programme was solved, or no answer leads to a steady cycle.
    """
    import casadi

    if not problem.cyclic and len(problem.desired) <= problem.ages.youngest + 1:
        return first  # no free request acts before the end
    samples, unit = len(problem.desired), problem.models[0].theta_0
    nlp, point, bounds = _transcribed(problem, first, ideal)
    settings = {"print_level": 0, "sb": "yes", "max_iter": OPTIONS.iterations}
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "expand": True,
        "ipopt": settings,
    }
    solve = casadi.nlpsol("inversion", "ipopt", nlp, options)
    best, least = first, problem.exact_error(first)
    solved, status = False, ""
    for radius in OPTIONS.radii:
        answer = solve(x0=point, p=radius, **bounds)
        status, iterations = str(solve.stats()["return_status"]), solve.stats()["iter_count"]
        unknowns = np.asarray(answer["x"], dtype=np.float64).ravel()
        outcome = f"ipopt, corners of {radius:g} theta_0: {status} after {iterations} iterations"
        if not solve.stats()["success"] or not np.all(np.isfinite(unknowns)):
            logging.getLogger(__name__).debug("%s", outcome)
            continue
        point, solved = unknowns, True
        requests = problem.resting.copy()
        requests[:samples, 0] = unit * unknowns[samples : 2 * samples]
        if problem.spec.limited and not problem.cyclic:  # requests that act after the end
            requests[samples - 1 :] = requests[samples - 1]
        requests = problem.admissible(requests)
        error = problem.exact_error(requests)
        logging.getLogger(__name__).debug("%s, exact error %s", outcome, angle_text(error))
        if error < least:
            best, least = requests, error
    if not solved:
        raise SolverFailed("inversion by ipopt", status)
    if not math.isfinite(least):
        raise SolverFailed("inversion by ipopt", "no requests lead to a steady cycle")
    return best


def _transcribed(
    problem: Problem, first: Array, ideal: Array
) -> tuple[dict[str, Any], Array, dict[str, Array]]:
    """The programme above, min f(x, p) where x and g(x, p) are within bounds, in units of theta_0.

    Returns:
        x, p, f and g; the initial x: angles, requests, and the largest error in the norm "max"; and
        the bounds lbx, ubx, lbg and ubg.
    """
    import casadi

    (model,), (load,) = problem.models, problem.loads
    samples, cyclic, unit = len(problem.desired), problem.cyclic, model.theta_0
    desired, resting = problem.desired[:, 0] / unit, problem.resting[:, 0] / unit
    ideal, first = ideal[:, 0] / unit, first[:, 0] / unit
    max_step = float(problem.max_step[0]) / unit

    # Unknowns
    angles, requests = casadi.SX.sym("M", samples), casadi.SX.sym("R", samples)
    largest, radius = casadi.SX.sym("s"), casadi.SX.sym("e")

    # Objective
    errors = angles - desired
    cost = casadi.sumsqr(errors) if problem.norm == "rms" else samples * largest**2
    cost += OPTIONS.weight * casadi.sumsqr(requests - resting)

    # Dynamics, and the boundary: a cycle, or from rest
    period_of = period_function(model)
    speeds = casadi.SX.sym("w", samples, model.law.states - 1)  # and integrals
    states = casadi.horzcat(angles, speeds).T
    rest = np.zeros(states.shape[0])
    torques = np.zeros(samples) if load is None else load
    rest[0] = 0.0 if problem.start is None else float(problem.start[0]) / unit
    rest[2:] = model.rest_integral(unit * rest[0], torques[0]) / unit
    before = casadi.horzcat(states[:, -1] if cyclic else rest, states[:, :-1])
    sent = np.maximum(acting(request_ages(model), samples, cyclic=cyclic), 0).tolist()
    reached = [
        period_of(unit * before[:, k], unit * requests[sent[k]], torques[k], unit * radius) / unit
        for k in range(samples)
    ]
    dynamics = casadi.vec(states - casadi.horzcat(*reached))

    # Limits
    free = np.full(samples, np.inf)
    lower = np.append(-free, np.full(samples, float(problem.lower.min()) / unit))
    upper = np.append(free, np.full(samples, float(problem.upper.max()) / unit))
    if not cyclic:
        lower[samples] = upper[samples] = first[0]

    # Changes of the requests
    changes = casadi.SX()
    if math.isfinite(max_step):
        changes = requests - casadi.vertcat(requests[-1], requests[:-1])
        changes = changes if cyclic else changes[1:]

    # Largest error
    path = (
        casadi.SX() if problem.norm == "rms" else casadi.vertcat(largest - errors, largest + errors)
    )
    unknowns, initial = [angles, requests], [ideal, first]
    if problem.norm == "max":
        unknowns.append(largest)
        initial.append(np.max(np.abs(ideal - desired), keepdims=True))
        lower, upper = np.append(lower, 0.0), np.append(upper, np.inf)

    if speeds.numel():
        unknowns.append(casadi.vec(speeds))
        moving = np.zeros((model.law.states - 1, samples))
        moving[0] = np.gradient(ideal) / model.hold
        initial.append(moving.ravel())
        unbounded = np.full(moving.size, np.inf)
        lower, upper = np.append(lower, -unbounded), np.append(upper, unbounded)
    g = casadi.vertcat(dynamics, changes, path)
    step = np.full(changes.numel(), max_step)
    closed = np.zeros(dynamics.numel())
    below = np.concatenate([closed, -step, np.zeros(path.numel())])
    above = np.concatenate([closed, step, np.full(path.numel(), np.inf)])
    return (
        {"x": casadi.vertcat(*unknowns), "p": radius, "f": cost, "g": g},
        np.concatenate(initial),
        {"lbx": lower, "ubx": upper, "lbg": below, "ubg": above},
    )
