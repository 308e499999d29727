"""Views of a plan for one joint or for a foot, and what it has learnt from executed cycles.

The views have the figures that follow from the requests; their ``plan.task`` has the arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar, final

import numpy as np

from planner.trajectory import Array
from planner.validation import ReadOnly, Summarised, Summary, freeze

if TYPE_CHECKING:
    from planner.planning.plan import Plan


class ErrorsOfModels(NamedTuple):
    """Errors of a plan over the models that joints may have, in its norm: [rad], of a foot [m]."""

    nominal: float  # of the nominal model
    mean: float  # root mean square over all models
    worst: float  # the largest


T = TypeVar("T")


class _Figure(cached_property[T]):
    """A figure of a view, from its plan and the column of its joint; ``words`` describe it."""

    def __init__(self, of: Callable[[Plan, int], T], words: str) -> None:
        super().__init__(lambda view: of(view.plan, view.column))
        self.__doc__ = words


def _own(rows: Array, plan: Plan, column: int) -> Array:
    """The column of a joint, (n,), of rows (n, k); for a foot all columns."""
    if plan.task.goal == "foot":
        return rows
    own = np.ascontiguousarray(rows[:, column])
    freeze(own)
    return own


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

    method = _Figure(lambda plan, _: plan.method, "The planning method.")
    cyclic = _Figure(lambda plan, _: plan.cyclic, "Whether the path repeats for ever.")
    norm = _Figure(
        lambda plan, _: plan.task.norm,
        "Error that was minimised, and that the bound and the gap are about.",
    )
    requests = _Figure(
        lambda plan, j: _own(plan.requests, plan, j),
        "Requests to the joint [rad], shape (n,); for a foot to all joints, (n, k).",
    )
    predicted = _Figure(
        lambda plan, j: _own(plan.predicted, plan, j),
        "Angles of the exact models under them, plus the disturbance [rad], like ``requests``.",
    )
    disturbance = _Figure(
        lambda plan, j: (
            None if plan.task.disturbance is None else _own(plan.task.disturbance, plan, j)
        ),
        "Disturbance of the models' angles in executed cycles [rad], like ``requests``; None before"
        " any was measured: see :func:`planner.refine`.",
    )
    rms = _Figure(lambda plan, j: float(plan.rms[j]), "Root mean square of the errors [unit].")
    max_error = _Figure(lambda plan, j: float(plan.max_error[j]), "Largest error [unit].")
    error = _Figure(
        lambda plan, j: float(plan.error[j]),
        "The error in the plan's norm [unit]; a foot's axes are weighted, the heaviest by 1.",
    )
    errors_of_models = _Figure(
        lambda plan, j: plan.errors_of_models[j],
        "The error of each model in the plan's norm [unit], the nominal one first, (models,).",
    )
    over_models = _Figure(
        lambda plan, j: plan.over_models[j], "The nominal, the mean and the worst of them [unit]."
    )
    lower_bound = _Figure(
        lambda plan, j: float(plan.lower_bounds[j]),
        "Lower bound on the error of any requests: see :attr:`planner.Plan.lower_bounds`.",
    )
    gap = _Figure(
        lambda plan, j: float(plan.gaps[j]),
        "Relative distance from the lower bound; inf where only the bound is zero.",
    )
    learning = _Figure(
        lambda plan, j: plan.learning[j] if plan.learning else None,
        "The executed cycles that the plan has learnt from; None where there are none.",
    )
    stopped = _Figure(
        lambda plan, j: plan.learning[j].stopped if plan.learning else "",
        "Why learning from executed cycles has ended; empty while it goes on, and before it.",
    )


@final
@dataclass(frozen=True, eq=False, init=False, repr=False)
class Inversion(_View):
    """Requests for a desired trajectory of one joint, with the response of the exact model.

    A view of one joint of a :class:`planner.Plan`, which computes every figure.
    """

    model = _Figure(lambda plan, j: plan.models[j], "The joint.")
    desired = _Figure(
        lambda plan, j: _own(plan.desired, plan, j), "Desired angles [rad], shape (n,)."
    )
    errors = _Figure(
        lambda plan, j: _own(plan.errors, plan, j), "Predicted minus desired angles [rad], (n,)."
    )
    approximation = _Figure(
        lambda plan, j: plan.approximations[j] if plan.approximations else None,
        "The piecewise linear trajectory behind a closed form, else None.",
    )
    lead = _Figure(
        lambda plan, j: plan.leads[j] if plan.leads else None,
        "Of a time shift: how early the desired angles are requested [s], else None.",
    )
    expected = _Figure(
        lambda plan, j: plan.expected[j],
        "Error to expect on the robot: see :attr:`planner.Plan.expected`.",
    )
    speeds = _Figure(
        lambda plan, j: plan.speeds[j], "Speeds of the desired path, and the joint's top speeds."
    )
    within_tolerance = _Figure(
        lambda plan, j: plan.task.tolerance is None or bool(plan.error[j] <= plan.task.tolerance),
        "Whether the plan keeps the tolerance, if there is one.",
    )
    largest_step = _Figure(
        lambda plan, j: plan.motions[j].largest_step,
        "Largest change from one request to the next, cycles closed [rad].",
    )
    excess = _Figure(
        lambda plan, j: plan.motions[j].beyond,
        "How far the requests go beyond the range of the desired angles [rad].",
    )


@final
@dataclass(frozen=True, eq=False, init=False, repr=False)
class FootInversion(_View):
    """Requests for all joints of a leg, with the response of the exact models.

    A view of a :class:`planner.Plan` for a foot, which computes every figure.
    """

    models = _Figure(lambda plan, _: plan.models, "The joints, in the leg's order.")
    foot = _Figure(lambda plan, _: plan.foot, "Predicted position of the foot [m], shape (n, 3).")
    distances = _Figure(
        lambda plan, _: plan.distances,
        "Distance of the foot from its desired position, all axes alike [m], shape (n,).",
    )
    largest_step = _Figure(
        lambda plan, _: float(np.max(plan.largest_steps)),
        "Largest change from one request of a joint to its next, cycles closed [rad].",
    )

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
