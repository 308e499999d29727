"""The cross-check: closed form, our own optimiser and CasADi's, each judged by the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
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
from planner.exceptions import Infeasible, InvalidInput, InvalidTrajectory, SolverFailed
from planner.model.joint import JointModel
from planner.model.load import load_columns
from planner.planning.arguments import (
    COLUMNS,
    Norm,
    check_norm,
    checked_leg,
    joint_names,
    limits_of_each,
    loads_of_each,
    model_of_each,
    one_path,
)
from planner.planning.bounds.reachable_set import LEVELS, Level, check_level
from planner.planning.closed_form import closed_forms
from planner.planning.inversion import invert_foot, planned
from planner.planning.line_inverse import RULES, check_rule
from planner.planning.result import Inversion
from planner.planning.task import Task
from planner.trajectory import Array
from planner.validation import as_flag, shown

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

    Each plan's predicted angles are held against an independent simulation, the optimised plan
    against the closed forms, with both of their rules, and against IPOPT's, all of them against
    bounds that no requests can go below; and where the requests differ, the answer says why.

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
    check_norm(norm)
    cyclic = as_flag("cyclic", cyclic)
    if not callable(progress):
        raise InvalidInput(f"progress: got {shown(progress)}, expected a function")
    check_level(level)
    levels = LEVELS[: LEVELS.index(level) + 1]
    columns = _columns_of(desired)
    count = len(columns)
    if leg is not None:
        _check_columns(checked_leg(leg), count)
    models = model_of_each(model, count, given_as="model", joints=COLUMNS)
    names = _names(names, leg, count)
    given = leg.limits if limits is None and leg is not None else limits
    shape = len(columns[0]), count
    loads = loads_of_each(load, names, shape)
    lower, upper = limits_of_each(given, names)
    joints = []
    for j, name in enumerate(names):
        progress(name)
        with _about(name if count > 1 else None):
            task = Task.of(
                [models[j]],
                one_path(columns[j]),
                names=("",),
                cyclic=cyclic,
                norm=norm,
                limits=None if given is None else (lower[j], upper[j]),
                load=loads[j],
            )
            plans = _plans(task, segments)
            failed = () if SECOND in plans else (SECOND,)
        joints.append(compare_joint(name, plans, levels=levels, failed=failed))
    foot = None
    if leg is not None:
        progress("foot")
        best = [joint.plans["optimal"] for joint in joints]
        together = invert_foot(
            models,
            leg,
            leg.foot_positions(np.column_stack([plan.desired for plan in best])),
            cyclic=cyclic,
            limits=(lower, upper),
            norm=norm,
            load=load_columns([plan.load for plan in best], len(columns[0])),
        )
        foot = judge_foot(joints, together)
    return CrossCheck(joints=tuple(joints), foot=foot)


def _columns_of(desired: npt.ArrayLike) -> list[Array]:
    """The desired angles of each joint [rad], shape (n,); the inversions check the values."""
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


def _names(names: Sequence[str] | None, leg: Leg | None, count: int) -> tuple[str, ...]:
    """What to call the joints; by default what the leg calls them."""
    if names is None and leg is not None:
        return leg.joint_names
    if names is None:
        return tuple(f"joint {j}" for j in range(count)) if count > 1 else ("joint",)
    return joint_names(names, None, count)


def _check_columns(leg: Leg, count: int) -> None:
    """Raise InvalidInput where there is no column for each joint of the leg."""
    if len(leg.joint_names) != count:
        raise InvalidInput(
            f"desired: got {count} columns, expected {len(leg.joint_names)}, one for each joint of "
            f"the leg ({', '.join(leg.joint_names)})"
        )


@contextmanager
def _about(name: str | None) -> Iterator[None]:
    """Let errors say which of several joints they are about."""
    try:
        yield
    except (Infeasible, InvalidTrajectory) as error:
        if name is None:
            raise
        raise type(error)(f"{name}: {error}") from error


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
