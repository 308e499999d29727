"""The problem of the optimised inversion: follow a trajectory with requests within limits."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from planner.exceptions import Infeasible, InvalidInput, NoSteadyCycle
from planner.inversion.bound import Norm
from planner.inversion.step import Stencil, stencil
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.model.transition import Linearised, reach, transitions
from planner.trajectory import Array

Limits = tuple[float, float]

ON_THE_LIMIT = 1e-9
"""How far beyond its limits a desired angle may lie [rad]: rounding of degrees, no more."""

CLOSED = 1e-11
"""Ends of a smoothed cycle that agree to this [rad] are close enough for a derivative."""

MOST_CYCLES = 30
"""Cycles after which smoothed requests that do not close count as unusable."""


class Tracking:
    """Desired angles for a joint, and how far requests lead it from them.

    Attributes:
        model: The joint.
        desired: Wanted angles [rad], shape (n,).
        cyclic: Whether the trajectory repeats for ever.
        norm: The error that counts.
        lower, upper: Limits on every request [rad].
        start: From rest: angle at which the joint rests before the plan [rad].
        movable: Requests that may be chosen, shape (n,): from rest the first one holds the joint.
    """

    def __init__(
        self,
        model: JointModel,
        desired: Array,
        *,
        cyclic: bool,
        norm: Norm,
        limits: Limits | None,
        start: float | None,
    ) -> None:
        """Take the problem as it is: :func:`planner.invert_optimal` has checked it."""
        self.model = model
        self.desired = desired
        self.cyclic = cyclic
        self.norm = norm
        self.lower, self.upper = (-math.inf, math.inf) if limits is None else limits
        self.start = start
        self.movable = np.ones(len(desired), dtype=np.bool_)
        if not cyclic:
            self.movable[0] = False

    @cached_property
    def stencil(self) -> Stencil:
        """Where requests act."""
        return stencil(reach(self.model), len(self.desired), cyclic=self.cyclic)

    def along(self, desired: Array) -> Tracking:
        """The same problem with other desired angles [rad], (n,), in the rms norm."""
        return Tracking(
            self.model,
            desired,
            cyclic=self.cyclic,
            norm="rms",
            limits=(self.lower, self.upper),
            start=self.start,
        )

    @cached_property
    def resting(self) -> Array:
        """Requests under which the joint would rest at the desired angles [rad], (n,)."""
        return self.admissible(self.desired - self.model.offset)

    def admissible(self, requests: Array) -> Array:
        """The nearest requests within the limits, the first one holding the joint at its start."""
        nearest = requests.copy()
        if self.start is not None:
            nearest[0] = self.start - self.model.offset
        return np.clip(nearest, self.lower, self.upper)

    def in_reach(self, angles: Array) -> Array:
        """The angles, brought to where a joint that rests at the start can be by then [rad], (n,).

        A cycle has no start, and all of it is in reach.
        """
        if self.start is None:
            return angles
        resting = reach(self.model).youngest + 1  # samples before the second request acts
        moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
        farthest = self.model.v_max * self.model.period * moving
        return np.clip(angles, self.start - farthest, self.start + farthest)

    def simulate(self, requests: Array) -> Array:
        """Angles of the exact model [rad], (n,)."""
        return simulate(self.model, requests, cyclic=self.cyclic, start=self.start)

    def error(self, angles: Array) -> float:
        """What is to be made small [rad]."""
        errors = np.abs(angles - self.desired)
        return float(np.max(errors) if self.norm == "max" else np.sqrt(np.mean(errors**2)))

    def exact_error(self, requests: Array) -> float:
        """Error of the exact model [rad]; inf for requests under which the joint finds no cycle."""
        try:
            return self.error(self.simulate(requests))
        except NoSteadyCycle:
            return math.inf

    def linearise(self, requests: Array, *, smoothing: float, seam: float) -> Linearised | None:
        """Angles of the smoothed model and their derivatives; None where it finds no cycle.

        Args:
            requests: Requests [rad], shape (n,).
            smoothing: Radius of the saturation's corners [rad].
            seam: Angle near which the cycle's seam is sought [rad].
        """
        compiled = transitions(self.model, len(requests))
        windows = self.stencil.windows(requests)
        if self.start is not None:
            run = compiled.run(self.start, windows, smoothing)
            run.by_angle[0] = 0.0  # nothing comes before the first sample that could change
            return run
        low = float(np.min(requests)) + self.model.offset - self.model.theta_0
        high = float(np.max(requests)) + self.model.offset + self.model.theta_0
        for _ in range(MOST_CYCLES):
            run = compiled.run(seam, windows, smoothing)
            mismatch = float(run.angles[-1]) - seam
            if abs(mismatch) <= CLOSED * max(1.0, abs(seam)):
                return run
            contraction = float(np.prod(run.by_angle))
            if contraction < 1.0:
                mismatch /= 1.0 - contraction
            seam = min(max(seam + mismatch, low), high)
        return None


def checked_limits(
    limits: tuple[float, float] | None,
    *,
    desired: Array,
    start: float | None,
    model: JointModel,
) -> Limits | None:
    """The limits as floats, or the reason why no requests within them can do.

    Raises:
        InvalidInput: The limits are not two numbers.
        Infeasible: The lower limit is above the upper one, or the start or a desired angle beyond
            them.
    """
    if limits is None:
        return None
    try:
        lower, upper = (float(limit) for limit in limits)
    except (TypeError, ValueError, OverflowError):
        lower = upper = math.nan
    if math.isnan(lower) or math.isnan(upper):
        raise InvalidInput(
            f"limits: got {limits!r}, expected (lower, upper) [rad]; use -inf or inf for no limit"
        )
    if lower > upper:
        raise Infeasible(
            f"limits: the lower one, {lower:g} rad, is above the upper one, {upper:g} rad; "
            "swap them, or check their units"
        )
    angles = desired if start is None else np.append(desired, start)
    beyond = np.maximum(lower - (angles - model.offset), (angles - model.offset) - upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > ON_THE_LIMIT:
        what = f"desired: sample {worst}" if worst < len(desired) else "start: it"
        raise Infeasible(
            f"{what} is {angles[worst]:.6g} rad, {beyond[worst]:.3g} rad beyond the angles "
            f"{lower + model.offset:.6g} to {upper + model.offset:.6g} rad where the limits on the "
            "requests let the joint rest; clip the trajectory, or widen the limits"
        )
    return lower, upper
