"""The paper's experiment, end to end: the walk, the baselines, both inversions, every distance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from kinematics import Leg, urdf_path
from planner.evaluation.baselines import TimeShift, best_time_shift, direct
from planner.evaluation.metrics import Distance, angle_distance, foot_distance, foot_distances
from planner.evaluation.paper import SEGMENTS, STEP_AMPLITUDES, deviations
from planner.evaluation.step_response import StepResponse, measure_step_response
from planner.gait import ReferenceWalk, reference_walk
from planner.inversion.closed_form import invert_closed_form
from planner.inversion.line import Rule
from planner.inversion.optimal import invert_optimal
from planner.inversion.result import Inversion
from planner.model.joint import JointModel
from planner.trajectory import Array

RULE: Rule = "paper"
"""How the model-based row of Table 2 inverts a line."""


@dataclass(frozen=True, eq=False)
class JointOutcome:
    """One joint of the experiment.

    Attributes:
        name: The joint.
        desired: Desired angles [rad], shape (n,): the paper's Des.
        direct: Angles when these are requested [rad], shape (n,): Dir.
        approximation: Piecewise linear approximation at the samples [rad], shape (n,): Pwl.
        closed_form: The paper's inversion; its predicted angles are MB.
        optimal: The optimised inversion, within the joint's limits.
    """

    name: str
    desired: Array
    direct: Array
    approximation: Array
    closed_form: Inversion
    optimal: Inversion

    @property
    def distances(self) -> dict[str, Distance]:
        """The rows of Table 2 [rad], and one more for the optimised inversion."""
        return {
            "Des,Dir": angle_distance(self.direct, self.desired),
            "Des,MB": angle_distance(self.closed_form.predicted, self.desired),
            "Pwl,MB": angle_distance(self.closed_form.predicted, self.approximation),
            "Des,Opt": angle_distance(self.optimal.predicted, self.desired),
        }


@dataclass(frozen=True, eq=False)
class FootOutcome:
    """The foot under one method.

    Attributes:
        positions: Its path [m], shape (n, 3).
        distances: Its distance from the desired path at each sample [m], shape (n,).
        distance: The same over all samples [m].
    """

    positions: Array
    distances: Array
    distance: Distance


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that the experiment gave.

    Attributes:
        model: The model of every joint.
        segments: Lines of each approximation.
        walk: The reference walk with its leg.
        joints: One outcome per joint, in the leg's order.
        knee: Where the leg's knee is at the desired angles [m], shape (n, 3).
        shift: The best time shift.
        foot: The foot under ``direct``, ``shift``, ``closed_form`` and ``optimal``.
        steps: The step tests, by amplitude [degrees].
        seconds: Time that each part took [s].
    """

    model: JointModel
    segments: int
    walk: ReferenceWalk
    joints: tuple[JointOutcome, ...]
    knee: Array
    shift: TimeShift
    foot: Mapping[str, FootOutcome]
    steps: Mapping[float, StepResponse]
    seconds: Mapping[str, float]

    @property
    def table2(self) -> dict[str, dict[str, Distance]]:
        """Distances between angle trajectories by joint and comparison [degrees]: Table 2."""
        return {
            joint.name: {
                comparison: distance.in_units_of(math.radians(1.0))
                for comparison, distance in joint.distances.items()
            }
            for joint in self.joints
        }

    @property
    def foot_table(self) -> dict[str, Distance]:
        """Distances of the foot from its desired path by method [cm]."""
        return {method: outcome.distance.in_units_of(0.01) for method, outcome in self.foot.items()}

    @property
    def baseline_deviation(self) -> float:
        """Mean relative deviation of the ten baseline figures from the paper's."""
        return float(np.mean(deviations(self.table2, self.foot_table)))


def reproduce(
    model: JointModel | None = None,
    *,
    segments: int = SEGMENTS,
    progress: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Run the paper's experiment on its own model.

    Args:
        model: The model of every joint; Table 1 where not given.
        segments: Lines of each approximation.
        progress: Told what is being computed.
    """
    model = JointModel.ers210a() if model is None else model
    clock = _Clock(progress)
    clock.start("walk", "the walk")
    walk = reference_walk()
    models = (model,) * walk.desired.shape[1]

    def foot(angles: Array) -> FootOutcome:
        positions = walk.leg.foot_positions(angles)
        return FootOutcome(
            positions,
            foot_distances(positions, walk.desired_foot),
            foot_distance(positions, walk.desired_foot),
        )

    clock.start("baselines", "the baselines")
    direct_angles = direct(models, walk.desired)
    shift = best_time_shift(models, walk.desired, lambda angles: foot(angles).distance)
    closed_form, optimal = [], []
    for j, name in enumerate(walk.joint_names):
        wanted = walk.desired[:, j]
        clock.start("closed_form", f"the closed form for the {name}")
        closed_form.append(invert_closed_form(model, wanted, segments=segments, rule=RULE))
        clock.start("optimal", f"the optimised requests for the {name}")
        limits = (float(walk.leg.limits.lower[j]), float(walk.leg.limits.upper[j]))
        optimal.append(invert_optimal(model, wanted, limits=limits))
        clock.start("bounds", f"the lower bound for the {name}")
        _ = closed_form[j].lower_bound, optimal[j].lower_bound
    clock.start("step_tests", "the step tests")
    steps = {
        amplitude: measure_step_response(model, float(np.radians(amplitude)))
        for amplitude in STEP_AMPLITUDES
    }
    clock.stop()
    return Reproduction(
        model=model,
        segments=segments,
        walk=walk,
        joints=tuple(
            JointOutcome(
                name=name,
                desired=walk.desired[:, j],
                direct=direct_angles[:, j],
                approximation=_angles_of(closed_form[j]),
                closed_form=closed_form[j],
                optimal=optimal[j],
            )
            for j, name in enumerate(walk.joint_names)
        ),
        knee=_knee_of(walk),
        shift=shift,
        foot={
            "direct": foot(direct_angles),
            "shift": foot(shift.angles),
            "closed_form": foot(_predicted(closed_form)),
            "optimal": foot(_predicted(optimal)),
        },
        steps=steps,
        seconds=clock.seconds,
    )


class _Clock:
    """Adds up the time that each part takes, and tells what is being done."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._part: str | None = None
        self._since = 0.0

    def start(self, part: str, doing: str) -> None:
        self.stop()
        self._progress(doing)
        self._part, self._since = part, time.perf_counter()

    def stop(self) -> None:
        if self._part is not None:
            spent = time.perf_counter() - self._since
            self.seconds[self._part] = self.seconds.get(self._part, 0.0) + spent
        self._part = None


def _knee_of(walk: ReferenceWalk) -> Array:
    """Path of the knee: the lower leg begins there, however the knee turns."""
    upper = Leg.from_urdf(urdf_path("reference_leg.urdf"), base=walk.leg.base, foot="lower")
    return upper.foot_positions(walk.desired)


def _predicted(inversions: list[Inversion]) -> Array:
    return np.column_stack([inversion.predicted for inversion in inversions])


def _angles_of(inversion: Inversion) -> Array:
    assert inversion.approximation is not None, "a closed form has one"
    return inversion.approximation.angles
