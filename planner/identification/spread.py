"""How much the estimate varies: the covariance of a robust fit whose residuals are not white."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from planner.identification.least_squares import Fit
from planner.trajectory import Array

CONFIDENCE = 0.95
"""Probability with which an interval holds the truth."""

LAGS_PER_TIME = 5.0
"""Autocorrelations are summed up to so many correlation times."""


class Spread(NamedTuple):
    """Second moments of the estimate, by the coordinates of ``parameters.COORDINATES``.

    Attributes:
        covariance: Of log gain, log v_max, lag and acceleration time [ticks] and offset, (5, 5);
            infinite on the diagonal where a parameter has no effect at all.
        inflation: By how much residuals that are correlated, or largest where the parameter acts,
            raise each variance, at least 1, (5,).
        variance: Of one residual [rad^2].
        quantile: Standard deviations to either side of the estimate.
    """

    covariance: Array
    inflation: Array
    variance: float
    quantile: float

    @property
    def deviations(self) -> Array:
        """Standard deviations, (5,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def threshold(self) -> Array:
        """Rise of the loss at the ends of each interval [rad^2], (5,)."""
        return 0.5 * self.quantile**2 * self.variance * self.inflation


def spread_of(fit: Fit) -> Spread:
    """Covariance of a fit: the sandwich of Huber's loss, raised where residuals are not white.

    A clock that jitters, or a joint that is not the model, errs most in fast motion, on the very
    rows that tell lag and acceleration time.
    """
    by_parameter = _beside_starts(fit)
    count = len(fit.residuals)
    pulls = fit.weights * fit.residuals
    freedom = max(count - 5 - len(fit.grid.starts), 1)
    variance = float(np.sum(pulls**2)) / freedom
    inner = by_parameter * (fit.weights >= 1.0)[:, np.newaxis]
    matrix = inner.T @ inner
    size = np.sqrt(np.diag(matrix))
    acting = size > 1e-9 * np.max(size)
    covariance = np.diag(np.full(5, math.inf))
    inflation = np.ones(5)
    if acting.any():
        scaled = matrix[np.ix_(acting, acting)] / np.outer(size[acting], size[acting])
        inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
        inverse /= np.outer(size[acting], size[acting])
        influence = (pulls[:, np.newaxis] * by_parameter[:, acting]) @ inverse
        outer = by_parameter[:, acting]
        white = variance * inverse @ (outer.T @ outer) @ inverse
        uneven = np.maximum(1.0, np.sum(influence**2, axis=0) / np.diag(white))
        alike = [correlation_time(column) for column in influence.T]
        inflation[acting] = uneven * alike
        inflation[~acting] = np.max(inflation)
        root = np.sqrt(inflation[acting])
        covariance[np.ix_(acting, acting)] = white * np.outer(root, root)
    effective = max(count / float(np.median(inflation)) - 5.0, 2.0)
    quantile = float(stdtrit(effective, 0.5 + CONFIDENCE / 2.0))
    return Spread(covariance, inflation, variance, quantile)


def _beside_starts(fit: Fit) -> Array:
    """Derivatives by the parameters, free of what a change of the first angles could do as well."""
    grid = fit.grid
    raw, by_start = fit.sensitivities(blur=0.025)
    runs = len(grid.starts)
    norms: Array = np.bincount(grid.run, fit.weights * by_start**2, runs).astype(float)
    along: Array = np.stack(
        [np.bincount(grid.run, fit.weights * by_start * column, runs) for column in raw.T], axis=1
    )
    shares = along / np.maximum(norms, 1e-300)[:, np.newaxis]
    return np.asarray(raw - by_start[:, np.newaxis] * shares[grid.run])


def correlation_time(series: Array) -> float:
    """Rows that count as one because they are alike: 1 + 2 times the sum of autocorrelations.

    The sum ends at five times itself, where what follows is noise (Sokal's window), and at the
    square root of the number of rows, beyond which it would mistake a cycle for one long
    correlation; at least 1.
    """
    count = len(series)
    transformed = np.fft.rfft(series, 2 * count)
    products = np.fft.irfft(np.abs(transformed) ** 2)[:count]
    if products[0] <= 0.0:
        return 1.0
    times = 2.0 * np.cumsum(products / products[0]) - 1.0
    furthest = math.isqrt(count)
    ended = np.flatnonzero(np.arange(furthest) >= LAGS_PER_TIME * times[:furthest])
    return max(1.0, float(times[ended[0] if len(ended) else furthest]))
