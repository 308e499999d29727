"""The trajectories of the experiment, under the names of their files."""

from __future__ import annotations

import numpy as np

from planner.evaluation.outcome import Reproduction, approximation
from planner.trajectory import Array


def joint_paths(reproduction: Reproduction) -> dict[str, Array]:
    """Angles and requests of all joints [rad], each (n, k), by the name of their file."""
    joints = reproduction.joints

    def columns(arrays: list[Array]) -> Array:
        return np.column_stack(arrays)

    return {
        "desired": reproduction.walk.desired,
        "approximation_plain": columns([approximation(each.closed_form_plain) for each in joints]),
        "approximation": columns([approximation(joint.closed_form) for joint in joints]),
        "requests_shift": reproduction.shift.requests,
        "requests_closed_form_plain": columns([each.closed_form_plain.requests for each in joints]),
        "requests_closed_form": columns([joint.closed_form.requests for joint in joints]),
        "requests_optimal": columns([joint.optimal.requests for joint in joints]),
        "requests_foot_optimal": reproduction.foot_plan.requests,
        "angles_direct": columns([joint.direct for joint in joints]),
        "angles_shift": reproduction.shift.angles,
        "angles_closed_form_plain": columns([each.closed_form_plain.predicted for each in joints]),
        "angles_closed_form": columns([joint.closed_form.predicted for joint in joints]),
        "angles_optimal": columns([joint.optimal.predicted for joint in joints]),
        "angles_foot_optimal": reproduction.foot_plan.predicted,
    }
