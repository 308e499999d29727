"""Lower bounds on the tracking error of any requests (``docs/math.md``, section 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import as_positive, check_choice, error_norm, relative_gap
from planner.exceptions import SolverFailed
from planner.model.joint import JointModel, checked_model
from planner.planning.bounds.exact import exact_bound, without_load
from planner.planning.bounds.multipliers import linear_bound
from planner.planning.bounds.reachable_set import LEVELS, Level
from planner.planning.inversion import planned
from planner.planning.task import Norm, Task

TIME_LIMIT = 60.0
"""Approximate time after which the search stops with the bound so far [s]."""


class Certificate(NamedTuple):
    """A lower bound, and how it was obtained.

    Attributes:
        bound: Lower bound on the error of any requests [rad].
        norm: Which error.
        level: The conditions on the joint: the requested level, or the strongest below it that
            holds for the joint.
        solver_gap: Relative distance between the bound and the best known value of the same level,
            for "exact" the error of a plan; 0 where one set of multipliers proves the bound, inf
            where there is none, or where it is at most 10 % of that value.
    """

    bound: float
    norm: Norm
    level: Level
    solver_gap: float


def lower_bound(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    load: npt.ArrayLike | None = None,
) -> float:
    """A lower bound on the error of any requests [rad]: see :func:`planner.certify`.

    Example:
        >>> import numpy as np
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> f"{np.degrees(lower_bound(JointModel.ers210a(), desired)):.1f} deg rms"
        '10.2 deg rms'
    """
    return certify(
        model,
        desired,
        cyclic=cyclic,
        norm=norm,
        level=level,
        start=start,
        time_limit=time_limit,
        load=load,
    ).bound


def certify(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    level: Level = "envelope",
    start: float | None = None,
    time_limit: float = TIME_LIMIT,
    load: npt.ArrayLike | None = None,
) -> Certificate:
    """A lower bound on the error of any requests, and how it was obtained.

    ``slope`` uses the joint's top speeds, gravity included; ``envelope`` also that its speed cannot
    change at once; ``exact`` follows every request through the window, and searches all
    requests for any that are better than a plan (``docs/math.md``, section 5). Each bound is at
    least the one before, and costs more: one and a few milliseconds, and seconds to the time limit
    for a hundred samples. All hold under a load, "exact" under a constant one. For a joint with a
    dead band, inertia or a sag by the pose "envelope" is the strongest; the answer has the level
    used. With the integral of a speed loop the bound is 0: it may exceed the top speed.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        norm: "rms" for the root mean square of the errors, "max" for the largest.
        level: "slope", "envelope" or "exact".
        start: From rest: angle at which the joint rests until the plan begins [rad]. Without it the
            bound holds for every start.
        time_limit: For "exact": when to stop with the bound so far [s]. It is counted as work that
            takes about this time, so that the bound is the same on a slow or busy machine.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,);
            the bound is about plans under this load.

    Returns:
        The bound, at least 0.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 3.
        InvalidInput: The norm or level is unknown, a cycle has a start, the load does not fit
            the samples or the joint, or it changes and the level is "exact".
        SolverFailed: The solver proposed no multipliers.

    Example:
        >>> import numpy as np
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> certificate = certify(JointModel.ers210a(), desired, level="slope")
        >>> certificate.level, f"{np.degrees(certificate.bound):.1f} deg rms"
        ('slope', '10.1 deg rms')
    """
    time_limit = as_positive("time_limit", time_limit, "a number of seconds above 0")
    check_choice("level", level, LEVELS)
    task = Task.of(
        [checked_model(model)],
        desired,
        names=("",),
        cyclic=cyclic,
        norm=norm,
        start=start,
        load=load,
    )
    anywhere = start is None and not task.cyclic
    return certified(replace(task, start=None) if anywhere else task, level, time_limit=time_limit)


def certified(joint: Task, level: Level, *, time_limit: float = TIME_LIMIT) -> Certificate:
    """:func:`certify` of the task of one joint, whose limits do not count."""
    (model,) = joint.nominal
    if level == "exact" and (model.dead_band or model.most_pose_sag or model.has_inertia):
        level = "envelope"  # its speed is not the sum of the requests' contributions
    if level == "exact":
        without_load(joint)  # refused before anything is computed
    bound, gap = linear_bound(joint, level), 0.0
    if level == "exact":
        plan_error = planned_error(joint)
        bound = max(bound, exact_bound(joint, plan_error, time_limit=time_limit))
        gap = max(relative_gap(plan_error, bound), 0.0)
    return Certificate(bound, joint.norm, level, gap)


def planned_error(joint: Task) -> float:
    """The error of a plan [rad]; of a joint at rest, where no plan is found."""
    start = joint.desired[0] if joint.start is None and not joint.cyclic else joint.start
    free = replace(joint.with_models(joint.nominal), start=start).unlimited
    try:
        return float(planned(free.unsmoothed).error[0])
    except SolverFailed:  # no steady cycle
        resting = np.mean(joint.desired) if joint.start is None else joint.start
        return error_norm(joint.desired[:, 0] - resting, joint.norm)
