"""Joint limits of a leg."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array

TURN = 2.0 * np.pi
"""A full turn [rad]."""


class Limits(NamedTuple):
    """Joint limits, read-only arrays.

    Attributes:
        lower: Lower limits [rad], -inf for a continuous joint, shape (k,).
        upper: Upper limits [rad], inf for a continuous joint, shape (k,).
    """

    lower: Array
    upper: Array

    @property
    def finite(self) -> Limits:
        """The same limits with one full turn in place of an unlimited range."""
        free = np.where(np.isfinite(self.upper), self.upper - TURN, -0.5 * TURN)
        lower = np.where(np.isfinite(self.lower), self.lower, free)
        return Limits(lower, np.where(np.isfinite(self.upper), self.upper, lower + TURN))

    @property
    def turning(self) -> npt.NDArray[np.bool_]:
        """Which joints can turn by a full turn or more, shape (k,)."""
        return np.asarray(self.upper - self.lower >= TURN)

    @property
    def middle(self) -> Array:
        """The middle of each range [rad], shape (k,).

        Of a full turn or more: the angle nearest to 0 with half a turn to either side of it.
        """
        near_zero = np.clip(0.0, self.lower + 0.5 * TURN, self.upper - 0.5 * TURN)
        lower, upper = self.finite
        return np.asarray(np.where(self.turning, near_zero, 0.5 * (lower + upper)))

    @property
    def central(self) -> Limits:
        """At most half a turn to either side of the middle: every direction once."""
        half = np.minimum(0.5 * (self.upper - self.lower), 0.5 * TURN)
        return Limits(self.clip(self.middle - half), self.clip(self.middle + half))

    def clip(self, angles: Array) -> Array:
        """The nearest angles within the limits [rad], for angles of shape (..., k)."""
        return np.clip(angles, self.lower, self.upper)

    def wrap(self, angles: Array) -> Array:
        """The same directions within half a turn of the middle of the limits [rad]."""
        return np.asarray(self.middle + half_turned(angles - self.middle))

    def margin(self, angles: Array) -> Array:
        """How far inside the limits a pose is [rad]: (...,) for angles of shape (..., k)."""
        inside = np.minimum(angles - self.lower, self.upper - angles)
        return np.asarray(inside.min(axis=-1))


def half_turned(angles: Array) -> Array:
    """The same directions between minus half a turn and half a turn [rad]."""
    return np.asarray(np.remainder(angles + 0.5 * TURN, TURN) - 0.5 * TURN)
