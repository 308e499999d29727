"""The report of a comparison as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from planner._version import __version__
from planner.evaluation.differences import REASONS
from planner.report import comparison_live as live
from planner.report.comparison_rows import (
    REASON_WORDS,
    differences_table,
    foot_table,
    plans_table,
    tolerance_reasons,
    worst_checks,
)
from planner.report.comparison_tints import TINTS
from planner.report.comparison_words import key_figures, remarks, shares, verdict
from planner.report.draw_comparison import draw_foot, draw_joint
from planner.report.draw_comparison_leg import draw_foot_paths
from planner.report.figures import Picture
from planner.report.linked_files import LinkedFile
from planner.report.live_page import live_head, live_scripts
from planner.report.live_words import variable
from planner.report.page import PARAMETERS, drawn, environment
from planner.report.results import versions
from planner.report.style import ROLES

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.evaluation.cross_check import CrossCheck

LIBRARIES = (
    "request-planner",
    "python",
    "numpy",
    "scipy",
    "casadi",
    "osqp",
    "pin",
    "matplotlib",
    "plotly",
)
"""Whose versions stand at the end of the page."""


def comparison_page(
    check: CrossCheck,
    *,
    title: str = "",
    leg: Leg | None = None,
    origins: Sequence[tuple[str, str]] = (),
    files: Sequence[LinkedFile] = (),
    unreachable: int = 0,
    notes: Sequence[str] = (),
) -> str:
    """The whole page: the verdict and the key figures first, where it comes from last.

    Args:
        check: The comparison.
        title: What was planned for; the joints' names by default.
        leg: The leg whose joints these are, in its order, if it is to be seen moving.
        origins: What the plans were made from: pairs of what it is and which.
        files: Files of the run to link to.
        unreachable: How many samples were out of the leg's reach.
        notes: What else should be known first.
    """
    head, tail = verdict(check)
    foot, joints = _foot_pictures(check, leg), _joint_pictures(check)
    figures = {each.name: each.live for each in chain(foot, joints) if each.live is not None}
    found, reasons = versions(), shares(check)
    return (
        environment()
        .get_template("comparison.html")
        .render(
            check=check,
            title=title or ", ".join(joint.name for joint in check.joints),
            head=head,
            tail=tail,
            figures=key_figures(check),
            remarks=[*remarks(check, unreachable=unreachable), *notes],
            plans=plans_table(check.joints),
            foot_table=None if check.foot is None else foot_table(check.foot),
            differences=differences_table(check.joints),
            reasons=[_reason(reason, share) for reason, share in reasons.items()],
            checks=worst_checks(check.checks),
            tolerances=tolerance_reasons(check.checks),
            foot_pictures=foot,
            joint_pictures=joints,
            live_head=live_head(),
            live_scripts=live_scripts(figures),
            drawn=drawn,
            words=PARAMETERS,
            origins=origins,
            files=files,
            roles=ROLES,
            made_by=f"request-planner {__version__} compare",
            versions={name: found[name] for name in LIBRARIES},
        )
    )


def _reason(reason: Any, share: float) -> dict[str, Any]:
    """A reason as the key to the shades tells it."""
    tint = TINTS[reason]
    return {
        "name": REASON_WORDS[reason],
        "about": REASONS[reason],
        "share": share,
        "colour": variable(tint.role),
        "opacity": tint.opacity,
    }


def _foot_pictures(check: CrossCheck, leg: Leg | None) -> list[Picture]:
    """The foot's distances; with a leg, first of all the leg in their place."""
    if check.foot is None:
        return []
    distances = Picture(
        "foot_distances",
        "The foot’s error over time",
        "Distance of the foot from where it should be at the same moment.",
        "Three curves over time: the distance under the closed form, under requests optimised "
        "joint by joint, and under requests optimised for the foot, on average the lowest.",
        draw_foot(check),
        live.live_foot(check),
    )
    if leg is None:
        return [distances]
    moving = Picture(
        "leg",
        "The leg under the plans",
        "Move the slider and the leg follows, drag it and it turns; the numbers are distances of "
        "the foot from its path. On paper: the paths of the foot from the side.",
        "Paths of the foot seen from the side: desired, closed form, optimised joint by joint, and "
        "optimised for the foot, which lies closest to the desired one.",
        draw_foot_paths(check, leg),
        live.live_leg(check, leg),
    )
    return [moving, distances]


def _joint_pictures(check: CrossCheck) -> list[Picture]:
    return [
        Picture(
            f"joint_{j}",
            joint.name,
            "Above: what the joint should do, and does under either plan. In the middle: what is "
            "requested of it. Below: how far the requests differ; the shades say why.",
            f"Angles and requests of the joint {joint.name} over time under both plans, and the "
            "difference of their requests over shades that say why they differ.",
            draw_joint(check, joint),
            live.live_joint(check, joint),
        )
        for j, joint in enumerate(check.joints)
    ]
