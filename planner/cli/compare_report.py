"""The page about a comparison, from the choices that it was made with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.cli import legs
from planner.cli.models import FROM_URDF
from planner.cli.plan_report import STANDING_IN, named_files, origins_of

if TYPE_CHECKING:
    from planner.cli.wanted import Wanted
    from planner.evaluation.cross_check import CrossCheck


def compare_report(
    page: Path | str,
    path: str,
    choices: Mapping[str, Any],
    wanted: Wanted,
    check: CrossCheck,
    *,
    written: Sequence[tuple[str, Path | str | None]] = (),
) -> str:
    """The page, as HTML.

    Args:
        page: Where it will stand.
        path: The path that was planned for.
        choices: The options of the command.
        wanted: What the joints should do.
        check: The comparison.
        written: What else the run has written: what it is, and where.
    """
    from planner.report.comparison_page import comparison_page
    from planner.report.linked_files import linked_files

    names = tuple(joint.name for joint in check.joints)
    leg = wanted.leg if wanted.leg and names == wanted.leg.joint_names else None
    return comparison_page(
        check,
        title=legs.title(choices) or ", ".join(names),
        leg=leg,
        origins=[*origins_of(path, choices, leg), ("bounds up to", choices["level"])],
        files=linked_files(page, [*named_files(path, choices), *written]),
        unreachable=wanted.moved,
        notes=[STANDING_IN] if choices["model"] == FROM_URDF else [],
    )
