"""The parameters that fit best: least squares under Huber's loss, whose scale follows the rows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from planner.arrays import Array, Indices, rms
from planner.identification.grid import Grid
from planner.identification.parameters import (
    BASE,
    TERMS,
    Free,
    Parameters,
    box_of,
    by_friction,
    coordinates_of,
    only,
    parameters_at,
    units,
)
from planner.identification.result import Interval, Term
from planner.model.law import Law

USUAL = only(*BASE)  # what is fitted where nothing else is asked for: the terms stay what they are

CORNER = 5.0
"""Residuals beyond so many standard deviations count by their size, not by their square. (On seven
reference logs half of it is up to 1.1 % worse on all rows and 16 % on those held out.)"""

TRUSTED = 0.95
"""Share of the residuals that the scale is read from: more outliers than the rest would raise it.
A median would do for white noise, but in a log that mostly rests it is the scale of the rest, and
the motion, which is all there is to learn from, would count as outliers."""

EDGE_DISTANCE = 1e-9
"""Distance from an edge of the window at which requests are read [ticks]: where the edge meets a
change of the request the derivative jumps, and the mean of both sides is taken."""

ROUNDED = 1e-9  # errors below this, relative to the spread of the angles, are rounding


class Effort(NamedTuple):
    """How far a fit is taken."""

    evaluations: int  # of the model, in each round
    tolerance: float  # relative change of the loss that ends a round
    rounds: int = 1  # estimates of the scale
    # Distance to both sides of the window's edges over which derivatives by lag and acceleration
    # time are averaged [ticks]. Rows a whole number of ticks apart put corners into the loss, at
    # which a search by exact derivatives ends.
    averaging: tuple[float, ...] = (0.3,)
    # Share of the residuals that the first step may explain: longer steps jump to delays a cycle
    # away. On a pure sine the fit ends in a local optimum at half and twice the value.
    first_step: float = 0.2


QUICK = Effort(evaluations=12, tolerance=1e-3, rounds=2)  # tells a good start from a poor one
# to a loss that is right to a thousandth, which tells one local optimum from another
SEARCH = Effort(evaluations=25, tolerance=1e-4, rounds=6)
# the same from a fit without a term: dry friction is found a long way from there
TERM = SEARCH._replace(first_step=0.5)
# tells whether a value is refuted, from a fit with a value close by
PROFILE = Effort(evaluations=15, tolerance=1e-3)
# to the optimum: parameters to a millionth of their standard deviations
FULL = Effort(evaluations=60, tolerance=1e-7, rounds=6, averaging=(0.3, EDGE_DISTANCE))

NO_COLUMNS = np.zeros(0, dtype=np.int_)


class Response(NamedTuple):
    """A joint run along the logs of a grid."""

    predicted: Array  # angles at the used rows [rad], (rows,)
    # least and largest request that acts at each tick, plus sag, less the angle before it [rad],
    # (t, 2)
    errors: Array

    def highest_command(self, at: Parameters) -> float:
        """Highest speed that the requests called for in any run, limited or not [rad/s]."""
        held = 0.0 if at.integral_rate > 0.0 else at.dead_band
        return at.gain * max(float(np.max(np.abs(self.errors))) - held, 0.0)


def respond(
    grid: Grid,
    at: Parameters,
    starts: Array,
    columns: Indices = NO_COLUMNS,
    apart: float = 0.0,
    slopes: Array | None = None,
) -> Response:
    """Run a joint along logs, from the angles at which the runs start [rad], (runs,).

    Slopes are filled with derivatives by columns, both as in :func:`planner.model.kernel.along`.
    """
    from planner.model.kernel import Servo, along

    tick, rows = grid.tick, len(grid.angles)
    faster = 0.0 if math.isinf(at.v_max) else tick * at.v_max
    servo = Servo(
        Law.of(at, tick=tick, acceleration=at.max_acceleration(tick)),
        float(at.lag),
        float(at.acceleration_time),
        float(at.compliance),
        faster * at.asymmetry,
        faster * at.slowing,
        float(at.play),
    )
    slopes = np.empty((rows, 0)) if slopes is None else slopes
    states = np.empty(len(grid.ticks) + len(starts))
    states[grid.starts] = starts
    found = Response(np.empty(rows), np.empty((len(grid.ticks), 2)))
    along(servo, grid.track, columns, apart, states, found.errors, found.predicted, slopes)
    return found


class Slopes(NamedTuple):
    """Derivatives of the angles at the used rows by the law's numbers, and the chain rule."""

    # by columns of the kernel; the last is by the first angle of the row's own run, (rows, c + 1)
    of_law: Array
    # derivatives of these c columns' parameters by the free coordinates, (c, p)
    change: Array

    @property
    def by_parameter(self) -> Array:
        """By the free coordinates, (rows, p)."""
        return np.asarray(self.of_law[:, :-1] @ self.change)

    @property
    def by_start(self) -> Array:
        """Each by the first angle of its own run, (rows,)."""
        return np.asarray(self.of_law[:, -1])


def linearised(
    grid: Grid, parameters: Parameters, starts: Array, free: Free, averaging: float = EDGE_DISTANCE
) -> tuple[Response, Slopes]:
    """Run a joint along logs, with derivatives by parameters and first angles: (16).

    Those by lag and acceleration time are averaged over ``averaging`` [ticks] to both sides.
    """
    from planner.model import kernel

    change = _by_coordinates(grid, parameters)[:, free]
    acting = np.flatnonzero(np.any(change != 0.0, axis=1))
    columns = np.append(acting, kernel.START)
    slopes = np.empty((len(grid.angles), len(columns)))
    response = respond(grid, parameters, starts, columns, averaging * grid.tick, slopes)
    return response, Slopes(slopes, change[acting])


def _by_coordinates(grid: Grid, at: Parameters) -> Array:
    """Derivatives of what the kernel takes by all coordinates, (START, fields)."""
    from planner.model import kernel

    tick, v_max = grid.tick, 0.0 if math.isinf(at.v_max) else at.v_max
    by_integral = tick if at.time_constant > 0.0 else 0.0
    integral = "position_integral_rate" if at.position_integral_rate > 0.0 else "integral_rate"
    entries = [
        (kernel.GAIN, "gain", tick),
        (kernel.V_MAX, "v_max", tick),
        (kernel.FASTER, "v_max", tick * at.asymmetry),
        (kernel.FASTER_LOAD, "v_max", tick * at.slowing),
        (kernel.LAG, "lag", 1.0 / tick),
        (kernel.WINDOW, "acceleration_time", 1.0 / tick),
        (kernel.SAG, "offset", 1.0),
        (kernel.BAND, "dead_band", 1.0),
        (kernel.FASTER, "asymmetry", tick * v_max),
        (kernel.SAG_LOAD, "compliance", 1.0),
        (kernel.FASTER_LOAD, "slowing", tick * v_max),
        (kernel.SHARE, "time_constant", at.motor_by_time_constant(tick)),
        (kernel.ACCELERATION, "acceleration", tick**2),
        (kernel.SAG_SIN, "sag_sin", 1.0),
        (kernel.SAG_COS, "sag_cos", 1.0),
        (kernel.INTEGRAL, integral, by_integral),
        (kernel.PLAY, "play", 1.0),
    ]
    if math.isfinite(at.acceleration):
        taken = by_friction(at, tick).items()
        entries += [(kernel.ACCELERATION, name, tick**2 * value) for name, value in taken]
    change = np.zeros((kernel.START, len(Parameters._fields)))
    for column, field, value in entries:
        change[column, Parameters._fields.index(field)] = value
    return change * units(grid, at)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit to the rows of a grid."""

    grid: Grid
    parameters: Parameters
    free: Free  # which of these were fitted
    starts: Array  # angle at the start of each run [rad]
    response: Response  # the joint along the grid
    residuals: Array  # predicted minus actual angle at the used rows [rad]
    scale: float  # standard deviation of the weighted residuals without outliers [rad]
    cost: float  # Huber's loss at that scale, sum over the rows [rad^2]; half a sum of squares
    # what was tried beside the paper's parameters, by the names of a model
    terms: dict[str, Term] = dataclasses.field(default_factory=dict)

    @property
    def free_names(self) -> tuple[str, ...]:
        """What was fitted, in the order of :class:`Parameters`."""
        return tuple(np.array(Parameters._fields)[self.free].tolist())

    def has(self, *names: str) -> bool:
        """Whether any of these parameters was fitted."""
        return bool((self.free & only(*names)).any())

    @property
    def predicted(self) -> Array:
        """Angle at the used rows [rad]."""
        return self.response.predicted

    @cached_property
    def weighted(self) -> Array:
        """The residuals times the rows' weights [rad]."""
        return self.grid.weights * self.residuals

    @cached_property
    def weights(self) -> Array:
        """Weight of each row beside its own, 1 unless its residual is an outlier."""
        sizes = np.maximum(np.abs(self.weighted), 1e-300)
        return np.minimum(1.0, CORNER * self.scale / sizes)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, outliers included [rad]."""
        return rms(self.residuals)

    @property
    def exact(self) -> bool:
        """Whether the residuals are rounding."""
        return min(self.scale, self.rms) <= ROUNDED * float(np.std(self.grid.angles))

    @property
    def peak_command(self) -> float:
        """Highest speed that the requests called for, limited or not [rad/s]."""
        return self.response.highest_command(self.parameters)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of residuals that are independent from row to row [rad].

        What the model does not explain cancels in the differences of neighbouring rows.
        """
        sound, run = self.weights >= 1.0, self.grid.run
        steps = np.diff(self.weighted)[(run[1:] == run[:-1]) & sound[1:] & sound[:-1]]
        return min(self.scale, rms(steps) / math.sqrt(2.0)) if len(steps) else self.scale

    @property
    def structure(self) -> float:
        """Share of the variance of the residuals that is no noise; 0 where that may be chance."""
        chance = 2.0 / math.sqrt(len(self.residuals))
        return max(1.0 - (self.noise / self.scale) ** 2 - chance, 0.0)

    def slopes(self, *, averaging: float = EDGE_DISTANCE) -> Slopes:
        """Derivatives of the predicted angles by what was fitted."""
        return linearised(self.grid, self.parameters, self.starts, self.free, averaging)[1]

    def starts_on(self, grid: Grid) -> Array:
        """Where the runs of a grid start: as fitted where it was, else as measured."""
        if grid is self.grid:
            return self.starts
        fitted = dict(zip(self.grid.firsts, self.starts, strict=True))
        pairs = zip(grid.firsts, grid.measured_starts, strict=True)
        return np.array([fitted.get(first, angle) for first, angle in pairs])

    def along(self, grid: Grid) -> Response:
        """The joint run along a grid."""
        return respond(grid, self.parameters, self.starts_on(grid))

    def again(self, at: Parameters | None = None, *, grid: Grid | None = None, **how: Any) -> Fit:
        """The search begun here, or at other parameters; ``how`` as in :func:`least_squares`."""
        grid = self.grid if grid is None else grid
        how = {"free": self.free, "starts": self.starts_on(grid), **how}
        found = least_squares(grid, self.parameters if at is None else at, **how)
        return replace(found, terms=self.terms)

    def trial(self, at: Parameters | None = None, *, effort: Effort = TERM, **how: Any) -> Fit:
        """The same at this fit's scale, so that the losses compare."""
        return self.again(at, effort=effort, **{"scale": self.scale, **how})

    def without(self, *names: str, effort: Effort = TERM) -> Fit:
        """The fit without some terms."""
        absent = {name: Parameters._field_defaults[name] for name in names}
        at, free = self.parameters._replace(**absent), self.free & ~only(*names)
        return self.trial(at, free=free, effort=effort)

    def with_short_window(self, *, effort: Effort) -> Fit:
        """The search begun with a window of a tick, and the same latency."""
        at, short = self.parameters, self.grid.tick
        lag = at.lag + 0.5 * (at.acceleration_time - short)
        return self.trial(at._replace(lag=lag, acceleration_time=short), effort=effort)

    def noting(self, without: Fit, with_it: Fit, ends: Mapping[str, Interval]) -> Fit:
        """The fit with a note of what terms would bring; those that it has are kept."""
        errors = {"rms_without": without.rms, "rms_with": with_it.rms}
        tried = {
            TERMS[name]: Term(name=TERMS[name], kept=self.has(name), interval=interval, **errors)
            for name, interval in ends.items()
        }
        return replace(self, terms=self.terms | tried)


def least_squares(
    grid: Grid,
    begin: Parameters,
    *,
    free: Free = USUAL,
    starts: Array | None = None,
    scale: float | None = None,
    effort: Effort = FULL,
    enough: float = -math.inf,
) -> Fit:
    """Fit the free parameters and the first angle of every run: (15) of ``docs/math.md``.

    Gauss-Newton steps in a trust region (Moré, 1978, in *Numerical Analysis*, Lecture Notes in
    Mathematics 630), with the derivatives of (16); first angles are eliminated (Golub and Pereyra,
    1973), and bounds kept by projection. The scale of the loss follows the residuals, from round to
    round, unless it is given. Begins at ``begin``, where what is not free stays, and with the first
    angles ``starts`` [rad], by default those measured. A loss of ``enough`` [rad^2] need not be
    improved on, nor is one that cannot come near it. The answer is never worse than where it began.
    """
    floor = 1e-12 * max(float(np.std(grid.angles)), 1e-300)  # less are rounding errors
    if starts is None:
        starts = grid.measured_starts
    box = box_of(grid)
    begin = Parameters(*np.where(free, np.clip(begin, box.lower, box.upper), begin).tolist())
    first, *others = effort.averaging if scale is None else effort.averaging[-1:]
    response, slopes = linearised(grid, begin, starts, free, first)
    fit = _fit_of(grid, begin, free, starts, response, scale or math.inf)
    if scale is not None:
        return _minimised(fit, slopes, effort, enough, first)[0]
    for averaging in (first, *others):
        slopes = slopes if averaging == first else fit.slopes(averaging=averaging)
        for number in range(effort.rounds):
            found = max(floor, sound_rms(fit.weighted, gross=1.0 - TRUSTED))
            settled = number > 0 and abs(found - fit.scale) <= 1e-3 * found
            fit = replace(fit, scale=found, cost=huber(fit.weighted, found))
            if settled:
                break
            fit, slopes = _minimised(fit, slopes, effort, enough, averaging)
    return fit


def _minimised(
    begin: Fit, slopes: Slopes, effort: Effort, enough: float, averaging: float
) -> tuple[Fit, Slopes]:
    """The best fit at a fixed scale, and its slopes, from those at the first."""
    from planner.identification.trust_region import most_reduction, quadratic_of, step_of

    grid, free = begin.grid, begin.free
    of_firsts = grid.weights[np.minimum(grid.first_rows, len(grid.run) - 1)]
    ends = (Parameters(*each.tolist()) for each in box_of(grid)[1:])
    lower, upper = (coordinates_of(grid, end)[free] for end in ends)
    radius = effort.first_step * float(np.linalg.norm(begin.weighted))
    sizes = np.zeros(len(lower))
    fit, near = begin, None
    for _ in range(effort.evaluations - 1):
        if fit.cost <= enough:
            break
        coordinates = coordinates_of(grid, fit.parameters)
        here = coordinates[free]
        near = near or quadratic_of(
            slopes.of_law,
            slopes.change,
            fit.residuals,
            grid.weights,
            CORNER * fit.scale,
            grid.run,
            of_firsts,
        )
        if not np.isfinite(near.matrix).all():  # derivatives of a joint that hardly comes to rest
            break
        sizes = np.maximum(sizes, near.sizes)
        if enough > 0.0 and fit.cost - 3.0 * most_reduction(near) > enough:
            break
        step, starts, predicted, length = step_of(near, sizes, radius, lower - here, upper - here)
        if not predicted > 1e-3 * effort.tolerance * fit.cost:
            break
        coordinates[free] += step
        at, firsts = parameters_at(grid, coordinates), fit.starts + starts
        response, by_trial = linearised(grid, at, firsts, free, averaging)
        trial = _fit_of(grid, at, free, firsts, response, fit.scale)
        reduced = fit.cost - trial.cost
        if not reduced >= 0.25 * predicted:
            radius = 0.25 * min(length, radius)
        elif reduced > 0.75 * predicted and length > 0.95 * radius:
            radius *= 2.0
        if reduced > 0.0:
            done = 0.25 * predicted < reduced < effort.tolerance * fit.cost
            fit, slopes, near = trial, by_trial, None
            if done:
                break
    return fit, slopes


def _fit_of(
    grid: Grid, at: Parameters, free: Free, starts: Array, response: Response, scale: float
) -> Fit:
    residuals = response.predicted - grid.angles
    cost = huber(grid.weights * residuals, scale)
    return Fit(grid, at, free, starts, response, residuals, scale, cost)


def huber(residuals: Array, scale: float) -> float:
    """Huber's loss of the residuals at a scale."""
    beyond = np.maximum(np.abs(residuals) - CORNER * scale, 0.0)
    # not by BLAS, whose threads wait for one another on a busy machine
    return 0.5 * float(np.sum(residuals**2) - np.sum(beyond**2))


def sound_rms(residuals: Array, *, gross: float = 0.01) -> float:
    """Root mean square of the residuals that are no gross outliers [rad], beyond 10 deviations.

    At most a share ``gross`` is taken for such: in a log that mostly rests even misses of all its
    motion are few and large.
    """
    sizes = np.abs(residuals)
    quantile, most = np.quantile(sizes, [TRUSTED, 1.0 - gross]).tolist()
    bulk = quantile / float(ndtri(0.5 + TRUSTED / 2.0))  # as of a normal distribution
    return rms(residuals[sizes <= max(10.0 * bulk, most)])


def better(fit: Fit, other: Fit) -> bool:
    """Whether another joint fits the rows of a fit better by the information criterion: (16a)."""
    before, after = (huber(each.weighted, fit.scale) for each in (fit, other))
    alike = correlation_time(other.weights * other.weighted)
    independent = max(len(other.residuals) / alike, 2.0)
    return independent * math.log(before / max(after, 1e-300)) > math.log(independent)


def correlation_time(series: Array) -> float:
    """Rows that count as one because they are alike: 1 + 2 times the sum of autocorrelations.

    The sum ends at five times itself (Sokal's window), and at the square root of the number of
    rows, beyond which it would mistake a cycle for one long correlation; at least 1.
    """
    count = len(series)
    transformed = np.fft.rfft(series, 2 * count)
    products = np.fft.irfft(np.abs(transformed) ** 2)[:count]
    if products[0] <= 0.0:
        return 1.0
    times = 2.0 * np.cumsum(products / products[0]) - 1.0
    furthest = math.isqrt(count)
    ended = np.flatnonzero(np.arange(furthest) >= 5.0 * times[:furthest])
    return max(1.0, float(times[ended[0] if len(ended) else furthest]))
