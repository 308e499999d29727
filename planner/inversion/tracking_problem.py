"""The problem of the optimised inversion: reach a goal with requests within limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.inversion.arguments import Limits, Norm
from planner.inversion.error_norm import error_norm
from planner.model.joint import JointModel, RequestAges, acting, request_ages
from planner.model.response import steady_cycle
from planner.model.sensitivity import Response, periods, request_ages_of_all
from planner.model.symbolic import exact_run
from planner.trajectory import Array

Indices = npt.NDArray[np.int_]


class TrackingProblem:
    """Joints that should reach a goal by requests within limits: (10) of ``docs/math.md``.

    Attributes:
        models: The joints, whose requests are sent together.
        goal: What they should do.
        resting: Requests that would hold the desired angles, R* of (10) [rad], (n, joints).
        cyclic: Whether the trajectory repeats for ever.
        norm: The error that counts.
        lower, upper: Limits on the requests [rad], shape (joints,).
        start: From rest: angles at which the joints rest before the plan [rad], shape (joints,).
        movable: Requests that may be chosen, shape (n, joints): from rest the first ones hold the
            joints where they are.
        ridge: Curvature added to the goal's, where it does not see every angle.
    """

    def __init__(
        self,
        models: Sequence[JointModel],
        goal: Goal,
        resting: Array,
        *,
        cyclic: bool,
        norm: Norm = "rms",
        limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        start: Array | None = None,
        ridge: float = 0.0,
    ) -> None:
        """Take the problem as it is: the callers have checked it."""
        self.models = tuple(models)
        self.goal = goal
        self.cyclic = cyclic
        self.norm = norm
        limits = (-math.inf, math.inf) if limits is None else limits
        self.lower, self.upper = (np.asarray(limit, dtype=np.float64) for limit in limits)
        self.start = start
        self.offsets = np.array([model.offset for model in self.models])
        self.resting = self.admissible(resting)
        self.ridge = ridge
        self.movable = np.ones(resting.shape, dtype=np.bool_)
        if not cyclic:
            self.movable[0] = False

    @cached_property
    def limited(self) -> bool:
        """Whether any request has a limit."""
        return bool(np.any(np.isfinite(self.lower)) or np.any(np.isfinite(self.upper)))

    def within(self, limits: tuple[Array, Array]) -> TrackingProblem:
        """The same problem with other limits."""
        return self._changed(limits, self.norm)

    def with_norm(self, norm: Norm) -> TrackingProblem:
        """The same problem, with another error that counts."""
        return self._changed((self.lower, self.upper), norm)

    def _changed(self, limits: tuple[Array, Array], norm: Norm) -> TrackingProblem:
        return TrackingProblem(
            self.models,
            self.goal,
            self.resting,
            cyclic=self.cyclic,
            norm=norm,
            limits=limits,
            start=self.start,
            ridge=self.ridge,
        )

    @cached_property
    def ages(self) -> RequestAges:
        """The ages of the requests that act on any of the joints between two samples."""
        return request_ages_of_all(self.models)

    @cached_property
    def windows(self) -> Windows:
        """Where requests act."""
        return windows_of(self.ages, *self.resting.shape, cyclic=self.cyclic)

    def admissible(self, requests: Array) -> Array:
        """The nearest requests within the limits, from rest with those that hold the start."""
        nearest = requests.copy()
        if self.start is not None:
            nearest[0] = self.start - self.offsets
        return np.clip(nearest, self.lower, self.upper)

    def error(self, angles: Array) -> float:
        """The error of the angles in the norm that counts."""
        return error_norm(self.goal.distances(angles), self.norm)

    def exact_error(self, requests: Array, boundary: Array | None = None) -> float:
        """Error of the exact models; inf where a joint has no steady cycle."""
        angles = self.exact_angles(requests, boundary)
        return math.inf if angles is None else self.error(angles)

    def exact_angles(self, requests: Array, boundary: Array | None = None) -> Array | None:
        """Angles of the exact models, run; None where a joint has no steady cycle.

        Args:
            requests: Requests [rad], shape (n, joints).
            boundary: Angles near which the cycles' boundaries are sought [rad], shape (joints,).
        """
        windows = self.windows.of(requests)
        boundary = self.resting[-1] + self.offsets if boundary is None else boundary
        answer = np.empty_like(requests)
        for joint, model in enumerate(self.models):
            own = request_ages(model)
            first = own.youngest - self.ages.youngest
            acting = np.ascontiguousarray(windows[first : first + own.width, :, joint].T)
            angles = self._run(model, acting, float(boundary[joint]), joint)
            if angles is None:
                return None
            answer[:, joint] = angles
        return answer

    def respond(self, angles: Array, requests: Array, *, radius: float) -> Response:
        """Where every request period of the smoothed models leads from these angles.

        Args:
            angles: Angles at the samples, whether the models reach them or not [rad], (n, joints).
            requests: Requests [rad], shape (n, joints).
            radius: Radius of the saturation's corners [theta_0].
        """
        before = angles[self.windows.before]
        if self.start is not None:
            before[0] = self.start
        evaluate = periods(self.models, len(angles))
        response = evaluate(before, self.windows.of(requests), radius)
        if self.start is not None:
            response.by_angle[0] = 0.0  # nothing comes before the first sample that could change
        return response

    def _run(self, model: JointModel, windows: Array, boundary: float, joint: int) -> Array | None:
        compiled = exact_run(model, len(windows))
        if self.start is not None:
            return compiled(float(self.start[joint]), windows)
        try:
            return steady_cycle(
                model, lambda start: compiled(start, windows), windows + model.offset, near=boundary
            )
        except NoSteadyCycle:
            return None


def track(
    model: JointModel,
    desired: Array,
    *,
    cyclic: bool,
    norm: Norm = "rms",
    limits: Limits | None = None,
    start: float | None = None,
) -> TrackingProblem:
    """The problem of one joint that should follow desired angles [rad], shape (n,)."""
    return TrackingProblem(
        [model],
        FollowAngles(desired),
        desired[:, np.newaxis] - model.offset,
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        start=None if start is None else np.array([start]),
    )


def within_attainable_range(model: JointModel, angles: Array, start: float) -> Array:
    """Angles, clipped to what a joint that rests at the start can attain by then [rad], (n,)."""
    resting = request_ages(model).youngest + 1  # samples before the second request acts
    moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
    farthest = model.v_max * model.period * moving
    return np.clip(angles, start - farthest, start + farthest)


class Errors(NamedTuple):
    """Errors of every sample and their derivatives by the joints' angles."""

    values: Array  # (n, m)
    jacobians: Array  # (n, m, joints)


class Goal(Protocol):
    """What the angles should achieve at every sample: desired angles, or a foot's position."""

    def distances(self, angles: Array) -> Array:
        """Distance of the angles (n, joints) from the goal at every sample [rad], (n,)."""
        ...

    def errors(self, angles: Array) -> Errors:
        """The errors, whose lengths are the distances, and their derivatives by the angles."""
        ...


class FollowAngles:
    """One joint that should follow desired angles."""

    def __init__(self, desired: Array) -> None:
        """Take the desired angles [rad], shape (n,)."""
        self.desired = desired

    def distances(self, angles: Array) -> Array:
        """Absolute errors [rad], (n,)."""
        distances: Array = np.abs(angles[:, 0] - self.desired)
        return distances

    def errors(self, angles: Array) -> Errors:
        """Angles minus desired [rad]."""
        return Errors(angles - self.desired[:, np.newaxis], np.ones((len(angles), 1, 1)))


class Windows:
    """Which requests act before which samples, for joints on which requests of these ages act.

    Quantities of a request at the samples on which it acts have shape (width, n, joints), the
    youngest request first.

    Attributes:
        acting: Number of the j-th youngest request that acts before sample k, -1 for one before the
            first, shape (width, n).
        before, after: The sample before and after each, shape (n,). From rest, too, the last one
            comes before the first: nothing of it is kept there.
    """

    def __init__(self, ages: RequestAges, samples: int, joints: int, *, cyclic: bool) -> None:
        """Work out the indices once."""
        self.ages = ages
        self.samples = samples
        self.joints = joints
        self.cyclic = cyclic
        every = np.arange(samples)
        self.acting = np.ascontiguousarray(acting(ages, samples, cyclic=cyclic).T)
        self._of_first = np.maximum(self.acting, 0)  # before the first request it was the first
        place = np.arange(ages.width)[:, np.newaxis]  # from the youngest on
        answering = self.wrap(every + ages.youngest + place)
        self._answers = np.where(
            answering < 0, ages.width * samples, place * samples + answering
        )  # where each request's entries are, among those of all; behind them where nowhere
        self.before, self.after = np.roll(every, 1), np.roll(every, -1)

    def wrap(self, index: Indices) -> Indices:
        """Numbers of samples, on a cycle modulo its length; from rest -1 where there is none."""
        if self.cyclic:
            return index % self.samples
        return np.where((index < 0) | (index >= self.samples), -1, index)

    def of(self, requests: Array) -> Array:
        """The requests that act before each sample, youngest first: (width, n, joints)."""
        windows: Array = requests.take(self._of_first, axis=0)
        return windows

    def spread(self, weights: Array) -> Array:
        """A quantity of each request, where the request acts; 0 before the first: (width, n, k)."""
        if not self.cyclic:
            weights = np.concatenate([weights, np.zeros((1, self.joints))])
        spread: Array = weights.take(self.acting, axis=0)  # -1 is the row of zeros
        return spread

    def gathered(self, entries: Array, combine: np.ufunc = np.add, nothing: float = 0.0) -> Array:
        """The sum of each request's entries over all samples, (n, joints): the transpose of spread.

        ``combine`` may take the place of the sum; ``nothing`` is then its neutral element.
        """
        flat = entries.reshape(-1, self.joints)
        if not self.cyclic:
            flat = np.concatenate([flat, np.full((1, self.joints), nothing)])
        answer: Array = combine.reduce(flat.take(self._answers, axis=0), axis=0)
        return answer


@lru_cache(maxsize=32)
def windows_of(ages: RequestAges, samples: int, joints: int, *, cyclic: bool) -> Windows:
    """The windows for these ages and this size: worked out at the first call, then kept."""
    return Windows(ages, samples, joints, cyclic=cyclic)
