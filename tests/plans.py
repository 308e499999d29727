"""Plans of one joint that say what a test wants them to say: nothing is searched."""

from __future__ import annotations

import numpy as np

from planner.planning.plan import Plan
from planner.planning.result import Inversion
from planner.planning.task import Task


def inversion(model, desired, requests, *, method="optimal", approximation=None, **asked):
    """The requests as a plan for the desired angles, with further options of a task."""
    requests = np.array(requests, dtype=float)[:, np.newaxis]
    task = Task.of([model], desired, names=("",), smoothness=0.0, **asked)
    curves = () if approximation is None else (approximation,)
    return Inversion(Plan(task=task, requests=requests, method=method, approximations=curves))


def claiming(plan, predicted):
    """The plan, saying that its angles are others than they are."""
    liar = type(plan)(plan.plan.joint(plan.column))
    predicted = np.array(predicted, dtype=float)
    liar.plan.__dict__["predicted"] = predicted.reshape(liar.plan.requests.shape)
    return liar
