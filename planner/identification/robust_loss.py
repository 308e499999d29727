"""How much a residual counts: squares for what is noise, less for what is an outlier."""

from __future__ import annotations

import numpy as np

from planner.trajectory import Array

HUBER = 5.0
"""Residuals beyond so many standard deviations count by their size, not by its square."""

GROSS = 10.0
"""Residuals beyond so many standard deviations are faults of the log, not of the model."""

SHARE_GROSS = 0.01
"""Share of the residuals that a verdict may leave out; single faulty rows have gone before."""

SHARE_TRUSTED = 0.95
"""Share of the residuals that the scale is read from: more outliers than the rest would raise it.
A median would do for white noise, but in a log that mostly rests it is the scale of the rest, and
the motion, which is all there is to learn from, would count as outliers."""

NORMAL_QUANTILE = 1.959964
"""That share of a normal distribution lies within so many standard deviations."""

NO_ERROR = 1e-12
"""Scale below which residuals are rounding errors, relative to the angles' standard deviation."""


def scale_of(residuals: Array, floor: float) -> float:
    """Standard deviation of the residuals that are no gross outliers."""
    return max(floor, sound_rms(residuals, gross=1.0 - SHARE_TRUSTED))


def sound_rms(residuals: Array, *, gross: float = SHARE_GROSS) -> float:
    """Root mean square of the residuals that are no gross outliers [rad].

    At most a share ``gross`` is taken for such: in a log that mostly rests even misses of all its
    motion are few and large.
    """
    bulk = float(np.quantile(np.abs(residuals), SHARE_TRUSTED)) / NORMAL_QUANTILE
    most = float(np.quantile(np.abs(residuals), 1.0 - gross))
    sound = np.abs(residuals) <= max(GROSS * bulk, most)
    return float(np.sqrt(np.mean(residuals[sound] ** 2)))


def huber(residuals: Array, scale: float) -> tuple[float, Array]:
    """Loss and weights of the residuals at a scale."""
    size = np.abs(residuals)
    bend = HUBER * scale
    weights = np.minimum(1.0, bend / np.maximum(size, 1e-300))
    loss = np.where(size <= bend, 0.5 * size**2, bend * (size - 0.5 * bend))
    return float(np.sum(loss)), weights
