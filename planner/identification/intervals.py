"""How far the data determines the parameters: covariances, and profiles where these may fail."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from planner.arrays import Array
from planner.identification.least_squares import FULL, PROFILE, Fit, correlation_time
from planner.identification.parameters import (
    COUNT,
    PARAMETERS,
    TERMS,
    Parameters,
    box_of,
    model_derivatives,
    only,
)
from planner.identification.result import Interval

MISFIT = 0.01
"""Share by which the loss has to rise before a value counts as refuted, however many the rows: real
joints are not the model, and a smaller gain of the fit is no evidence about the parameter."""

STRUCTURE = 0.2
"""The same share where all of the residuals are alike from row to row: structure that the model
does not have, and that other motions have otherwise. On 29 recordings of an arm of which 25 do not
saturate, an unlimited top speed raises the loss by 0 to 0.18 of it, in those of the gripper that do
by 1.3 and more (at half two top speeds count as bounded that are not)."""

WIDENING = 2.5
"""By how much each of four steps of a profile is longer than the one before; what is not refuted
then is open. (At half 3 ends more of 70 are open; at twice intervals are up to 1.6 times wider.)"""

BISECTIONS = 2
"""Halvings that narrow the end of an interval, each one fit (half: up to 1.8 times as wide; twice:
down to 0.6, in 1.1 times the time)."""

FASTER = 1.4
"""Factor from one top speed to the next among which that of a joint with limited acceleration is
sought. (Of five simulated motors that few rows show at their top speed all intervals hold it, at
1.2 and at 2 four of them.)"""

V_MAX = Parameters._fields.index("v_max")


def over_top_speeds(fit: Fit) -> tuple[Fit, tuple[Fit, ...]]:
    """The best fit over top speeds, and fits with others that are not refuted.

    Where the acceleration is limited few rows are at the top speed, and the loss is rough in it.
    Each fit is also begun with a window of a tick and the same latency. (Of 160 simulated motors
    two logs of one seemed to bound a top speed of a tenth without this.)
    """
    if not fit.free[V_MAX] or math.isinf(fit.parameters.acceleration):
        return fit, ()
    while True:
        found = _at_other_speeds(fit)
        found += [each.with_short_window(effort=PROFILE) for each in (fit, *found)]
        best = min([fit, *found], key=lambda each: each.cost)
        if best.cost >= 0.999 * fit.cost:
            break
        fit = best.trial(free=fit.free, effort=FULL)
    allowed = fit.cost + rise_allowed(fit, "v_max")
    return fit, tuple(each for each in found if each.cost <= allowed)


def _at_other_speeds(fit: Fit) -> list[Fit]:
    """Fits with higher and lower top speeds, each from the one before, until they fit far worse.

    From the highest speed that the log calls for on they are all alike: the last is without limit.
    """
    free, peak, found = fit.free & ~only("v_max"), fit.peak_command, list[Fit]()
    least = box_of(fit.grid).lower[V_MAX]
    for factor in (FASTER, 1.0 / FASTER):
        last, v_max = fit, fit.parameters.v_max
        while last.cost <= 2.0 * fit.cost and least < v_max < peak:
            v_max *= factor
            at = last.parameters._replace(v_max=v_max if v_max < peak else math.inf)
            last = last.trial(at, free=free, effort=PROFILE)
            found.append(last)
    return found


def intervals_of(fit: Fit, others: Sequence[Fit] = ()) -> dict[str, Interval]:
    """95 % intervals of what was fitted, by profile where the covariance is not enough.

    They hold the parameters of ``others``, which the data does not refute.
    """
    possible = [other.parameters for other in others]
    ends = {name: _interval(fit, name, possible) for name in fit.free_names}
    for name, end in ends.items():  # it holds what the profiles of other parameters did not refute
        values = [float(getattr(each, name)) for each in possible]
        ends[name] = Interval(min([end.lower, *values]), max([end.upper, *values]))
    return ends


def _interval(fit: Fit, name: str, possible: list[Parameters]) -> Interval:
    """The interval of a parameter, open where its search ended: the covariance does not hold there.

    What its profile does not refute is added to ``possible``. Widths and steps are those of the
    logarithm where the parameter is counted by that.
    """
    box, index = box_of(fit.grid), Parameters._fields.index(name)
    unit, lower, upper = (float(each[index]) for each in box)
    value, reported = float(fit.parameters[index]), (float(box.open_ends[index]), math.inf)
    delay = fit.parameters.whole_delay
    sizes = dict.fromkeys(("lag", "acceleration_time", "time_constant"), delay)
    sizes |= dict.fromkeys(("integral_rate", "position_integral_rate"), 1.0 / delay)
    uncertainty = uncertainty_of(fit)
    half = uncertainty.quantile * float(uncertainty.deviations[index]) * (unit or 1.0)
    least, most = 0.25 * unit or 0.02, 0.3 * sizes.get(name, unit or 1.0)
    limits = (lower if unit else 0.0), (math.inf if name == "v_max" else upper)
    allowed = fit.cost + rise_allowed(fit, name)

    def moved(by: float) -> float:
        return value + by if unit else value * math.exp(by)

    def end(side: int) -> float:
        """Where the profile has risen as far as the interval reaches, below (0) or above (1).

        It is sought outwards from where the covariance puts it: no interval is narrower than that.
        """
        last = fit

        def refutes(value: float) -> bool:
            nonlocal last
            held = _held_at(last, name, value, allowed)
            if math.isfinite(value):
                last = held
            if held.cost <= allowed:
                possible.append(held.parameters)
            return held.cost > allowed

        limit, way = limits[side], 2 * side - 1
        if limit == value or (math.isinf(limit) and not refutes(limit)):
            return reported[side]
        inner, step = value, min(max(half, least), most)
        for _ in range(4):
            outer = moved(way * step)
            beyond = (outer - limit) * way >= 0.0
            if beyond and not refutes(limit):
                return reported[side]
            outer = limit if beyond else outer
            if beyond or refutes(outer):
                break
            inner, step = outer, WIDENING * step
        else:
            return reported[side]
        for _ in range(BISECTIONS if inner != value or step > half else 0):
            middle = (inner + outer) / 2.0 if unit else math.sqrt(inner * outer)
            inner, outer = (inner, middle) if refutes(middle) else (middle, outer)
        return outer

    if half <= (max(unit, most) if unit else 0.1):
        # so narrow that the slopes at its middle hold at its ends
        low, high = max(moved(-half), reported[0]), moved(half)
    else:
        low, high = end(0), end(1)
    if at_edge(fit, name):
        at_top = value >= upper * (1.0 - EDGE)
        return Interval(low, math.inf) if at_top else Interval(reported[0], high)
    return Interval(low, high)


def _held_at(fit: Fit, name: str, value: float, enough: float) -> Fit:
    """The fit with a parameter at a value, no better than is enough."""
    at, free = fit.parameters._replace(**{name: value}), fit.free & ~only(name)
    return fit.trial(at, free=free, effort=PROFILE, enough=enough)


def speed_bounded(fit: Fit) -> bool:
    """Whether the data bounds the top speed from above."""
    allowed = fit.cost + rise_allowed(fit, "v_max")
    return _held_at(fit, "v_max", math.inf, allowed).cost > allowed


ROUGH, ROUGH_FRICTION = 2.0, 1.2
"""By how much the parameters of motors scatter more than the curvature of their loss says: it has a
kink wherever an acceleration begins or ends to be limited. The dead band, which rows at rest
determine, scatters less. (Of 160 simulated motors the intervals of seven parameters hold in 81 to
92 % without this, at 1.5 in 89 to 96 %, at 2 in 92 to 98 %, ``scripts/bench models``; of 240
others that of the dead band in 91 % without its own, in 95 % with it.)"""

EDGE = 1e-6  # a parameter this close to a bound of the search, relative to it, is at the edge


def at_edge(fit: Fit, name: str) -> bool:
    """Whether a parameter ended at a bound that is the search's, not the joint's."""
    index = Parameters._fields.index(name)
    value, (unit, lower, upper) = fit.parameters[index], (each[index] for each in box_of(fit.grid))
    near = EDGE * max(abs(value), 1e-300)
    low = lower if unit == 0.0 or lower < 0.0 else -math.inf
    return math.isfinite(value) and bool(value <= low + near or value >= upper - near)


def rise_allowed(fit: Fit, name: str) -> float:
    """Rise of the loss from which on a value of a parameter is refuted: (18) [rad^2]."""
    of, index = uncertainty_of(fit), Parameters._fields.index(name)
    threshold = 0.5 * of.quantile**2 * of.variance * float(of.inflation[index])
    return max(threshold, MISFIT * fit.cost)


class Uncertainty(NamedTuple):
    """Second moments of the estimate, by ``parameters.coordinates_of``."""

    covariance: Array  # infinite on the diagonal where a parameter has no effect at all, (p, p)
    # the same of :data:`PARAMETERS`, the play and the gain in SI units, where what the log does not
    # show at all counts as known, (p + 1, p + 1)
    of_model: Array
    # by how much residuals that are correlated, or largest where the parameter acts, raise each
    # variance, at least 1, (p,)
    inflation: Array
    variance: float  # of one residual [rad^2]
    quantile: float  # standard deviations to either side of the estimate

    @property
    def deviations(self) -> Array:
        """Standard deviations, (p,)."""
        return np.sqrt(np.diag(self.covariance))


@lru_cache(maxsize=4)
def uncertainty_of(fit: Fit) -> Uncertainty:
    """Covariance of a fit: the sandwich of Huber's loss, raised where residuals are not white.

    What the model does not have errs otherwise in other motions, however many rows a log has of
    one: the loss may rise by a share of it (18).
    """
    by_parameter = _beside_starts(fit)
    count = len(fit.residuals)
    active = fit.weights * fit.weighted
    fitted = len(fit.free_names)
    freedom = max(count - fitted - len(fit.grid.starts), 1)
    variance = float(np.sum(active**2)) / freedom
    inner = by_parameter * (fit.weights >= 1.0)[:, np.newaxis]
    matrix = inner.T @ inner
    size = np.sqrt(np.diag(matrix))
    acting = size > 1e-9 * np.max(size)
    covariance = np.diag(np.full(COUNT, math.inf))
    inflation = np.ones(COUNT)
    if acting.any():
        scaled = matrix[np.ix_(acting, acting)] / np.outer(size[acting], size[acting])
        inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
        inverse /= np.outer(size[acting], size[acting])
        influence = (active[:, np.newaxis] * by_parameter[:, acting]) @ inverse
        outer = by_parameter[:, acting]
        white = variance * inverse @ (outer.T @ outer) @ inverse
        squares, even = np.sum(influence**2, axis=0), np.diag(white)
        shares = np.divide(squares, even, out=np.ones_like(squares), where=even > 0.0)
        uneven = np.maximum(1.0, shares)
        together = correlation_time(active)
        alike = [max(correlation_time(column), together) for column in influence.T]
        inflation[acting] = uneven * alike
        inflation[~acting] = np.max(inflation)
        root = np.sqrt(inflation[acting])
        covariance[np.ix_(acting, acting)] = white * np.outer(root, root)
    effective = max(count / float(np.median(inflation[fit.free])) - fitted, 2.0)
    quantile = float(stdtrit(effective, 0.975))
    rounding = (1e-6 * float(np.std(fit.grid.angles))) ** 2 / max(variance, 1e-300)
    least = max(STRUCTURE * fit.structure, rounding) * count / quantile**2
    more = np.maximum(least / inflation, 1.0)
    root = np.sqrt(np.where(np.isfinite(np.diag(covariance)), more, 1.0))
    covariance = covariance * np.outer(root, root)
    known = np.isfinite(np.diag(covariance))
    change = model_derivatives(fit.grid, fit.parameters)[:, known]
    of_model = change @ covariance[np.ix_(known, known)] @ change.T
    return Uncertainty(covariance, of_model, inflation * more, variance, quantile)


def _beside_starts(fit: Fit) -> Array:
    """Derivatives by the parameters, free of what a change of the first angles could do as well."""
    grid = fit.grid
    slopes = fit.slopes(averaging=0.025)
    raw = np.zeros((len(fit.residuals), COUNT))
    weights = grid.weights
    most = 1e100  # those of a joint that nearly rings for ever outgrow numbers
    raw[:, fit.free] = np.clip(weights[:, np.newaxis] * slopes.by_parameter, -most, most)
    by_start = np.clip(weights * slopes.by_start, -most, most)
    runs = len(grid.starts)
    norms: Array = np.bincount(grid.run, fit.weights * by_start**2, runs).astype(float)
    along: Array = np.stack(
        [np.bincount(grid.run, fit.weights * by_start * column, runs) for column in raw.T], axis=1
    )
    shares = along / np.maximum(norms, 1e-300)[:, np.newaxis]
    return np.asarray(raw - by_start[:, np.newaxis] * shares[grid.run])


def all_intervals(coarse: Fit, bounds: Mapping[str, Interval], fit: Fit) -> dict[str, Interval]:
    """Intervals of :data:`PARAMETERS`, and the "gain", in SI units, moved to another ``fit``.

    The top speed is open above where its end is then beyond the highest speed that the log calls
    for.
    """
    known = dict(bounds)
    for name in ("asymmetry", "slowing"):
        if name in bounds:
            determined = bounds[name].bounded and bounds["v_max"].bounded
            least = -math.inf if name == "asymmetry" else 0.0
            of_model = model_interval(coarse, name)
            known[TERMS[name]] = of_model if determined else Interval(least, math.inf)
    limit = known.pop("acceleration", None)
    if limit is not None:
        if coarse.parameters.dead_band > 0.0:
            ends = model_interval(coarse, "acceleration")
            limit = ends if limit.bounded else Interval(ends.lower, math.inf)
        known["max_acceleration"] = limit
    known["theta_0"] = _theta_0(coarse, bounds)
    known = {name: known[name] for name in (*PARAMETERS, "gain") if name in known}
    known, speed = over_ticks(known, coarse, fit), bounds["v_max"]
    if speed.bounded and known["v_max"].upper >= fit.peak_command:
        return all_intervals(coarse, {**bounds, "v_max": Interval(speed.lower, math.inf)}, fit)
    return known


def over_ticks(intervals: Mapping[str, Interval], coarse: Fit, fine: Fit) -> dict[str, Interval]:
    """Intervals of a fit, moved to one with shorter ticks, that hold for any shorter ones, too.

    The fits differ by what ticks make of the parameters, in proportion to their length, and by how
    far a search in a rough loss ends beside its optimum: what shorter ticks still have of that
    counts to both sides.
    """
    at, moved = (
        vars(each.parameters.model(tick=each.grid.tick, hold=1)) | {"gain": each.parameters.gain}
        for each in (coarse, fine)
    )
    inertia = fine.parameters.time_constant > 0.0 or math.isfinite(fine.parameters.acceleration)
    ticks, found = (fine.grid.tick, coarse.grid.tick), dict(intervals)
    share = ticks[0] / (ticks[1] - ticks[0]) if ticks[0] < ticks[1] else 0.0
    for name, ends in intervals.items():
        sizes = np.array([at[name], moved[name], *ends])
        if logarithmic := name in ("v_max", "theta_0", "gain") and ends.lower > 0.0:
            sizes = np.log(sizes)
        before, after, *ends_before = sizes.tolist()
        rough, by = 1.0, 0.0
        if share and ends.bounded:
            by = share * abs(after - before)
            if inertia:
                rough = ROUGH_FRICTION if name == "dead_band" else ROUGH
        low, high = (after + rough * (end - before) for end in ends_before)
        low, high = low - by, high + by
        if not ends.bounded:  # by how much such parameters differ says little
            low, high = min(low, ends_before[0]), max(high, ends_before[1])
        if logarithmic:
            low, high = math.exp(low), math.exp(high)
        elif ends.lower >= 0.0:
            low = max(low, 0.0) if ends.lower > 0.0 else 0.0
        found[name] = Interval(low, high)
    return found


def _theta_0(fit: Fit, bounds: Mapping[str, Interval]) -> Interval:
    """theta_0 = v_max / gain: by their covariance where it holds, else from their ends."""
    gain, v_max = bounds["gain"], bounds["v_max"]
    if v_max.bounded and gain.bounded:
        value = fit.parameters.v_max / fit.parameters.gain
        uncertainty = uncertainty_of(fit)
        half = uncertainty.quantile * math.sqrt(uncertainty.of_model[1, 1]) / value
        if half < 1.0:
            return Interval(value * math.exp(-half), value * math.exp(half))
    upper = v_max.upper / gain.lower if gain.lower > 0.0 else math.inf
    return Interval(v_max.lower / gain.upper, upper)


def model_interval(fit: Fit, name: str) -> Interval:
    """95 % interval of a term, by the covariance, in the unit of :class:`planner.JointModel`."""
    index = Parameters._fields.index(name)
    open_end = float(box_of(fit.grid).open_ends[index])
    value = float(getattr(fit.parameters.model(tick=fit.grid.tick, hold=1), TERMS[name]))
    uncertainty = uncertainty_of(fit)
    half = uncertainty.quantile * math.sqrt(max(uncertainty.of_model[index, index], 0.0))
    return Interval(max(value - half, open_end), value + half)


def correlations_of(fit: Fit) -> tuple[tuple[float, ...], ...]:
    """Correlations of the fitted :data:`PARAMETERS`, the gain instead of theta_0."""
    rows, of_gain = np.flatnonzero(fit.free), -1  # the last one of the covariance
    rows[rows == PARAMETERS.index("theta_0")] = of_gain
    covariance = uncertainty_of(fit).of_model[np.ix_(rows, rows)]
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shares = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    found = np.clip(covariance * np.outer(shares, shares), -1.0, 1.0)
    np.fill_diagonal(found, 1.0)
    rounded = np.round((found + found.T) / 2.0, 4) + 0.0  # no -0.0
    return tuple(map(tuple, rounded.tolist()))
