"""How far and how fast the joints of a leg may turn, from what the robot's URDF says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kinematics.chain import Array, read_only
from kinematics.exceptions import InvalidUrdf
from kinematics.limits import Limits

UNLIMITED = 1e6
"""Limits beyond this [rad] are a way of writing that there is none."""

FASTEST = 100.0
"""Speeds beyond this [rad/s] are a way of writing that none is known."""


def read_limits(path: Path, model: Any, joints: list[int]) -> Limits:
    """Joint limits; a continuous joint has none."""
    lower, upper = np.full(len(joints), -np.inf), np.full(len(joints), np.inf)
    for k, joint in enumerate(joints):
        if model.joints[joint].nq == 1:  # a continuous joint is stored as cosine and sine
            index = model.joints[joint].idx_q
            lower[k], upper[k] = model.lowerPositionLimit[index], model.upperPositionLimit[index]
        if not lower[k] <= upper[k]:
            raise InvalidUrdf(
                path,
                f"joint {model.names[joint]!r} has the limits {lower[k]:g} and {upper[k]:g}, "
                "expected lower <= upper [rad]",
            )
    for limit in (lower, upper):
        limit[np.abs(limit) > UNLIMITED] = np.copysign(np.inf, limit[np.abs(limit) > UNLIMITED])
    return Limits(read_only(lower), read_only(upper))


def read_speeds(model: Any, joints: list[int]) -> Array:
    """Top speeds [rad/s], read-only, shape (k,); NaN where the URDF has none that can be meant."""
    speeds = np.array([model.velocityLimit[model.joints[joint].idx_v] for joint in joints])
    return read_only(np.where((speeds > 0.0) & (speeds <= FASTEST), speeds, np.nan))
