"""Weighted sums over any stretch of samples at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array


class Moments(NamedTuple):
    """Sums over stretches of samples, time counted from the first node of each; any shape."""

    w0: Array  # Σ w
    w1: Array  # Σ w k
    w2: Array  # Σ w k²
    d0: Array  # Σ w d
    d1: Array  # Σ w k d
    d2: Array  # Σ w d²


def moments(
    desired: Array, weights: Array, start: npt.NDArray[np.intp], end: npt.NDArray[np.intp]
) -> Moments:
    """Sums over the samples after ``start`` up to ``end``, with k = 0 at ``start``.

    Args:
        desired: Samples, shape (..., n); their sums have the same leading axes.
        weights: Their weights, shape (n,).
        start: Nodes, of any shape that broadcasts with ``end``.
        end: Nodes.

    Returns:
        The sums, each of the common shape. Cost O(n) and a few operations per stretch.
    """
    k = np.arange(desired.shape[-1], dtype=np.float64)
    wk, wd = weights * k, weights * desired
    w0, w1, w2, d0, d1, d2 = (
        (total := np.cumsum(each, axis=-1))[..., end] - total[..., start]
        for each in (weights, wk, wk * k, wd, wk * desired, wd * desired)
    )
    # About the start.
    w2 = w2 - start * (2.0 * w1 - start * w0)
    return Moments(w0, w1 - start * w0, w2, d0, d1 - start * d0, d2)
