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


Table2 = Mapping[str, Mapping[str, Distance]]
FootTable = Mapping[str, Distance]

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

VISIBLE = 0.01
"""A speed has changed, or is the top speed, when it is this close, relative to the top speed."""


class Measured(NamedTuple):
    """A figure measured on the robot: mean and standard deviation over 20 steps of the walk."""

    mean: float
    deviation: float


class Published(NamedTuple):
    """A distance as published: the paper's L2, a root mean square, and its Linf."""

    L2: Measured
    Linf: Measured


TABLE_2: Mapping[str, Mapping[str, Published]] = {
    "rotator": {
        "Des,Dir": Published(Measured(31.0, 0.2), Measured(57.2, 0.3)),
        "Des,MB": Published(Measured(9.1, 0.2), Measured(29.4, 0.8)),
        "Pwl,MB": Published(Measured(2.7, 0.4), Measured(6.4, 0.6)),
    },
    "abductor": {
        "Des,Dir": Published(Measured(29.0, 0.2), Measured(59.5, 0.5)),
        "Des,MB": Published(Measured(10.4, 0.1), Measured(24.5, 0.7)),
        "Pwl,MB": Published(Measured(2.7, 0.3), Measured(6.0, 0.4)),
    },
    "knee": {
        "Des,Dir": Published(Measured(20.1, 0.1), Measured(42.6, 0.3)),
        "Des,MB": Published(Measured(5.6, 0.2), Measured(11.1, 0.5)),
        "Pwl,MB": Published(Measured(2.6, 0.2), Measured(6.2, 0.7)),
    },
}
"""Distances between angle trajectories [degrees], by joint and comparison.

Des is the desired trajectory, Dir the angles when it is requested, Pwl its piecewise
linear approximation, and MB (model-based) the angles under the requests from that.
"""

FOOT: Mapping[str, Published] = {
    "direct": Published(Measured(3.23, 0.01), Measured(4.61, 0.05)),
    "shift": Published(Measured(1.55, 0.04), Measured(3.57, 0.08)),
    "closed_form": Published(Measured(1.21, 0.04), Measured(2.34, 0.12)),
}
"""Distances of the foot from its desired path [cm], by method."""


def published(joint: str, comparison: str) -> Published | None:
    """The paper's figures beside a distance of angles [degrees]; None where it has none."""
    return TABLE_2.get(joint, {}).get(SAME_METHOD.get(comparison, comparison))


def published_foot(method: str) -> Published | None:
    """The paper's figures beside a distance of the foot [cm]; None where it has none."""
    return FOOT.get(SAME_METHOD.get(method, method))


def deviations(table2: Table2, foot: FootTable) -> tuple[float, ...]:
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
        abs(our / published.mean - 1.0)
        for ours, theirs in pairs
        for our, published in zip(ours, theirs, strict=True)
    )


@dataclass(frozen=True, eq=False)
class JointOutcome:
    """One joint of the experiment.

    Attributes:
        name: The joint.
        desired: Desired angles [rad], shape (n,): the paper's Des.
        direct: Angles when these are requested [rad], shape (n,): Dir.
        limits: Smallest and largest request that the joint can take [rad].
        closed_form_plain: The inversion as in the paper, which knows no limits.
        closed_form: The same, with the knots moved until the joint itself tracks best; ours.
        optimal: The optimised inversion, within the joint's limits.
        foot_requests: Requests of the plan for all joints at once [rad], shape (n,).
        foot_optimal: Angles under them [rad], shape (n,).
    """

    name: str
    desired: Array
    limits: tuple[float, float]
    direct: Array
    closed_form_plain: Inversion
    closed_form: Inversion
    optimal: Inversion
    foot_requests: Array
    foot_optimal: Array

    @property
    def goals(self) -> dict[str, Array]:
        """Goals of the rows of Table 2 other than the desired angles [rad], (n,)."""
        plain, refined = approximation(self.closed_form_plain), approximation(self.closed_form)
        return {"Pwl,Plain": plain, "Pwl,MB": refined}

    @property
    def excesses(self) -> dict[str, float]:
        """How far the farthest request of each plan is beyond the joint's limits [rad], or 0."""
        requests = {
            "closed_form_plain": self.closed_form_plain.requests,
            "closed_form": self.closed_form.requests,
            "optimal": self.optimal.requests,
            "foot_optimal": self.foot_requests,
        }
        return {
            method: max(beyond_limits(values, self.limits), 0.0)
            for method, values in requests.items()
        }


def approximation(closed_form: Inversion) -> Array:
    """Piecewise linear approximation behind a closed form at the samples [rad], shape (n,): Pwl."""
    assert closed_form.approximation is not None, "a closed form has one"
    return closed_form.approximation.angles


@dataclass(frozen=True, eq=False)
class PlannedWalk:
    """Every plan for the reference walk, and the predictions of the joints' models.

    Attributes:
        models: The model of each joint, in the leg's order.
        segments: Lines of each approximation.
        walk: The reference walk with its leg.
        joints: One outcome per joint, in the leg's order.
        lead: Samples by which the best time shift is early.
        foot_plan: The plan for all joints at once, which keeps the foot close to its path.
    """

    models: tuple[JointModel, ...]
    segments: int
    walk: ReferenceWalk
    joints: tuple[JointOutcome, ...]
    lead: int
    foot_plan: FootInversion

    @cached_property
    def requests(self) -> dict[str, Array]:
        """Requests of all joints by method [rad], each (n, k)."""
        desired = self.walk.desired
        return {
            "direct": desired,
            "shift": np.roll(desired, -self.lead, axis=0),
            **self._columns(lambda plan: plan.requests),
            "foot_optimal": self.foot_plan.requests,
        }

    @cached_property
    def angles(self) -> dict[str, Array]:
        """Angles that the models predict under them [rad], each (n, k)."""
        direct = np.column_stack([joint.direct for joint in self.joints])
        return {
            "direct": direct,
            "shift": np.roll(direct, -self.lead, axis=0),
            **self._columns(lambda plan: plan.predicted),
            "foot_optimal": self.foot_plan.predicted,
        }

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
            joint.name: {
                pair: angle_distance(
                    self.angles[method][:, j], joint.goals.get(pair, joint.desired)
                ).in_units_of(math.radians(1.0))
                for pair, method in PAIRS.items()
            }
            for j, joint in enumerate(self.joints)
        }

    @property
    def foot_table(self) -> dict[str, Distance]:
        """Distances of the foot from its desired path by method [cm]."""
        return {
            method: foot_distance(path, self.walk.desired_foot).in_units_of(0.01)
            for method, path in self.foot.items()
        }

    def _columns(self, read: Callable[[Inversion], Array]) -> dict[str, Array]:
        """A property of every joint's plans by method, each (n, k)."""
        return {
            method: np.column_stack([read(getattr(joint, method)) for joint in self.joints])
            for method in ("closed_form_plain", "closed_form", "optimal")
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
    begun = int(np.argmax(np.abs(after - after[0]) > VISIBLE * fastest))
    full = int(np.argmax(after <= -(1.0 - VISIBLE) * fastest))
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
    direct_angles = simulate_joints(models, walk.desired, cyclic=True)
    lead = best_lead(direct_angles, walk_distance(walk))
    clock.start("foot_optimal", "the optimised requests for the foot")
    foot_plan = invert_foot(models, walk.leg, walk.desired_foot)
    clock.start("foot_bound", "the lower bound for the foot")
    _ = foot_plan.lower_bound
    joints = tuple(
        _plan_joint(j, walk, direct_angles, foot_plan, segments=segments, clock=clock)
        for j in range(len(models))
    )
    clock.stop()
    return PlannedWalk(models, segments, walk, joints, lead, foot_plan)


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


def _plan_joint(
    j: int,
    walk: ReferenceWalk,
    direct_angles: Array,
    foot_plan: FootInversion,
    *,
    segments: int,
    clock: Clock,
) -> JointOutcome:
    """All plans of one joint, and their bounds, which are computed when first asked for."""
    name, desired, model = walk.joint_names[j], walk.desired[:, j], foot_plan.models[j]
    limits = (float(walk.leg.limits.lower[j]), float(walk.leg.limits.upper[j]))
    clock.start("closed_form", f"the closed form for the {name}")
    plain, refined = (
        invert_closed_form(model, desired, segments=segments, rule=RULE, refine=REFINE[method])
        for method in ("closed_form_plain", "closed_form")
    )
    clock.start("optimal", f"the optimised requests for the {name}")
    # A joint that sags cannot rest at a limit of its requests: clip to the angles where it can.
    resting = np.clip(desired, *model.rest(limits))
    optimal = invert_optimal(model, resting, limits=limits)
    clock.start("bounds", f"the lower bound for the {name}")
    _ = plain.lower_bound, refined.lower_bound, optimal.lower_bound
    return JointOutcome(
        name=name,
        desired=desired,
        limits=limits,
        direct=direct_angles[:, j],
        closed_form_plain=plain,
        closed_form=refined,
        optimal=optimal,
        foot_requests=foot_plan.requests[:, j],
        foot_optimal=foot_plan.predicted[:, j],
    )


class Clock:
    """Adds up the wall-clock time [s] of each part, and reports each part when it begins."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        """A stopped clock; ``progress`` is called with the name of each part."""
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._part: str | None = None
        self._since = 0.0

    def start(self, part: str, doing: str) -> None:
        """End the part before, and begin this one."""
        self.stop()
        self._progress(doing)
        self._part, self._since = part, time.perf_counter()

    def stop(self) -> None:
        """End the part that is under way, if any."""
        if self._part is not None:
            spent = time.perf_counter() - self._since
            self.seconds[self._part] = self.seconds.get(self._part, 0.0) + spent
        self._part = None
