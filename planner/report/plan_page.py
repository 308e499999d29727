"""The report of a plan for any leg, or any joints, as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from planner._version import __version__
from planner.report.figures import Picture
from planner.report.linked_files import LinkedFile
from planner.report.live_page import live_head, live_scripts
from planner.report.page import PARAMETERS, drawn, environment
from planner.report.plan_draw import draw_distances, draw_joint, draw_view
from planner.report.plan_live import live_distances, live_joint, live_leg, live_view
from planner.report.plan_words import joint_rows, remarks, size, verdict
from planner.report.results import versions
from planner.report.style import CLOSED_FORM, FOOT_OPTIMAL, OPTIMAL, ROLES, applied

if TYPE_CHECKING:
    from planner.evaluation.plan_outcome import PlanOutcome

METHODS = {"closed-form": CLOSED_FORM, "optimal": OPTIMAL, "foot-optimal": FOOT_OPTIMAL}
"""How the plan of each method is drawn everywhere."""

LIBRARIES = ("request-planner", "python", "numpy", "casadi", "pin", "matplotlib", "plotly")
"""Whose versions stand at the end of the page."""


CAPTIONS = {
    "side": "Move the slider and the leg follows, drag it and it turns. On paper it stands at the "
    "beginning of the planned motion; thin lines are later moments.",
    "front": "The same paths from the front.",
}
"""Under the views of the foot."""


def plan_page(
    outcome: PlanOutcome,
    *,
    title: str,
    method: str,
    origins: Sequence[tuple[str, str]] = (),
    files: Sequence[LinkedFile] = (),
    unreachable: int = 0,
    missed: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """The whole page: what holds and what does not first, where it comes from last.

    Args:
        outcome: The plan.
        title: What was planned for.
        method: How, as the command line calls it.
        origins: What the plan was made from: pairs of what it is and which.
        files: Files of the run to link to.
        unreachable: How many positions are out of the leg's reach.
        missed: Tolerances that the plan misses, in words.
        notes: What else should be known first.
    """
    head, tail = verdict(outcome)
    found = versions()
    shown = pictures(outcome, method)
    live = {each.name: each.live for each in chain(*shown.values()) if each.live is not None}
    said = [*remarks(outcome, unreachable=unreachable, missed=missed), *notes]
    return (
        environment()
        .get_template("plan.html")
        .render(
            title=title,
            method=method,
            outcome=outcome,
            head=head,
            tail=tail,
            holds=not (missed or outcome.jumps),
            remarks=said,
            feet={name: size(each, 100.0) for name, each in outcome.distances.items()},
            joints=joint_rows(outcome),
            requests_deg=np.degrees(outcome.requests).tolist(),
            pictures=shown,
            live_head=live_head(),
            live_scripts=live_scripts(live),
            drawn=drawn,
            words=PARAMETERS,
            origins=origins,
            files=files,
            roles=ROLES,
            made_by=f"request-planner {__version__} plan",
            versions={name: found[name] for name in LIBRARIES if name in found},
        )
    )


def pictures(outcome: PlanOutcome, method: str) -> dict[str, list[Picture]]:
    """The pictures: of the foot, if there is one, and of the joints."""
    role = METHODS[method]
    foot = []
    with applied():
        if outcome.feet:
            foot = [
                Picture(
                    f"foot_{view}",
                    f"The foot from the {view}",
                    CAPTIONS[view],
                    f"Paths of the foot seen from the {view}: desired, direct and planned.",
                    draw_view(outcome, role, view),
                    live_leg(outcome, role) if view == "side" else live_view(outcome, role, view),
                )
                for view in ("side", "front")
            ]
            foot.append(
                Picture(
                    "foot_distances",
                    "The foot's error over time",
                    "Distance of the foot from where it should be at the same moment.",
                    "Two curves over time: the distance without a plan and with it.",
                    draw_distances(outcome, role),
                    live_distances(outcome, role),
                )
            )
        joints = [
            Picture(
                f"joint_{j}",
                name,
                "Above: what the joint should do, does without a plan, and does with it. Below: "
                "what is requested of it; limits are drawn where they are near.",
                f"Angles and requests of the joint {name} over time.",
                draw_joint(outcome, role, j),
                live_joint(outcome, role, j),
            )
            for j, name in enumerate(outcome.names)
        ]
    return {"foot": foot, "joints": joints}
