"""One pose for all shifts, mirror images and reversals of the same samples.

A search that meets them in one pose finds the same curve for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.approximation.objective import Candidate, Problem
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class Pose:
    """How samples as given become samples in pose: rolled to the seam, reversed, mirrored.

    Attributes:
        samples: Number of samples n.
        cyclic: Whether the first sample follows the last.
        seam: Given sample that comes first in pose; 0 unless cyclic.
        backwards: Whether time runs backwards in pose.
        sign: -1 if the samples are mirrored in pose, else 1.
    """

    samples: int
    cyclic: bool
    seam: int
    backwards: bool
    sign: float

    @classmethod
    def of(cls, desired: Array, ideal: Array, *, cyclic: bool) -> Pose:
        """The sharpest corner of a cycle first, the larger half last, the first extreme above."""
        n = desired.size
        seam = _sharpest_corner(desired, ideal) if cyclic else 0
        rolled = np.roll(desired, -seam)
        k = np.arange(n)
        # Odd under reversal: sample k goes to -k in a cycle, to n - 1 - k otherwise.
        side = np.sin(2.0 * np.pi * k / n) if cyclic else 0.5 * (n - 1) - k
        backwards = bool(side @ (rolled - np.mean(rolled)) ** 2 > 0.0)
        pose = cls(samples=n, cyclic=cyclic, seam=seam, backwards=backwards, sign=1.0)
        posed = pose.apply(desired)
        extreme = posed[np.argmax(np.abs(posed) > (1.0 - 1e-9) * np.max(np.abs(posed)))]
        sign = -1.0 if extreme < 0.0 else 1.0
        return cls(samples=n, cyclic=cyclic, seam=seam, backwards=backwards, sign=sign)

    def apply(self, given: Array) -> Array:
        """Samples in pose."""
        return self.sign * self.in_order(given)

    def in_order(self, given: Array) -> Array:
        """What belongs to samples, in the order of the pose."""
        posed = np.roll(given, -self.seam)
        if self.backwards:
            posed = np.roll(posed[::-1], 1) if self.cyclic else posed[::-1]
        return np.ascontiguousarray(posed)

    def of_problem(self, given: Problem) -> Problem:
        """A problem in pose."""
        places, pins = given.required - self.seam, self.sign * given.pins
        if self.backwards:
            places = (0.0 if self.cyclic else self.samples - 1.0) - places
        places = np.mod(places, self.samples) if self.cyclic else places
        order = np.argsort(places)
        return replace(
            given,
            desired=self.apply(given.desired),
            weights=self.in_order(given.weights),
            required=places[order],
            pins=pins[order],
        )

    def restore(self, curve: Candidate) -> tuple[Array, Array]:
        """Knots and values for the samples as given, in order and within the cycle."""
        knots, values = curve.knots, self.sign * curve.values
        if self.backwards:
            last = 0.0 if self.cyclic else self.samples - 1.0
            knots, values = last - knots[::-1], values[::-1]
        if self.cyclic:
            knots = np.mod(knots + self.seam, self.samples)
            order = np.argsort(knots)
            knots, values = knots[order], values[order]
        return knots, values


def _sharpest_corner(desired: Array, ideal: Array) -> int:
    """Where the ideal bends most; of many turns at top speed, where the samples bend most."""
    reach = max(1, ideal.size // 32)
    bend, own_bend = (
        np.abs(np.roll(curve, -reach) - 2.0 * curve + np.roll(curve, reach))
        for curve in (ideal, desired)
    )
    return int(np.argmax(bend + 1e-3 * own_bend))
