"""The paper's experiment, end to end: the walk, the baselines, the plans, every distance."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from kinematics import Leg, urdf_path
from planner.evaluation.baselines import best_time_shift, direct
from planner.evaluation.metrics import foot_distance, foot_distances
from planner.evaluation.outcome import FootOutcome, JointOutcome, Reproduction
from planner.evaluation.paper import SEGMENTS, STEP_AMPLITUDES
from planner.evaluation.step_response import measure_step_response
from planner.gait import ReferenceWalk, reference_walk
from planner.inversion.closed_form import invert_closed_form
from planner.inversion.foot import invert_foot
from planner.inversion.foot_result import FootInversion
from planner.inversion.line import Rule
from planner.inversion.optimal import invert_optimal
from planner.inversion.result import Inversion
from planner.model.joint import JointModel
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
        progress: Told what is being computed.
    """
    model = JointModel.ers210a() if model is None else model
    clock = _Clock(progress)
    clock.start("walk", "the walk")
    walk = reference_walk()
    models = (model,) * walk.desired.shape[1]
    clock.start("baselines", "the baselines")
    direct_angles = direct(models, walk.desired)
    shift = best_time_shift(models, walk.desired, lambda angles: _foot(walk, angles).distance)
    clock.start("foot_optimal", "the optimised requests for the foot")
    foot_plan = invert_foot(models, walk.leg, walk.desired_foot)
    joints = tuple(
        _plan_joint(j, walk, direct_angles, foot_plan, segments=segments, clock=clock)
        for j in range(len(models))
    )
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
        joints=joints,
        knee=_knee_of(walk),
        shift=shift,
        foot_plan=foot_plan,
        foot={
            "direct": _foot(walk, direct_angles),
            "shift": _foot(walk, shift.angles),
            "closed_form_plain": _foot(
                walk, _predicted([each.closed_form_plain for each in joints])
            ),
            "closed_form": _foot(walk, _predicted([joint.closed_form for joint in joints])),
            "optimal": _foot(walk, _predicted([joint.optimal for joint in joints])),
            "foot_optimal": _foot(walk, foot_plan.predicted),
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


def _plan_joint(
    j: int,
    walk: ReferenceWalk,
    direct_angles: Array,
    foot_plan: FootInversion,
    *,
    segments: int,
    clock: _Clock,
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
    optimal = invert_optimal(model, desired, limits=limits)
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


def _foot(walk: ReferenceWalk, angles: Array) -> FootOutcome:
    positions = walk.leg.foot_positions(angles)
    return FootOutcome(
        positions=positions,
        distances=foot_distances(positions, walk.desired_foot),
        distance=foot_distance(positions, walk.desired_foot),
    )


def _knee_of(walk: ReferenceWalk) -> Array:
    """Path of the knee: the lower leg begins there, however the knee turns."""
    upper = Leg.from_urdf(urdf_path("reference_leg.urdf"), base=walk.leg.base, foot="lower")
    return upper.foot_positions(walk.desired)


def _predicted(inversions: Sequence[Inversion]) -> Array:
    return np.column_stack([inversion.predicted for inversion in inversions])
