"""Plans that survive a model that is a little wrong: the same requests for several models.

What is known of a joint is never one model exactly: fits of two logs differ, and an identification
has a covariance. Here one column of requests drives all models of the joint, each with angles of
its own, and the cost is the weighted sum of their squared errors,

    minimise  sum_i weight_i |M^i - D|^2 + alpha |S R|^2,    M^i the angles of model i,
                                                            S R second differences of the requests.

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
from planner.model.evidence import GAIN
from planner.model.joint import JointModel, checked_model
from planner.model.load import Loads
from planner.model.sensitivity import Response
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
        pairs: Pairs of models that are drawn from intervals beside the nominal one, either side of
            it.
        largest_radius: Corners of the first stage [theta_0]: the plan for the first model is near.
        smoothing: Weight of the squared second differences of the requests beside the squares of
            the errors in the search [-]: a second difference of a degree counts as an error of 0.03
            degrees. Requests that switch between the top speeds depend less on a joint's gain: with
            a tenth of this weight errors are up to 2 % smaller, for 2.5 times the travel.
        rounds: How often the weights follow the errors for the worst model. (Five: the worst error
            changes by up to 1 %, eight: as good.)
    """

    pairs: int = 4
    largest_radius: float = 0.1
    smoothing: float = 1e-3
    rounds: int = 6


OPTIONS = RobustOptions()

QUANTILE = 1.96
"""Half the width of a 95 % interval [standard deviations]."""


def checked_models(model: ModelOrModels, robust: Robust | None = None) -> tuple[JointModel, ...]:
    """The models that a joint may have, the nominal one first.

    One model stands for itself, unless ``robust`` asks for those that its intervals allow.

    Raises:
        InvalidInput: There is none, one is no JointModel, their request periods differ, the only
            one has no intervals, or ``robust`` does not say which error over the models counts.
    """
    if robust is not None and not is_one_of(robust, get_args(Robust)):
        raise InvalidInput(f"robust: got {shown(robust)}, expected 'mean' or 'worst'")
    if isinstance(model, Identification):
        return drawn_models(model.model)
    if isinstance(model, JointModel) or not isinstance(model, Sequence) or isinstance(model, str):
        only = checked_model(model)
        return (only,) if robust is None else drawn_models(only)
    models = tuple(checked_model(each) for each in model)
    if not models or len({each.period for each in models}) > 1:
        raise InvalidInput(
            f"model: got {len(models)} models with periods of "
            f"{', '.join(f'{each.period:g}' for each in models) or 'nothing'} s, expected at least "
            "one, all of one joint with one request period"
        )
    return models


def drawn_models(model: JointModel, *, pairs: int | None = None) -> tuple[JointModel, ...]:
    """The model, and others that its intervals allow.

    They are drawn from a normal distribution with the intervals' widths, either side by itself, and
    their correlations, but none outside of the intervals; in pairs on either side of the model,
    always the same ones. A parameter does not move towards an end that is not known.

    Args:
        model: The nominal model, with intervals as :attr:`planner.JointModel.evidence`.
        pairs: How many pairs; by default four.

    Raises:
        InvalidInput: The model has no interval with a known end.
    """
    if not has_intervals(model):
        raise InvalidInput(
            "model: got one without intervals of its parameters, from which other models are "
            "drawn; expected one that planner.identify found or planner.read_models read from its "
            "file, or several models"
        )
    evidence = model.evidence
    assert evidence is not None, "a model without intervals was refused"
    names = list(evidence.intervals)
    values = np.array([_value(model, name) for name in names])
    ends = np.array(list(evidence.intervals.values()))
    down, up = np.where(np.isfinite(ends), np.abs(ends - values[:, np.newaxis]), 0.0).T / QUANTILE
    matrix = np.array(evidence.correlations) if evidence.correlations else np.eye(len(names))
    eigenvalues, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0)) @ vectors.T  # unique: symmetric
    rng, moves = np.random.default_rng(0), list[Array]()
    while len(moves) < 2 * (OPTIONS.pairs if pairs is None else pairs):
        move = root @ rng.standard_normal(len(names))
        if np.all(np.abs(move) <= QUANTILE):
            moves += [move, -move]
    return (model, *(_moved(model, names, np.where(z < 0.0, down, up) * z) for z in moves))


def has_intervals(model: JointModel) -> bool:
    """Whether other models can be drawn from what is known of this one."""
    intervals = model.evidence.intervals if model.evidence else {}
    return any(math.isfinite(end) for ends in intervals.values() for end in ends)


def _value(model: JointModel, name: str) -> float:
    """A parameter of the model, or v_max / theta_0."""
    return model.v_max / model.theta_0 if name == GAIN else float(getattr(model, name))


def _moved(model: JointModel, names: Sequence[str], move: Array) -> JointModel:
    """The model with its parameters moved, or half as far where they would describe no joint."""
    moved = {name: _value(model, name) + by for name, by in zip(names, move.tolist(), strict=True)}
    gain = moved.pop(GAIN, None)
    if gain is not None and gain > 0.0:
        moved["theta_0"] = moved.get("v_max", model.v_max) / gain
    try:
        if gain is not None and gain <= 0.0:
            raise InvalidModel(f"v_max / theta_0: got {gain:g}, expected more than 0")
        return replace(model, **moved)
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
        requests: A plan for the first [rad], shape (n, 1). Without dead bands the answer's error
            over all models is no larger than that of this plan.
        robust: Which error over the models counts.
        smoothness: Share of that error which smoother requests may cost.

    Raises:
        SolverFailed: Under no requests all models have a steady cycle.
    """
    stages = [
        each._replace(weight=OPTIONS.smoothing, smoothing=True)
        for each in SEARCH.narrow
        if each.radius <= OPTIONS.largest_radius
    ]
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
        weights = problem.weights * problem.errors_of_models(angles)
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
    before = problem.exact_error(requests)
    return smoothed(answer, best.requests, smoothness=smoothness, at_most=before)
