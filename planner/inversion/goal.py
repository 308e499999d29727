"""What an optimised inversion wants: errors of the joints' angles, and how they change."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from planner.inversion.step import Quadratic
from planner.trajectory import Array


class Errors(NamedTuple):
    """Errors of every sample and their derivatives by the joints' angles."""

    values: Array  # (n, m)
    jacobians: Array  # (n, m, joints)


class Goal(Protocol):
    """Something that angles can miss, sample by sample."""

    def distances(self, angles: Array) -> Array:
        """How far the angles (n, joints) miss it: (n,)."""
        ...

    def errors(self, angles: Array) -> Errors:
        """By which errors, whose lengths are the distances, and their derivatives."""
        ...


class FollowAngles:
    """One joint that should follow desired angles."""

    def __init__(self, desired: Array) -> None:
        """Take the desired angles [rad], shape (n,)."""
        self.desired = desired
        self._jacobians = np.ones((len(desired), 1, 1))

    def distances(self, angles: Array) -> Array:
        """Absolute errors [rad], (n,)."""
        distances: Array = np.abs(angles[:, 0] - self.desired)
        return distances

    def errors(self, angles: Array) -> Errors:
        """Angles minus desired [rad]."""
        return Errors(angles - self.desired[:, np.newaxis], self._jacobians)


LEAST_WEIGHT = 1e-6
"""Least weight on an error, relative to that on an error of one unit in a sum of squares."""

LARGEST_SHARE = 1e4
"""Error in units from which on a cost counts as this large: its highest power is still a number."""


def quadratic(errors: Errors, *, power: float, unit: float, ridge: float) -> Quadratic:
    """The sum of ``unit^2 |error / unit|^power`` to second order in the angles.

    Gauss-Newton: the errors themselves are taken to be linear in the angles.

    Args:
        errors: Errors and their derivatives.
        power: 2 for least squares; large powers approach the largest error.
        unit: Error that counts as one.
        ridge: Added to the curvature, so that it is definite where the errors do not see an angle.
    """
    gradient = np.einsum("kmi,km->ki", errors.jacobians, errors.values)
    curvature = np.einsum("kmi,kmj->kij", errors.jacobians, errors.jacobians)
    if power == 2.0:
        value = float(np.vdot(errors.values, errors.values))
    else:
        lengths = np.linalg.norm(errors.values, axis=1)
        # Beyond this a power overflows; such a step is refused for its cost in any case.
        share = np.minimum(lengths / unit, LARGEST_SHARE)
        value = unit**2 * float(np.sum(share**power))
        weights = power / 2.0 * np.maximum(share ** (power - 2.0), LEAST_WEIGHT)
        radial = gradient / np.maximum(lengths, np.finfo(np.float64).tiny)[:, np.newaxis]
        curvature += (power - 2.0) * radial[:, :, np.newaxis] * radial[:, np.newaxis]
        gradient = weights[:, np.newaxis] * gradient
        curvature *= weights[:, np.newaxis, np.newaxis]
    if ridge > 0.0:
        curvature = curvature + ridge * np.eye(curvature.shape[-1])
    return Quadratic(value, gradient, curvature)
