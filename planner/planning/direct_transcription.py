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

import contextlib
import logging
import math
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.exceptions import SolverFailed
from planner.model.symbolic import period_function
from planner.planning.problem import Problem

ITERATIONS = 300  # most for each radius: with half 0.3 % worse in the norm "max", else the same


def transcribed_requests(problem: Problem, first: Array, ideal: Array) -> Array:
    """The best requests that IPOPT finds for one joint from first ones and ideal angles, (n, 1).

    They are within the limits, and at least as good as the first ones. On 14 instances of the
    benchmark the rms is 0.02 % above that of "gauss-newton" on average, 0.2 % at worst.
    """
    import casadi

    if not problem.cyclic and len(problem.desired) <= problem.acting.youngest + 1:
        return first  # no free request acts before the end
    (model,), samples, cyclic = problem.drives, len(problem.desired), problem.cyclic
    unit, size, torques = model.theta_0, model.states, problem.torques[0]
    opti: Any = casadi.Opti()
    angles, requests, radius = opti.variable(samples), opti.variable(samples), opti.parameter()
    opti.set_initial(angles, ideal[:, 0] / unit)
    opti.set_initial(requests, first[:, 0] / unit)

    # Objective
    errors = angles - problem.desired[:, 0] / unit
    cost = casadi.sumsqr(errors)
    if problem.norm == "max":
        largest = opti.variable()
        opti.set_initial(largest, float(np.max(np.abs(ideal - problem.desired))) / unit)
        opti.subject_to(errors <= largest)
        opti.subject_to(errors >= -largest)
        cost = samples * largest**2
    opti.minimize(cost + 1e-4 * casadi.sumsqr(requests - problem.resting[:, 0] / unit))

    # Dynamics, and the boundary: a cycle, or from rest
    states = angles.T
    if size > 1:  # speeds, and integrals
        speeds = opti.variable(size - 1, samples)
        opti.set_initial(speeds[0, :], np.gradient(ideal[:, 0] / unit) / model.hold)
        states = casadi.vertcat(states, speeds)
    start = 0.0 if problem.start is None else float(problem.start[0])
    rest = model.at_rest(start, torques[0])[:size] / unit
    before = casadi.horzcat(states[:, -1] if cyclic else rest, states[:, :-1])
    sent = np.maximum(problem.acting.numbers(samples, cyclic=cyclic), 0).tolist()
    period_of = period_function(model)
    for k in range(samples):
        inputs = unit * before[:, k], unit * requests[sent[k]], torques[k], unit * radius
        opti.subject_to(states[:, k] == period_of(*inputs) / unit)

    # Limits
    low, high = (float(end[0]) / unit for end in (problem.lower, problem.upper))
    opti.subject_to(opti.bounded(low, requests if cyclic else requests[1:], high))
    if not cyclic:
        opti.subject_to(requests[0] == first[0, 0] / unit)
    if math.isfinite(problem.max_step[0]):
        changes = requests - casadi.vertcat(requests[-1], requests[:-1])
        most = float(problem.max_step[0]) / unit
        opti.subject_to(opti.bounded(-most, changes if cyclic else changes[1:], most))

    options = {"print_time": False, "error_on_fail": False, "expand": True}
    options["detect_simple_bounds"] = True
    opti.solver("ipopt", options, {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS})
    best, least = first, problem.exact_error(first)
    solved, status = False, ""
    for corners in (0.4, 0.12, 0.04, 0.013):  # three leave 0.3 % in the norm "max", half 0.7 %
        opti.set_value(radius, corners)
        with contextlib.suppress(RuntimeError):  # not solved
            opti.solve()
        status, iterations = opti.stats()["return_status"], opti.stats()["iter_count"]
        outcome = f"ipopt, corners of {corners:g} theta_0: {status} after {iterations} iterations"
        if not opti.stats()["success"]:
            logging.getLogger(__name__).debug("%s", outcome)
            continue
        point, sent_now = opti.value(opti.x), opti.value(requests)
        opti.set_initial(opti.x, point)
        solved = True
        answer = problem.admissible(unit * sent_now[:, np.newaxis])
        error = problem.exact_error(answer)
        logging.getLogger(__name__).debug("%s, exact error %.4g deg", outcome, math.degrees(error))
        if error < least:
            best, least = answer, error
    if not solved:
        raise SolverFailed("inversion by ipopt", status)
    if not math.isfinite(least):
        raise SolverFailed("inversion by ipopt", "no requests lead to a steady cycle")
    return best
