"""What the virtual robot's joints and foot did, every cycle of it, as curves over samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.evaluation.outcome import approximation
from planner.model.response import simulate
from planner.report.curves import Curve, Panel, cycle, cycles
from planner.report.draw_foot import ROLES
from planner.report.draw_joints import JointCurves
from planner.report.style import (
    APPROXIMATION,
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    INK,
    OPTIMAL,
    PLAIN,
    REQUESTED,
    Role,
)

if TYPE_CHECKING:
    from planner.evaluation.outcome import JointOutcome
    from planner.evaluation.virtual_outcome import VirtualOutcome
    from planner.trajectory import Array

THIN = 0.7
"""Width of a line that is one of many cycles [pt]."""

PREDICTED = Role("predicted", INK.light, INK.dark, width=1.1, dashes=(0, (1, 1.6)))


def unseen_curves(outcome: VirtualOutcome) -> JointCurves:
    """Figure 2: the joints under the direct method, and what the models had said of it."""
    run = outcome.runs["direct"]

    def curves(joint: JointOutcome) -> list[Curve]:
        j = _index(outcome, joint)
        predicted = simulate(outcome.planned.models[j], run.requests[:, j])
        return [
            cycle(joint.desired, DESIRED, "requested = desired"),
            _walked(outcome, "direct", joint, DIRECT, f"actual, {len(run.angles)} cycles"),
            cycle(predicted, PREDICTED),
        ]

    return curves


def tracking_curves(outcome: VirtualOutcome) -> JointCurves:
    """Figure 7: desired, approximation, requests, and the angles of every cycle."""

    def curves(joint: JointOutcome) -> list[Curve]:
        return [
            cycle(joint.closed_form_plain.requests, REQUESTED),
            cycle(joint.desired, DESIRED),
            cycle(approximation(joint.closed_form_plain), APPROXIMATION),
            _walked(outcome, "closed_form_plain", joint, PLAIN, "actual"),
        ]

    return curves


def foot_tracking_curves(outcome: VirtualOutcome) -> JointCurves:
    """The joints under the requests that were planned for the foot, every cycle."""
    requests = outcome.runs["foot_optimal"].requests

    def curves(joint: JointOutcome) -> list[Curve]:
        return [
            cycle(requests[:, _index(outcome, joint)], REQUESTED),
            cycle(joint.desired, DESIRED),
            _walked(outcome, "foot_optimal", joint, FOOT_OPTIMAL, "actual"),
            cycle(joint.foot_optimal, PREDICTED),
        ]

    return curves


def method_curves(outcome: VirtualOutcome) -> JointCurves:
    """Every cycle of the joints under the methods that the foot is drawn under."""

    def curves(joint: JointOutcome) -> list[Curve]:
        return [
            _walked(outcome, "direct", joint, DIRECT),
            _walked(outcome, "closed_form_plain", joint, PLAIN),
            _walked(outcome, "optimal", joint, OPTIMAL)._replace(hidden=True),
            _walked(outcome, "foot_optimal", joint, FOOT_OPTIMAL),
            cycle(joint.desired, DESIRED),
        ]

    return curves


def distance_panel(outcome: VirtualOutcome, *, hidden: Sequence[str] = ()) -> Panel:
    """The foot's distances in every cycle, those of some methods hidden at first."""
    wanted = outcome.planned.walk.desired_foot
    curves = []
    for method, role in ROLES.items():
        distances = np.linalg.norm(outcome.foot_paths[method] - wanted, axis=2)
        curve = cycles(100.0 * distances, role._replace(width=THIN))
        curves.append(curve._replace(hidden=method in hidden))
    return Panel("foot, from its desired path", "distance", "cm", tuple(curves), floor=True)


def _walked(
    outcome: VirtualOutcome, method: str, joint: JointOutcome, role: Role, label: str = ""
) -> Curve:
    """A joint's angles in every cycle under a method."""
    angles: Array = outcome.runs[method].angles[:, :, _index(outcome, joint)]
    return cycles(np.degrees(angles), role._replace(width=THIN), label)


def _index(outcome: VirtualOutcome, joint: JointOutcome) -> int:
    return outcome.planned.walk.joint_names.index(joint.name)
