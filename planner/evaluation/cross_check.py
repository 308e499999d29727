"""The cross-check: closed form, our own optimiser and CasADi's, each compared with the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from kinematics.leg import Leg
from planner.evaluation.checks import Check
from planner.evaluation.comparison import (
    SECOND,
    FootComparison,
    JointComparison,
    compare_joint,
    judge_foot,
    planned_methods,
)
from planner.exceptions import InvalidInput, SolverFailed, about
from planner.model.joint import JointModel
from planner.planning.arguments import Norm, checked_leg
from planner.planning.bounds.reachable_set import LEVELS, Level
from planner.planning.closed_form import closed_forms
from planner.planning.inversion import invert_foot, planned
from planner.planning.line_inverse import RULES, check_rule
from planner.planning.result import Inversion
from planner.planning.task import Task
from planner.trajectory import as_rows
from planner.validation import check_choice, shown

Limits = tuple[npt.ArrayLike, npt.ArrayLike]


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """Closed form against optimised inversion, with a verdict.

    Attributes:
        joints: Every joint.
        foot: The foot, where a leg was given.
    """

    joints: tuple[JointComparison, ...]
    foot: FootComparison | None

    @property
    def cyclic(self) -> bool:
        """Whether the trajectory repeats for ever."""
        return self.joints[0].plans["optimal"].cyclic

    @property
    def norm(self) -> Norm:
        """The error that was minimised."""
        return self.joints[0].plans["optimal"].norm

    @property
    def methods(self) -> list[str]:
        """The methods by which every joint is planned."""
        return planned_methods(self.joints)

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
    load: npt.ArrayLike | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> CrossCheck:
    """Plan by the closed form, by our own optimiser and by CasADi with IPOPT, and judge the plans.

    Each plan's predicted angles are compared with an independent simulation, the optimised plan
    against the closed forms, with both of their rules, and against IPOPT's, all of them against
    lower bounds; where the requests differ, the answer gives the reason.

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
        names: Names of the joints; by default those of the leg.
        load: Torque on the joints in the direction of positive angles [N m], a number, shape (k,)
            for each joint's, or (n, k); row i acts in the request period that ends in sample i.
        progress: Called with the name of each joint before it is compared, and with ``"foot"``.

    Returns:
        Plans, bounds, differences and the verdict, ``.passed``.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) or (n, k) with n >= 3.
        InvalidInput: The models, names, limits, the load or the leg do not fit the joints, or the
            level is not known for one of them.
        Infeasible: The limits exclude each other, or a desired angle.
        SolverFailed: A plan or a bound was not found. A plan that IPOPT does not find is missing,
            and fails a check instead.

    Example:
        >>> import numpy as np
        >>> desired = 0.5 * np.sin(2 * np.pi * np.arange(40) / 40)  # [rad], every 8 ms
        >>> check = cross_check(JointModel.ers210a(), desired, level="slope")
        >>> check.passed, check.methods
        (True, ['closed_form_paper', 'closed_form_exact', 'optimal', 'optimal_ipopt'])
    """
    if not callable(progress):
        raise InvalidInput(f"progress: got {shown(progress)}, expected a function")
    check_choice("level", level, LEVELS)
    levels = LEVELS[: LEVELS.index(level) + 1]
    if leg is not None:
        _check_columns(desired, checked_leg(leg))
    task = Task.of(
        model,
        desired,
        names=leg.joint_names if names is None and leg is not None else names,
        cyclic=cyclic,
        norm=norm,
        limits=leg.limits if limits is None and leg is not None else limits,
        load=load,
    )
    if len(task.scenarios) > 1:
        raise InvalidInput("model: got several of a joint, expected one of each")
    joints = []
    for j, name in enumerate(task.names):
        progress(name)
        with about(name):
            plans = _plans(task.joint(j), segments)
            failed = () if SECOND in plans else (SECOND,)
        joints.append(compare_joint(name, plans, levels=levels, failed=failed))
    foot = None
    if leg is not None:
        progress("foot")
        together = invert_foot(
            task.nominal,
            leg,
            leg.foot_positions(task.desired),
            cyclic=cyclic,
            limits=(task.lower, task.upper),
            norm=norm,
            load=task.load,
        )
        foot = judge_foot(joints, together)
    return CrossCheck(joints=tuple(joints), foot=foot)


def _check_columns(desired: npt.ArrayLike, leg: Leg) -> None:
    """Raise InvalidInput where there is no column for each joint of the leg."""
    count = as_rows(desired, name="desired").shape[1]
    if len(leg.joint_names) != count:
        raise InvalidInput(
            f"desired: got {count} columns, expected {len(leg.joint_names)}, one for each joint of "
            f"the leg ({', '.join(leg.joint_names)})"
        )


def _plans(task: Task, segments: int | None) -> dict[str, Inversion]:
    """The plans for a joint by all methods."""
    for rule in RULES:
        check_rule(rule, task.nominal[0])
    by_rule = closed_forms(task, RULES, segments=segments)
    plans = {f"closed_form_{rule}": plan for rule, plan in zip(RULES, by_rule, strict=True)}
    plans["optimal"] = planned(task)
    # A solver that fails costs its plan and a check, not the comparison of the others.
    with suppress(SolverFailed):
        plans[SECOND] = planned(task, solver="ipopt")
    return {method: Inversion(plan) for method, plan in plans.items()}
