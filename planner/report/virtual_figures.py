"""All pictures of the experiment on the virtual robot, with what they show in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from planner.report import virtual_draw as draw
from planner.report import virtual_joints as joints
from planner.report.draw_foot import ROLES
from planner.report.draw_joints import joint_plot, joint_rows
from planner.report.figures import Picture
from planner.report.live_figures import HIDDEN, distance_plot, walking_leg
from planner.report.style import applied
from planner.report.virtual_live import promises_plot, steps_plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.virtual_outcome import VirtualOutcome


def virtual_pictures(outcome: VirtualOutcome) -> tuple[Picture, ...]:
    """Draw every picture, in the order of the paper's figures."""
    live = _live_figures(outcome)
    with applied():
        return tuple(
            Picture(name, title, caption, description, drawn(outcome), live.get(name))
            for name, title, caption, description, drawn in _PICTURES
        )


def _live_figures(outcome: VirtualOutcome) -> Mapping[str, Mapping[str, Any]]:
    """What is live on the page, by the name of the picture whose place it takes."""
    planned, few = outcome.planned, joints.distance_panel(outcome, hidden=HIDDEN)
    legs = {method: outcome.legs[method][0] for method in ROLES}
    return {
        "foot_paths": walking_leg(planned, legs),
        "step_tests": steps_plot(outcome),
        "promises": promises_plot(outcome),
        "joints_direct": joint_plot(planned, joints.unseen_curves(outcome)),
        "trajectories": joint_plot(planned, joints.tracking_curves(outcome)),
        "foot_optimised_trajectories": joint_plot(planned, joints.foot_tracking_curves(outcome)),
        "joints_by_method": joint_plot(planned, joints.method_curves(outcome), few, clock=True),
        "foot_distances": distance_plot(planned, joints.distance_panel(outcome)),
    }


_Entry = tuple[str, str, str, str, "Callable[[VirtualOutcome], Figure]"]

_PICTURES: tuple[_Entry, ...] = (
    (
        "foot_paths",
        "The foot, every cycle (the paper's Figure 8)",
        "What the robot's foot does in each recorded cycle under three methods; the cycles nearly "
        "cover one another. On a screen the leg walks the first of them.",
        "Side view of the leg and four closed foot paths; that of the foot-optimised requests lies "
        "closest to the desired one, then the closed form's, then the direct method's.",
        draw.draw_paths,
    ),
    (
        "step_tests",
        "The step tests (Figures 3 and 4)",
        "Dots: what each joint's sensor recorded in the last cycle of each test, around the "
        "middle of the joint's range in the walk. Lines: the one model that was identified from "
        "all of them. Beside or below, what it leaves unexplained.",
        "For each joint three square-wave responses of growing height as rings, with the lines of "
        "the model's predictions running through them, and beside them the small differences.",
        draw.draw_steps,
    ),
    (
        "joints_direct",
        "The direct method (Figure 2), predicted before it was seen",
        "The models come from step tests alone; this walk is new to them. Dotted: what they "
        "predict.",
        "Angles of rotator, abductor and knee over one cycle: desired, actual some ten samples "
        "later, and the prediction, a dotted line that lies on the actual angles.",
        lambda outcome: joint_rows(outcome.planned, joints.unseen_curves(outcome), columns=3),
    ),
    (
        "trajectories",
        "The four trajectories of the paper's method (Figure 7)",
        "How close the actual angles stay to the approximation is the paper's measure of the "
        "model's fidelity. Requests beyond a joint's limits are cut off by the robot.",
        "For each joint the desired angles, the approximation, the requests and the actual angles "
        "of all cycles, which stay near the approximation.",
        lambda outcome: joint_rows(outcome.planned, joints.tracking_curves(outcome), columns=4),
    ),
    (
        "foot_optimised_trajectories",
        "The joints under requests for the foot",
        "Dotted: what the plan predicted. Single joints leave their desired angles for the foot's "
        "sake, as planned.",
        "For each joint the requests, the desired angles, the actual angles of all cycles and the "
        "predicted ones beneath them.",
        lambda outcome: joint_rows(
            outcome.planned, joints.foot_tracking_curves(outcome), columns=4
        ),
    ),
    (
        "joints_by_method",
        "The joints under the methods, every cycle",
        "What the joints do while the foot goes along its paths.",
        "For each joint the desired angles and those of every cycle under the direct method, which "
        "lag, the closed form, and requests optimised for the foot, which lie close to them.",
        lambda outcome: joint_rows(outcome.planned, joints.method_curves(outcome), columns=2),
    ),
    (
        "foot_distances",
        "The foot's error over time, every cycle",
        "Distance of the foot from where it should be at each instant. Where the swing is faster "
        "than the joints can be, no method follows it.",
        "Five bundles of curves over one cycle: the distances under the direct method and the time "
        "shift are the largest, those of requests optimised for the foot the lowest, through most "
        "of it.",
        draw.draw_distances,
    ),
    (
        "promises",
        "Planned and executed",
        "From what each plan promised to what the robot made of it: the shorter the line, the "
        "better the model.",
        "A row per method with a ring where the plan predicted the foot's error, a dot where it "
        "was on the robot, and a cross for the paper's robot where it has one.",
        draw.draw_promises,
    ),
)
