"""Plans that survive a model that is a little wrong: the same requests for several models.

What is known of a joint is never one model exactly: fits of two logs differ, and an identification
has a covariance. Here one column of requests drives all models of the joint, each with angles of
its own, and the cost is the weighted sum of their squared errors,

    minimise  sum_i omega_i |M^i - D|^2 + alpha |R - R*|^2,    M^i the angles of model i.

With even weights that is the mean over the models. For the worst model the weights follow the
errors: those of models with larger errors grow until none stands out (C. L. Lawson's algorithm, as
in J. R. Rice, K. H. Usow, *Mathematics of Computation* 22, 1968).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from planner.exceptions import InvalidInput, InvalidModel, SolverFailed
from planner.identification.result import Identification
from planner.inversion.error_norm import error_norm
from planner.inversion.gauss_newton import OPTIONS as SEARCH
from planner.inversion.gauss_newton import State, minimise
from planner.inversion.smoothing import smoothed
from planner.inversion.tracking_problem import Errors, TrackingProblem
from planner.model.joint import JointModel, checked_model
from planner.model.load import Loads
from planner.model.sensitivity import Response
from planner.trajectory import Array
from planner.validation import is_one_of, shown

Robust = Literal["mean", "worst"]
"""Which error over several models is made small."""

ModelOrModels = JointModel | Sequence[JointModel] | Identification
"""A joint: its model, several that it may be, or an identification, from which they are drawn."""


@dataclass(frozen=True, kw_only=True)
class RobustOptions:
    """What steers plans for several models.

    Attributes:
        pairs: Pairs of models that are drawn from an identification beside its own, either side of
            it.
        largest_radius: Corners of the first stage [theta_0]: the plan for the first model is near.
        rounds: How often the weights follow the errors for the worst model.
        exponent: Power of a model's error by which its weight grows in a round.
    """

    pairs: int = 4
    largest_radius: float = 0.1
    rounds: int = 6
    exponent: float = 2.0


OPTIONS = RobustOptions()

QUANTILE = 1.96
"""Half the width of a 95 % interval [standard deviations]."""


def checked_models(model: ModelOrModels) -> tuple[JointModel, ...]:
    """The models that a joint may have, the nominal one first.

    Raises:
        InvalidInput: There is none, one is no JointModel, or their request periods differ.
    """
    if isinstance(model, Identification):
        return drawn_models(model)
    if isinstance(model, JointModel) or not isinstance(model, Sequence) or isinstance(model, str):
        return (checked_model(model),)
    models = tuple(checked_model(each) for each in model)
    if not models or len({each.period for each in models}) > 1:
        raise InvalidInput(
            f"model: got {len(models)} models with periods of "
            f"{', '.join(f'{each.period:g}' for each in models) or 'nothing'} s, expected at least "
            "one, all of one joint with one request period"
        )
    return models


def check_robust(robust: str) -> None:
    """Raise InvalidInput unless ``robust`` says which error over the models counts."""
    if not is_one_of(robust, get_args(Robust)):
        raise InvalidInput(f"robust: got {shown(robust)}, expected 'mean' or 'worst'")


def drawn_models(
    identification: Identification, *, pairs: int | None = None
) -> tuple[JointModel, ...]:
    """The model of an identification, and others that its data does not distinguish from it.

    They are drawn from a normal distribution with the covariance of the parameters, in pairs on
    either side of the model, always the same ones; where there is no covariance, because a
    parameter is not determined, each from its 95 % interval, if that is bounded.

    Args:
        identification: What was found.
        pairs: How many pairs; by default four.
    """
    model, names = identification.model, list(identification.intervals)
    covariance = identification.covariance
    if covariance is None:
        ends = identification.intervals.values()
        widths = [each.upper - each.lower if each.bounded else 0.0 for each in ends]
        covariance = np.diag((np.array(widths) / (2.0 * QUANTILE)) ** 2)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    count = OPTIONS.pairs if pairs is None else pairs
    normal = np.random.default_rng(0).standard_normal((count, len(names)))
    moves = [sign * (root @ each) for each in normal for sign in (1.0, -1.0)]
    return (model, *(_moved(model, names, move) for move in moves))


def _moved(model: JointModel, names: Sequence[str], move: Array) -> JointModel:
    """The model with its parameters moved, or half as far where they would describe no joint."""
    try:
        changes = zip(names, move.tolist(), strict=True)
        return replace(model, **{name: getattr(model, name) + by for name, by in changes})
    except InvalidModel:
        return _moved(model, names, move / 2.0)


class RobustProblem(TrackingProblem):
    """One joint that may be any of several models, under the same requests.

    Requests have shape (n, 1), angles (n, models).
    """

    def __init__(
        self,
        nominal: TrackingProblem,
        models: Sequence[JointModel],
        loads: Loads,
        robust: Robust,
        weights: Array,
    ) -> None:
        """Take the problem of the nominal model, and load and weight of each; weights sum to 1."""
        self.nominal, self.robust, self.weights = nominal, robust, weights
        super().__init__(
            models,
            FollowWithAll(nominal.desired, weights),
            nominal.desired,
            cyclic=nominal.cyclic,
            norm=nominal.norm,
            limits=(nominal.lower, nominal.upper),
            max_step=nominal.max_step,
            start=nominal.start,
            ridge=nominal.ridge,
            loads=loads,
        )

    def admissible(self, requests: Array) -> Array:
        """Requests within the limits [rad], (n, 1); from rest the first holds the nominal model."""
        return self.nominal.admissible(requests)

    def resting_requests(self) -> Array:
        """Requests that hold the nominal model at the desired angles [rad], (n, 1)."""
        return self.nominal.resting

    @cached_property
    def coupled(self) -> bool:
        """True: requests are coupled by the models that they drive."""
        return True

    def errors_of_models(self, angles: Array) -> Array:
        """The error of each model, in the norm that counts [rad], (models,)."""
        return np.array([error_norm(each, self.norm) for each in (angles - self.desired).T])

    def error(self, angles: Array) -> float:
        """The error that counts: root mean square over the models, or that of the worst."""
        errors = self.errors_of_models(angles)
        return float(np.max(errors)) if self.robust == "worst" else error_norm(errors, "rms")

    def exact_angles(self, requests: Array, boundary: Array | None = None) -> Array | None:
        """Angles of all models [rad], (n, models); None where one has no steady cycle."""
        everywhere = np.repeat(requests, len(self.models), axis=1)
        return self._all.exact_angles(everywhere, boundary)

    def respond(self, angles: Array, requests: Array, *, radius: float) -> Response:
        """Where every request period of the smoothed models leads from these angles."""
        everywhere = np.repeat(requests, len(self.models), axis=1)
        return self._all.respond(angles, everywhere, radius=radius)

    @cached_property
    def _all(self) -> TrackingProblem:
        """The models as joints with requests of their own, which are the same."""
        count = len(self.models)
        return TrackingProblem(
            self.models,
            self.goal,
            np.repeat(self.desired, count, axis=1),
            cyclic=self.cyclic,
            start=None if self.start is None else np.repeat(self.start, count),
            loads=self.loads,
        )


class FollowWithAll:
    """Several models that should follow the same desired angles; see the module's equation."""

    def __init__(self, desired: Array, weights: Array) -> None:
        """Take the desired angles [rad], shape (n, 1), and the weight of each model."""
        self.desired = desired
        self._roots = np.sqrt(weights)
        self._jacobian = np.diag(self._roots)

    def distances(self, angles: Array) -> Array:
        """Weighted root of the squared errors over the models [rad], (n,)."""
        distances: Array = np.linalg.norm((angles - self.desired) * self._roots, axis=1)
        return distances

    def errors(self, angles: Array) -> Errors:
        """Angles minus desired, each times the root of its model's weight [rad]."""
        values = (angles - self.desired) * self._roots
        return Errors(values, np.broadcast_to(self._jacobian, (len(angles), *self._jacobian.shape)))


def robust_requests(
    nominal: TrackingProblem,
    models: Sequence[JointModel],
    loads: Loads,
    requests: Array,
    *,
    robust: Robust,
    smoothness: float,
) -> Array:
    """Requests with a small error over all models, from those of the nominal one on.

    Args:
        nominal: The problem of the first model.
        models: The models.
        loads: Torque on the joint as each model feels it [N m], (n,), or None.
        requests: A plan for the first [rad], shape (n, 1).
        robust: Which error over the models counts.
        smoothness: Share of that error which smoother requests may cost.

    Raises:
        SolverFailed: Under no requests all models have a steady cycle.
    """
    stages = [each for each in SEARCH.narrow if each.radius <= OPTIONS.largest_radius]
    even = np.full(len(models), 1.0 / len(models))
    problem = RobustProblem(nominal, models, loads, robust, even)
    angles = problem.exact_angles(requests)
    state = State(requests, np.repeat(nominal.desired, len(models), axis=1))
    state = state if angles is None else state._replace(angles=angles)
    best, least = minimise(problem, state, stages)
    state, answer = best, problem
    for _ in range(OPTIONS.rounds if robust == "worst" else 0):
        angles = problem.exact_angles(state.requests)
        if angles is None:
            break
        weights = problem.weights * problem.errors_of_models(angles) ** OPTIONS.exponent
        if not np.sum(weights) > 0.0:
            break
        problem = RobustProblem(nominal, models, loads, robust, weights / np.sum(weights))
        state, error = minimise(problem, State(state.requests, angles), stages[-3:])
        if error < least:
            best, least, answer = state, error, problem
    if not math.isfinite(least):
        raise SolverFailed(
            "optimised inversion", "no requests lead to a steady cycle of all models"
        )
    return smoothed(answer, best.requests, smoothness=smoothness)
