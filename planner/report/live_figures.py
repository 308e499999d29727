"""What is live on the page of the paper's experiment: the moving leg, and plots over a step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report import draw_foot, draw_joints
from planner.report.curves import Panel
from planner.report.draw_joints import joint_plot
from planner.report.live_leg import Motion, moving_leg
from planner.report.live_plot import time_plot
from planner.report.style import DESIRED

if TYPE_CHECKING:
    from planner.evaluation.outcome import PlannedWalk, Reproduction
    from planner.trajectory import Array

HIDDEN = ("shift", "optimal")
"""Methods that are hidden at first: their curves run near those of others."""


def live_figures(reproduction: Reproduction) -> Mapping[str, Mapping[str, Any]]:
    """By the name of the picture whose place it takes."""
    distances = draw_foot.distance_panel(reproduction)
    few = draw_foot.distance_panel(reproduction, hidden=HIDDEN)
    return {
        "figure2_joints_direct": joint_plot(reproduction, draw_joints.direct_curves),
        "figure6_approximation": joint_plot(reproduction, draw_joints.approximation_curves),
        "figure7_trajectories": joint_plot(reproduction, draw_joints.trajectory_curves),
        "figure8_foot_paths": walking_leg(reproduction, reproduction.legs),
        "joints_by_method": joint_plot(reproduction, draw_joints.method_curves, few, clock=True),
        "foot_distances": distance_plot(reproduction, distances),
        "optimised_trajectories": joint_plot(reproduction, draw_joints.optimised_curves),
        "foot_optimised_trajectories": joint_plot(reproduction, draw_joints.foot_optimised_curves),
    }


def walking_leg(planned: PlannedWalk, legs: Mapping[str, Array]) -> dict[str, Any]:
    """The leg as it should walk, and as it walks under the methods.

    Args:
        planned: The walk.
        legs: Where joints and foot are under each method [m], each of shape (n, joints + 1, 3).
    """
    wanted = planned.legs["desired"]
    motions = [Motion(DESIRED, wanted)]
    for method, role in draw_foot.ROLES.items():
        distances = np.linalg.norm(legs[method][:, -1] - planned.walk.desired_foot, axis=1)
        motions.append(Motion(role, legs[method], distances, hidden=method in HIDDEN))
    return moving_leg(motions, period=planned.models[0].period, cyclic=True, ground=True)


def distance_plot(planned: PlannedWalk, panel: Panel) -> dict[str, Any]:
    """The foot's distances alone, so high as their picture."""
    alone = panel._replace(title="", height=1.8)
    return time_plot([alone], unit="ms", scale=1000.0 * planned.models[0].period)
