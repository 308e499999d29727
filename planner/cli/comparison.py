"""The ways to plan, compared for the settings of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from planner.evaluation.cross_check import CrossCheck, cross_check
from planner.planning.arguments import limits_of_each

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.desired import Desired
    from planner.cli.planning import Prepared


def steps_of(desired: Desired) -> list[str]:
    """The steps of a comparison, for the progress line."""
    return [*desired.names, *([] if _in_leg_order(desired)[1] is None else ["foot"])]


def comparison_of(
    prepared: Prepared, progress: Callable[[str], None] = lambda _: None
) -> CrossCheck:
    """The plans for the desired path, compared under its load."""
    run, torques = prepared.settings, prepared.load
    desired, leg = _in_leg_order(prepared.desired)
    if callable(torques):
        torques = torques(prepared.desired.angles)
    if torques is not None:
        torques = torques[:, [prepared.desired.names.index(name) for name in desired.names]]
    return cross_check(
        desired.models,
        desired.angles,
        cyclic=desired.cyclic,
        limits=limits_of_each(prepared.limits, desired.names) if prepared.limits else None,
        segments=run.plan.segments,
        leg=leg,
        norm=run.plan.norm or "rms",
        level=run.output.level or "envelope",
        names=desired.names,
        load=torques,
        progress=progress,
    )


def _in_leg_order(desired: Desired) -> tuple[Desired, Leg | None]:
    """The joints in the order of the leg; no leg if some of its joints are missing."""
    leg = desired.leg
    if leg is None or set(desired.names) != set(leg.joint_names):
        return desired, None
    columns = [desired.names.index(name) for name in leg.joint_names]
    models = tuple(desired.models[column] for column in columns)
    angles = desired.angles[:, columns]
    return replace(desired, names=leg.joint_names, models=models, angles=angles), leg
