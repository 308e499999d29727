"""The checks of a plan: claims with their tolerances, and the figures that they rest on."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, excess, finite
from planner.exceptions import NoSteadyCycle
from planner.model.joint import JointModel, acting_requests
from planner.model.response import load_by_period, motion_under
from planner.planning.bounds.reachable_set import Level
from planner.planning.plan import Inversion, Plan
from planner.planning.task import SMOOTHNESS


class Claim(NamedTuple):
    """What a check claims, how much it allows, and why."""

    name: str
    tolerance: float
    unit: str
    reason: str

    def of(self, what: str, allowed: float = 0.0) -> Claim:
        """The claim about something, with so much more allowed."""
        return self._replace(name=self.name.format(what), tolerance=self.tolerance + allowed)


LOCAL = 2e-4  # share of the error by which a local optimum may exceed that of another search
SHARE = SMOOTHNESS + LOCAL
_CLAIMS = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
CLAIMS = {
    key: Claim(**each | {"reason": each["reason"].format(smoothness=SMOOTHNESS, local=LOCAL)})
    for key, each in _CLAIMS.items()
}
ROUNDING = 1e-3  # share of a tolerance within which a value is rounding, not what breaks a claim
FOLLOWED = 1e-4  # errors up to this count as zero [rad]: 0.006 degrees


@dataclass(frozen=True)
class Check:
    """A claim about a joint or the foot, and the figure that it rests on.

    Attributes:
        subject: The joint that it is about, or the foot.
        plan: The plan that it is about; empty where it is about none.
        claim: The claim.
        value: The figure, in the claim's unit; negative where there is room.
    """

    subject: str
    plan: str
    claim: Claim
    value: float

    @property
    def name(self) -> str:
        """The claim in words."""
        return self.claim.name

    @property
    def is_rounding(self) -> bool:
        """Whether the value is rounding, which must not decide which plan is worst."""
        return abs(self.value) <= ROUNDING * self.claim.tolerance > 0.0

    @property
    def passed(self) -> bool:
        """Whether the claim holds; not for NaN."""
        return self.value <= self.claim.tolerance

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; a value that is not finite becomes None."""
        return {
            "subject": self.subject,
            "plan": self.plan,
            "name": self.name,
            "value": finite(self.value),
            **self.claim._asdict(),
            "passed": self.passed,
        }


class Answer(NamedTuple):
    """Motion of one joint under one plan, simulated independently."""

    agreement: float  # largest distance from the predicted angles [rad]
    # between the ends of the predicted cycle, from rest between the first angle and the one it
    # rests at [rad]
    closure: float


def second_answer(plan: Plan, column: int = 0) -> Answer:
    """Simulate a joint of a plan by the law in CasADi symbols, and compare the predicted angles.

    A cycle is run from where the predicted one ends.
    """
    model, start, load = plan.models[column], plan.task.starts[column], plan.task.loads[column]
    requests, predicted = plan.requests[:, column].copy(), plan.predicted[:, column]
    run = _symbolic_run(model, requests, load, cyclic=plan.cyclic)
    if not plan.cyclic:
        torque = 0.0 if load is None else load[0]
        rest = float(model.rest(requests[0], torque)) if start is None else start
        angles = run(model.at_rest(rest, torque))[0]
        apart = float(np.max(np.abs(predicted - angles)))
        return Answer(apart, abs(float(predicted[0]) - rest))
    acting_load = load_by_period(load, cyclic=True)
    last = motion_under(model, requests, cyclic=True, torques=acting_load)[:, -1]
    following = run(np.array([predicted[-1], *last[1:]]))[0]
    closure = abs(float(following[-1] - predicted[-1]))
    return Answer(max(float(np.max(np.abs(predicted - following))), closure), closure)


def _symbolic_run(
    model: JointModel, requests: Array, load: Array | None, *, cyclic: bool
) -> Callable[[Array], Array]:
    """States at the samples, (3, n), from the one before: by the law in CasADi symbols."""
    from planner.model.symbolic import period_function  # slow to import: CasADi

    count = len(requests)
    acting_load = load_by_period(load, cyclic=cyclic)
    torques = np.zeros(count) if acting_load is None else acting_load
    sent = requests[np.maximum(acting_requests(model).numbers(count, cyclic=cyclic), 0)]
    size = model.states
    first = 0 if cyclic else 1
    periods = period_function(model).mapaccum("run", count - first)

    def run(state: Array) -> Array:
        motion, begun = np.zeros((3, count)), state[:size]
        if not cyclic:  # one tick before the first sample, under a request that was always there
            tick = period_function(replace(model, hold=1))
            width = acting_requests(replace(model, hold=1)).width
            begun = np.asarray(tick(begun, np.full(width, requests[0]), torques[0], 0.0)).ravel()
            motion[:size, 0] = begun
        motion[:size, first:] = periods(begun, sent[first:].T, torques[first:], 0.0)
        return motion

    return run


def answer_checks(subject: str, plan: str, answer: Answer, *, cyclic: bool) -> list[Check]:
    """That the predicted angles agree with the second answer, and begin as they should."""
    return [
        Check(subject, plan, CLAIMS["agrees"], answer.agreement),
        Check(subject, plan, CLAIMS["closes" if cyclic else "rests"], answer.closure),
    ]


def bound_checks(
    subject: str, bounds: Mapping[Level, float], errors: Mapping[str, float]
) -> list[Check]:
    """That each bound is at least the one before it, and no plan is below any [rad]."""
    values = list(bounds.values())
    ordered = CLAIMS["ordered"].of(" ≤ ".join(bounds))
    worst = max((low - high for low, high in pairwise(values)), default=None)
    checks = [] if worst is None else [Check(subject, "", ordered, worst)]
    above = ((plan, max(values) - error) for plan, error in errors.items())
    return checks + [Check(subject, plan, CLAIMS["above"], below) for plan, below in above]


def beyond_limits(requests: Array, limits: tuple[Any, Any]) -> float:
    """Largest distance of a request beyond the limits [rad]; negative where all are inside."""
    return float(np.max(excess(requests, *limits)))


def kept_within(plan: Inversion, limits: tuple[float, float] | None) -> Inversion | None:
    """The plan, clipped to the limits, beyond which no gain counts; None where it has no cycle."""
    if limits is None or beyond_limits(plan.requests, limits) <= CLAIMS["inside"].tolerance:
        return plan
    clipped = Inversion(plan.plan, plan.column, requests=np.clip(plan.requests, *limits))
    try:
        _ = clipped.predicted
    except NoSteadyCycle:
        return None
    return clipped
