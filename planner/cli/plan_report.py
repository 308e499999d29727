"""The page about a plan, from the choices that it was made with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.cli import legs
from planner.cli.models import FROM_URDF

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.limits import Limits
    from planner.cli.planning import Plan
    from planner.cli.wanted import Wanted

STANDING_IN = (
    "The models stand in for servos of which the URDF tells no more than the top speed. Identify "
    "the joints before these requests are sent."
)

TOLD = ("model", "unreachable", "norm", "solver", "weights", "segments", "rule", "lock", "near")
"""Choices that are told where they were made."""


def plan_report(
    path: str,
    choices: Mapping[str, Any],
    wanted: Wanted,
    made: Plan,
    *,
    limits: Limits,
    missed: Sequence[str],
    page: Path | str,
    written: Sequence[tuple[str, Path | str | None]] = (),
) -> str:
    """The page, as HTML.

    Args:
        path: The path that was planned for.
        choices: The options of the command.
        wanted: What the joints should do.
        made: The plan.
        limits: Limits of the requests.
        missed: Tolerances that the plan misses.
        page: Where it will stand.
        written: What else the run writes: what it is, and where.
    """
    from planner.evaluation.plan_outcome import PlanOutcome
    from planner.report.linked_files import linked_files
    from planner.report.plan_page import plan_page

    leg = wanted.leg if wanted.leg and wanted.names == wanted.leg.joint_names else None
    outcome = PlanOutcome(
        names=wanted.names,
        models=wanted.models,
        desired=wanted.angles,
        requests=made.requests,
        predicted=made.predicted,
        cyclic=choices["cyclic"],
        limits=limits,
        bounds={name: each.lower_bound for name, each in made.inversions.items()},
        norm=choices["norm"] or "rms",
        leg=leg,
        foot=None if leg is None else wanted.foot,
        foot_bound=made.foot_bound,
        foot_gap=made.together.gap if made.together and made.foot_bound else None,
    )
    return plan_page(
        outcome,
        title=legs.title(choices) or ", ".join(wanted.names),
        method=choices["method"],
        origins=origins_of(path, choices, leg),
        files=linked_files(page, [*named_files(path, choices), *written]),
        unreachable=wanted.moved,
        missed=missed,
        notes=[STANDING_IN] if choices["model"] == FROM_URDF else [],
    )


def origins_of(path: str, choices: Mapping[str, Any], leg: Leg | None) -> list[tuple[str, str]]:
    """What a page tells of where its plans come from: pairs of what it is and which."""
    origins = [("path", path)]
    if leg is not None:
        robot = choices.get("leg") or choices.get("urdf")
        origins.append(("leg", f"{robot}, from {leg.base} to {leg.foot}"))
    for name in TOLD:
        if choices.get(name):
            value = choices[name]
            several = isinstance(value, list | tuple)
            origins.append((name, ", ".join(map(str, value)) if several else str(value)))
    return origins


def named_files(path: str, choices: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The files that the options name: what each is, and where."""
    named = [("path", path), ("model", choices.get("model"))]
    named += [("robot", choices.get(key)) for key in ("leg", "urdf")]
    return [(role, file) for role, file in named if file and Path(file).is_file()]
