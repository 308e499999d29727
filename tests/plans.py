"""Plans that say what a test wants them to say, and what joints make of others: no search."""

from dataclasses import replace

import numpy as np

from planner import Inversion, Plan, simulate
from planner.planning.problem import problem_of
from planner.planning.task import Task


def inversion(model, desired, requests, *, method="optimal", **asked):
    """The requests as a plan for the desired angles, with further options of a task."""
    requests = np.array(requests, dtype=float)[:, np.newaxis]
    task = Task.of([model], desired, names=("",), smoothness=0.0, **asked)
    return Inversion(Plan(task=task, requests=requests, method=method))


def joint_task(model, desired, *, cyclic=True, norm="rms", start=None, load=None):
    """The task of a joint, from rest at any angle unless one is given."""
    options = {"cyclic": cyclic, "norm": norm, "start": start, "load": load}
    task = Task.of([model], desired, names=("",), **options)
    return task if start is not None else replace(task, start=None)


def claiming(plan, predicted):
    """The plan, saying that its angles are others than they are."""
    liar = type(plan)(plan.plan.joint(plan.column))
    predicted = np.array(predicted, dtype=float)
    liar.plan.__dict__["predicted"] = predicted.reshape(liar.plan.requests.shape)
    return liar


def foot_distances(plan, requests=None, *, models=None, loads=None):
    """Distances of a leg's foot under other requests, of joints simulated one by one [m], (n,)."""
    task = plan.plan.task
    columns = (
        task.nominal if models is None else models,
        np.transpose(plan.requests if requests is None else requests),
        [None] * len(task.names) if task.start is None else task.start,
        task.loads if loads is None else loads,
    )
    angles = [
        simulate(model, sent, cyclic=task.cyclic, start=start, load=load)
        for model, sent, start, load in zip(*columns, strict=True)
    ]
    off = task.leg.foot_positions(np.transpose(angles)) - task.desired_foot
    return np.linalg.norm(off * np.sqrt(task.weights / np.max(task.weights)), axis=1)


def track(model, desired, **options):
    """The problem of one joint that should follow desired angles."""
    return problem_of(Task.of([model], desired, names=("",), smoothness=0.0, **options))
