"""Parts shared by the rivals: smoothed saturation, schedule, choice by the exact model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

import planner
from planner.arrays import Array

Limits = tuple[float, float]
Solve = Callable[[Array, Limits, Array], Array]

DEGREE = math.pi / 180.0  # the rivals count in degrees, so that their solvers' tolerances fit
RADII = (0.4, 0.12, 0.04)
"""Radii of the saturation's corners [theta_0], stage by stage: 1, 0.3 and 0.1 degrees a tick for a
joint of 2.5. One stage sharper, IPOPT fails or reports success at three times the error."""

REGULARISATION = 1e-4  # weight on the distance of the requests from the desired angles


def smoothed(error: Any, radius: Any, *, v_max: float, theta_0: float) -> Any:
    """Speed that an error calls for, with corners of this radius; all in the same unit of angle."""
    above, below = error + theta_0, error - theta_0
    rounded = radius * radius
    return v_max * ((above**2 + rounded) ** 0.5 - (below**2 + rounded) ** 0.5) / (2.0 * theta_0)


def exact_rms(model: planner.JointModel, desired: Array, requests: Array) -> float:
    """Error of the requests by the exact model [rad]; inf where there is no cycle."""
    if not np.all(np.isfinite(requests)):
        return math.inf
    try:
        errors = planner.simulate(model, requests) - desired
    except planner.PlannerError:
        return math.inf
    return float(np.sqrt(np.mean(errors**2)))


def best_of(
    model: planner.JointModel, desired: Array, limits: Limits, candidates: Iterable[Array]
) -> Array:
    """The candidate, brought within the limits, that the exact model finds best."""
    admissible = [np.clip(candidate, *limits) for candidate in candidates]
    return min(admissible, key=lambda requests: exact_rms(model, desired, requests))
