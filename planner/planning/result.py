"""The result of an inversion: the requests, with the data from which their errors follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.model.evidence import Expectation, expectation
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.arguments import Norm, Solver
from planner.planning.bounds.multipliers import linear_bound
from planner.planning.bounds.reachable_set import BoundProblem
from planner.planning.error_norm import error_norm, largest_step, relative_gap
from planner.planning.trials import Learning
from planner.trajectory import Array
from planner.validation import freeze

Method = Literal["closed_form", "optimal"]


class ErrorsOfModels(NamedTuple):
    """Errors of a plan over the models that joints may have, in its norm: [rad], of a foot [m].

    Attributes:
        nominal: That of the nominal model.
        mean: Root mean square over all models.
        worst: The largest.
    """

    nominal: float
    mean: float
    worst: float

    @classmethod
    def of(cls, errors: Array) -> ErrorsOfModels:
        """Those of the errors of each model, the nominal one first, shape (models,)."""
        return cls(float(errors[0]), error_norm(errors, "rms"), float(np.max(errors)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Inversion:
    """Requests for a desired trajectory, with what the exact model makes of them.

    Every figure is computed from the requests by simulation, whatever solver found them.

    Attributes:
        model: The joint.
        desired: Desired angles [rad], shape (n,).
        requests: What to send to the joint [rad], shape (n,).
        method: How they were found.
        solver: What solved the problem of an optimised plan; None for a closed form.
        cyclic: Whether the trajectory repeats for ever.
        norm: Error that was minimised, and that the bound and the gap are about.
        limits: Smallest and largest request allowed [rad]; None where there was no limit.
        max_step: Largest change allowed from one request to the next [rad]; None for any.
        smoothness: Relative rise of the error that smoother requests were allowed to cost [-].
        models: All models that are judged, the nominal one first; () for that alone.
        robust: Whether the "mean" or the "worst" of their errors was minimised; None where only
            that of the nominal model was.
        nominal: With several models: the plan for the nominal one alone, to compare with.
        start: From rest: angle at which the joint rests before the first request [rad].
        approximation: The piecewise linear trajectory behind a closed form, else None.
        tolerance: Error that was asked for, in the plan's norm [rad]; None where none was.
        load: Torque on the joint in the period that ends in each sample [N m], shape (n,); None
            where there is none, or none of the models feels it.
        load_of_pose: Whether that is the load of the predicted angles. Other requests would meet
            another load, so that there is no lower bound on their error: it is 0, unless the
            nominal model feels no load.
        disturbance: What executed cycles add to the model's angles [rad], shape (n,): see
            :func:`planner.refine`; None before any was measured.
        learning: The executed cycles that the plan has learnt from; None where there are none.
    """

    model: JointModel
    desired: Array
    requests: Array
    method: Method
    solver: Solver | None = None
    cyclic: bool = True
    norm: Norm = "rms"
    limits: tuple[float, float] | None = None
    max_step: float | None = None
    smoothness: float = 0.0
    models: tuple[JointModel, ...] = ()
    robust: Literal["mean", "worst"] | None = None
    nominal: Inversion | None = None
    start: float | None = None
    approximation: PiecewiseLinear | None = None
    tolerance: float | None = None
    load: Array | None = None
    load_of_pose: bool = False
    disturbance: Array | None = None
    learning: Learning | None = None

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Freeze what was copied or read from a pickle."""
        self.__dict__.update(state)
        freeze(*(each for each in state.values() if isinstance(each, np.ndarray)))

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact model under the requests, plus the disturbance [rad], (n,)."""
        angles = simulate(
            self.model, self.requests, cyclic=self.cyclic, start=self.start, load=self.load
        )
        if self.disturbance is not None:
            angles = angles + self.disturbance
            angles.setflags(write=False)
        return angles

    @cached_property
    def errors(self) -> Array:
        """Predicted minus desired angles [rad], shape (n,)."""
        errors = self.predicted - self.desired
        errors.setflags(write=False)
        return errors

    @property
    def rms(self) -> float:
        """Root mean square of the errors [rad]."""
        return error_norm(self.errors, "rms")

    @property
    def max_error(self) -> float:
        """Largest error [rad]."""
        return error_norm(self.errors, "max")

    @property
    def error(self) -> float:
        """The error in the plan's norm [rad]."""
        return error_norm(self.errors, self.norm)

    @cached_property
    def expected(self) -> Expectation:
        """Error to expect on the robot, and in what the plan is outside of what was tested.

        The error is NaN where nothing is known: see :attr:`planner.JointModel.evidence`. That is
        about the model alone, so that it says nothing of a plan that has learnt from cycles.
        """
        return expectation(
            self.model.evidence if self.disturbance is None else None,
            self.desired,
            self.predicted,
            period=self.model.period,
            cyclic=self.cyclic,
            load=self.load,
        )

    @cached_property
    def errors_of_models(self) -> Array:
        """The error of each model in the plan's norm [rad], the nominal one first, (models,)."""
        others = [replace(self, model=each, models=()).error for each in self.models[1:]]
        errors = np.array([self.error, *others])
        errors.setflags(write=False)
        return errors

    @property
    def over_models(self) -> ErrorsOfModels:
        """The nominal, the mean and the worst of them [rad]."""
        return ErrorsOfModels.of(self.errors_of_models)

    @property
    def worst_error(self) -> float:
        """The worst of them [rad]."""
        return self.over_models.worst

    @cached_property
    def lower_bound(self) -> float:
        """Lower bound on the error of any requests, in the plan's norm [rad].

        Level "envelope", with inertia "slope".
        """
        if self.load_of_pose and self.model.feels_load:
            return 0.0
        goal = self.desired if self.disturbance is None else self.desired - self.disturbance
        problem = BoundProblem(self.model, goal, self.cyclic, self.norm, self.start, self.load)
        return linear_bound(problem, "envelope")

    @property
    def stopped(self) -> str:
        """Why learning from executed cycles has ended; empty while it goes on, and before it."""
        return "" if self.learning is None else self.learning.stopped

    @property
    def gap(self) -> float:
        """Relative distance from the lower bound; inf where only the bound is zero."""
        return relative_gap(self.error, self.lower_bound)

    @property
    def within_tolerance(self) -> bool:
        """Whether the plan keeps the tolerance that was asked for, if one was."""
        return self.tolerance is None or self.error <= self.tolerance

    @property
    def largest_step(self) -> float:
        """Largest change from one request to the next, cycles closed [rad]."""
        return largest_step(self.requests, cyclic=self.cyclic)

    @property
    def excess(self) -> float:
        """How far the requests go beyond the range of the desired angles [rad]."""
        below = np.min(self.desired) - np.min(self.requests)
        above = np.max(self.requests) - np.max(self.desired)
        return float(max(below, above, 0.0))
