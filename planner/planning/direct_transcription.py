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
from typing import Any

import numpy as np

from planner.exceptions import SolverFailed, angle_text
from planner.model.joint import acting, request_ages
from planner.model.symbolic import period_function
from planner.planning.problem import Problem
from planner.trajectory import Array

# Measured on 14 instances of the benchmark: the rms is 0.02 % above that of "gauss-newton" on
# average, 0.2 % at worst. In brackets this excess with half and twice of a number.

RADII = (0.4, 0.12, 0.04, 0.013)
"""Radii of the rounded corners [theta_0], a programme each (0.06 and 0.7 %; 0.2 and 1.2 %). The
fourth gains 0.01 %, and 0.3 % in the norm "max", for half as much time again."""

WEIGHT = 1e-4
"""Weight alpha on the distance of the requests from those that hold the desired angles (0.04 % on
average; 0.06 %)."""

ITERATIONS = 300
"""Most iterations for each radius: with half 0.3 % worse in the norm "max", else the same."""


def transcribed_requests(problem: Problem, first: Array, ideal: Array) -> Array:
    """The best requests that IPOPT finds for one joint from first ones and ideal angles, (n, 1).

    They are within the limits, and at least as good as the first ones.

    Raises:
        SolverFailed: No programme was solved, or no answer leads to a steady cycle.
    """
    import casadi

    if not problem.cyclic and len(problem.desired) <= problem.ages.youngest + 1:
        return first  # no free request acts before the end
    samples, unit = len(problem.desired), problem.models[0].theta_0
    nlp, point, bounds = _transcribed(problem, first, ideal)
    settings = {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS}
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "expand": True,
        "ipopt": settings,
    }
    solve = casadi.nlpsol("inversion", "ipopt", nlp, options)
    best, least = first, problem.exact_error(first)
    solved, status = False, ""
    for radius in RADII:
        answer = solve(x0=point, p=radius, **bounds)
        status, iterations = str(solve.stats()["return_status"]), solve.stats()["iter_count"]
        unknowns = np.asarray(answer["x"], dtype=np.float64).ravel()
        outcome = f"ipopt, corners of {radius:g} theta_0: {status} after {iterations} iterations"
        if not solve.stats()["success"] or not np.all(np.isfinite(unknowns)):
            logging.getLogger(__name__).debug("%s", outcome)
            continue
        point, solved = unknowns, True
        requests = problem.admissible(unit * unknowns[samples : 2 * samples, np.newaxis])
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

    (model,), samples = problem.models, len(problem.desired)
    cyclic, unit = problem.cyclic, model.theta_0
    desired, resting = problem.desired[:, 0] / unit, problem.resting[:, 0] / unit
    ideal, first = ideal[:, 0] / unit, first[:, 0] / unit
    max_step = float(problem.max_step[0]) / unit

    # Unknowns
    angles, requests = casadi.SX.sym("M", samples), casadi.SX.sym("R", samples)
    largest, radius = casadi.SX.sym("s"), casadi.SX.sym("e")

    # Objective
    errors = angles - desired
    cost = casadi.sumsqr(errors) if problem.norm == "rms" else samples * largest**2
    cost += WEIGHT * casadi.sumsqr(requests - resting)

    # Dynamics, and the boundary: a cycle, or from rest
    period_of = period_function(model)
    speeds = casadi.SX.sym("w", samples, model.law.states - 1)  # and integrals
    states = casadi.horzcat(angles, speeds).T
    rest = np.zeros(states.shape[0])
    torques = problem.torques[0]
    rest[0] = 0.0 if problem.start is None else float(problem.start[0]) / unit
    rest[2:] = model.rest_integral(unit * rest[0], torques[0]) / unit
    before = casadi.horzcat(states[:, -1] if cyclic else rest, states[:, :-1])
    sent = np.maximum(acting(request_ages(model), samples, cyclic=cyclic), 0).tolist()
    reached = [
        period_of(unit * before[:, k], unit * requests[sent[k]], torques[k], unit * radius) / unit
        for k in range(samples)
    ]
    # Unknowns with their initial values and bounds, and conditions with theirs
    low, high = (np.full(samples, float(end[0]) / unit) for end in (problem.lower, problem.upper))
    if not cyclic:
        low[0] = high[0] = first[0]
    unknowns = [(angles, ideal, -np.inf, np.inf), (requests, first, low, high)]
    conditions: list[tuple[Any, float, float]] = [(states - casadi.horzcat(*reached), 0.0, 0.0)]
    if math.isfinite(max_step):
        changes = requests - casadi.vertcat(requests[-1], requests[:-1])
        conditions.append((changes if cyclic else changes[1:], -max_step, max_step))
    if problem.norm == "max":
        unknowns.append((largest, np.max(np.abs(ideal - desired), keepdims=True), 0.0, np.inf))
        conditions.append((casadi.vertcat(largest - errors, largest + errors), 0.0, np.inf))
    if speeds.numel():
        moving = np.zeros((model.law.states - 1, samples))
        moving[0] = np.gradient(ideal) / model.hold
        unknowns.append((speeds, moving.ravel(), -np.inf, np.inf))

    def ends(place: int, groups: list[Any]) -> Array:
        return np.concatenate([np.full(each[0].numel(), each[place]) for each in groups])

    x, g = (
        casadi.vertcat(*(casadi.vec(each[0]) for each in groups))
        for groups in (unknowns, conditions)
    )
    bounds = {"lbx": ends(2, unknowns), "ubx": ends(3, unknowns)}
    bounds |= {"lbg": ends(1, conditions), "ubg": ends(2, conditions)}
    return {"x": x, "p": radius, "f": cost, "g": g}, ends(1, unknowns), bounds
