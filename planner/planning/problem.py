"""The problem of the optimised inversion: reach a goal with requests within limits.

Import this module where it is used, inside functions, as ``model/kernel.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import chain
from operator import attrgetter

import numpy as np

from planner.arrays import Array
from planner.exceptions import Infeasible
from planner.model.joint import Acting, JointModel, acting_requests
from planner.model.response import load_by_period, of_joints
from planner.planning.gauss_newton import (
    FIRST,
    LARGEST_CHANGE,
    LOWER,
    UPPER,
    Rows,
    Spec,
    errors_of,
    judge,
    limit,
    roughness,
    simulate_all,
)
from planner.planning.task import Task

LEAST_FOOT_MOTION = 1e-9
"""Movement of the foot per radian that is rounding, relative to the last link's length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem(Task):
    """A task as (10) of ``docs/math.md``: joints that should reach a goal by requests in limits.

    A scenario is one model for each joint, all driven by the same requests. These have shape (n, J)
    for J joints, angles (n, A) with the joints of one scenario after the other. Desired angles are
    those without the disturbance; limits may have shape (n, J).

    Attributes:
        links: The constants of the foot's leg, with which errors count in radians of a typical
            joint's turn, as in :class:`Spec`.
        first: From rest: the requests that hold the joints at the start [rad], (J,); by default in
            the middle of the dead bands of the nominal models.
        near: Near which requests stay [rad], (n, J); by default R* of (10).
        shares: Weights of the scenarios, together 1.
    """

    links: Array = field(default_factory=partial(np.empty, (0, 10, 3)))
    first: Array | None = None
    near: Array | None = None
    shares: tuple[float, ...] = (1.0,)

    @cached_property
    def drives(self) -> tuple[JointModel, ...]:
        """The models of the nominal scenario, then of further ones, (A,)."""
        return tuple(chain.from_iterable(self.scenarios))

    @cached_property
    def load_of_drives(self) -> Array:
        """Torque on each model's joint at each sample [N m], (A, n)."""
        return np.vstack(list(map(self.loads_on, self.scenarios)))

    @cached_property
    def first_requests(self) -> Array | None:
        """From rest: the requests that hold the joints, not yet within the limits [rad], (J,)."""
        if self.start is None or self.first is not None:
            return self.first
        loads = self.load_of_drives[: len(self.names), 0]
        return of_joints(JointModel.request_at, self.nominal, self.start, loads)

    @property
    def resting(self) -> Array:
        """Requests within the limits, near ``near`` or R* of (10), (n, J)."""
        return self.spec.near.centre

    @cached_property
    def acting(self) -> Acting:
        """The requests that act on any of the joints between two samples."""
        return acting_requests(*self.drives)

    @property
    def settling(self) -> float:
        """Time in which the slowest of the joints comes to rest [samples]: theta_0/v_max + T."""
        slowest = max(each.theta_0 / each.v_max + each.time_constant for each in self.drives)
        return slowest / self.period

    @cached_property
    def torques(self) -> Array:
        """Torque on each model's joint in the period that ends in each sample [N m], (A, n)."""
        return np.asarray(load_by_period(self.load_of_drives, cyclic=self.cyclic))

    @cached_property
    def spec(self) -> Spec:
        """The problem as arrays, for the compiled search."""
        parts = max(map(attrgetter("states"), self.drives))
        periods, drives = np.empty((2, len(self.drives), len(self.desired))), []
        for number, (model, torque) in enumerate(zip(self.drives, self.torques, strict=True)):
            periods[0, number] = model.compliance * torque
            periods[1, number] = model.faster_per_tick(torque)
            start = math.nan if self.start is None else self.start[number % len(self.names)]
            coasts = max(1.0 / model.law.share, model.hold) if parts > 1 else 1.0
            drives.append((*model.law, model.hold, model.theta_0, coasts, start))
        first, bounds = self.first_requests, np.empty((4, *self.desired.shape))
        bounds[LOWER], bounds[UPPER], bounds[LARGEST_CHANGE] = self.lower, self.upper, self.max_step
        held = 0.0 if first is None else first
        bounds[FIRST] = np.minimum(np.maximum(held, bounds[LOWER]), bounds[UPPER])
        if self.near is None:
            loads = self.load_of_drives[: len(self.names)]
            near = np.array(of_joints(JointModel.request_at, self.nominal, self.desired, loads))
            # From the middle of a dead band: a request returns there within some four periods; with
            # half the weight within six, at twice the weight within three, with larger steps.
            centring = 0.1 if any(map(attrgetter("dead_band"), self.drives)) else 0.0
        else:
            # Weight of the distance of a request from that near which it should stay, beside a
            # second difference. With a third of it a saturated servo follows once in nine series of
            # trials what its model does not show; three times it makes the second trial of a servo
            # in three worse.
            centring, near = 0.3, np.array(self.near)
        goal, samples = np.array(self.desired), np.arange(len(self.desired))[:, np.newaxis]
        each, bending = np.empty((2, len(samples), 3))
        each[:], bending[:] = (1.0, 0.0, 0.0), (1.0, -2.0, 1.0)
        if self.goal == "foot":
            added = np.zeros_like(goal) if self.disturbance is None else self.disturbance
            goal = np.hstack([self.desired_foot, added])
        rows = Rows(np.repeat(samples, 3, axis=1), each, near)
        spec = Spec(
            cyclic=self.cyclic,
            oldest=self.acting.oldest,
            parts=parts,
            largest=self.norm == "max",
            worst=self.robust == "worst",
            limited=bool(np.isfinite(self.max_step).any()),
            ridge=1e-4 if self.goal == "foot" else 0.0,
            drives=np.array(drives, dtype=np.float64),
            weights=self.acting.weights,
            acting=self.acting.numbers(len(self.desired), cyclic=self.cyclic),
            periods=periods,
            bounds=bounds,
            near=rows,
            smooth=rows,
            goal=goal,
            leg=np.array(self.links),
            shares=np.array(self.shares),
        )
        limit(spec, near)  # in place; second differences are of requests within the limits
        bends = samples if self.cyclic else samples[:-1]
        numbers = (bends + np.array([-1, 0, 1])) % len(near)
        numbers[0, 0] = numbers[0, 0] if self.cyclic else 0
        factors = bending[: len(bends)]
        centre = np.zeros((len(bends), len(self.names)))
        if self.near is not None:
            centre = np.einsum("kp,kpj->kj", factors, near[numbers])
        if centring > 0.0:
            numbers = np.vstack([numbers, rows.numbers])
            factors = np.vstack([factors, centring * rows.factors])
            centre = np.vstack([centre, centring * near])
        return spec._replace(smooth=Rows(numbers, factors, centre))

    def admissible(self, requests: Array) -> Array:
        """Requests near the given ones within the limits [rad], (n, J): see ``keep_step``."""
        nearest = np.array(requests, dtype=np.float64, order="C")
        limit(self.spec, nearest)
        return nearest

    def roughness(self, requests: Array) -> float:
        """Objective of the smoothing: the sum of squared second differences [rad^2].

        With dry friction also squared distances from the middle of the dead band: inside it any
        request holds the joint (``docs/math.md``, section 6). Near other requests it is that of
        the change from these, and their squared distances.
        """
        return roughness(self.spec, np.ascontiguousarray(requests))

    def exact_angles(self, requests: Array) -> Array:
        """Angles of the exact models [rad], (n, A); NaN where a joint has no steady cycle."""
        angles = np.empty((len(requests), len(self.drives)))
        simulate_all(self.spec, np.ascontiguousarray(requests), angles)
        return angles

    def errors(self, angles: Array) -> tuple[Array, Array]:
        """See :func:`gauss_newton.errors_of`."""
        return errors_of(self.spec, np.ascontiguousarray(angles))

    def errors_of_models(self, angles: Array) -> tuple[float, Array]:
        """The error that counts, and those it comes from: see :func:`gauss_newton.judge`."""
        errors = np.empty(len(self.shares) + 1)
        return judge(self.spec, np.ascontiguousarray(angles), errors), errors

    def exact_error(self, requests: Array) -> float:
        """Error of the exact models; inf where a joint has no steady cycle."""
        return self.errors_of_models(self.exact_angles(requests))[0]

    def distances(self, angles: Array) -> Array:
        """Weighted root of the squared errors over the scenarios [rad], (n,)."""
        values = self.errors(angles)[0]
        return np.asarray(np.sqrt(np.einsum("kcm,kcm,c->k", values, values, self.shares)))


OF_TASK = tuple(map(attrgetter("name"), fields(Task)))
"""The fields of a task."""


def problem_of(task: Task) -> Problem:
    """The problem of a task for its nominal models: of a joint, or of all joints of a leg.

    A foot's errors are scaled by how far a radian of a joint moves it.
    """
    models, loads, desired = task.nominal, task.loads_on(task.nominal), task.desired
    given = dict(zip(OF_TASK, attrgetter(*OF_TASK)(task), strict=True))
    problem = Problem(**given | {"models": tuple(zip(models, strict=True))})
    if task.disturbance is not None or task.goal == "foot":  # where requests can hold them
        added = 0.0 if task.disturbance is None else task.disturbance
        least, most = (
            of_joints(JointModel.rest, models, end, loads) for end in (task.lower, task.upper)
        )
        desired = np.clip(desired - added, least, most)
    if task.goal == "angles":
        return replace(problem, desired=np.ascontiguousarray(desired))
    assert task.leg is not None, "a foot belongs to a leg"
    moved = float(np.sqrt(np.mean(task.foot_jacobians(desired + added) ** 2)))
    length = float(np.max(np.abs(task.leg.chain.tip), initial=LEAST_FOOT_MOTION))
    if moved <= LEAST_FOOT_MOTION * length:
        raise Infeasible(
            "leg: none of its joints moves the foot along an axis that counts; choose another foot "
            "frame, or give the axis along which it moves a weight"
        )
    links = np.zeros((len(task.leg.chain.links) + 1, 10, 3))
    for own, link in zip(links, task.leg.chain.links, strict=False):
        own[:] = np.vstack([link.origin.T, link.axial, link.cosine, link.sine])
    links[-1, 0], links[-1, 1] = task.leg.chain.tip, task.axis_scales / moved
    return replace(problem, desired=np.ascontiguousarray(desired), links=links)
