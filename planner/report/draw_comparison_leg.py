"""A picture of a leg under the plans of a comparison, seen from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.report.comparison_live import FOOT_ROLES
from planner.report.draw_foot import draw_path, legend
from planner.report.plan_draw import draw_sketch
from planner.report.style import DESIRED, WIDTH, applied

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kinematics.leg import Leg
    from planner.evaluation.cross_check import CrossCheck

SEEN = [0, 2]
"""Across and up."""


def draw_foot_paths(check: CrossCheck, leg: Leg) -> Figure:
    """The path of the foot, desired and under each plan, with the leg where the path begins."""
    from matplotlib.figure import Figure

    assert check.foot is not None, "only a leg has a foot"
    with applied():
        figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
        axes = figure.add_subplot()
        first = np.array([[joint.desired[0] for joint in check.joints]])
        draw_sketch(axes, 100.0 * leg.joint_positions(first)[0][:, SEEN], first=True)
        draw_path(axes, check.foot.desired, DESIRED, zorder=6, closed=check.cyclic)
        for method, role in FOOT_ROLES.items():
            positions = check.foot.plans[method].outcome.positions
            draw_path(axes, positions, role, closed=check.cyclic)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.07)
        axes.set_xlabel(f"x in the frame {leg.base} [cm]")
        axes.set_ylabel("z [cm]")
        legend(axes, 2)
    return figure
