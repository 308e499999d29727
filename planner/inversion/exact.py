"""Condition 4: every request followed through the window, a mixed-integer programme for SCIP.

In units of v_max a tick, with u(r, t) for what request r calls for at tick t, and k for the slope
v_max / theta_0 of f,

    x(t) - x(t-1) = w(t) = sum_r W(r, t) u(r, t),    |u(r, t)| <= 1,
    -k max(0, w(t)) <= u(r, t+1) - u(r, t) <= k max(0, -w(t)),

since what a request calls for changes only because the joint moved, and against the motion
(``docs/math.md``, condition 4). One binary a tick says which way the joint moves.
"""

from __future__ import annotations

import logging
import warnings
from typing import Any

import numpy as np
from scipy import sparse

from planner.exceptions import MissingExtra, SolverFailed
from planner.inversion.bounds.reachable_set import Question, setting_off
from planner.inversion.bounds.saturation_relaxation import contributions
from planner.inversion.norm import Norm
from planner.model.joint import JointModel
from planner.trajectory import Array

SOLVER_TOLERANCE = 1e-4
"""Relative gap between bound and best known answer at which the solver stops."""

MARGIN = 1e-5
"""Relative amount taken off the solver's bound, which holds only within its tolerances (1e-6)."""


def scip_bound(question: Question, *, time_limit: float) -> tuple[float, float]:
    """What SCIP proves, and the best error that it knows of [rad]; inf if it knows none.

    Raises:
        MissingExtra: SCIP is not installed.
        SolverFailed: SCIP has proved nothing.
    """
    try:
        import pyscipopt  # noqa: F401
    except ImportError as error:
        raise MissingExtra("proof='scip'", "exact") from error
    import cvxpy

    model, desired, cyclic, norm, start = question
    unit, middle = model.v_max_per_tick, float(np.mean(desired))
    desired = desired - middle
    stride = model.hold
    ticks = len(desired) * stride if cyclic else (len(desired) - 1) * stride + 1
    angles, objective, conditions = build(model, desired, ticks, cyclic=cyclic, norm=norm)
    if start is not None:
        near = setting_off(model, ticks, "envelope")
        from_start = angles[: len(near)] - (start - middle) / unit
        conditions += [from_start <= near / unit, -from_start <= near / unit]
    problem = cvxpy.Problem(cvxpy.Minimize(objective), conditions)
    options = {"limits/time": time_limit, "limits/gap": SOLVER_TOLERANCE, "parallel/maxnthreads": 1}
    try:
        with warnings.catch_warnings():  # that a limit stopped it: the bound counts, not the answer
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            problem.solve(solver=cvxpy.SCIP, scip_params=options)  # type: ignore[no-untyped-call]
        scip: Any = problem.solver_stats.extra_stats
        proved = float(scip["model"].getDualbound())
    except (cvxpy.SolverError, KeyError, TypeError, AttributeError) as error:
        raise SolverFailed("exact bound", str(error) or str(problem.status)) from error
    logging.getLogger(__name__).debug(
        "exact bound: SCIP says %s after %s parts", problem.status, scip["model"].getNNodes()
    )
    known = np.inf if problem.value is None else float(problem.value)
    proved, known = (unit * _error(value, desired, norm) for value in (proved, known))
    return proved * (1.0 - MARGIN), known


def _error(value: float, desired: Array, norm: Norm) -> float:
    value = max(value, 0.0)
    return value if norm == "max" else float(np.sqrt(value / len(desired)))


def build(
    model: JointModel, desired: Array, ticks: int, *, cyclic: bool, norm: Norm
) -> tuple[Any, Any, list[Any]]:
    """The programme, in units of v_max a tick: angles, objective and conditions."""
    import cvxpy

    gain = model.v_max_per_tick / model.theta_0
    acting = contributions(model, ticks, cyclic=cyclic)
    angles = cvxpy.Variable(ticks)
    calls = cvxpy.Variable(len(acting.tick), bounds=[-1.0, 1.0])
    forward = cvxpy.Variable(ticks, nonneg=True)
    backward = cvxpy.Variable(ticks, nonneg=True)
    is_forward = cvxpy.Variable(ticks, boolean=True)
    moved = np.arange(0 if cyclic else 1, ticks)  # ticks before which the angle is known
    window = sparse.csr_array(
        (acting.weight, (acting.tick, np.arange(len(acting.tick)))), shape=(ticks, len(acting.tick))
    )
    pairs = np.flatnonzero(acting.following >= 0)
    change = calls[acting.following[pairs]] - calls[pairs]
    at = acting.tick[pairs]
    conditions = [
        angles[moved] - angles[moved - 1] == (forward - backward)[moved],
        (forward - backward)[moved] == (window @ calls)[moved],
        forward <= is_forward,
        backward <= 1.0 - is_forward,
        change <= gain * backward[at],
        change >= -gain * forward[at],
    ]
    errors = angles[np.arange(0, ticks, model.hold)] - desired / model.v_max_per_tick
    distance: Any = cvxpy.sum_squares if norm == "rms" else cvxpy.norm_inf  # type: ignore[attr-defined]
    return angles, distance(errors), conditions
