"""Weighted sums over any stretch of samples at once."""

from __future__ import annotations

from collections.abc import Sequence
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
    totals = running(desired, weights)
    begun = [total[..., start] for total in totals]
    ended = [total[..., end] for total in totals]
    return between(start, begun, ended)


def running(desired: Array, weights: Array) -> list[Array]:
    """Sums over the samples up to each, in the order of :class:`Moments`, with k = 0 at first."""
    k = np.arange(desired.shape[-1], dtype=np.float64)
    wk, wd = weights * k, weights * desired
    products = (weights, wk, wk * k, wd, wk * desired, wd * desired)
    return [np.cumsum(each, axis=-1) for each in products]


def between(
    start: npt.NDArray[np.intp] | Array, begun: Sequence[Array], ended: Sequence[Array]
) -> Moments:
    """Sums about ``start``, whole or not, from those of :func:`running` there and at the ends."""
    # In C order, as sliding views would otherwise leave theirs to all that is made of them.
    w0, w1, w2, d0, d1, d2 = (
        np.subtract(after, before, order="C") for before, after in zip(begun, ended, strict=True)
    )
    since = start.astype(np.float64)
    w2 = w2 - since * (2.0 * w1 - since * w0)
    return Moments(w0, w1 - since * w0, w2, d0, d1 - since * d0, d2)
