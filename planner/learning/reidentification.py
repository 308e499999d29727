"""Models identified anew from trials, where they predict a trial that they have not seen better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.exceptions import PlannerError
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.plan import Plan
from planner.planning.result import Trial
from planner.trajectory import Array, rms

UNEXPLAINED, NEGLIGIBLE = 2.0, 0.002
"""Error of the prediction up to which learning copes with it: in standard deviations of the
measured cycle's noise [-], and as a share of the joint's motion [-]."""

SAVING = 0.3
"""Share of that error that another model has to save on a trial that it has not seen [-]: a model
that is as good brings nothing, and forgets the logs it came from."""

TRIALS = 4
"""Trials, the last ones, that are fitted."""

RESTING = 20
"""Rows of rest before a motion from rest: longer than any lag."""


def reidentified(
    joints: Plan, trials: Sequence[Trial], since: Sequence[int], noise: Array
) -> tuple[Plan, tuple[int, ...], list[str]]:
    """The plan with the models that the trials identify anew, where these predict better.

    Where the requests for such a model make the error larger, they are given up as all requests
    that do. (The model before was taken up again once: on none of 18 joints and servos of the
    benchmark did that happen in ten trials.)

    Args:
        joints: The plan that was executed.
        trials: All trials, the last one of its requests.
        since: The trial after which the model of each joint was changed last, (k,).
        noise: Standard deviation of one cycle's noise [rad], (k,).

    Returns:
        The plan, the trials after which its models were changed last, and remarks.
    """
    models, last, remarks = list(joints.models), list(since), list[str]()
    for j, model in enumerate(joints.models):
        better = better_model(model, joints, trials, j, float(noise[j]))
        if better is not None:
            models[j], last[j] = better, len(trials) - 1
            of = "" if len(models) == 1 else f" of joint {j + 1}"
            remarks.append(
                f"the model{of} was identified anew from the measured cycles: it predicts a trial "
                "that it had not seen better than the model as it was and what was learnt with it"
            )
    if remarks:
        joints = replace(joints, task=joints.task.with_models(models))
    return joints, tuple(last), remarks


def better_model(
    model: JointModel, joints: Plan, trials: Sequence[Trial], j: int, noise: float
) -> JointModel | None:
    """A model of joint j identified from the trials, if it predicts the last one better; else None.

    The last trial is held out. With the model as it is, its angles are predicted with the
    disturbance of the trial before; so they are with a model that is identified from those before.
    With that disturbance every model explains a repeated motion: the models are compared by how
    the angles change with the requests. So there is no other model after a single trial,
    however many cycles it has, nor where the requests have hardly changed.

    ``noise`` is the standard deviation of one cycle's [rad].
    """
    cyclic, start, load = joints.cyclic, joints.task.starts[j], joints.task.loads[j]

    def run(of: JointModel, requests: Array) -> Array:
        return simulate(of, requests, cyclic=cyclic, start=start, load=load)

    def identified(data: Sequence[tuple[Array, Array]]) -> JointModel | None:
        logs = [_log(model, *each, cyclic=cyclic, load=load) for each in data[-TRIALS:]]
        return _identified(model, logs)

    if len(trials) < 2:
        return None
    pairs = [(trial.requests[:, j], trial.mean[:, j]) for trial in trials]
    data, (sent, target) = pairs[:-1], pairs[-1]
    noise /= math.sqrt(trials[-1].cycles)

    def missed(by: JointModel) -> float:
        before, angles = data[-1]
        return rms(run(by, sent) - run(by, before) + angles - target)

    try:
        now = missed(model)
        least = max(UNEXPLAINED * noise, NEGLIGIBLE * float(np.ptp(target)))
        if now <= least:
            return None
        candidate = identified(data)
        if candidate is None or missed(candidate) > (1.0 - SAVING) * now:
            return None
        return identified([*data, (sent, target)])
    except PlannerError:  # no motion to identify from, or no steady cycle
        return None


def _log(
    model: JointModel, requests: Array, angles: Array, *, cyclic: bool, load: Array | None
) -> Log:
    """A cycle twice, or a motion after some rest: all requests that act are known."""
    if cyclic:
        rows = np.arange(2 * len(requests)) % len(requests)
    else:
        rows = np.maximum(np.arange(-RESTING, len(requests)), 0)
    return Log(
        times=model.period * np.arange(len(rows), dtype=np.float64),
        requests=requests[rows],
        angles=angles[rows],
        load=None if load is None else load[rows],
        name="executed cycles",
    )


def _identified(model: JointModel, logs: Sequence[Log]) -> JointModel | None:
    """The model of the logs; a top speed that they do not show remains as it was."""
    result = identify(logs, tick=model.tick, hold=model.hold, hold_out=False)
    if not result.accepted:
        return None
    candidate = replace(result.model, tick=model.tick)
    if not result.saturates and candidate.v_max < model.v_max:
        stretch = model.v_max / candidate.v_max
        candidate = replace(candidate, v_max=model.v_max, theta_0=candidate.theta_0 * stretch)
    return candidate
