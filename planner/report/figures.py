"""All pictures of the report, with what they show in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from planner.evaluation.paper import STEP_AMPLITUDES
from planner.report import draw_agreement, draw_foot, draw_joints, draw_model
from planner.report.live_figures import live_figures
from planner.report.style import applied

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import Reproduction


@dataclass(frozen=True)
class Picture:
    """A picture of the report.

    Attributes:
        name: Name of its files, without the ending.
        title: What it is about, in a few words.
        caption: What to see in it.
        description: What it shows, for those who cannot see it.
        figure: The picture.
        live: What takes its place in a page on a screen, or None.
    """

    name: str
    title: str
    caption: str
    description: str
    figure: Figure
    live: Mapping[str, Any] | None = None


def pictures(reproduction: Reproduction) -> tuple[Picture, ...]:
    """Draw every picture, in the order of the paper's figures."""
    live = live_figures(reproduction)
    with applied():
        return tuple(
            Picture(name, title, caption, description, draw(reproduction), live.get(name))
            for name, title, caption, description, draw in (*_IN_THE_PAPER, *_BEYOND)
        )


_Entry = tuple[str, str, str, str, "Callable[[Reproduction], Figure]"]

_IN_THE_PAPER: tuple[_Entry, ...] = (
    (
        "figure1_foot_direct",
        "Figure 1: the foot, desired and actual",
        "Request the desired angles as they are, and the foot lags: it cuts the swing short. Grey "
        "lines join the two paths at the same instants.",
        "Side view of two closed foot paths: the desired half ellipse, flat on the ground, and the "
        "smaller, tilted path under the direct method.",
        draw_foot.draw_direct_foot,
    ),
    (
        "figure2_joints_direct",
        "Figure 2: the joints under the direct method",
        "Every joint starts late and then moves at its top speed at most. The paper shows the "
        "rotator.",
        "Angles of rotator, abductor and knee over one cycle; the actual angles follow the "
        "requested ones some ten samples later and with cut peaks.",
        partial(draw_joints.joint_rows, curves=draw_joints.direct_curves, columns=2),
    ),
    *(
        (
            f"figure{number}_step_{amplitude:g}",
            f"Figure {number}: step test, {amplitude:g} degrees",
            caption,
            f"Requests step between 0 and {amplitude:g} degrees; the angle waits for the lag, "
            "takes the acceleration time to reach its top speed, and moves along a straight line.",
            partial(draw_model.draw_step, amplitude=amplitude),
        )
        for number, amplitude, caption in (
            (3, STEP_AMPLITUDES[0], "From rest to top speed: lag, acceleration time, plateau."),
            (
                4,
                STEP_AMPLITUDES[1],
                "From top speed to top speed the other way: twice the change of speed in the same "
                "acceleration time, where a limit on the acceleration would take twice as long.",
            ),
        )
    ),
    (
        "figure5_speed",
        "Figure 5: the function f",
        "The speed that an error calls for: proportional up to θ₀, top speed beyond.",
        "A line through the origin that turns level at plus and minus theta 0, at the speeds plus "
        "and minus v max.",
        draw_model.draw_speed,
    ),
    (
        "figure6_approximation",
        "Figure 6: piecewise linear approximations",
        "Six lines per joint, none steeper than the top speed, with knots chosen automatically; in "
        "the paper they were drawn by hand. Where the desired angles are faster than the joint, "
        "the lines must leave them.",
        "For each joint the desired angles and six straight lines that follow them, joined at "
        "marked knots.",
        partial(draw_joints.joint_rows, curves=draw_joints.approximation_curves, columns=3),
    ),
    (
        "figure7_trajectories",
        "Figure 7: the four trajectories of the paper's method",
        "The requests run ahead of the approximation, the joint stays approximately on it. They "
        "know no limits: where the joint has some, a robot would clip them.",
        "For each joint four curves: desired, approximation, requests, which lead the others and "
        "overshoot them, and actual angles close to the approximation.",
        partial(draw_joints.joint_rows, curves=draw_joints.trajectory_curves, columns=4),
    ),
    (
        "figure8_foot_paths",
        "Figure 8: the foot under the methods",
        "The desired path, what the direct method makes of it, the closed form as in the paper, "
        "and requests optimised for the foot; on paper with the leg in the middle of its time on "
        "the ground. The best time shift runs along the direct method's path, only earlier; "
        "requests optimised joint by joint run nearly along the closed form's.",
        "Side view of the leg and four closed foot paths; that of the closed form comes closer to "
        "the desired one than the direct method's, and that of requests optimised for the foot "
        "comes closest.",
        draw_foot.draw_foot_paths,
    ),
)

_BEYOND: tuple[_Entry, ...] = (
    (
        "joints_by_method",
        "The joints under the methods",
        "What the joints do while the foot goes as in Figure 8.",
        "For each joint the desired angles and those under the direct method, which lag, under the "
        "closed form and under requests optimised for the foot, which lie close to the desired.",
        partial(draw_joints.joint_rows, curves=draw_joints.method_curves, columns=2),
    ),
    (
        "foot_distances",
        "The foot's error over time",
        "Distance of the foot from where it should be at each instant. Where the swing is faster "
        "than the joints can be, no method follows it.",
        "Five curves over one cycle: the distances under the direct method and the time shift are "
        "larger through most of it than those of the closed form and of requests optimised joint "
        "by joint; those of requests optimised for the foot are the lowest through most of it.",
        draw_foot.draw_foot_distances,
    ),
    (
        "optimised_trajectories",
        "Beyond the paper: optimised requests",
        "Found on the full nonlinear model, inside the joint's limits, and within a fraction of a "
        "percent of what no requests whatever can beat.",
        "For each joint the desired angles, the optimised requests and the resulting angles.",
        partial(draw_joints.joint_rows, curves=draw_joints.optimised_curves, columns=3),
    ),
    (
        "foot_optimised_trajectories",
        "Beyond the paper: requests for the foot",
        "All joints are planned at once for the foot's sake: single joints stray further from "
        "their desired angles, and make up for one another.",
        "For each joint the desired angles, the requests of the plan for the foot and the "
        "resulting angles, which leave the desired ones near the top of the swing.",
        partial(draw_joints.joint_rows, curves=draw_joints.foot_optimised_curves, columns=3),
    ),
    (
        "table2_agreement",
        "Table 2 at a glance",
        "Each row is a joint: the paper's robot and the paper's model. The closed form is that of "
        "the paper, with knots chosen automatically.",
        "Eighteen pairs of dots, one for each figure of Table 2, the paper's and ours, joined by "
        "lines; most pairs lie close together.",
        draw_agreement.draw_agreement,
    ),
)
