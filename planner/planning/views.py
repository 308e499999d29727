"""Views of a plan for one joint or for a foot, and what it has learnt from executed cycles.

The views have the figures that follow from the requests; their ``plan.task`` has the arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self, final

import numpy as np

from planner.trajectory import Array
from planner.validation import ReadOnly, Summarised, Summary, freeze

if TYPE_CHECKING:
    from planner.approximation.curve import PiecewiseLinear
    from planner.model.evidence import Expectation
    from planner.model.joint import JointModel
    from planner.model.response import PathSpeeds
    from planner.planning.plan import Method, Plan
    from planner.planning.task import Norm


class ErrorsOfModels(NamedTuple):
    """Errors of a plan over the models that joints may have, in its norm: [rad], of a foot [m]."""

    nominal: float  # of the nominal model
    mean: float  # root mean square over all models
    worst: float  # the largest


@dataclass(frozen=True, eq=False, init=False, repr=False)
class _View(Summarised):
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

    def __getstate__(self) -> dict[str, Any]:
        """The fields, without cached figures."""
        return {"plan": self.plan, "column": self.column}

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
        """Relative distance from the lower bound; inf where only the bound is zero."""
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
        return self.plan.motions[self.column].beyond


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


UNFORESEEN = 0.2
"""Expected error of a change of the angles by the model, as a share of the change [-]. (Of 33 first
trials on servos from their physics the middle half missed 0.13 to 0.28 of it; by the model alone
their errors were up to five times the predicted ones.)"""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trial(ReadOnly, Summarised):
    """Requests as they were executed, in one cycle or in several.

    Attributes:
        requests: Sent requests [rad], shape (n, k).
        measured: Measured angles of each cycle [rad], shape (cycles, n, k), without known delays of
            the sensors.
        error: Error of the mean cycle, in the norm of the plan: [rad], or [m] for a foot.
    """

    requests: Array
    measured: Array
    error: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze(self.requests, self.measured)

    def _summarised(self) -> Summary:
        """Its cycles and its error."""
        return Summary(f"Trial of {self.cycles} cycles: error {self.error:.4g} rad (foot: m)")

    @property
    def mean(self) -> Array:
        """Mean of the measured cycles [rad], shape (n, k)."""
        mean: Array = self.measured.mean(axis=0)
        return mean

    @property
    def cycles(self) -> int:
        """Number of measured cycles."""
        return len(self.measured)


@dataclass(frozen=True, kw_only=True)
class SensorDelay:
    """The part of the disturbance that late sensors would explain.

    Attributes:
        seconds: The delay of the measured angles behind the model that fits best [s].
        share: Share of the squared disturbance that it explains [-].
        removed: Delay removed from the measured angles before learning [s].
    """

    seconds: float
    share: float
    removed: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Learning(ReadOnly, Summarised):
    """The state of learning: all data, beside the plan, for the next cycle.

    Attributes:
        trials: The executed trials, oldest first.
        noise: Standard deviation of one cycle about the mean of many, rms over samples [rad], (k,).
        gain: Learning gain: share of the last disturbance that the requests compensate, 0 to 1.
        reidentified: The trial after which each joint's model was changed last, one a joint; 0
            for the model of the first plan.
        delays: The effect of a late sensor, for each joint.
        best: The trial from which the requests were computed.
        floor: Error of the best trial that cannot be learnt: ``speed``, from the lower bound of the
            model, and ``noise``, in the unit of the trials' errors; ``nan`` where unknown.
        next_error: Error to expect of one measured cycle of the next requests, in the unit of the
            trials' errors: from the models with the disturbance measured in the best trial, its
            noise and unlearnt part included, and a share of the change by the new requests;
            ``nan`` where unknown.
        stopped: Why learning has ended; empty while it continues.
        remarks: Remarks on the processing of the measurements.
    """

    trials: tuple[Trial, ...]
    noise: Array
    gain: float
    reidentified: tuple[int, ...]
    delays: tuple[SensorDelay, ...]
    best: int
    floor: tuple[float, float]
    next_error: float = math.nan
    stopped: str = ""
    remarks: tuple[str, ...] = ()

    def _summarised(self) -> Summary:
        """The error of each trial, and what is expected of the next, or why there is none."""
        rows = [
            (f"{number}", f"{trial.cycles}", f"{trial.error:.4g}")
            for number, trial in enumerate(self.trials, start=1)
        ]
        rest = f"ended: {self.stopped}" if self.stopped else f"next error {self.next_error:.4g}"
        plural = "s" * (len(rows) > 1)
        head = f"Learning from {len(rows)} trial{plural}, the best is {self.best + 1}; {rest}"
        return Summary(head, ("trial", "cycles", "error [rad, foot: m]"), rows)

    @property
    def errors(self) -> Array:
        """Error of each trial: [rad], or [m] for a foot, shape (trials,)."""
        return np.array([trial.error for trial in self.trials])
