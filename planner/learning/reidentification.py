"""Another model from the measured cycles, where it predicts a cycle that it has not seen better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.exceptions import PlannerError
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.inversion.trials import Trial
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.trajectory import Array, rms


@dataclass(frozen=True, kw_only=True)
class ReidentificationOptions:
    """When the measured cycles identify a model anew.

    Attributes:
        unexplained: Error of the prediction from which on it is worth a second, in standard
            deviations of the measured cycle's noise [-].
        negligible: So is one beyond this share of the joint's motion [-]: learning copes with it.
        saving: Share of that error that another model has to save on a cycle that it has not seen
            [-]: a model that is as good brings nothing, and forgets the logs it came from.
        trials: Trials, the last ones, that are fitted.
        resting: Rows of rest before a motion from rest: longer than any lag.
    """

    unexplained: float = 2.0
    negligible: float = 0.002
    saving: float = 0.3
    trials: int = 4
    resting: int = 20


OPTIONS = ReidentificationOptions()


def better_model(
    model: JointModel,
    trials: Sequence[Trial],
    joint: int,
    noise: float,
    *,
    cyclic: bool,
    start: float | None,
    load: Array | None,
) -> JointModel | None:
    """A model identified from the trials, if it predicts the last one better; else None.

    The last trial is held out. With the model as it is, its angles are predicted with the
    disturbance of the trial before; so they are with a model that is identified from those before.
    Of a single trial the last cycle is held out; as the disturbance of the others would explain it
    whatever the model, the models compete without one.

    Args:
        model: The joint as it is known.
        trials: What was executed.
        joint: Which column of the trials is its.
        noise: Standard deviation of one cycle's noise [rad].
        cyclic: Whether requests repeat.
        start: From rest: where the joint rests before [rad].
        load: Torque on the joint [N m], (n,).
    """

    def run(of: JointModel, requests: Array) -> Array:
        return simulate(of, requests, cyclic=cyclic, start=start, load=load)

    def identified(known: Sequence[tuple[Array, Array]]) -> JointModel | None:
        logs = [_log(model, *each, cyclic=cyclic, load=load) for each in known[-OPTIONS.trials :]]
        return _identified(model, logs)

    pairs = [(trial.requests[:, joint], trial.measured[:, :, joint]) for trial in trials]
    sent, measured = pairs[-1]
    if len(pairs) > 1:
        known = [(requests, cycles.mean(axis=0)) for requests, cycles in pairs[:-1]]
        target = measured.mean(axis=0)
        noise /= np.sqrt(len(measured))
    elif len(measured) > 1:
        known, target = [(sent, measured[:-1].mean(axis=0))], measured[-1]
    else:
        return None

    def missed(by: JointModel) -> float:
        before, angles = known[-1]
        disturbance = angles - run(by, before) if len(pairs) > 1 else 0.0
        return rms(run(by, sent) + disturbance - target)

    try:
        now = missed(model)
        least = max(OPTIONS.unexplained * noise, OPTIONS.negligible * float(np.ptp(target)))
        if now <= least:
            return None
        other = identified(known)
        if other is None or missed(other) > (1.0 - OPTIONS.saving) * now:
            return None
        return identified([*known, (sent, target)])
    except PlannerError:  # no motion to identify from, or no steady cycle
        return None


def _log(
    model: JointModel, requests: Array, angles: Array, *, cyclic: bool, load: Array | None
) -> Log:
    """A cycle twice, or a motion after some rest: all requests that act are known."""
    if cyclic:
        rows = np.arange(2 * len(requests)) % len(requests)
    else:
        rows = np.maximum(np.arange(-OPTIONS.resting, len(requests)), 0)
    return Log(
        times=model.period * np.arange(len(rows), dtype=np.float64),
        requests=requests[rows],
        angles=angles[rows],
        load=None if load is None else load[rows],
        name="executed cycles",
    )


def _identified(model: JointModel, logs: Sequence[Log]) -> JointModel | None:
    """The model of the logs; a top speed that they do not show remains as it was."""
    found = identify(logs, tick=model.tick, hold=model.hold, hold_out=False)
    if found.verdict == "refused":
        return None
    other = replace(found.model, tick=model.tick)
    shown = found.intervals["v_max"].bounded
    if not shown and other.v_max < model.v_max:
        stretch = model.v_max / other.v_max
        other = replace(other, v_max=model.v_max, theta_0=other.theta_0 * stretch)
    return other
