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
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.exceptions import MissingExtra, SolverFailed
from planner.inversion.norm import Norm
from planner.inversion.question import Question
from planner.inversion.reachable import setting_off
from planner.model.joint import JointModel
from planner.trajectory import Array

TIME_LIMIT = 60.0
"""Seconds after which the solver stops with what it has proved."""

SOLVER_TOLERANCE = 1e-4
"""Relative gap between bound and best known answer at which the solver stops."""

MARGIN = 1e-5
"""Relative amount taken off the solver's bound, which holds only within its tolerances (1e-6)."""


class Contributions(NamedTuple):
    """Which requests act at which ticks, one entry for every pair.

    Attributes:
        tick: The tick, shape (m,).
        request: The request, shape (m,).
        weight: Its weight there, shape (m,).
        following: Index of the same request's entry one tick later; -1 where there is none.
    """

    tick: npt.NDArray[np.int_]
    request: npt.NDArray[np.int_]
    weight: Array
    following: npt.NDArray[np.int_]


def exact_bound(question: Question, *, time_limit: float) -> tuple[float, float]:
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


def contributions(model: JointModel, ticks: int, *, cyclic: bool) -> Contributions:
    """Every pair of a tick and a request that acts there.

    From rest, requests before the first are the first one.
    """
    window = model.window
    requests = ticks // model.hold if cyclic else (ticks - 1) // model.hold + 1
    ages = window.first + np.arange(len(window.weights))
    tick = np.repeat(np.arange(ticks), len(ages))
    number = np.floor_divide((np.arange(ticks)[:, np.newaxis] - ages).ravel(), model.hold)
    if not cyclic:
        number = np.maximum(number, 0)
    # In a short cycle a request may act twice at one tick, as sent in two cycles: it is the same.
    number = number % requests
    key = tick * requests + number
    unique, inverse = np.unique(key, return_inverse=True)
    weight: Array = np.zeros(len(unique))
    np.add.at(weight, inverse, np.tile(window.weights, ticks))
    tick, number = np.divmod(unique, requests)
    later = tick + 1
    wanted = (later % ticks) * requests + number
    place = np.minimum(np.searchsorted(unique, wanted), len(unique) - 1)
    found = unique[place] == wanted
    if not cyclic:
        found &= later < ticks
    return Contributions(tick, number, weight, np.where(found, place, -1))
