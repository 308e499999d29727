"""The size of a plan's errors, and the distance of an error from its lower bound."""

from __future__ import annotations

import math

import numpy as np

from planner.planning.arguments import Norm
from planner.trajectory import Array, rms


def error_norm(errors: Array, norm: Norm) -> float:
    """Root mean square of the errors or largest absolute value, in their own unit.

    Args:
        errors: Errors or distances at the samples, shape (n,).
        norm: "rms" or "max".
    """
    if norm == "max":
        return float(np.max(np.abs(errors)))
    return rms(errors)


def relative_gap(error: float, bound: float) -> float:
    """``error / bound - 1`` [-]; inf where only the bound is zero, 0 where both are."""
    if bound > 0.0:
        return error / bound - 1.0
    return math.inf if error > 0.0 else 0.0
