"""The paper's experiment, end to end, and the figures that the paper reports."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, Distance, size
from planner.gait.half_ellipse import ReferenceWalk, reference_walk
from planner.identification.excitation import step_test
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.inversion import planned
from planner.planning.line_inverse import Rule
from planner.planning.plan import Plan
from planner.planning.task import Task

JOINTS = ("rotator", "abductor", "knee")

SOURCE = (
    "Daniel Stronger and Peter Stone: A Model-Based Approach to Robot Joint Control, "
    "Table 2 and Section 5"
)

STEP_AMPLITUDES = (40.0, 110.0)  # amplitudes of the step tests of Figures 3 and 4 [degrees]

SEGMENTS = 6  # lines of an approximation; the paper draws about as many by hand (Figure 6)
RULE: Rule = "paper"  # how the model-based rows of Table 2 invert a line

# The paper has one closed form; its figures stand beside ours as it is and with knots refined.
SAME_METHOD = {"Des,Plain": "Des,MB", "Pwl,Plain": "Pwl,MB", "closed_form_plain": "closed_form"}

# Whether knots are moved by the error of the simulated joint. The paper's stay where they are.
REFINE = {"closed_form_plain": False, "closed_form": True}

# The rows of Table 2, Plain for the closed form as in the paper and MB for ours, with two of the
# optimised plans, and the method whose angles each of them judges.
PAIRS: Mapping[str, str] = {
    "Des,Dir": "direct",
    "Des,Plain": "closed_form_plain",
    "Pwl,Plain": "closed_form_plain",
    "Des,MB": "closed_form",
    "Pwl,MB": "closed_form",
    "Des,Opt": "optimal",
    "Des,Foot": "foot_optimal",
}


class OverCycles(NamedTuple):
    """A distance over several cycles: its mean and its standard deviation."""

    mean: Distance
    deviation: Distance

    @classmethod
    def of(cls, distances: Iterable[Distance], unit: float) -> OverCycles:
        """From the distances of single cycles, where ``unit`` counts as 1."""
        rows = np.array(list(distances)) / unit
        deviation = rows.std(axis=0, ddof=1) if len(rows) > 1 else np.zeros(2)
        return cls(Distance(*rows.mean(axis=0).tolist()), Distance(*deviation.tolist()))


def _printed(l2: float, l2_deviation: float, linf: float, linf_deviation: float) -> OverCycles:
    """A distance as published, over 20 steps of the robot's walk."""
    return OverCycles(Distance(l2, linf), Distance(l2_deviation, linf_deviation))


# Distances between angle trajectories [degrees], by joint and comparison: Des is the desired
# trajectory, Dir the angles when it is requested, Pwl its piecewise linear approximation, and MB
# (model-based) the angles under the requests from that.
TABLE_2: Mapping[str, Mapping[str, OverCycles]] = {
    "rotator": {
        "Des,Dir": _printed(31.0, 0.2, 57.2, 0.3),
        "Des,MB": _printed(9.1, 0.2, 29.4, 0.8),
        "Pwl,MB": _printed(2.7, 0.4, 6.4, 0.6),
    },
    "abductor": {
        "Des,Dir": _printed(29.0, 0.2, 59.5, 0.5),
        "Des,MB": _printed(10.4, 0.1, 24.5, 0.7),
        "Pwl,MB": _printed(2.7, 0.3, 6.0, 0.4),
    },
    "knee": {
        "Des,Dir": _printed(20.1, 0.1, 42.6, 0.3),
        "Des,MB": _printed(5.6, 0.2, 11.1, 0.5),
        "Pwl,MB": _printed(2.6, 0.2, 6.2, 0.7),
    },
}

# Distances of the foot from its desired path [cm], by method.
FOOT: Mapping[str, OverCycles] = {
    "direct": _printed(3.23, 0.01, 4.61, 0.05),
    "shift": _printed(1.55, 0.04, 3.57, 0.08),
    "closed_form": _printed(1.21, 0.04, 2.34, 0.12),
}


def published(name: str, joint: str = "") -> OverCycles | None:
    """The paper's figures for a joint's comparison or a method's foot; None where it has none."""
    return (TABLE_2.get(joint, {}) if joint else FOOT).get(SAME_METHOD.get(name, name))


def deviations(
    table2: Mapping[str, Mapping[str, OverCycles]], foot: Mapping[str, OverCycles]
) -> tuple[float, ...]:
    """Relative distances of the ten baseline figures, without approximations, from published."""
    pairs = [(table2[joint]["Des,Dir"], TABLE_2[joint]["Des,Dir"]) for joint in JOINTS]
    pairs += [(foot[method], FOOT[method]) for method in ("direct", "shift")]
    return tuple(
        abs(our / their - 1.0)
        for ours, theirs in pairs
        for our, their in zip(ours.mean, theirs.mean, strict=True)
    )


@dataclass(frozen=True, eq=False)
class PlannedWalk:
    """Every plan for the reference walk, and the predictions of the joints' models.

    Methods are "direct", the desired angles as requests; "shift", with the best time shift;
    "closed_form_plain", as in the paper, which ignores limits; "closed_form", with knots moved
    until the joint tracks best; "optimal", within limits; "foot_optimal", for all joints at once.
    """

    segments: int  # lines of each approximation
    walk: ReferenceWalk
    lead: int  # samples by which the best time shift is early
    plans: Mapping[str, Plan]  # of all joints, by method
    seconds: Mapping[str, float]  # time that each part took [s]

    @property
    def models(self) -> tuple[JointModel, ...]:
        """The model of each joint, in the leg's order."""
        return self.plans["direct"].models

    @cached_property
    def approximations(self) -> dict[str, Array]:
        """Piecewise linear approximations behind the closed forms at the samples: Pwl."""
        return {
            method: np.column_stack([curve.angles for curve in self.plans[method].approximations])
            for method in REFINE
        }

    def goal(self, pair: str) -> Array:
        """What the angles of a row of Table 2 are compared with: Des or Pwl."""
        return self.approximations[PAIRS[pair]] if pair.startswith("Pwl") else self.walk.desired

    @cached_property
    def legs(self) -> dict[str, Array]:
        """Joints and, last, foot by method, and ``desired`` [m], each (n, joints + 1, 3)."""
        predicted = {method: plan.predicted for method, plan in self.plans.items()}
        angles = {"desired": self.walk.desired, **predicted}
        return {method: self.walk.leg.joint_positions(each) for method, each in angles.items()}

    def table2(self, walks: Mapping[str, Array] | None = None) -> dict[str, dict[str, OverCycles]]:
        """Table 2 [degrees] by joint, of predicted angles or of ``walks`` [rad], (cycles, n, k)."""
        table: dict[str, dict[str, OverCycles]] = {name: {} for name in self.walk.joint_names}
        for pair, method in PAIRS.items():
            cycles = [self.plans[method].predicted] if walks is None else walks[method]
            goal = self.goal(pair)
            for j, pairs in enumerate(table.values()):
                distances = (size(angles[:, j] - goal[:, j]) for angles in cycles)
                pairs[pair] = OverCycles.of(distances, math.radians(1.0))
        return table

    def foot_table(self, walks: Mapping[str, Array] | None = None) -> dict[str, OverCycles]:
        """Distances of the foot from its desired path by method [cm]; see :meth:`table2`."""
        distance = walk_distance(self.walk)
        if walks is None:
            walks = {method: plan.predicted[np.newaxis] for method, plan in self.plans.items()}
        return {
            method: OverCycles.of(map(distance, cycles), 0.01) for method, cycles in walks.items()
        }

    def baseline_deviation(self, walks: Mapping[str, Array] | None = None) -> float:
        """Mean relative deviation of the ten baseline figures from the paper's."""
        return float(np.mean(deviations(self.table2(walks), self.foot_table(walks))))

    @cached_property
    def steps(self) -> dict[float, StepResponse]:
        """The step tests of the first joint, by amplitude [degrees]."""
        return {
            amplitude: measure_step_response(self.models[0], float(np.radians(amplitude)))
            for amplitude in STEP_AMPLITUDES
        }


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A joint's steady answer to the step test, and its features at the step down."""

    requests: Array  # of Equation 1 [rad], (n,)
    angles: Array  # [rad], (n,)
    step: int  # sample at which the requests step down
    lag: int  # samples until the speed begins to change
    acceleration: int  # samples from then until the joint moves down at its top speed
    v_max: float  # that speed [rad/s]


def measure_step_response(
    model: JointModel, amplitude: float, *, samples: int = 88
) -> StepResponse:
    """Run the step test of Equation 1 up to the top speed, and read its features off as by eye."""
    requests = step_test(amplitude, samples=samples)
    angles = simulate(model, requests)
    step = int(np.argmin(requests))
    speeds = angles - np.roll(angles, 1)  # speeds[k] leads from sample k - 1 to k [rad/sample]
    fastest = float(np.max(np.abs(speeds)))
    after = speeds[step:]
    visible = 0.01 * fastest  # a change of the speed, or its distance from the top speed
    begun = int(np.argmax(np.abs(after - after[0]) > visible))
    full = int(np.argmax(after <= visible - fastest))
    lag = begun - 1  # sample `begun` ends the first interval in which the speed is another
    return StepResponse(requests, angles, step, lag, full - lag, v_max=fastest / model.period)


def reproduce(
    model: JointModel | None = None,
    *,
    segments: int = SEGMENTS,
    progress: Callable[[str], None] = lambda _: None,
) -> PlannedWalk:
    """Run the paper's experiment on the model of every joint, by default that of Table 1."""
    clock = Clock(progress)
    models = (JointModel.ers210a() if model is None else model,) * len(JOINTS)
    planned_walk = plan_walk(models, segments=segments, clock=clock)
    clock.start("step_tests", "the step tests")
    _ = planned_walk.steps
    clock.stop()
    return planned_walk


def plan_walk(models: Sequence[JointModel], *, segments: int, clock: Clock) -> PlannedWalk:
    """Plan the reference walk by every method, and compute the lower bounds."""
    clock.start("walk", "the walk")
    walk = reference_walk()
    limits, names = walk.leg.limits, walk.joint_names

    def task_for(desired: Array, **more: Any) -> Task:
        """The task for the joints one by one, with their leg and its foot."""
        task = Task.of(models, desired, names=names, **more)
        return replace(task, leg=walk.leg, foot=walk.desired_foot)

    def of_joints(part: str, words: str) -> Callable[[str], None]:
        return lambda name: clock.start(part, f"{words} for the {name}")

    clock.start("baselines", "the baselines")
    task = task_for(walk.desired)
    plans = {"direct": Plan(task=task, requests=walk.desired)}
    lead = best_lead(plans["direct"].predicted, walk_distance(walk))
    plans["shift"] = Plan(task=task, requests=np.roll(walk.desired, -lead, axis=0))
    for method, refine in REFINE.items():
        lines = {"segments": segments, "rule": RULE, "refine": refine}
        words = "the refined closed form" if refine else "the closed form"
        progress = of_joints("closed_form", words)
        plans[method] = planned(task, method="closed_form", lines=lines, progress=progress)
    # A joint that sags cannot rest at a limit of its requests: clip to the angles where it can.
    ends = [model.rest(pair) for model, pair in zip(models, np.transpose(limits), strict=True)]
    resting = task_for(np.clip(walk.desired, *np.transpose(ends)), limits=limits)
    plans["optimal"] = planned(resting, progress=of_joints("optimal", "the optimised requests"))
    clock.start("foot_optimal", "the optimised requests for the foot")
    plans["foot_optimal"] = planned(Task.of(models, walk.desired_foot, leg=walk.leg))
    clock.start("bounds", "the lower bounds for the joints")
    _ = [plans[method].lower_bounds for method in (*REFINE, "optimal")]  # kept from now on
    clock.start("foot_bound", "the lower bound for the foot")
    _ = plans["foot_optimal"].lower_bounds
    clock.stop()
    return PlannedWalk(segments, walk, lead, plans, clock.seconds)


def best_lead(unshifted: Array, distance: Callable[[Array], Distance]) -> int:
    """By how many samples to be early: the lead with the least rms, the smallest such lead.

    One cycle serves all leads, as shifted requests have the shifted answer: ``unshifted`` is that
    to the desired angles [rad], (n, k), of which the paper judges the ``distance`` in the foot.
    """
    leads = range(len(unshifted))
    return min(leads, key=lambda lead: distance(np.roll(unshifted, -lead, axis=0)).rms)


def walk_distance(walk: ReferenceWalk) -> Callable[[Array], Distance]:
    """Distance of the foot from the walk's path [m], as a function of the angles [rad], (n, k)."""

    def distance(angles: Array) -> Distance:
        apart = walk.leg.foot_positions(angles) - walk.desired_foot
        return size(np.linalg.norm(apart, axis=1))

    return distance


class Clock:
    """Adds up the wall-clock time [s] of each part, and reports each part when it begins."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        """A stopped clock; ``progress`` is called with the name of each part."""
        self.seconds = dict[str, float]()
        self._progress, self._part, self._since = progress, "", 0.0

    def start(self, part: str, doing: str) -> None:
        """End the part before, and begin this one."""
        self.stop()
        self._progress(doing)
        self._part, self._since = part, time.perf_counter()

    def stop(self) -> None:
        """End the part that is under way, if any."""
        if self._part:
            spent = time.perf_counter() - self._since
            self.seconds[self._part] = self.seconds.get(self._part, 0.0) + spent
        self._part = ""
