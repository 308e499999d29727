"""How far the data determines the parameters: covariances, and profiles where these may fail."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.identification.adjust import FASTEST, Adjusted, adjust, slopes, units
from planner.identification.grid import Grid
from planner.identification.identification import Interval
from planner.identification.simulation import Parameters, Pulls
from planner.trajectory import Array

CONFIDENCE = 0.95
"""Probability with which an interval holds the truth."""

MISFIT = 0.01
"""Share by which the loss has to rise before a value counts as refuted, however many the rows: real
joints are not the model, and what fits better by less says nothing about the parameter."""

CERTAIN = 0.05
"""A logarithm with a standard deviation below this is determined; no profile is asked."""

LAGS_PER_TIME = 5.0
"""Autocorrelations are summed up to so many correlation times."""

PROFILE_STEPS = 4
"""Steps with which a profile widens at most."""

WIDENING = 2.5
"""By how much each step of a profile is wider than the one before."""

BISECTIONS = 2
"""Halvings that narrow the end of an interval."""

JUST_ABOVE = 1e-6
"""Share by which a top speed that was never reached lies above the fastest call."""

GAIN, V_MAX, LAG, ACCELERATION_TIME, OFFSET = range(5)


class Spread(NamedTuple):
    """Second moments of the estimate, in what the search counts in (see ``adjust.units``).

    Attributes:
        covariance: Of log gain, log v_max, lag and acceleration time [ticks] and offset, (5, 5);
            infinite on the diagonal where a parameter has no effect at all.
        inflation: By how much correlated residuals raise each variance, at least 1, (5,).
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


def spread_of(fit: Adjusted) -> Spread:
    """Covariance of a fit: the sandwich of Huber's loss, raised where residuals are correlated."""
    from scipy.special import stdtrit

    slope = slopes(fit, blur=0.5 * fit.grid.tick * 0.05)
    count = len(fit.residuals)
    pulls = fit.weights * fit.residuals
    freedom = max(count - 5 - len(fit.grid.starts), 1)
    variance = float(np.sum(pulls**2)) / freedom
    inner = slope.by_parameter * (fit.weights >= 1.0)[:, np.newaxis]
    matrix = inner.T @ inner
    size = np.sqrt(np.diag(matrix))
    acting = size > 1e-9 * np.max(size)
    covariance = np.diag(np.full(5, math.inf))
    inflation = np.ones(5)
    if acting.any():
        scaled = matrix[np.ix_(acting, acting)] / np.outer(size[acting], size[acting])
        inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
        inverse /= np.outer(size[acting], size[acting])
        influence = (pulls[:, np.newaxis] * slope.by_parameter[:, acting]) @ inverse
        outer = slope.by_parameter[:, acting]
        white = variance * inverse @ (outer.T @ outer) @ inverse
        inflation[acting] = [correlation_time(column) for column in influence.T]
        inflation[~acting] = np.max(inflation)
        root = np.sqrt(inflation[acting])
        covariance[np.ix_(acting, acting)] = white * np.outer(root, root)
    effective = max(count / float(np.median(inflation)) - 5.0, 2.0)
    quantile = float(stdtrit(effective, 0.5 + CONFIDENCE / 2.0))
    return Spread(covariance, inflation, variance, quantile)


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


class Bounds(NamedTuple):
    """What the data says of each parameter."""

    gain: Interval
    v_max: Interval
    lag: Interval
    acceleration_time: Interval
    offset: Interval


def bounds_of(fit: Adjusted, spread: Spread) -> Bounds:
    """95 % intervals of the parameters of a fit, by profile where the covariance is not enough."""
    at = fit.parameters
    half = spread.quantile * spread.deviations
    scaling = units(fit.grid, at)
    ends = []
    for index, value in enumerate(at):
        logarithmic = index in (GAIN, V_MAX)
        if logarithmic and half[index] <= CERTAIN * spread.quantile:
            ends.append(Interval(value * math.exp(-half[index]), value * math.exp(half[index])))
        elif not logarithmic and _narrow(fit, index, half[index]):
            width = half[index] * scaling[index]
            low = value - width
            ends.append(Interval(low if index == OFFSET else max(low, 0.0), value + width))
        else:
            ends.append(Interval(*(_end(fit, spread, index, way) for way in (-1, 1))))
    return Bounds(*ends)


def _narrow(fit: Adjusted, index: int, half: float) -> bool:
    """Whether an interval is so narrow that the slopes at its middle hold at its ends."""
    if index == OFFSET:
        return math.isfinite(half)
    at = fit.parameters
    delay = at.lag + at.acceleration_time / 2.0 + 1.0 / at.gain
    return half * fit.grid.tick <= max(fit.grid.tick, 0.3 * delay)


def _end(fit: Adjusted, spread: Spread, index: int, way: int) -> float:
    """Where the profile of a parameter has risen as far as its interval reaches, to one side.

    The end is sought from where the covariance puts it outwards, so an interval may come out wider
    than its profile but not narrower.
    """
    rise = max(float(spread.threshold[index]), MISFIT * fit.cost)
    value = fit.parameters[index]
    limit, reported = _limit(fit, index, way)
    profile = _Profile(fit, index, fit.cost + rise)
    if limit == value or (math.isinf(limit) and not profile.refutes(limit)):
        return reported
    profile = _Profile(fit, index, fit.cost + rise)
    logarithmic = index in (GAIN, V_MAX)
    inner, step = value, _first_step(fit, spread, index)
    for _ in range(PROFILE_STEPS):
        outer = value * math.exp(way * step) if logarithmic else value + way * step
        beyond = (outer - limit) * way >= 0.0
        if beyond and not profile.refutes(limit):
            return reported
        outer = limit if beyond else outer
        if beyond or profile.refutes(outer):
            break
        inner, step = outer, WIDENING * step
    else:
        return reported
    for _ in range(BISECTIONS if inner != value or step > _wald(spread, fit, index) else 0):
        middle = math.sqrt(inner * outer) if logarithmic else (inner + outer) / 2.0
        inner, outer = (inner, middle) if profile.refutes(middle) else (middle, outer)
    return outer


class _Profile:
    """The best fits with one parameter held, each begun from the one before."""

    def __init__(self, fit: Adjusted, index: int, allowed: float) -> None:
        self._allowed = allowed
        self._name = Parameters._fields[index]
        self._free = fit.free.copy()
        self._free[index] = False
        self._last = fit

    def refutes(self, value: float) -> bool:
        """Whether nothing with the parameter at this value fits well enough."""
        held = adjust(
            self._last.grid,
            self._last.parameters._replace(**{self._name: value}),
            free=self._free,
            starts=self._last.starts,
            scale=self._last.scale,
            steps=5,
            precision=1e-3,
            enough=self._allowed,
        )
        if math.isfinite(value):
            self._last = held
        return held.cost > self._allowed


def _limit(fit: Adjusted, index: int, way: int) -> tuple[float, float]:
    """How far a parameter can go to one side, and what to report where the data lets it."""
    grid, at = fit.grid, fit.parameters
    if index == GAIN:
        return (FASTEST / grid.tick, math.inf) if way > 0 else (0.0, 0.0)
    if index == V_MAX:
        return (math.inf, math.inf) if way > 0 else (0.0, 0.0)
    if index == LAG:
        room = grid.reach - 2.0 * grid.tick
        return (room, math.inf) if way > 0 else (0.0, 0.0)
    room = grid.reach - grid.tick - at.lag
    return (room, math.inf) if way > 0 else (grid.tick, 0.0)


def _wald(spread: Spread, fit: Adjusted, index: int) -> float:
    """Half the width of an interval by the covariance: a logarithm, or a time [s]."""
    half = spread.quantile * float(spread.deviations[index])
    return half if index in (GAIN, V_MAX) else half * fit.grid.tick


def _first_step(fit: Adjusted, spread: Spread, index: int) -> float:
    half = _wald(spread, fit, index)
    if index in (GAIN, V_MAX):
        return min(max(half, 0.02), 0.3)
    delay = fit.parameters.lag + fit.parameters.acceleration_time + 1.0 / fit.parameters.gain
    return min(max(half, 0.25 * fit.grid.tick), 0.3 * delay)


def speed_bounded(fit: Adjusted) -> bool:
    """Whether the data bounds the top speed from above."""
    return math.isfinite(_end(fit, spread_of(fit), V_MAX, 1))


def peak_call(fit: Adjusted) -> float:
    """Highest speed that the requests of a fit called for, limited or not [rad/s]."""
    return fastest_call(fit.parameters, fit.grid, fit.pulls, fit.states)


def fastest_call(parameters: Parameters, grid: Grid, pulls: Pulls, states: Array) -> float:
    """Highest speed that the requests called for in any run, limited or not [rad/s]."""
    errors = pulls.targets - states[grid.states - 1][:, np.newaxis]
    errors[pulls.weights <= 0.0] = 0.0
    return float(parameters.gain * np.max(np.abs(errors)))


def with_shown_speed(fit: Adjusted) -> Adjusted:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one promises the least.
    """
    shown = peak_call(fit)
    if fit.parameters.v_max <= shown:
        return fit
    return replace(fit, parameters=fit.parameters._replace(v_max=(1.0 + JUST_ABOVE) * shown))
