"""From a task to requests: the one place that calls the search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.exceptions import about
from planner.planning.arguments import Robust, Solver
from planner.planning.optimal import best_requests, first_request_freed
from planner.planning.problem import Problem, track
from planner.planning.reversals import LEAST_REVERSAL, without_small_reversals
from planner.planning.search import FOOT, robust_requests, smoothed
from planner.planning.task import Task
from planner.trajectory import Array

__all__ = ["Solved", "solve", "solve_foot", "solve_joint"]


class Solved(NamedTuple):
    """What the search finds.

    Attributes:
        requests: Requests to the joints [rad], shape (n, k).
        nominal: With several models: those for the nominal ones alone; else None.
    """

    requests: Array
    nominal: Array | None


def solve(
    task: Task, *, solver: Solver = "gauss-newton", progress: Callable[[str], None] = lambda _: None
) -> Solved:
    """The requests for a task: of a foot all at once, of joints one by one.

    Args:
        task: What is asked.
        solver: What solves the problem of a joint.
        progress: Called with the name of each joint before it is planned.

    Raises:
        SolverFailed: No requests were found that lead to a steady cycle.
    """
    if task.disturbance is not None:  # what the models were known to miss has been measured
        known = (tuple(each.with_evidence(None) for each in models) for models in task.models)
        task = replace(task, models=tuple(known))
    if task.goal == "foot":
        return solve_foot(task)
    found = []
    for j, name in enumerate(task.names):
        progress(name)
        with about(name):
            found.append(solve_joint(task.joint(j), solver=solver))
    requests = np.column_stack([each.requests for each in found])
    if all(each.nominal is None for each in found):
        return Solved(requests, None)
    nominal = [each.requests if each.nominal is None else each.nominal for each in found]
    return Solved(requests, np.column_stack(nominal))


def solve_joint(task: Task, *, solver: Solver = "gauss-newton") -> Solved:
    """The requests for one joint, (n, 1)."""
    (models,), share = task.models, task.smoothness
    model, desired = models[0], _reachable_angles(task)
    start = task.starts[0]
    loads = [task.loads_on((each,))[0] for each in models]
    follow: Callable[..., Problem] = partial(
        track,
        model,
        cyclic=task.cyclic,
        norm=task.norm,
        limits=task.limits[0],
        max_step=float(task.max_step[0]),
        start=start,
        load=loads[0],
    )
    problem = follow(desired)
    column = best_requests(problem, solver)
    if start is not None and model.dead_band and len(models) == 1:
        follow, problem, column = first_request_freed(follow, problem, column, solver, share)
    others = []
    if model.dead_band and share:
        least = LEAST_REVERSAL * model.dead_band
        filtered = without_small_reversals(desired, least, cyclic=task.cyclic)
        others = [best_requests(follow(filtered), solver)]
    column = smoothed(problem, column, smoothness=share, others=others)
    if len(models) == 1:
        return Solved(column, None)
    robust = robust_requests(
        problem,
        tuple((each,) for each in models),
        [(each,) for each in loads],
        column,
        robust=_robust(task),
        smoothness=share,
    )
    return Solved(robust, column)


def solve_foot(task: Task) -> Solved:
    """The requests for all joints of a leg, (n, k), from those for its joints one by one."""
    from planner.planning.foot.invert import foot_problem, foot_requests  # with kinematics

    problem = foot_problem(task)
    singly = [solve_joint(_alone(task, problem, j)).requests for j in range(len(task.names))]
    problem, requests = foot_requests(problem, np.hstack(singly), smoothness=task.smoothness)
    if len(task.scenarios) == 1:
        return Solved(requests, None)
    robust = robust_requests(
        problem,
        task.scenarios,
        [task.loads_on(each) for each in task.scenarios],
        requests,
        robust=_robust(task),
        smoothness=task.smoothness,
        search=FOOT,
    )
    return Solved(robust, requests)


def _alone(task: Task, problem: Problem, j: int) -> Task:
    """The task of one joint of a leg that should be where the problem of the foot has it."""
    nearest = np.ascontiguousarray(problem.desired[:, j : j + 1])
    return replace(
        task.joint(j),
        models=((task.nominal[j],),),
        desired=nearest,
        norm="rms",
        start=None if task.cyclic else nearest[0],
        smoothness=0.0,
        disturbance=None,
    )


def _robust(task: Task) -> Robust:
    return task.robust or "mean"


def _reachable_angles(task: Task) -> Array:
    """Angles that the model of a joint should follow [rad], (n,): desired less the disturbance.

    Where requests within the limits can hold them, as the desired ones are.
    """
    desired = np.ascontiguousarray(task.desired[:, 0])
    if task.disturbance is None:
        return desired
    aimed: Array = desired - task.disturbance[:, 0]
    if task.limits[0] is None:
        return aimed
    sag = task.nominal[0].sag(0.0 if task.loads[0] is None else task.loads[0])
    lower, upper = task.limits[0]
    clipped: Array = np.clip(aimed, lower + sag, upper + sag)
    return clipped
