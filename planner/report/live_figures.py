"""What is live on the page of the paper's experiment: the moving leg, and plots over a step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.evaluation.paper import STEP_AMPLITUDES
from planner.report import draw_foot, draw_joints
from planner.report.curves import Curve, Panel
from planner.report.draw_agreement import agreement_plot
from planner.report.draw_joints import joint_plot
from planner.report.live_leg import Motion, moving_leg
from planner.report.live_model import speed_plot, step_plot
from planner.report.live_plane import Axis, around, plane_plot
from planner.report.live_plot import time_plot
from planner.report.style import DESIRED, DIRECT, GRID, Role

if TYPE_CHECKING:
    from planner.evaluation.outcome import PlannedWalk, Reproduction
    from planner.trajectory import Array

HIDDEN = ("shift", "optimal")
"""Methods that are hidden at first: their curves run near those of others."""


TIED = 8
"""Every so many samples, desired and actual positions are joined by a line."""


def live_figures(reproduction: Reproduction) -> Mapping[str, Mapping[str, Any]]:
    """By the name of the picture whose place it takes."""
    distances = draw_foot.distance_panel(reproduction)
    few = draw_foot.distance_panel(reproduction, hidden=HIDDEN)
    return {
        "figure1_foot_direct": direct_foot(reproduction),
        "figure2_joints_direct": joint_plot(reproduction, draw_joints.direct_curves),
        **{
            f"figure{number}_step_{amplitude:g}": step_plot(reproduction, amplitude)
            for number, amplitude in enumerate(STEP_AMPLITUDES, 3)
        },
        "figure5_speed": speed_plot(reproduction),
        "figure6_approximation": joint_plot(reproduction, draw_joints.approximation_curves),
        "figure7_trajectories": joint_plot(reproduction, draw_joints.trajectory_curves),
        "figure8_foot_paths": walking_leg(reproduction, reproduction.legs),
        "joints_by_method": joint_plot(reproduction, draw_joints.method_curves, few, clock=True),
        "foot_distances": distance_plot(reproduction, distances),
        "optimised_trajectories": joint_plot(reproduction, draw_joints.optimised_curves),
        "foot_optimised_trajectories": joint_plot(reproduction, draw_joints.foot_optimised_curves),
        "table2_agreement": agreement_plot(reproduction),
    }


def direct_foot(reproduction: Reproduction) -> dict[str, Any]:
    """Figure 1: the foot's paths from the side, joined at the same instants by thin lines."""
    desired, actual = reproduction.walk.desired_foot, reproduction.foot["direct"].positions
    period, paths = 1000.0 * reproduction.model.period, (desired, actual)
    joined = np.full((3 * len(desired[::TIED]), 3), np.nan)
    joined[0::3], joined[1::3] = desired[::TIED], actual[::TIED]
    ties = GRID._replace(label="the same instants", width=1.2)
    return plane_plot(
        [
            Curve(ties, *draw_foot.seen(joined)),
            path_curve(actual, DIRECT, period),
            path_curve(desired, DESIRED, period),
        ],
        Axis(
            "forward of the hip, x [cm]", "cm", around(*(draw_foot.seen(each)[0] for each in paths))
        ),
        Axis("above the hip, z [cm]", "cm", around(*(draw_foot.seen(each)[1] for each in paths))),
        equal=True,
    )


def path_curve(positions: Array, role: Role, period: float) -> Curve:
    """A closed path of the foot [m] from the side, with the moments at which it is there [ms]."""
    closed = np.vstack([positions, positions[:1]])
    moments = tuple(f"{period * k:g} ms" for k in range(len(closed)))
    return Curve(role, *draw_foot.seen(closed), notes=moments)


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
