"""The last digit of a bound: values whose slopes keep it in floating point."""

from __future__ import annotations

import numpy as np

from planner.trajectory import Array

ROUNDING = 1e-13
"""Relative excess over a limit that is left to rounding."""


def within_slopes(
    values: Array, limits: Array, *, cyclic: bool, towards: Array | None = None
) -> Array:
    """Shrink ``values`` towards their middle until every rise keeps its limit, rounding included.

    Args:
        values: Values at the knots [rad], shape (K,).
        limits: Largest rise of every segment [rad], shape (K,) for a cycle, else (K - 1,).
        cyclic: Whether the last segment leads back to the first knot.
        towards: Values that keep the limits, shape (K,), in place of the middle.

    Returns:
        Values, shape (K,), that exceed no limit by more than one part in 1e13.
    """
    if towards is None:
        middle = 0.5 * (float(values.max()) + float(values.min()))
        towards = np.full_like(values, middle)
    offset = values - towards
    shrink, shrunk = 1.0, values
    for attempt in range(64):
        ends = np.append(shrunk, shrunk[0]) if cyclic else shrunk
        excess = float(np.max(np.abs(np.diff(ends)) / limits, initial=0.0))
        if excess <= 1.0 + ROUNDING:
            return shrunk
        shrink *= (1.0 - 2.0**attempt * 1e-16) / excess
        shrunk = towards + shrink * offset
    return towards
