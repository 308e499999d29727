"""The cross-check: closed form and optimised inversion, each judged by what the other does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.evaluation.checks import Check
from planner.evaluation.differences import REASONS
from planner.evaluation.foot_comparison import FootComparison, compare_foot
from planner.evaluation.joint_comparison import JointComparison, compare_joint
from planner.exceptions import Infeasible, InvalidInput, InvalidTrajectory
from planner.given import as_flag, as_reals, is_one_of, shown
from planner.inversion.bound import LEVELS
from planner.inversion.closed_form import invert_closed_form
from planner.inversion.line import RULES
from planner.inversion.norm import Norm, check_norm
from planner.inversion.optimal import invert_optimal
from planner.inversion.reachable import Level
from planner.inversion.result import Inversion
from planner.model.joint import JointModel
from planner.trajectory import Array

Limits = tuple[npt.ArrayLike, npt.ArrayLike]


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """Closed form against optimised inversion, with a verdict.

    Attributes:
        joints: Every joint.
        foot: The foot, where a leg was given.
        cyclic: Whether the trajectory repeats for ever.
        norm: The error that was minimised.
    """

    joints: tuple[JointComparison, ...]
    foot: FootComparison | None
    cyclic: bool
    norm: Norm

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every check."""
        of_joints = tuple(check for joint in self.joints for check in joint.checks)
        return of_joints if self.foot is None else of_joints + self.foot.checks

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that do not hold."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def passed(self) -> bool:
        """Whether every check holds."""
        return not self.failures

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.joints[0].model.period

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with all that is needed to compute them again.

        Angles are in degrees and lengths in centimetres, as the keys say; a figure that is not
        finite becomes None.
        """
        return {
            "passed": self.passed,
            "cyclic": self.cyclic,
            "norm": self.norm,
            "period_s": self.period,
            "joints": {joint.name: joint.to_dict() for joint in self.joints},
            "foot": None if self.foot is None else self.foot.to_dict(),
            "checks": [check.to_dict() for check in self.checks],
            "reasons": dict(REASONS),
        }


def cross_check(
    model: JointModel | Sequence[JointModel],
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: Limits | None = None,
    segments: int | None = None,
    leg: Leg | None = None,
    norm: Norm = "rms",
    level: Level = "envelope",
    names: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> CrossCheck:
    """Plan by the closed form with both of its rules and by optimisation, and judge the plans.

    Each plan's predicted angles are held against an independent simulation, the optimised plan
    against the closed forms, all of them against bounds that no requests can go below; and where
    the requests differ, the answer says why.

    Args:
        model: One joint model for all joints, or one for each.
        desired: Desired angles [rad], shape (n,) or (n, k), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever, or starts from rest at its first sample.
        limits: Smallest and largest request allowed [rad], each a number or shape (k,); by default
            those of the leg, if there is one.
        segments: Number of lines of the closed form; chosen automatically where not given.
        leg: A leg whose joints these are: then the foot is compared too, and a plan for all joints
            at once (:func:`planner.invert_foot`) with the others.
        norm: "rms" or "max": the error that the optimised plans minimise and the bounds are about.
        level: The sharpest bound to compute; those before it are computed too.
        names: What to call the joints; by default what the leg calls them.
        progress: Told which joint is being compared, and ``"foot"`` at the end.

    Returns:
        Plans, bounds, differences and the verdict, ``.passed``.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) or (n, k) with n >= 3.
        InvalidInput: The models, names, limits or the leg do not fit the joints.
        Infeasible: The limits exclude each other, or a desired angle.
        SolverFailed: A plan or a bound was not found.
    """
    check_norm(norm)
    cyclic = as_flag("cyclic", cyclic)
    if leg is not None and not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    if not callable(progress):
        raise InvalidInput(f"progress: got {shown(progress)}, expected a function")
    levels = _levels_up_to(level)
    columns = _columns(desired)
    count = len(columns)
    if leg is not None and len(leg.joint_names) != count:
        raise InvalidInput(
            f"desired: got {count} columns, expected {len(leg.joint_names)}, one for each joint of "
            f"the leg ({', '.join(leg.joint_names)})"
        )
    models = _one_for_each(model, count)
    called = _checked_names(names, leg, count)
    given = leg.limits if limits is None and leg is not None else limits
    ranges = None if given is None else _each_range(given, count)
    joints = []
    for j in range(count):
        progress(called[j])
        within = None if ranges is None else (float(ranges[0][j]), float(ranges[1][j]))
        try:
            plans = _plans(
                models[j], columns[j], within, cyclic=cyclic, segments=segments, norm=norm
            )
        except (Infeasible, InvalidTrajectory) as error:
            if count == 1:
                raise
            raise type(error)(f"{called[j]}: {error}") from error
        joints.append(compare_joint(called[j], plans, levels=levels))
    foot = None
    if leg is not None and ranges is not None:
        progress("foot")
        foot = compare_foot(leg, joints, cyclic=cyclic, norm=norm, limits=ranges)
    return CrossCheck(joints=tuple(joints), foot=foot, cyclic=cyclic, norm=norm)


def _plans(
    model: JointModel,
    desired: Array,
    limits: tuple[float, float] | None,
    *,
    cyclic: bool,
    segments: int | None,
    norm: Norm,
) -> dict[str, Inversion]:
    plans = {
        f"closed_form_{rule}": replace(
            invert_closed_form(model, desired, cyclic=cyclic, segments=segments, rule=rule),
            norm=norm,
        )
        for rule in RULES
    }
    plans["optimal"] = invert_optimal(model, desired, cyclic=cyclic, limits=limits, norm=norm)
    return plans


def _levels_up_to(level: Level) -> tuple[Level, ...]:
    """The bounds to compute, from the coarsest on."""
    if not is_one_of(level, LEVELS):
        raise InvalidInput(
            f"level: got {shown(level)}, expected one of {', '.join(map(repr, LEVELS))}"
        )
    return LEVELS[: LEVELS.index(level) + 1]


def _columns(desired: npt.ArrayLike) -> list[Array]:
    """The joints' desired angles [rad], each (n,); what they hold is checked by who plans them."""
    try:
        angles = np.asarray(desired)
    except ValueError as error:
        raise InvalidTrajectory(
            "desired: got rows of different lengths, expected shape (n,) or (n, k)"
        ) from error
    if angles.ndim == 1:
        return [angles]
    if angles.ndim != 2 or angles.shape[1] == 0:
        raise InvalidTrajectory(
            f"desired: got shape {angles.shape}, expected (n,), or (n, k) with a column per joint"
        )
    return list(angles.T)


def _one_for_each(model: JointModel | Sequence[JointModel], count: int) -> tuple[JointModel, ...]:
    try:
        models = (model,) * count if isinstance(model, JointModel) else tuple(model)
    except TypeError:
        models = ()
    if len(models) != count or not all(isinstance(each, JointModel) for each in models):
        raise InvalidInput(
            f"model: got {len(models)} of them for {count} joints, expected one JointModel, or one "
            "for each column of desired"
        )
    if len({each.period for each in models}) > 1:
        raise InvalidInput(
            "model: the joints are requested at different rates, expected one; compare them one "
            "by one"
        )
    return models


def _checked_names(names: Sequence[str] | None, leg: Leg | None, count: int) -> tuple[str, ...]:
    if names is None:
        if leg is not None:
            return leg.joint_names
        return tuple(f"joint {j}" for j in range(count)) if count > 1 else ("joint",)
    listed = names if isinstance(names, Sequence) and not isinstance(names, str) else ()
    texts = {name for name in listed if isinstance(name, str)}
    if len(listed) != count or len(texts) != count:
        raise InvalidInput(f"names: got {shown(names)}, expected {count} different ones")
    return tuple(names)


def _each_range(limits: Limits, count: int) -> tuple[Array, Array]:
    try:
        lower, upper = (np.broadcast_to(as_reals(each), count).copy() for each in limits)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"limits: got {shown(limits)}, "
            "expected (lower, upper) [rad], each a number or one per joint"
        ) from error
    return lower, upper
