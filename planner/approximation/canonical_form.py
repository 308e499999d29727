"""One form for all shifts, mirror images, reversals and scales of the same samples.

A search in this form finds the same curve for all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from planner.approximation.problem import Candidate, Problem
from planner.trajectory import Array

RESOLUTION = 2.0**-36
"""Samples and slope are searched as multiples of this; the last QP takes them as they are."""

EQUAL = 1e-9
"""Relative difference up to which two numbers count as equal where the larger one decides, so that
rounding, which differs between processors, does not."""


def at_resolution(problem: Problem) -> Problem:
    """The problem with samples and slope as multiples of :data:`RESOLUTION`."""
    mantissa, exponent = math.frexp(problem.step)
    return replace(
        problem,
        desired=to_resolution(problem.desired),
        step=math.ldexp(math.floor(mantissa / RESOLUTION) * RESOLUTION, exponent),
    )


def to_resolution(samples: Array) -> Array:
    """Samples of size one, shape (n,), as multiples of :data:`RESOLUTION`."""
    return np.asarray(np.round(samples / RESOLUTION) * RESOLUTION)


@dataclass(frozen=True, kw_only=True)
class CanonicalForm:
    """How input samples become canonical: rolled to their first, reversed, mirrored.

    Attributes:
        samples: Number of samples n.
        cyclic: Whether the first sample follows the last.
        first: Input sample that comes first; 0 unless cyclic.
        backwards: Whether time runs backwards.
        sign: -1 if the samples are mirrored, else 1.
    """

    samples: int
    cyclic: bool
    first: int
    backwards: bool
    sign: float

    @classmethod
    def of(cls, desired: Array, ideal: Array, *, cyclic: bool) -> CanonicalForm:
        """The sharpest corner of a cycle first, the larger half last, the first extreme above."""
        n = desired.size
        first = _sharpest_corner(desired, ideal) if cyclic else 0
        rolled = np.roll(desired, -first)
        k = np.arange(n)
        # Odd under reversal: sample k goes to -k in a cycle, to n - 1 - k otherwise. A sine instead
        # gives zero for samples whose second half is the first one mirrored.
        side = np.where(k > 0, 0.5 * n - k, 0.0) if cyclic else 0.5 * (n - 1) - k
        power = (rolled - np.mean(rolled)) ** 2
        backwards = bool(side @ power > EQUAL * (np.abs(side) @ power))
        form = cls(samples=n, cyclic=cyclic, first=first, backwards=backwards, sign=1.0)
        samples = form.apply(desired)
        extreme = samples[np.argmax(np.abs(samples) > (1.0 - EQUAL) * np.max(np.abs(samples)))]
        return replace(form, sign=-1.0 if extreme < 0.0 else 1.0)

    def apply(self, samples: Array) -> Array:
        """Samples, shape (n,), in this form."""
        ordered = np.roll(samples, -self.first)
        if self.backwards:
            ordered = np.roll(ordered[::-1], 1) if self.cyclic else ordered[::-1]
        return self.sign * ordered

    def of_problem(self, problem: Problem) -> Problem:
        """A problem in this form."""
        places, pins = problem.required - self.first, self.sign * problem.pins
        if self.backwards:
            places = (0.0 if self.cyclic else self.samples - 1.0) - places
        places = np.mod(places, self.samples) if self.cyclic else places
        order = np.argsort(places)
        return replace(
            problem,
            desired=self.apply(problem.desired),
            required=places[order],
            pins=pins[order],
        )

    def restore(self, curve: Candidate) -> Candidate:
        """Knots and values for the input samples, in order and within the cycle."""
        knots, values = curve.knots, self.sign * curve.values
        if self.backwards:
            last = 0.0 if self.cyclic else self.samples - 1.0
            knots, values = last - knots[::-1], values[::-1]
        if self.cyclic:
            knots = np.mod(knots + self.first, self.samples)
            order = np.argsort(knots)
            knots, values = knots[order], values[order]
        return Candidate(knots, values, curve.error)


def _sharpest_corner(desired: Array, ideal: Array) -> int:
    """Where the ideal bends most; of many turns at top speed, where the samples bend most."""
    reach = max(1, ideal.size // 32)
    bend, own_bend = (
        np.abs(np.roll(curve, -reach) - 2.0 * curve + np.roll(curve, reach))
        for curve in (ideal, desired)
    )
    sharpness = bend + 1e-3 * own_bend
    return int(np.argmax(sharpness >= (1.0 - EQUAL) * np.max(sharpness)))
