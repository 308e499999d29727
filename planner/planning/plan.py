"""A plan: requests for a task, and all figures that follow from the two.

Its views of one joint or of the foot have these figures; their ``plan.task`` has the arguments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, final

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.arrays import (
    Array,
    ReadOnly,
    Summarised,
    Summary,
    error_norm,
    freeze,
    relative_gap,
    reversals,
    steps,
)
from planner.model.evidence import Expectation, expectation
from planner.model.joint import JointModel
from planner.model.response import PathSpeeds, path_speeds
from planner.planning.task import Norm, Solver, Task, columns_of

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.learning.trials import Learning

Method = Literal["shift", "closed_form", "optimal", "foot_optimal"]


DEGREE = math.degrees(1.0)
"""Degrees in a radian."""


class RequestMotion(NamedTuple):
    """How a joint's requests move, beside the desired angles."""

    largest_step: float  # largest change from one request to the next [rad]
    reversals_per_s: float  # how often the requests change direction [1/s]
    path_length: float  # sum of the changes of the requests [rad]
    desired_path_length: float  # sum of the changes of the desired angles [rad]
    beyond_desired: float  # how far the requests go beyond the range of the desired angles [rad]


def request_motion(
    requests: Array, desired: Array, *, period: float, cyclic: bool
) -> RequestMotion:
    """How one joint's requests move, beside desired angles: both (n,) [rad], cycles closed."""
    changes, desired_changes = (steps(each, cyclic=cyclic) for each in (requests, desired))
    beyond = max(desired.min() - requests.min(), requests.max() - desired.max(), 0.0)
    return RequestMotion(
        largest_step=float(np.max(np.abs(changes), initial=0.0)),
        reversals_per_s=reversals(requests, cyclic=cyclic) / (len(requests) * period),
        path_length=float(np.sum(np.abs(changes))),
        desired_path_length=float(np.sum(np.abs(desired_changes))),
        beyond_desired=float(beyond),
    )


class ErrorsOfModels(NamedTuple):
    """Errors of a plan over the models that joints may have, in its norm: [rad], of a foot [m]."""

    nominal: float  # of the nominal model
    mean: float  # root mean square over all models
    worst: float  # the largest


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Plan(ReadOnly, Summarised):
    """Requests for a task, and the response of the exact models to them.

    Every figure is computed from task and requests by simulation, for any method, on first access.
    The k joints are judged, each by itself, or the foot: ``rms``, ``max_error``, ``error``,
    ``lower_bounds`` and the like have an entry for each of these m.

    Attributes:
        task: The task.
        requests: Requests to the joints [rad], shape (n, k).
        method: The planning method.
        solver: Solver of an optimised plan for joints; else None.
        approximations: The piecewise linear trajectories behind a closed form, one a joint.
        leads: Of a time shift: how early each joint's desired angles are requested [s].
        nominal_requests: With several models: requests for the nominal ones alone [rad], (n, k).
        learning: The executed cycles that the plan has learnt from, an entry for each judged joint
            or foot; () for none.
    """

    task: Task
    requests: Array
    method: Method = "optimal"
    solver: Solver | None = None
    approximations: tuple[PiecewiseLinear, ...] = ()
    leads: tuple[float, ...] = ()
    nominal_requests: Array | None = None
    learning: tuple[Learning, ...] = ()

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        freeze(self.requests, self.nominal_requests)

    def _summarised(self) -> Summary:
        """Requests and errors; the lower bound where it has been computed already."""
        foot = self.task.goal == "foot"
        names, factor, unit = (["foot"], 100.0, "cm") if foot else (self.names, DEGREE, "deg")
        bounds = self.__dict__.get("lower_bounds")
        count, joints = self.requests.shape
        head = (
            f"Plan by {self.method}: {count} requests to {joints} joint{'s' * (joints > 1)}, one "
            f"every {1e3 * self.period:.4g} ms, {'cyclic' if self.cyclic else 'from rest'}"
        )
        columns = [f"rms [{unit}]", f"max [{unit}]", *([] if bounds is None else ["lower bound"])]
        values = [self.rms, self.max_error, *([] if bounds is None else [bounds])]
        cells = zip(*(factor * each for each in values), strict=True)
        rows = [
            (name, *(f"{value:.4g}" for value in row))
            for name, row in zip(names, cells, strict=True)
        ]
        return Summary(head, ("", *columns), rows)

    @property
    def names(self) -> tuple[str, ...]:
        """The joints."""
        return self.task.names

    @property
    def models(self) -> tuple[JointModel, ...]:
        """The nominal model of each joint."""
        return self.task.nominal

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.task.period

    @property
    def cyclic(self) -> bool:
        """Whether the requests repeat for ever."""
        return self.task.cyclic

    @property
    def desired(self) -> Array:
        """Desired angles [rad], shape (n, k); for a foot the angles that bring it nearest."""
        return self.task.desired

    @cached_property
    def inversions(self) -> tuple[Inversion, ...]:
        """The plan of each joint, with its error, its bound and its gap; () of one for a foot."""
        each = () if self.task.goal == "foot" else range(len(self.names))
        return tuple(Inversion(self, j) for j in each)

    @cached_property
    def of_foot(self) -> FootInversion | None:
        """The plan as a plan for a foot; None of a plan for joints."""
        return FootInversion(self) if self.task.goal == "foot" else None

    @cached_property
    def nominal(self) -> Plan | None:
        """With several models: the plan for the nominal ones alone, to compare with."""
        if self.nominal_requests is None:
            return None
        task = replace(self.task, robust=None)
        return replace(self, task=task, requests=self.nominal_requests, nominal_requests=None)

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact models under the requests, plus the disturbance [rad], (n, k)."""
        return self._under_models(self.task.nominal)

    def _under_models(self, models: Sequence[JointModel]) -> Array:
        """The same angles with other models of the joints."""
        angles = self.task.response(self.requests, models)
        if self.task.disturbance is not None:
            angles += self.task.disturbance
        freeze(angles)
        return angles

    @cached_property
    def direct(self) -> Plan:
        """The desired angles requested as they are, without a disturbance: no plan at all."""
        return Plan(task=replace(self.task, disturbance=None), requests=self.desired)

    @cached_property
    def errors(self) -> Array:
        """Predicted minus desired angles [rad], shape (n, k)."""
        errors = self.predicted - self.desired
        freeze(errors)
        return errors

    @cached_property
    def foot(self) -> Array:
        """Predicted position of the foot [m], shape (n, 3)."""
        return self.task.foot_at(self.predicted)

    @property
    def distances(self) -> Array:
        """Distance of the foot from its desired position, all axes alike [m], shape (n,)."""
        distances: Array = np.linalg.norm(self.foot - self.task.desired_foot, axis=1)
        return distances

    @cached_property
    def _judged(self) -> list[Array]:
        """Errors that are judged, each of shape (n,)."""
        return [self.distances] if self.task.goal == "foot" else columns_of(self.errors)

    @property
    def rms(self) -> Array:
        """Root mean square of the errors [rad], shape (k,); of the foot's distances [m], (1,)."""
        return np.array([error_norm(each, "rms") for each in self._judged])

    @property
    def max_error(self) -> Array:
        """Largest errors [rad], shape (k,); distance [m], (1,)."""
        return np.array([error_norm(each, "max") for each in self._judged])

    @cached_property
    def error(self) -> Array:
        """The errors in the norm that counts [rad], shape (k,); of a foot as weighted [m], (1,)."""
        return self.task.errors_of(self.predicted)

    @cached_property
    def expected(self) -> tuple[Expectation, ...]:
        """Expected error of each joint on the robot, and where its motion is outside the tests.

        The error is NaN where nothing is known: see :attr:`planner.JointModel.evidence`. It is
        about the model alone, and so NaN for a plan that has learnt from cycles.
        """
        task, learnt = self.task, self.task.disturbance is not None
        evidence = [None if learnt else model.evidence for model in task.nominal]
        each = zip(
            evidence, columns_of(task.desired), columns_of(self.predicted), task.loads, strict=True
        )
        return tuple(
            expectation(known, goal, angles, period=task.period, cyclic=task.cyclic, load=load)
            for known, goal, angles, load in each
        )

    @property
    def expected_rms(self) -> Array:
        """Errors to expect on the robot [rad], shape (k,); NaN where a model was not tested.

        The errors of the plan and of the model, by the tests of the model. A joint whose
        ``expected[j].untested`` is not empty moves outside their range.
        """
        return np.array([each.error for each in self.expected])

    @cached_property
    def expected_foot(self) -> float | None:
        """Root mean square distance of the foot to expect on the robot [m]; None where unknown.

        The models' errors, taken as independent, move the foot from its planned position.
        """
        leg = self.task.leg
        if leg is None or not all(math.isfinite(each.error) for each in self.expected):
            return None
        squares = float(np.mean(self.distances**2))
        own = np.mean(self.errors**2, axis=0)
        for j, each in enumerate(self.expected):
            moved = self.predicted.copy()
            moved[:, j] += math.sqrt(max(each.error**2 - own[j], 0.0))
            away = leg.foot_positions(moved) - self.foot
            squares += float(np.mean(np.sum(away**2, axis=1)))
        return math.sqrt(squares)

    @cached_property
    def errors_of_models(self) -> tuple[Array, ...]:
        """Errors with every model of each judged joint or foot, nominal first, (models,)."""
        task = self.task
        errors = np.array([task.errors_of(self._under_models(each)) for each in task.scenarios])
        many = [len(task.scenarios)] if task.goal == "foot" else map(len, task.models)
        each = [errors[:count, j].copy() for j, count in enumerate(many)]
        freeze(*each)
        return tuple(each)

    @property
    def over_models(self) -> tuple[ErrorsOfModels, ...]:
        """The nominal, the mean and the worst of them."""
        return tuple(
            ErrorsOfModels(float(each[0]), error_norm(each, "rms"), float(np.max(each)))
            for each in self.errors_of_models
        )

    @cached_property
    def lower_bounds(self) -> Array:
        """Lower bounds on the error of any requests, in the norm that counts: [rad], of a foot [m].

        Of a joint level "envelope". Limits of requests and steps are ignored; the bound stays
        valid, and part of the gap may be due to them. The bound of a foot is about requests within
        the limits, from rest about plans that begin at ``start``; it takes some 30 ms a sample, up
        to ten seconds where a path is short. It is 0 where the load depends on the pose, and for a
        foot with a disturbance.
        """
        task = self.task
        felt = [task.load_of_pose and model.feels_load for model in task.nominal]
        if task.goal == "foot":
            if any(felt) or task.disturbance is not None:
                return np.zeros(1)
            from planner.planning.bounds.foot_bound import foot_bound

            return np.array([foot_bound(task, self.predicted)])
        from planner.planning.bounds.multipliers import linear_bound  # slow to import: SciPy

        if task.disturbance is not None:
            task = replace(task, desired=task.desired - task.disturbance, disturbance=None)
        bounds = np.zeros(len(felt))
        for j in np.flatnonzero(np.logical_not(felt)).tolist():
            bounds[j] = linear_bound(task.joint(j), "envelope")
        return bounds

    @property
    def gaps(self) -> Array:
        """Relative distances of the errors from the bounds; inf where they are over ten times."""
        pairs = zip(self.error.tolist(), self.lower_bounds.tolist(), strict=True)
        return np.array([relative_gap(error, bound) for error, bound in pairs])

    @property
    def foot_bound(self) -> float | None:
        """The bound of a foot [m]; None of joints, and where it would take more than minutes."""
        from planner.planning.bounds.foot_bound import MOST_SAMPLES_BOUNDED

        if self.task.goal == "angles" or len(self.requests) > MOST_SAMPLES_BOUNDED:
            return None
        return float(self.lower_bounds[0])

    @property
    def stopped(self) -> dict[str, str]:
        """Why learning from executed cycles has ended, by joint where it has."""
        pairs = zip(self.names, self.learning, strict=False)
        return {name: each.stopped for name, each in pairs if each.stopped}

    @cached_property
    def motions(self) -> tuple[RequestMotion, ...]:
        """How the requests of every joint move."""
        pairs = zip(columns_of(self.requests), columns_of(self.desired), strict=True)
        return tuple(
            request_motion(*pair, period=self.period, cyclic=self.cyclic) for pair in pairs
        )

    @property
    def largest_steps(self) -> Array:
        """Largest change from one request of each joint to its next, cycles closed [rad], (k,)."""
        return np.array([each.largest_step for each in self.motions])

    @cached_property
    def speeds(self) -> tuple[PathSpeeds, ...]:
        """Speeds of every joint on the desired path, and its top speeds."""
        each = zip(self.models, columns_of(self.desired), self.task.loads, strict=True)
        return tuple(
            path_speeds(model, desired, cyclic=self.cyclic, load=load)
            for model, desired, load in each
        )

    @property
    def too_fast(self) -> Array:
        """Share of the desired path above the joint's top speed, shape (k,)."""
        return np.array([float(np.mean(each.too_fast)) for each in self.speeds])

    def under(self, torques: Array) -> Plan:
        """The same requests under the load of a pose [N m], shape (n, k)."""
        return replace(self, task=self.task.under(torques, of_pose=True))

    def joint(self, j: int) -> Plan:
        """The plan of one of the joints, which were planned one by one."""
        nominal = self.nominal_requests if len(self.task.models[j]) > 1 else None
        return replace(
            self,
            task=self.task.joint(j),
            requests=columns_of(self.requests)[j][:, np.newaxis],
            approximations=self.approximations[j : j + 1],
            leads=self.leads[j : j + 1],
            nominal_requests=None if nominal is None else columns_of(nominal)[j][:, np.newaxis],
            learning=self.learning[j : j + 1],
        )

    def of_leg(self, leg: Leg) -> Plan:
        """The part of a plan for many joints that moves a leg, with its foot."""
        part = joined([self.joint(self.names.index(name)) for name in leg.joint_names])
        return replace(part, task=replace(part.task, leg=leg))

    def save(self, path: Path | str) -> None:
        """Write the requests as CSV: ``t_s`` [s] and one ``<joint>_deg`` column per joint.

        ``request-planner export``, ``simulate`` and ``view`` read this file.

        Args:
            path: The file, or ``-`` for standard output.

        Raises:
            InvalidFile: The file cannot be written.
        """
        from planner.files.paths import write_joint_path

        write_joint_path(path, self.names, self.requests, period=self.period)


def joined(plans: Sequence[Plan]) -> Plan:
    """The plan of several joints that were planned one by one, all in the same way."""
    nominal = [
        each.requests if each.nominal_requests is None else each.nominal_requests for each in plans
    ]
    robust = any(each.nominal_requests is not None for each in plans)
    return replace(
        plans[0],
        task=Task.joined([each.task for each in plans]),
        requests=np.hstack([each.requests for each in plans]),
        approximations=tuple(curve for each in plans for curve in each.approximations),
        leads=tuple(lead for each in plans for lead in each.leads),
        nominal_requests=np.hstack(nominal) if robust else None,
        learning=tuple(state for each in plans for state in each.learning),
    )


@dataclass(frozen=True, eq=False, init=False, repr=False)
class _View(ReadOnly, Summarised):
    """A judged joint of a plan, or its foot; [unit] is rad, or m for a foot.

    ``dataclasses.replace`` takes ``requests`` and fields of the plan and of its task.

    Attributes:
        plan: The plan.
        column: Index of the joint; 0 for a foot.
    """

    plan: Plan
    column: int

    def __init__(self, plan: Plan, column: int = 0, **changes: Any) -> None:
        """View a plan; ``changes`` are fields of it, or of its task, that are replaced."""
        if changes:
            if plan.task.goal == "angles":
                plan, column = plan.joint(column), 0
            own = {name: changes.pop(name) for name in plan.__dataclass_fields__ if name in changes}
            if "requests" in own:
                own["requests"] = np.reshape(own["requests"], plan.requests.shape).copy()
            plan = replace(plan, **{"task": replace(plan.task, **changes), **own})
        vars(self).update(plan=plan, column=column)

    def _summarised(self) -> Summary:
        """Requests and errors; the lower bound where it has been computed already."""
        summary = self.plan._summarised()
        head = f"{type(self).__name__}{summary.head.removeprefix('Plan')}"
        return Summary(head, summary.columns, [summary.rows[self.column]])

    @property
    def nominal(self) -> Self | None:
        """With several models: the plan for the nominal ones alone, to compare with."""
        task, nominal = self.plan.task, self.plan.nominal
        several = task.goal == "foot" or len(task.models[self.column]) > 1
        return type(self)(nominal, self.column) if nominal is not None and several else None

    @property
    def method(self) -> Method:
        """The planning method."""
        return self.plan.method

    @property
    def cyclic(self) -> bool:
        """Whether the path repeats for ever."""
        return self.plan.cyclic

    @property
    def norm(self) -> Norm:
        """Error that was minimised, and that the bound and the gap are about."""
        return self.plan.task.norm

    @cached_property
    def requests(self) -> Array:
        """Requests to the joint [rad], shape (n,); for a foot to all joints, (n, k)."""
        return self._own(self.plan.requests)

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact models under them, plus the disturbance [rad], like ``requests``."""
        return self._own(self.plan.predicted)

    @cached_property
    def disturbance(self) -> Array | None:
        """Disturbance of the models' angles in executed cycles [rad], like ``requests``.

        None before any was measured: see :func:`planner.refine`.
        """
        added = self.plan.task.disturbance
        return None if added is None else self._own(added)

    @property
    def rms(self) -> float:
        """Root mean square of the errors [unit]."""
        return float(self.plan.rms[self.column])

    @property
    def max_error(self) -> float:
        """Largest error [unit]."""
        return float(self.plan.max_error[self.column])

    @property
    def error(self) -> float:
        """The error in the plan's norm [unit]; a foot's axes are weighted, the heaviest by 1."""
        return float(self.plan.error[self.column])

    @property
    def errors_of_models(self) -> Array:
        """The error of each model in the plan's norm [unit], the nominal one first, (models,)."""
        return self.plan.errors_of_models[self.column]

    @property
    def over_models(self) -> ErrorsOfModels:
        """The nominal, the mean and the worst of them [unit]."""
        return self.plan.over_models[self.column]

    @property
    def lower_bound(self) -> float:
        """Lower bound on the error of any requests: see :attr:`planner.Plan.lower_bounds`."""
        return float(self.plan.lower_bounds[self.column])

    @property
    def gap(self) -> float:
        """Relative distance from the lower bound; inf where the error is over ten times it."""
        return float(self.plan.gaps[self.column])

    @property
    def learning(self) -> Learning | None:
        """The executed cycles that the plan has learnt from; None where there are none."""
        return self.plan.learning[self.column] if self.plan.learning else None

    @property
    def stopped(self) -> str:
        """Why learning from executed cycles has ended; empty while it goes on, and before it."""
        return "" if self.learning is None else self.learning.stopped

    def _own(self, rows: Array) -> Array:
        """The column of the joint, (n,), of rows (n, k); for a foot all columns."""
        if self.plan.task.goal == "foot":
            return rows
        column = np.ascontiguousarray(rows[:, self.column])
        freeze(column)
        return column


@final
@dataclass(frozen=True, eq=False, init=False, repr=False)
class Inversion(_View):
    """Requests for a desired trajectory of one joint, with the response of the exact model.

    A view of one joint of a :class:`planner.Plan`, which computes every figure.
    """

    @property
    def model(self) -> JointModel:
        """The joint."""
        return self.plan.models[self.column]

    @cached_property
    def desired(self) -> Array:
        """Desired angles [rad], shape (n,)."""
        return self._own(self.plan.desired)

    @cached_property
    def errors(self) -> Array:
        """Predicted minus desired angles [rad], shape (n,)."""
        return self._own(self.plan.errors)

    @property
    def approximation(self) -> PiecewiseLinear | None:
        """The piecewise linear trajectory behind a closed form, else None."""
        return self.plan.approximations[self.column] if self.plan.approximations else None

    @property
    def lead(self) -> float | None:
        """Of a time shift: how early the desired angles are requested [s], else None."""
        return self.plan.leads[self.column] if self.plan.leads else None

    @property
    def expected(self) -> Expectation:
        """Error to expect on the robot: see :attr:`planner.Plan.expected`."""
        return self.plan.expected[self.column]

    @property
    def speeds(self) -> PathSpeeds:
        """Speeds of the desired path, and the joint's top speeds."""
        return self.plan.speeds[self.column]

    @property
    def within_tolerance(self) -> bool:
        """Whether the plan keeps the tolerance, if there is one."""
        return self.plan.task.tolerance is None or self.error <= self.plan.task.tolerance

    @property
    def largest_step(self) -> float:
        """Largest change from one request to the next, cycles closed [rad]."""
        return self.plan.motions[self.column].largest_step

    @property
    def excess(self) -> float:
        """How far the requests go beyond the range of the desired angles [rad]."""
        return self.plan.motions[self.column].beyond_desired


@final
@dataclass(frozen=True, eq=False, init=False, repr=False)
class FootInversion(_View):
    """Requests for all joints of a leg, with the response of the exact models.

    A view of a :class:`planner.Plan` for a foot, which computes every figure.
    """

    @property
    def models(self) -> tuple[JointModel, ...]:
        """The joints, in the leg's order."""
        return self.plan.models

    @property
    def foot(self) -> Array:
        """Predicted position of the foot [m], shape (n, 3)."""
        return self.plan.foot

    @property
    def distances(self) -> Array:
        """Distance of the foot from its desired position, all axes alike [m], shape (n,)."""
        return self.plan.distances

    @property
    def largest_step(self) -> float:
        """Largest change from one request of a joint to its next, cycles closed [rad]."""
        return float(np.max(self.plan.largest_steps))

    def error_of(self, angles: Array) -> float:
        """The error of other angles in the plan's norm [m]; ``angles`` [rad], shape (n, k)."""
        return float(self.plan.task.errors_of(angles)[0])
