"""The problem of the optimised inversion: reach a goal with requests within limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.model.joint import JointModel, RequestAges, acting
from planner.model.load import Loads, rest_requests, sags
from planner.model.response import motion_under
from planner.model.sensitivity import Periods, Response, periods, request_ages_of_all
from planner.planning.arguments import Limits, Norm
from planner.planning.error_norm import error_norm
from planner.trajectory import Array, Indices

CENTRING = 0.1
"""Where a joint has a dead band: weight of the distance of a request from its middle, beside a
second difference [-]. A request returns to the middle within some four periods; with half the
weight within six, at twice the weight within three, with steps that are larger by a fifth."""


class TrackingProblem:
    """Joints that should reach a goal by requests within limits: (10) of ``docs/math.md``.

    Attributes:
        models: The joints, whose requests are sent together.
        goal: What they should do.
        desired: Desired angles, of a foot those that bring it nearest [rad], (n, joints).
        loads: Torque on each joint in the period that ends in each sample [N m], (n,), or None.
        sags: Where the joints rest beside their requests [rad], (joints,), or (n, joints) by loads.
        resting: Requests that would hold the desired angles, R* of (10) [rad], (n, joints).
        cyclic: Whether the trajectory repeats for ever.
        norm: The error that counts.
        lower, upper: Limits on the requests [rad], shape (joints,).
        max_step: Largest change from one request to the next [rad], shape (joints,), inf for none.
        start: From rest: angles at which the joints rest before the plan [rad], shape (joints,).
        first: From rest: the requests that hold them there [rad], shape (joints,).
        movable: Requests that may be chosen, shape (n, joints): from rest the first ones hold the
            joints where they are.
        ridge: Curvature added to the goal's, where it does not see every angle.
    """

    def __init__(
        self,
        models: Sequence[JointModel],
        goal: Goal,
        desired: Array,
        *,
        cyclic: bool,
        norm: Norm = "rms",
        limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        max_step: npt.ArrayLike = math.inf,
        start: Array | None = None,
        first: Array | None = None,
        ridge: float = 0.0,
        loads: Loads | None = None,
    ) -> None:
        """Take the problem as it is: the callers have checked it.

        Without ``first`` the first requests are those in the middle of the dead bands.
        """
        self.models = tuple(models)
        self.goal = goal
        self.cyclic = cyclic
        self.norm = norm
        limits = (-math.inf, math.inf) if limits is None else limits
        self.lower, self.upper = (np.asarray(limit, dtype=np.float64) for limit in limits)
        self.max_step = np.broadcast_to(np.asarray(max_step, dtype=np.float64), desired.shape[1:])
        self.start = start
        self.desired = desired
        self.loads = tuple(loads or [None] * len(self.models))
        self.sags = sags(self.models, self.loads)
        self.first = first
        if first is None and start is not None:
            self.first = start - self.sag(0)
        self.resting = self.resting_requests()
        self.ridge = ridge
        self.movable = np.ones(desired.shape, dtype=np.bool_)
        if not cyclic:
            self.movable[0] = False

    def resting_requests(self) -> Array:
        """Requests within the limits that would hold the desired angles [rad], (n, joints)."""
        return self.admissible(rest_requests(self.models, self.desired, self.loads))

    @cached_property
    def limited(self) -> bool:
        """Whether any request has a limit."""
        return bool(np.any(np.isfinite(self.lower)) or np.any(np.isfinite(self.upper)))

    @cached_property
    def coupled(self) -> bool:
        """Whether requests are coupled to one another: by the largest change from one to the next.

        With inertia, too, as each drives two states.
        """
        return self.has_speeds or self.limited_step

    @cached_property
    def limited_step(self) -> bool:
        """Whether the change from any request to the next has a limit."""
        return bool(np.any(np.isfinite(self.max_step)))

    @cached_property
    def has_speeds(self) -> bool:
        """Whether any joint has inertia: then the states are angles and speeds."""
        return any(model.has_inertia for model in self.models)

    def over_driven(self, entries: Array) -> Array:
        """Sums of entries of the states, over those that every request drives."""
        joints = self.desired.shape[1]
        if entries.shape[-1] == joints:
            return entries
        sums: Array = entries.reshape(*entries.shape[:-1], -1, joints).sum(axis=-2)
        return sums

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
            self.desired,
            cyclic=self.cyclic,
            norm=norm,
            limits=limits,
            max_step=self.max_step,
            start=self.start,
            first=self.first,
            ridge=self.ridge,
            loads=self.loads,
        )

    @cached_property
    def ages(self) -> RequestAges:
        """The ages of the requests that act on any of the joints between two samples."""
        return request_ages_of_all(self.models)

    @cached_property
    def windows(self) -> Windows:
        """Where requests act."""
        return windows_of(self.ages, *self.resting.shape, cyclic=self.cyclic)

    @cached_property
    def periods(self) -> Periods:
        """The request periods of the smoothed models."""
        if all(load is None for load in self.loads):
            return periods(self.models, len(self.desired))
        return Periods(self.models, len(self.desired), self.loads)

    def sag(self, sample: int) -> Array:
        """Where the joints rest beside their requests at a sample [rad], (joints,)."""
        each: Array = self.sags if self.sags.ndim == 1 else self.sags[sample]
        return each

    def admissible(self, requests: Array) -> Array:
        """Requests near the given ones within the limits [rad], shape (n, joints).

        From rest the first one holds the start. Without ``max_step`` they are the nearest ones,
        with it see :func:`within_step`.
        """
        nearest = requests.copy()
        if self.first is not None:
            nearest[0] = self.first
        if self.limited:
            nearest = np.clip(nearest, self.lower, self.upper)
        if self.limited_step:
            first = None if self.first is None else nearest[0]
            nearest = within_step(nearest, self.max_step, cyclic=self.cyclic, first=first)
            nearest = np.clip(nearest, self.lower, self.upper)  # rounding
        return nearest

    def second_differences(self, requests: Array) -> Array:
        """Second differences of requests [rad], (n, joints), from rest (n - 1, joints)."""
        if self.cyclic:
            around = np.concatenate([requests[-1:], requests, requests[:1]])
            return np.asarray(around[:-2] - 2.0 * requests + around[2:])
        return np.diff(requests, n=2, axis=0, prepend=requests[:1])

    @cached_property
    def centring(self) -> float:
        """Weight of the distances from the middle of a dead band beside second differences [-]."""
        return CENTRING if any(model.dead_band for model in self.models) else 0.0

    def roughness_terms(self, requests: Array) -> Array:
        """What smoothing squares and sums [rad]: second differences, and with dry friction more.

        Inside a dead band any request holds the joint: those that differ little from its middle
        are preferred (``docs/math.md``, section 6).
        """
        terms = self.second_differences(requests)
        if not self.centring:
            return terms
        return np.concatenate([terms, self.centring * (requests - self.resting)])

    def error(self, angles: Array) -> float:
        """The error of the angles in the norm that counts."""
        return error_norm(self.goal.distances(self.angles_of(angles)), self.norm)

    def angles_of(self, states: Array) -> Array:
        """The angles among states [rad], (n, joints)."""
        return states[:, : len(self.models)]

    def states_of(self, angles: Array) -> Array:
        """States near angles, whose speeds are the mean ones since the sample before."""
        if not self.has_speeds or angles.shape[1] > len(self.models):
            return angles
        before = angles[self.windows.before]
        if self.start is not None:
            before[0] = np.resize(self.start, angles.shape[1])  # the same in all scenarios
        holds = np.array([model.hold for model in self.models])
        return self.periods.states(angles, (angles - before) / holds)

    def errors(self, states: Array) -> Errors:
        """The goal's errors, and their derivatives by the states."""
        errors = self.goal.errors(self.angles_of(states))
        if not self.has_speeds:
            return errors
        return Errors(
            errors.values, np.pad(errors.jacobians, ((0, 0), (0, 0), (0, len(self.models))))
        )

    def exact_error(self, requests: Array) -> float:
        """Error of the exact models; inf where a joint has no steady cycle."""
        angles = self.exact_angles(requests)
        return math.inf if angles is None else self.error(angles)

    def exact_angles(self, requests: Array) -> Array | None:
        """Angles of the exact models, run, (n, joints); None where a joint has no steady cycle.

        A cycle need not be unique: as in :func:`planner.simulate` it is the one near the angles at
        which the first requests hold the joints.
        """
        answer = np.empty_like(requests)
        for joint, (model, load) in enumerate(zip(self.models, self.loads, strict=True)):
            start = None if self.start is None else float(self.start[joint])
            try:
                answer[:, joint] = motion_under(
                    model, requests[:, joint], cyclic=self.cyclic, start=start, torques=load
                ).angles
            except NoSteadyCycle:
                return None
        return answer

    def respond(self, angles: Array, requests: Array, *, radius: float) -> Response:
        """Where every request period of the smoothed models leads from these angles.

        Args:
            angles: States at the samples, whether the models reach them or not, (n, states).
            requests: Requests [rad], shape (n, joints).
            radius: Radius of the saturation's corners [theta_0].
        """
        before = angles[self.windows.before]
        if self.start is not None:
            before[0] = 0.0
            before[0, : len(self.start)] = self.start
        response = self.periods(before, self.windows.of(requests), radius)
        if self.start is not None:  # nothing comes before the first sample that could change
            response.by_own[0] = 0.0
            if response.by_other is not None:
                response.by_other[0] = 0.0
        return response


def track(
    model: JointModel,
    desired: Array,
    *,
    cyclic: bool,
    norm: Norm = "rms",
    limits: Limits | None = None,
    max_step: float = math.inf,
    start: float | None = None,
    first: float | None = None,
    load: Array | None = None,
) -> TrackingProblem:
    """The problem of one joint that should follow desired angles.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,).
        cyclic: Whether they repeat for ever.
        norm: The error that counts.
        limits: Smallest and largest request [rad]; None for none.
        max_step: Largest change from one request to the next [rad].
        start: From rest: where the joint rests before [rad].
        first: From rest: the request that holds it there [rad]; by default the middle one of these.
        load: Torque on the joint [N m], shape (n,), or None.
    """
    return TrackingProblem(
        [model],
        FollowAngles(desired),
        desired[:, np.newaxis],
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        max_step=max_step,
        start=None if start is None else np.array([start]),
        first=None if first is None else np.array([first]),
        loads=[load],
    )


ROOM_FOR_ROUNDING = 1e-9
"""Share of the largest step that is left unused, so that rounding never exceeds it [-]."""


def within_step(
    requests: Array, max_step: npt.ArrayLike, *, cyclic: bool, first: Array | float | None = None
) -> Array:
    """Requests near the given ones that change by at most ``max_step`` from one to the next.

    With s the largest step they are the middle between the largest requests below the given ones
    that keep it, ``min_j (R_j + s |j - k|)``, and the smallest above, ``max_j (R_j - s |j - k|)``;
    in a cycle distances are those around it. Requests that keep it already stay as they are, and
    none leaves the range of the given ones, so that limits still hold. Time: O(n).

    Args:
        requests: Requests [rad], shape (n, ...).
        max_step: Largest change from one to the next [rad], inf where there is no limit.
        cyclic: Whether the last request precedes the first.
        first: From rest: the first request, which stays [rad], within the range of the requests.
    """
    step = (1.0 - ROOM_FOR_ROUNDING) * np.asarray(max_step, dtype=np.float64)
    limited = np.isfinite(step)
    step = np.where(limited, step, 0.0)
    count = len(requests)
    travelled = step * np.arange(count).reshape(-1, *(1,) * (requests.ndim - 1))
    near = requests
    if first is not None:
        near = np.clip(near, first - travelled, first + travelled)
    turns = np.concatenate([near] * (3 if cyclic else 1))
    travelled = step * np.arange(len(turns)).reshape(-1, *(1,) * (requests.ndim - 1))
    below, above = _majorised(turns, travelled), -_majorised(-turns, travelled)
    begin = count if cyclic else 0
    middle = (below + above)[begin : begin + count] / 2.0
    if first is not None:
        middle[0] = first
    return np.where(limited, middle, requests)


def _majorised(values: Array, travelled: Array) -> Array:
    """``min_j (values_j + |travelled_j - travelled_k|)`` for each k along the first axis."""
    rising = np.minimum.accumulate(values - travelled, axis=0) + travelled
    falling = np.minimum.accumulate((values + travelled)[::-1], axis=0)[::-1] - travelled
    return np.minimum(rising, falling)


class Errors(NamedTuple):
    """Errors of every sample and their derivatives by the joints' angles."""

    values: Array  # (n, m)
    jacobians: Array  # (n, m, joints)


class Goal(Protocol):
    """What the angles should achieve at every sample: desired angles, or a foot's position.

    Attributes:
        shared: Whether several joints share the errors, so that one can rest and others correct it.
    """

    shared: bool

    def distances(self, angles: Array) -> Array:
        """Distance of the angles (n, joints) from the goal at every sample [rad], (n,)."""
        ...

    def errors(self, angles: Array) -> Errors:
        """The errors, whose lengths are the distances, and their derivatives by the angles."""
        ...


class FollowAngles:
    """One joint that should follow desired angles."""

    shared = False

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
