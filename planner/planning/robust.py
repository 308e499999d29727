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
from typing import Any, Literal, get_args

import numpy as np

from planner.exceptions import InvalidInput, SolverFailed
from planner.identification.result import Identification
from planner.model.drawn_models import drawn_models
from planner.model.joint import JointModel, checked_model
from planner.model.load import Loads
from planner.model.sensitivity import Response
from planner.planning.arguments import Norm, model_of_each
from planner.planning.error_norm import error_norm
from planner.planning.gauss_newton import OPTIONS as SEARCH
from planner.planning.gauss_newton import Stage, State, minimise
from planner.planning.smoothing import smoothed
from planner.planning.tracking_problem import Errors, Goal, TrackingProblem
from planner.trajectory import Array
from planner.validation import is_one_of, shown

Robust = Literal["mean", "worst"]
"""Which error over several models is made small."""

ModelOrModels = JointModel | Sequence[JointModel] | Identification
"""A joint: its model, several that it may have, or an identification, whose intervals give them."""


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


def checked_models(model: ModelOrModels, robust: Robust | None = None) -> tuple[JointModel, ...]:
    """The models that a joint may have, the nominal one first.

    A model by itself is the only one, unless ``robust`` asks for those that its intervals allow. A
    sequence has all of them: of one, the joint has that model in any case. Those of an
    identification are always drawn from its intervals.

    Raises:
        InvalidInput: There is none, one is no JointModel, their request periods differ, one by
            itself has no intervals, or ``robust`` does not say which error over the models counts,
            or is given for a sequence of one.
    """
    _check_robust(robust)
    models = _models_of(model, robust)
    _check_several(robust, [models])
    return models


def _check_robust(robust: Robust | None) -> None:
    if robust is not None and not is_one_of(robust, get_args(Robust)):
        raise InvalidInput(f"robust: got {shown(robust)}, expected 'mean' or 'worst'")


def _check_several(robust: Robust | None, models: Sequence[tuple[JointModel, ...]]) -> None:
    """Raise InvalidInput if ``robust`` is given and every joint has one model in any case."""
    if robust is not None and all(len(each) == 1 for each in models):
        raise InvalidInput(
            f"robust: got {robust!r} for a sequence of one model, which the joint has in any case; "
            "expected several models, or the model by itself, from whose intervals others are drawn"
        )


def _models_of(
    model: ModelOrModels, robust: Robust | None, *, seed: int = 0
) -> tuple[JointModel, ...]:
    """The models of :func:`checked_models`; ``seed`` is that of :func:`drawn_models`."""
    if isinstance(model, Identification):
        return drawn_models(model.model, seed=seed)
    if isinstance(model, JointModel) or not isinstance(model, Sequence) or isinstance(model, str):
        only = checked_model(model)
        return (only,) if robust is None else drawn_models(only, seed=seed)
    models = tuple(checked_model(each) for each in model)
    if not models or len({each.period for each in models}) > 1:
        raise InvalidInput(
            f"model: got {len(models)} models with periods of "
            f"{', '.join(f'{each.period:g}' for each in models) or 'nothing'} s, expected at least "
            "one, all of one joint with one request period"
        )
    return models


def models_of_joints(
    models: ModelOrModels | Sequence[ModelOrModels],
    count: int,
    robust: Robust | None = None,
    *,
    joints: str,
    independent: bool = False,
) -> list[tuple[JointModel, ...]]:
    """The models that each joint may have, the nominal one first, in the order of the joints.

    Args:
        models: One for all joints, or a sequence with one for each; in the place of one several
            that the joint may have, or an identification, see :func:`checked_models`. For one joint
            a flat sequence of more than one is such a place.
        count: How many joints there are.
        robust: Whether others are drawn for models by themselves.
        joints: What has a joint each, in words.
        independent: Whether the models of different joints are drawn independently of one another.
            Joints with the same model share what is not known of it.

    Raises:
        InvalidInput: They do not fit the joints, or see :func:`checked_models`.
    """
    _check_robust(robust)
    given: list[Any]
    if isinstance(models, JointModel | Identification):
        given = [models] * count
    else:
        try:
            given = list(models)
        except TypeError:
            given = []
        if count == 1 and len(given) > 1:
            given = [given]
        fits = all(isinstance(each, JointModel | Identification | Sequence) for each in given)
        fits = fits and not any(isinstance(each, str) for each in given)
        if len(given) != count or not fits:
            model_of_each(models, count, given_as="models", joints=joints)  # type: ignore[arg-type]
    known = [_what_is_known(each) for each in given]
    seeds = [known.index(each) if independent else 0 for each in known]
    several = [_models_of(each, robust, seed=seed) for each, seed in zip(given, seeds, strict=True)]
    _check_several(robust, several)
    return several


def _what_is_known(model: ModelOrModels) -> object:
    """What models are drawn from, to compare."""
    model = model.model if isinstance(model, Identification) else model
    return (model, model.evidence) if isinstance(model, JointModel) else model


Scenarios = tuple[tuple[JointModel, ...], ...]
"""Models of all joints that are planned together, the nominal ones first: one for each joint in
each scenario."""


def scenarios_of(
    models: ModelOrModels | Sequence[ModelOrModels],
    count: int,
    robust: Robust | None = None,
    *,
    joints: str,
) -> Scenarios:
    """The scenarios of joints that are planned together.

    The models of a joint are taken in their order; a joint with one model has it in all scenarios.
    The arguments are those of :func:`models_of_joints`.

    Raises:
        InvalidInput: As there, or joints with several models have different numbers of them.
    """
    several = models_of_joints(models, count, robust, joints=joints, independent=True)
    numbers = {len(each) for each in several} - {1}
    if len(numbers) > 1:
        raise InvalidInput(
            f"models: got {', '.join(str(len(each)) for each in several)} of the {joints}, "
            "expected as many of each, taken in their order, or one where a joint has but one"
        )
    most = max(numbers, default=1)
    return tuple(
        zip(*(each if len(each) == most else each * most for each in several), strict=True)
    )


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
