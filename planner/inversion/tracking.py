"""The problem of the optimised inversion: reach a goal with requests within limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from planner.exceptions import NoSteadyCycle
from planner.inversion.goal import FollowAngles, Goal
from planner.inversion.limits import Limits
from planner.inversion.norm import Norm
from planner.inversion.stencil import Stencil, stencil
from planner.model.joint import JointModel, Reach, reach
from planner.model.response import steady_cycle
from planner.model.sensitivity import Response, periods, reach_of
from planner.model.symbolic import exact_run
from planner.trajectory import Array


class Tracking:
    """Joints that should reach a goal by requests within limits, and how far they miss it.

    Attributes:
        models: The joints, whose requests are sent together.
        goal: What they should do.
        resting: Requests towards which the search leans where nothing else decides [rad],
            shape (n, joints).
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

    def within(self, limits: tuple[Array, Array]) -> Tracking:
        """The same problem with other limits."""
        return Tracking(
            self.models,
            self.goal,
            self.resting,
            cyclic=self.cyclic,
            norm=self.norm,
            limits=limits,
            start=self.start,
            ridge=self.ridge,
        )

    @cached_property
    def reach(self) -> Reach:
        """The requests that act on any of the joints between two samples."""
        return reach_of(self.models)

    @cached_property
    def stencil(self) -> Stencil:
        """Where requests act."""
        return stencil(self.reach, *self.resting.shape, cyclic=self.cyclic)

    def admissible(self, requests: Array) -> Array:
        """The nearest requests within the limits, from rest with those that hold the start."""
        nearest = requests.copy()
        if self.start is not None:
            nearest[0] = self.start - self.offsets
        return np.clip(nearest, self.lower, self.upper)

    def error(self, angles: Array) -> float:
        """What is to be made small."""
        distances = self.goal.distances(angles)
        return float(np.max(distances) if self.norm == "max" else np.sqrt(np.mean(distances**2)))

    def exact_error(self, requests: Array, seam: Array | None = None) -> float:
        """Error of the exact models; inf for requests under which a joint finds no cycle."""
        angles = self.exact_angles(requests, seam)
        return math.inf if angles is None else self.error(angles)

    def exact_angles(self, requests: Array, seam: Array | None = None) -> Array | None:
        """Angles of the exact models, run; None where a joint finds no cycle.

        Args:
            requests: Requests [rad], shape (n, joints).
            seam: Angles near which the cycles' seams are sought [rad], shape (joints,).
        """
        windows = self.stencil.windows(requests)
        seam = self.resting[-1] + self.offsets if seam is None else seam
        answer = np.empty_like(requests)
        for joint, model in enumerate(self.models):
            own = reach(model)
            first = own.youngest - self.reach.youngest
            acting = np.ascontiguousarray(windows[first : first + own.width, :, joint].T)
            angles = self._run(model, acting, float(seam[joint]), joint)
            if angles is None:
                return None
            answer[:, joint] = angles
        return answer

    def respond(self, angles: Array, requests: Array, *, smoothing: float) -> Response:
        """Where every request period of the smoothed models leads from these angles.

        Args:
            angles: Angles at the samples, whether the models reach them or not [rad], (n, joints).
            requests: Requests [rad], shape (n, joints).
            smoothing: Radius of the saturation's corners [theta_0].
        """
        before = angles[self.stencil.before]
        if self.start is not None:
            before[0] = self.start
        evaluate = periods(self.models, len(angles))
        response = evaluate(before, self.stencil.windows(requests), smoothing)
        if self.start is not None:
            response.by_angle[0] = 0.0  # nothing comes before the first sample that could change
        return response

    def _run(self, model: JointModel, windows: Array, seam: float, joint: int) -> Array | None:
        compiled = exact_run(model, len(windows))
        if self.start is not None:
            return compiled(float(self.start[joint]), windows)
        try:
            return steady_cycle(
                model, lambda start: compiled(start, windows), windows + model.offset, near=seam
            )
        except NoSteadyCycle:
            return None


def follow(
    model: JointModel,
    desired: Array,
    *,
    cyclic: bool,
    norm: Norm = "rms",
    limits: Limits | None = None,
    start: float | None = None,
) -> Tracking:
    """The problem of one joint that should follow desired angles [rad], shape (n,)."""
    return Tracking(
        [model],
        FollowAngles(desired),
        desired[:, np.newaxis] - model.offset,
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        start=None if start is None else np.array([start]),
    )


def in_reach(model: JointModel, angles: Array, start: float | None) -> Array:
    """The angles, brought to where a joint that rests at the start can be by then [rad], (n,).

    A cycle has no start, and all of it is in reach.
    """
    if start is None:
        return angles
    resting = reach(model).youngest + 1  # samples before the second request acts
    moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
    farthest = model.v_max * model.period * moving
    return np.clip(angles, start - farthest, start + farthest)
