"""The result of an inversion: the requests, with the data from which their errors follow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.inversion.arguments import Norm, Solver
from planner.inversion.bounds.multipliers import linear_bound
from planner.inversion.bounds.reachable_set import BoundProblem
from planner.inversion.error_norm import error_norm, relative_gap
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.trajectory import Array

Method = Literal["closed_form", "optimal"]


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
        start: From rest: angle at which the joint rests before the first request [rad].
        approximation: The piecewise linear trajectory behind a closed form, else None.
        tolerance: Error that was asked for, in the plan's norm [rad]; None where none was.
    """

    model: JointModel
    desired: Array
    requests: Array
    method: Method
    solver: Solver | None = None
    cyclic: bool = True
    norm: Norm = "rms"
    limits: tuple[float, float] | None = None
    start: float | None = None
    approximation: PiecewiseLinear | None = None
    tolerance: float | None = None

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact model under the requests [rad], shape (n,)."""
        return simulate(self.model, self.requests, cyclic=self.cyclic, start=self.start)

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
    def lower_bound(self) -> float:
        """Lower bound on the error of any requests, in the plan's norm [rad]: level "envelope"."""
        problem = BoundProblem(self.model, self.desired, self.cyclic, self.norm, self.start)
        return linear_bound(problem, "envelope")

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
        previous = np.roll(self.requests, 1) if self.cyclic else self.requests[:-1]
        following = self.requests if self.cyclic else self.requests[1:]
        return float(np.max(np.abs(following - previous)))

    @property
    def excess(self) -> float:
        """How far the requests go beyond the range of the desired angles [rad]."""
        below = np.min(self.desired) - np.min(self.requests)
        above = np.max(self.requests) - np.max(self.desired)
        return float(max(below, above, 0.0))
