"""From a CSV to what every joint should do: joint paths as they are, foot paths through a leg."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from planner.cli.legs import load_leg
from planner.cli.models import load_models

if TYPE_CHECKING:
    from kinematics import Leg
    from kinematics.inverse import Unreachable
    from planner.files.foot_path import FootPath
    from planner.files.joint_model import ModelFile
    from planner.files.joint_path import JointPath
    from planner.files.table import Table
    from planner.model.joint import JointModel
    from planner.trajectory import Array


@dataclass(frozen=True)
class Wanted:
    """What every joint should do.

    Attributes:
        names: The joints.
        angles: Their desired angles [rad], shape (n, k).
        models: Their models.
        limits: Smallest and largest angle of each joint [rad], where a leg tells.
        leg: The leg, where one was named.
        foot: Where the foot should be [m], shape (n, 3), for a foot path. The walk's clamped joints
            set themselves another path; positions that are out of reach otherwise remain wanted.
        moved: Samples for which the foot is not where the leg can bring it.
    """

    names: tuple[str, ...]
    angles: Array
    models: tuple[JointModel, ...]
    limits: dict[str, tuple[float, float]]
    leg: Leg | None = None
    foot: Array | None = None
    moved: int = 0

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period


def load_chosen(path: str, choices: Mapping[str, Any]) -> tuple[Leg | None, Wanted]:
    """The leg that a command's options name, if any, and what its joints should do.

    Raises as :func:`load_wanted` does.
    """
    leg = load_leg(choices)
    wanted = load_wanted(
        path,
        model=choices["model"],
        joints=choices["joints"],
        leg=leg,
        unreachable=choices["unreachable"],
    )
    return leg, wanted


def load_wanted(
    path: str,
    *,
    model: str | ModelFile,
    joints: tuple[str, ...] = (),
    leg: Leg | None = None,
    unreachable: Unreachable = "raise",
    takes_leg: bool = True,
    table: Table | None = None,
) -> Wanted:
    """Read a joint path, or a foot path where a leg can turn it into one.

    Args:
        path: The file, or ``-`` for standard input.
        model: The option ``--model``, or models that have been read already.
        joints: Joints to read from a joint path.
        leg: The leg, where the options name one.
        unreachable: What to do with foot positions out of the leg's reach.
        takes_leg: Whether the command has options that name a leg.
        table: What stands in the file, if it has been read already.

    Raises:
        InvalidFile: The file is neither, or its rate is not the models'.
        KinematicsError: The leg cannot reach the path.
        click.UsageError: A foot path without a leg, or joints that the leg has not.
    """
    from planner.files.foot_path import foot_path, is_foot_path
    from planner.files.joint_path import joint_path
    from planner.files.table import read_table

    table = read_table(path) if table is None else table
    if not is_foot_path(table):
        return _from_joints(joint_path(table, joints=joints), model, leg)
    if leg is None:
        raise click.UsageError(
            f"{path} is a foot path: name its leg with --leg."
            if takes_leg
            else f"{path} is a foot path, expected columns <joint>_deg or <joint>_rad."
        )
    if joints:
        raise click.UsageError("--joint chooses columns of a joint path; a foot moves all joints.")
    return from_foot(foot_path(table), model, leg, unreachable)


def _from_joints(given: JointPath, model: str | ModelFile, leg: Leg | None) -> Wanted:
    models = load_models(model, given.names, leg)
    given.check_period(models[0].period)
    limits = {} if leg is None else _limits(leg)
    strange = [name for name in given.names if leg is not None and name not in limits]
    if leg is not None and strange:
        raise click.UsageError(
            f"joint '{strange[0]}' of {given.path} is not on the leg; its joints: "
            f"{', '.join(leg.joint_names)}."
        )
    return Wanted(given.names, given.angles, models, limits, leg)


def from_foot(
    given: FootPath, model: str | ModelFile, leg: Leg, unreachable: Unreachable
) -> Wanted:
    """What the joints of a leg should do for its foot to follow a path.

    Raises as :func:`load_wanted` does.
    """
    models = load_models(model, leg.joint_names, leg)
    given.check_period(models[0].period)
    solution = leg.inverse(given.positions, unreachable=unreachable)
    moved = int((~solution.reachable).sum())
    clamped = unreachable == "clamp" and moved > 0
    foot = leg.foot_positions(solution.angles) if clamped else given.positions
    return Wanted(leg.joint_names, solution.angles, models, _limits(leg), leg, foot, moved)


def _limits(leg: Leg) -> dict[str, tuple[float, float]]:
    lower, upper = leg.limits
    return {name: (float(lower[j]), float(upper[j])) for j, name in enumerate(leg.joint_names)}
