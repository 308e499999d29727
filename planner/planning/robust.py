"""Plans that survive a model that is a little wrong: the same requests for several models.

What is known of a joint is never one model exactly: fits of two logs differ, and an identification
has a covariance. A scenario is one model for each joint that is planned, of one joint or of all
joints of a leg. The same requests drive the joints of every scenario, each with angles of its own,
and the cost is the weighted sum of their squared errors,

    minimise  sum_i weight_i |e(M^i)|^2 + alpha |S R|^2,    M^i the angles in scenario i,
                                                           e their errors, of a joint or of a foot,
                                                           S R second differences of the requests.

With even weights that is the mean over the scenarios. For the worst one the weights follow the
errors: those of scenarios with larger errors grow until none stands out (C. L. Lawson's algorithm,
as in J. R. Rice, K. H. Usow, *Mathematics of Computation* 22, 1968).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.exceptions import SolverFailed
from planner.model.load import Loads
from planner.model.sensitivity import Response
from planner.planning.arguments import Norm, Robust
from planner.planning.error_norm import error_norm
from planner.planning.gauss_newton import OPTIONS as SEARCH
from planner.planning.gauss_newton import Stage, State, minimise
from planner.planning.smoothing import smoothed
from planner.planning.task import Scenarios
from planner.planning.tracking_problem import Errors, Goal, TrackingProblem
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class RobustOptions:
    """What steers plans for several models.

    Attributes:
        largest_radius: Corners of the first stage [theta_0]: the plan for the first model is near.
            Over 19 joints and 5 feet, half: their errors fall by 1 % less; 0.5: as good.
        smoothing: Weight of the squared second differences of the requests beside the squares of
            the errors in the search [-]: a second difference of a degree counts as an error of 0.03
            degrees. Requests that switch between the top speeds depend less on a joint's gain: with
            a tenth of this weight errors are up to 2 % smaller, for 2.5 times the travel.
        rounds: How often the weights follow the errors for the worst model. (Five: the worst error
            changes by up to 1 %, eight: as good.)
        sharpened: How many of the search's stages, the last ones, follow new weights: those of
            sharp corners, as the requests before are near.
    """

    largest_radius: float = 0.2
    smoothing: float = 1e-3
    rounds: int = 6
    sharpened: int = 3


OPTIONS = RobustOptions()


class RobustProblem(TrackingProblem):
    """Joints that may be those of any of several scenarios, under the same requests.

    Requests have shape (n, joints), angles (n, scenarios * joints), one scenario after the other.
    """

    def __init__(
        self,
        nominal: TrackingProblem,
        scenarios: Scenarios,
        loads: Sequence[Loads],
        robust: Robust,
        weights: Array,
    ) -> None:
        """Take the problem of the nominal models, and loads and weight of each scenario.

        The weights sum to 1.
        """
        self.nominal, self.scenarios, self.robust = nominal, scenarios, robust
        self.weights, self._loads = weights, loads
        super().__init__(
            [model for scenario in scenarios for model in scenario],
            ReachInAll(nominal.goal, weights),
            nominal.desired,
            cyclic=nominal.cyclic,
            norm=nominal.norm,
            limits=(nominal.lower, nominal.upper),
            max_step=nominal.max_step,
            start=nominal.start,
            first=nominal.first,
            ridge=nominal.ridge,
            loads=[load for each in loads for load in each],
        )

    def weighted(self, weights: Array) -> RobustProblem:
        """The same problem with other weights."""
        return RobustProblem(self.nominal, self.scenarios, self._loads, self.robust, weights)

    def _changed(self, limits: tuple[Array, Array], norm: Norm) -> RobustProblem:
        nominal = self.nominal.within(limits).with_norm(norm)
        return RobustProblem(nominal, self.scenarios, self._loads, self.robust, self.weights)

    def admissible(self, requests: Array) -> Array:
        """Requests within the limits [rad]; from rest the first ones hold the nominal models."""
        return self.nominal.admissible(requests)

    def resting_requests(self) -> Array:
        """Requests that hold the nominal models at the desired angles [rad], (n, joints)."""
        return self.nominal.resting

    @cached_property
    def coupled(self) -> bool:
        """True: requests are coupled by the models that they drive."""
        return True

    def errors_of_models(self, angles: Array) -> Array:
        """The error in each scenario, in the norm that counts [rad], (scenarios,)."""
        return np.array(
            [
                self.nominal.error(each)
                for each in np.split(self.angles_of(angles), len(self.scenarios), axis=1)
            ]
        )

    def error(self, angles: Array) -> float:
        """The error that counts: root mean square over the scenarios, or that of the worst."""
        errors = self.errors_of_models(angles)
        return float(np.max(errors)) if self.robust == "worst" else error_norm(errors, "rms")

    def exact_angles(self, requests: Array) -> Array | None:
        """Angles of all models [rad]; None where one has no steady cycle."""
        return self._all.exact_angles(self.in_all(requests))

    def respond(self, angles: Array, requests: Array, *, radius: float) -> Response:
        """Where every request period of the smoothed models leads from these angles."""
        return self._all.respond(angles, self.in_all(requests), radius=radius)

    def in_all(self, columns: Array) -> Array:
        """Columns of the joints, repeated for each scenario."""
        return np.tile(columns, len(self.scenarios))

    @cached_property
    def _all(self) -> TrackingProblem:
        """The models as joints with requests of their own, which are the same."""
        return TrackingProblem(
            self.models,
            self.goal,
            self.in_all(self.desired),
            cyclic=self.cyclic,
            start=None if self.start is None else self.in_all(self.start),
            loads=self.loads,
        )


class ReachInAll:
    """The same goal in all scenarios; see the module's equation."""

    def __init__(self, goal: Goal, weights: Array) -> None:
        """Take what the joints should do in each scenario, and the scenarios' weights."""
        self._goal = goal
        self.shared = goal.shared
        self._roots = np.sqrt(weights)

    def distances(self, angles: Array) -> Array:
        """Weighted root of the squared distances over the scenarios [rad], (n,)."""
        each = [self._goal.distances(own) for own in self._split(angles)]
        distances: Array = np.linalg.norm(self._roots[:, np.newaxis] * each, axis=0)
        return distances

    def errors(self, angles: Array) -> Errors:
        """The errors in each scenario, times the root of its weight [rad]."""
        each = [self._goal.errors(own) for own in self._split(angles)]
        values = np.concatenate(
            [root * own.values for root, own in zip(self._roots, each, strict=True)], axis=1
        )
        samples, rows, columns = each[0].jacobians.shape
        jacobians = np.zeros((samples, len(each), rows, len(each), columns))
        for number, (root, own) in enumerate(zip(self._roots, each, strict=True)):
            jacobians[:, number, :, number] = root * own.jacobians
        return Errors(values, jacobians.reshape(samples, values.shape[1], angles.shape[1]))

    def _split(self, angles: Array) -> list[Array]:
        return np.split(angles, len(self._roots), axis=1)


def robust_requests(
    nominal: TrackingProblem,
    scenarios: Scenarios,
    loads: Sequence[Loads],
    requests: Array,
    *,
    robust: Robust,
    smoothness: float,
    search: Sequence[Stage] = SEARCH.narrow,
) -> Array:
    """Requests with a small error over all scenarios, from those of the nominal one on.

    Args:
        nominal: The problem of the nominal models.
        scenarios: The models of the joints in each scenario.
        loads: Torques on the joints as the models of each scenario feel them.
        requests: A plan for the nominal models [rad], shape (n, joints). Without dead bands the
            answer's error over all scenarios is no larger than that of this plan.
        robust: Which error over the scenarios counts.
        smoothness: Share of that error which smoother requests may cost.
        search: The stages, of which those with small corners are gone through.

    Raises:
        SolverFailed: Under no requests all models have a steady cycle.
    """
    stages = [
        each._replace(weight=OPTIONS.smoothing, smoothing=True)
        for each in search
        if each.radius <= OPTIONS.largest_radius
    ]
    even = np.full(len(scenarios), 1.0 / len(scenarios))
    problem = RobustProblem(nominal, scenarios, loads, robust, even)
    angles = problem.exact_angles(requests)
    state = State(requests, problem.in_all(nominal.desired) if angles is None else angles)
    best, least = minimise(problem, state, stages)
    state, answer, sharp = best, problem, stages[-OPTIONS.sharpened :]
    for _ in range(OPTIONS.rounds if robust == "worst" else 0):
        angles = problem.exact_angles(state.requests)
        if angles is None:
            break
        weights = problem.weights * problem.errors_of_models(angles)
        if not np.sum(weights) > 0.0:
            break
        problem = problem.weighted(weights / np.sum(weights))
        state, error = minimise(problem, State(state.requests, angles), sharp)
        if error < least:
            best, least, answer = state, error, problem
    if not math.isfinite(least):
        raise SolverFailed(
            "optimised inversion", "no requests lead to a steady cycle of all models"
        )
    before = problem.exact_error(requests)
    return smoothed(answer, best.requests, smoothness=smoothness, at_most=before)
