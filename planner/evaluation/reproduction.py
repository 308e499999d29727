"""The paper's experiment, end to end: the walk, the baselines, the plans, every distance."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np

from kinematics import Leg, urdf_path
from planner.evaluation.baselines import best_time_shift, direct
from planner.evaluation.metrics import foot_distance, foot_distances
from planner.evaluation.outcome import (
    FootOutcome,
    JointOutcome,
    PlannedWalk,
    Reproduction,
    measure_step_response,
)
from planner.evaluation.paper import JOINTS, SEGMENTS, STEP_AMPLITUDES
from planner.gait.half_ellipse import ReferenceWalk, reference_walk
from planner.model.joint import JointModel
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_foot, invert_optimal
from planner.planning.line_inverse import Rule
from planner.planning.result import FootInversion, Inversion
from planner.trajectory import Array

RULE: Rule = "paper"
"""How the model-based rows of Table 2 invert a line."""

REFINE = {"closed_form_plain": False, "closed_form": True}
"""Whether knots are moved by the error of the simulated joint. The paper's stay where they are."""


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
    """Plan the reference walk by every method, and predict the angles and the foot's path.

    Args:
        models: One model per joint of the leg.
        segments: Lines of each approximation.
        clock: Takes the time of each part.
    """
    models = tuple(models)
    clock.start("walk", "the walk")
    walk = reference_walk()
    clock.start("baselines", "the baselines")
    direct_angles = direct(models, walk.desired)
    shift = best_time_shift(
        walk.desired, direct_angles, lambda each: foot_outcome(walk, each).distance
    )
    clock.start("foot_optimal", "the optimised requests for the foot")
    foot_plan = invert_foot(models, walk.leg, walk.desired_foot)
    clock.start("foot_bound", "the lower bound for the foot")
    _ = foot_plan.lower_bound
    joints = tuple(
        _plan_joint(j, walk, direct_angles, foot_plan, segments=segments, clock=clock)
        for j in range(len(models))
    )
    clock.stop()
    angles = {
        "direct": direct_angles,
        "shift": shift.angles,
        "closed_form_plain": _predicted([joint.closed_form_plain for joint in joints]),
        "closed_form": _predicted([joint.closed_form for joint in joints]),
        "optimal": _predicted([joint.optimal for joint in joints]),
        "foot_optimal": foot_plan.predicted,
    }
    return PlannedWalk(
        models=models,
        segments=segments,
        walk=walk,
        joints=joints,
        knee=_knee_of(walk),
        legs={
            method: walk.leg.joint_positions(each)
            for method, each in {"desired": walk.desired, **angles}.items()
        },
        shift=shift,
        foot_plan=foot_plan,
        foot={method: foot_outcome(walk, each) for method, each in angles.items()},
    )


def foot_outcome(walk: ReferenceWalk, angles: Array) -> FootOutcome:
    """Where the walk's leg has its foot at these angles [rad], and how far off that is."""
    positions = walk.leg.foot_positions(angles)
    return FootOutcome(
        positions=positions,
        distances=foot_distances(positions, walk.desired_foot),
        distance=foot_distance(positions, walk.desired_foot),
    )


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
    resting = np.clip(desired, limits[0] + model.offset, limits[1] + model.offset)
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


def _knee_of(walk: ReferenceWalk) -> Array:
    """Path of the knee: the lower leg begins there, however the knee turns."""
    upper = Leg.from_urdf(urdf_path("reference_leg.urdf"), base=walk.leg.base, foot="lower")
    return upper.foot_positions(walk.desired)


def _predicted(inversions: Sequence[Inversion]) -> Array:
    return np.column_stack([inversion.predicted for inversion in inversions])


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
