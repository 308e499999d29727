"""The pages about a plan and about a comparison, from the settings that they were made with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.cli.settings import FROM_URDF
from planner.report.comparison import comparison_page
from planner.report.page import linked_files
from planner.report.plan import plan_page
from planner.run.desired import leg_title
from planner.run.models import beside

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.evaluation.cross_check import CrossCheck
    from planner.planning.plan import Plan
    from planner.run.run import Prepared

    Written = Sequence[tuple[str, Path | str | None]]

ASSUMED = (
    "The URDF has no more than the top speeds of the servos; the rest of their models is assumed. "
    "Identify the joints before these requests are sent."
)


def plan_report(
    prepared: Prepared,
    plan: Plan,
    *,
    missed: Sequence[str],
    page: Path | str,
    written: Written = (),
) -> str:
    """The page about a plan, as HTML.

    Args:
        prepared: What was planned.
        plan: The plan.
        missed: Tolerances that the plan misses.
        page: Where the page will stand.
        written: Other files to link to: what each is, and where.
    """
    run, desired = prepared.settings, prepared.desired
    return plan_page(
        plan,
        title=leg_title(run.leg) or ", ".join(desired.names),
        method=run.plan.method,
        origins=_origins(prepared, plan.task.leg),
        files=linked_files(page, [*_inputs(prepared), *written]),
        foot_given=desired.foot_given,
        unreachable=desired.unreachable,
        missed=missed,
        notes=_notes(prepared),
    )


def comparison_report(
    prepared: Prepared, check: CrossCheck, *, page: Path | str, written: Written = ()
) -> str:
    """The page about a comparison, as HTML; see :func:`plan_report`."""
    run = prepared.settings
    names = tuple(joint.name for joint in check.joints)
    leg = _whole_leg(prepared, names)
    level = run.output.level or "envelope"
    return comparison_page(
        check,
        title=leg_title(run.leg) or ", ".join(names),
        leg=leg,
        origins=[*_origins(prepared, leg), ("bounds up to", level)],
        files=linked_files(page, [*_inputs(prepared), *written]),
        unreachable=prepared.desired.unreachable,
        notes=_notes(prepared),
    )


def _notes(prepared: Prepared) -> list[str]:
    """What else should be known first."""
    desired = prepared.desired
    shares = [name for j, name in enumerate(desired.names) if desired.unit(j) != "deg"]
    notes = [ASSUMED] if prepared.settings.model.file == FROM_URDF else []
    if shares:
        notes.append(f"{', '.join(shares)}: degrees stand for percent of the joint's range.")
    return notes


def _whole_leg(prepared: Prepared, names: tuple[str, ...]) -> Leg | None:
    """The leg, where its joints are those of the path, in their order."""
    leg = prepared.desired.leg
    return leg if leg is not None and leg.joint_names == names else None


def _origins(prepared: Prepared, leg: Leg | None) -> list[tuple[str, str]]:
    """Where the plans come from: pairs of what it is and which."""
    run = prepared.settings
    origins = [("path", run.path.file or "a half ellipse")]
    if leg is not None:
        origins.append(("leg", f"{run.leg.name or run.leg.urdf}, from {leg.base} to {leg.foot}"))
    plan = {name: getattr(run.plan, name) for name in run.plan.keys_set - {"method", "cyclic"}}
    chosen: dict[str, Any] = {
        "model": run.model.file,
        "unreachable": None if leg is None else run.leg.unreachable,
        **{name: plan[name] for name in run.plan.keys if name in plan},
        "lock": _positions(run.leg.lock) + _positions(run.leg.lock_m, "m"),
        "near": _positions(run.leg.near),
    }
    for name, value in chosen.items():
        if value or value == 0.0:
            several = isinstance(value, list | tuple)
            origins.append((name, ", ".join(map(str, value)) if several else str(value)))
    return origins


def _positions(by_joint: Mapping[str, float] | None, unit: str = "") -> list[str]:
    return [f"{joint}={position:g}{unit}" for joint, position in (by_joint or {}).items()]


def _inputs(prepared: Prepared) -> list[tuple[str, str]]:
    """The files that the settings name: what each is, and where."""
    run = prepared.settings
    named = [("path", run.path.file), ("model", run.model.file), ("robot", run.leg.urdf)]
    places = [(role, beside(prepared.folder, name)) for role, name in named if name]
    return [(role, place) for role, place in places if Path(place).is_file()]
