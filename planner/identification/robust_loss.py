"""How much a residual counts: squares for what is noise, less for what is an outlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class LossOptions:
    """Which residuals are noise, outliers and gross outliers.

    In brackets what half and twice the value change on seven reference logs (four made, three
    recorded; ``scripts/reference``), at most: the error on all rows, and on those held out.

    Attributes:
        corner: Residuals beyond so many standard deviations count by their size, not by its
            square (1.1 and 16 %; none and 15 %).
        gross: Residuals beyond so many standard deviations are faults of the log, not of the
            model (0.07 and 1.8 %; none).
        share_gross: Share of the residuals that a verdict may leave out; single faulty rows
            have gone before (none; none).
        share_trusted: Share of the residuals that the scale is read from: more outliers than
            the rest would raise it. A median would do for white noise, but in a log that mostly
            rests it is the scale of the rest, and the motion, which is all there is to learn
            from, would count as outliers (half of it: 0.7 and 3.2 %).
    """

    corner: float = 5.0
    gross: float = 10.0
    share_gross: float = 0.01
    share_trusted: float = 0.95


OPTIONS = LossOptions()


NO_ERROR = 1e-12
"""Scale below which residuals are rounding errors, relative to the angles' standard deviation."""


def rms(errors: Array) -> float:
    """Root mean square of errors, outliers included."""
    return float(np.sqrt(np.mean(errors**2)))


def scale_of(residuals: Array, floor: float) -> float:
    """Standard deviation of the residuals that are no gross outliers."""
    return max(floor, sound_rms(residuals, gross=1.0 - OPTIONS.share_trusted))


def sound_rms(residuals: Array, *, gross: float = OPTIONS.share_gross) -> float:
    """Root mean square of the residuals that are no gross outliers [rad].

    At most a share ``gross`` is taken for such: in a log that mostly rests even misses of all its
    motion are few and large.
    """
    quantile = float(np.quantile(np.abs(residuals), OPTIONS.share_trusted))
    bulk = quantile / float(ndtri(0.5 + OPTIONS.share_trusted / 2.0))  # as of a normal distribution
    most = float(np.quantile(np.abs(residuals), 1.0 - gross))
    sound = np.abs(residuals) <= max(OPTIONS.gross * bulk, most)
    return rms(residuals[sound])


def huber(residuals: Array, scale: float) -> tuple[float, Array]:
    """Loss and weights of the residuals at a scale."""
    size = np.abs(residuals)
    bend = OPTIONS.corner * scale
    weights = np.minimum(1.0, bend / np.maximum(size, 1e-300))
    loss = np.where(size <= bend, 0.5 * size**2, bend * (size - 0.5 * bend))
    return float(np.sum(loss)), weights
