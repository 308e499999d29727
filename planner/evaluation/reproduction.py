"""The paper's experiment, end to end, and the figures that the paper reports."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.evaluation.checks import beyond_limits
from planner.gait.half_ellipse import ReferenceWalk, reference_walk
from planner.identification.excitation import step_test
from planner.model.joint import JointModel
from planner.model.response import simulate, simulate_joints
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_foot, invert_optimal
from planner.planning.line_inverse import Rule
from planner.planning.result import FootInversion, Inversion
from planner.trajectory import Array, Distance, angle_distance, foot_distance

JOINTS = ("rotator", "abductor", "knee")

SOURCE = (
    "Daniel Stronger and Peter Stone: A Model-Based Approach to Robot Joint Control, "
    "Table 2 and Section 5"
)

STEP_AMPLITUDES = (40.0, 110.0)
"""Amplitudes of the step tests of Figures 3 and 4 [degrees]."""

SEGMENTS = 6
"""Lines of an approximation; the paper draws its own by hand, with about as many (Figure 6)."""


SAME_METHOD: Mapping[str, str] = {
    "Des,Plain": "Des,MB",
    "Pwl,Plain": "Pwl,MB",
    "closed_form_plain": "closed_form",
}
"""The paper has one closed form; its figures stand beside ours as it is and with knots refined."""

RULE: Rule = "paper"
"""How the model-based rows of Table 2 invert a line."""

REFINE = {"closed_form_plain": False, "closed_form": True}
"""Whether knots are moved by the error of the simulated joint. The paper's stay where they are."""

PAIRS: Mapping[str, str] = {
    "Des,Dir": "direct",
    "Des,Plain": "closed_form_plain",
    "Pwl,Plain": "closed_form_plain",
    "Des,MB": "closed_form",
    "Pwl,MB": "closed_form",
    "Des,Opt": "optimal",
    "Des,Foot": "foot_optimal",
}
"""The rows of Table 2, Plain for the closed form as in the paper and MB for ours, with two of the
optimised plans, and the method whose angles each of them judges."""


class OverCycles(NamedTuple):
    """A distance over several cycles: its mean and its standard deviation."""

    mean: Distance
    deviation: Distance


def _printed(l2: float, l2_deviation: float, linf: float, linf_deviation: float) -> OverCycles:
    """A distance as published, over 20 steps of the robot's walk."""
    return OverCycles(Distance(l2, linf), Distance(l2_deviation, linf_deviation))


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
"""Distances between angle trajectories [degrees], by joint and comparison.

Des is the desired trajectory, Dir the angles when it is requested, Pwl its piecewise
linear approximation, and MB (model-based) the angles under the requests from that.
"""

FOOT: Mapping[str, OverCycles] = {
    "direct": _printed(3.23, 0.01, 4.61, 0.05),
    "shift": _printed(1.55, 0.04, 3.57, 0.08),
    "closed_form": _printed(1.21, 0.04, 2.34, 0.12),
}
"""Distances of the foot from its desired path [cm], by method."""


def published(joint: str, comparison: str) -> OverCycles | None:
    """The paper's figures beside a distance of angles [degrees]; None where it has none."""
    return TABLE_2.get(joint, {}).get(SAME_METHOD.get(comparison, comparison))


def published_foot(method: str) -> OverCycles | None:
    """The paper's figures beside a distance of the foot [cm]; None where it has none."""
    return FOOT.get(SAME_METHOD.get(method, method))


def deviations(
    table2: Mapping[str, Mapping[str, Distance]], foot: Mapping[str, Distance]
) -> tuple[float, ...]:
    """How far the baseline figures are from the published ones, each relative to the latter.

    The baselines are the figures that no choice of an approximation enters: the six of (Des, Dir),
    and L2 and Linf of the foot under the direct method and under the best time shift.

    Args:
        table2: Our distances by joint and comparison [degrees].
        foot: Our foot distances by method [cm].

    Returns:
        Ten relative deviations, without a sign.
    """
    pairs = [(table2[joint]["Des,Dir"], TABLE_2[joint]["Des,Dir"]) for joint in JOINTS]
    pairs += [(foot[method], FOOT[method]) for method in ("direct", "shift")]
    return tuple(
        abs(our / their - 1.0)
        for ours, theirs in pairs
        for our, their in zip(ours, theirs.mean, strict=True)
    )


@dataclass(frozen=True, eq=False)
class PlannedWalk:
    """Every plan for the reference walk, and the predictions of the joints' models.

    Methods are "direct", the desired angles requested as they are; "shift", the best time shift of
    them; "closed_form_plain", the inversion as in the paper, which knows no limits; "closed_form",
    the same with the knots moved until the joint itself tracks best; "optimal", within the joints'
    limits; and "foot_optimal", for all joints at once. Angles are in radians, shape (n, k).

    Attributes:
        models: The model of each joint, in the leg's order.
        segments: Lines of each approximation.
        walk: The reference walk with its leg.
        direct: Angles when the desired angles are requested.
        lead: Samples by which the best time shift is early.
        plans: The plans of the joints, one by one, for methods that plan them so.
        foot_plan: The plan for all joints at once, which keeps the foot close to its path.
    """

    models: tuple[JointModel, ...]
    segments: int
    walk: ReferenceWalk
    direct: Array
    lead: int
    plans: Mapping[str, tuple[Inversion, ...]]
    foot_plan: FootInversion

    @cached_property
    def requests(self) -> dict[str, Array]:
        """Requests of all joints by method."""
        return self._by_method(self.walk.desired, "requests")

    @cached_property
    def angles(self) -> dict[str, Array]:
        """Angles that the models predict under them."""
        return self._by_method(self.direct, "predicted")

    def _by_method(self, direct: Array, of_plans: str) -> dict[str, Array]:
        return {
            "direct": direct,
            "shift": np.roll(direct, -self.lead, axis=0),
            **{
                method: np.column_stack([getattr(each, of_plans) for each in own])
                for method, own in self.plans.items()
            },
            "foot_optimal": getattr(self.foot_plan, of_plans),
        }

    @cached_property
    def approximations(self) -> dict[str, Array]:
        """Piecewise linear approximations behind the closed forms at the samples: Pwl."""
        curves = {method: [each.approximation for each in self.plans[method]] for method in REFINE}
        return {
            method: np.column_stack([curve.angles for curve in own if curve is not None])
            for method, own in curves.items()
        }

    def goal(self, pair: str) -> Array:
        """What the angles of a row of Table 2 are compared with: Des or Pwl."""
        return self.approximations[PAIRS[pair]] if pair.startswith("Pwl") else self.walk.desired

    def excess(self, method: str, j: int) -> float:
        """How far a method's farthest request is beyond the limits of a joint [rad], or 0."""
        lower, upper = self.walk.leg.limits
        return max(beyond_limits(self.requests[method][:, j], (lower[j], upper[j])), 0.0)

    @cached_property
    def legs(self) -> dict[str, Array]:
        """Where the leg's joints and, last, its foot are at the ``desired`` angles and by method.

        In metres, each of shape (n, joints + 1, 3).
        """
        angles = {"desired": self.walk.desired, **self.angles}
        return {method: self.walk.leg.joint_positions(each) for method, each in angles.items()}

    @property
    def foot(self) -> dict[str, Array]:
        """Path of the foot under each method [m], shape (n, 3)."""
        return {method: self.legs[method][:, -1] for method in self.angles}

    @property
    def table2(self) -> dict[str, dict[str, Distance]]:
        """Distances between angle trajectories by joint and comparison [degrees]: Table 2."""
        return {
            name: {
                pair: angle_distance(self.angles[method][:, j], self.goal(pair)[:, j]).in_units_of(
                    math.radians(1.0)
                )
                for pair, method in PAIRS.items()
            }
            for j, name in enumerate(self.walk.joint_names)
        }

    @property
    def foot_table(self) -> dict[str, Distance]:
        """Distances of the foot from its desired path by method [cm]."""
        return {
            method: foot_distance(path, self.walk.desired_foot).in_units_of(0.01)
            for method, path in self.foot.items()
        }


@dataclass(frozen=True, eq=False)
class Reproduction(PlannedWalk):
    """Results of the experiment on one model for all joints.

    Attributes:
        steps: The step tests, by amplitude [degrees].
        seconds: Time that each part took [s].
    """

    steps: Mapping[float, StepResponse]
    seconds: Mapping[str, float]

    @property
    def model(self) -> JointModel:
        """The model of every joint."""
        return self.models[0]

    @property
    def baseline_deviation(self) -> float:
        """Mean relative deviation of the ten baseline figures from the paper's."""
        return float(np.mean(deviations(self.table2, self.foot_table)))


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A joint's steady answer to the step test, and its features at the step down.

    Attributes:
        requests: Requests of Equation 1 [rad], shape (n,).
        angles: Angles [rad], shape (n,).
        step: Sample at which the requests step down.
        lag: Samples until the speed begins to change.
        acceleration: Samples from then until the joint moves down at its top speed.
        v_max: Its top speed [rad/s].
    """

    requests: Array
    angles: Array
    step: int
    lag: int
    acceleration: int
    v_max: float


def measure_step_response(
    model: JointModel, amplitude: float, *, samples: int = 88
) -> StepResponse:
    """Run the step test of Equation 1 and read its features off, in whole samples as by eye.

    Args:
        model: The joint.
        amplitude: Height of the step [rad]; high enough for the joint to reach its top speed.
        samples: Length of the test.
    """
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
    return StepResponse(
        requests=requests,
        angles=angles,
        step=step,
        lag=lag,
        acceleration=full - lag,
        v_max=fastest / model.period,
    )


def reproduce(
    model: JointModel | None = None,
    *,
    segments: int = SEGMENTS,
    progress: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Run the paper's experiment on its own model.

    Args:
        model: The model of every joint; by default Table 1.
        segments: Lines of each approximation.
        progress: Called with the name of each part before it is computed.
    """
    model = JointModel.ers210a() if model is None else model
    clock = Clock(progress)
    planned = plan_walk((model,) * len(JOINTS), segments=segments, clock=clock)
    clock.start("step_tests", "the step tests")
    steps = {
        amplitude: measure_step_response(model, float(np.radians(amplitude)))
        for amplitude in STEP_AMPLITUDES
    }
    clock.stop()
    return Reproduction(
        **{each.name: getattr(planned, each.name) for each in fields(PlannedWalk)},
        steps=steps,
        seconds=clock.seconds,
    )


def plan_walk(models: Sequence[JointModel], *, segments: int, clock: Clock) -> PlannedWalk:
    """Plan the reference walk by every method, and predict the angles and the foot's path."""
    models = tuple(models)
    clock.start("walk", "the walk")
    walk = reference_walk()
    clock.start("baselines", "the baselines")
    direct = simulate_joints(models, walk.desired, cyclic=True)
    lead = best_lead(direct, walk_distance(walk))
    clock.start("foot_optimal", "the optimised requests for the foot")
    foot_plan = invert_foot(models, walk.leg, walk.desired_foot)
    clock.start("foot_bound", "the lower bound for the foot")
    _ = foot_plan.lower_bound
    plans = []
    for j, (name, model) in enumerate(zip(walk.joint_names, models, strict=True)):
        desired = walk.desired[:, j]
        limits = (float(walk.leg.limits.lower[j]), float(walk.leg.limits.upper[j]))
        clock.start("closed_form", f"the closed form for the {name}")
        own = {
            method: invert_closed_form(model, desired, segments=segments, rule=RULE, refine=refine)
            for method, refine in REFINE.items()
        }
        clock.start("optimal", f"the optimised requests for the {name}")
        # A joint that sags cannot rest at a limit of its requests: clip to the angles where it can.
        resting = np.clip(desired, *model.rest(limits))
        own["optimal"] = invert_optimal(model, resting, limits=limits)
        clock.start("bounds", f"the lower bound for the {name}")
        _ = [each.lower_bound for each in own.values()]  # computed when first asked for
        plans.append(own)
    clock.stop()
    by_method = {method: tuple(own[method] for own in plans) for method in plans[0]}
    return PlannedWalk(models, segments, walk, direct, lead, by_method, foot_plan)


def best_lead(unshifted: Array, distance: Callable[[Array], Distance]) -> int:
    """By how many samples to be early: the lead with the least rms, the smallest such lead.

    A joint's answer to shifted requests is its shifted answer, so one simulation serves all leads.

    Args:
        unshifted: A cycle of the joints' angles when the desired angles are requested [rad],
            shape (n, joints).
        distance: Distance from the goal for given angles [rad], shape (n, joints); the paper judges
            in the foot's space.
    """
    leads = range(len(unshifted))
    return min(leads, key=lambda lead: distance(np.roll(unshifted, -lead, axis=0)).rms)


def walk_distance(walk: ReferenceWalk) -> Callable[[Array], Distance]:
    """Distance of the foot from the walk's path [m], as a function of the angles [rad], (n, k)."""
    return lambda angles: foot_distance(walk.leg.foot_positions(angles), walk.desired_foot)


class Clock:
    """Adds up the wall-clock time [s] of each part, and reports each part when it begins."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        """A stopped clock; ``progress`` is called with the name of each part."""
        self.seconds: dict[str, float] = {}
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
