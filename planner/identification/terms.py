"""What a joint has beside the paper's four numbers: terms that are kept, departures that are named.

A further parameter of the model is 0, or infinite, unless it reduces the loss: inertia, dry
friction, asymmetry, load, a sag by the angle, the integral of a speed loop. Backlash is no part of
a model. It is detected by fitting a joint that has it to the same rows::

    m(t) = m(t-1) + w(t),  M(t) = clip(M(t-1), m(t) - h, m(t) + h)

``w`` is the speed of (1a) of ``docs/math.md``, and 2 h the play between the motor m and the angle
M. It is named where it explains the rows much better than the motor's inertia and friction do.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, rms
from planner.identification.grid import Grid, resampled, resampled_like
from planner.identification.intervals import at_edge, model_interval, rise_allowed, uncertainty_of
from planner.identification.least_squares import (
    FULL,
    PROFILE,
    TERM,
    Effort,
    Fit,
    better,
    huber,
    least_squares,
    respond,
)
from planner.identification.parameters import (
    MOST_SAG,
    TERMS,
    Free,
    Parameters,
    coordinates_of,
    only,
)
from planner.identification.result import Interval

ORDER = ("time_constant", "dead_band", "compliance", "slowing", "asymmetry", "sag_sin")
"""In which order the terms are tried, each beside those that were kept before it. Near one pose a
sag by the angle, with an offset against it, is nearly as good as an asymmetry, which comes first:
where an integral term hides the sag at rest gravity shows in the top speeds alone."""

SAG = ("sag_sin", "sag_cos")  # the sag by the angle
PARTNERS = {SAG[0]: SAG[1:]}  # parameters that a term has beside the one that it is called by

INTEGRALS = ("integral_rate", "position_integral_rate")
"""The integrals of a speed loop and of a position controller, tried after all other terms, one of
them at most."""

LEAST_SAVING = 0.1  # least share of the loss that an integral explains by itself

MOTOR = ("acceleration", "time_constant", "dead_band", "asymmetry")
"""Terms that may show only together: a slow start hides dry friction, and friction the inertia."""

SAVING = 0.2
"""Least share of the loss that play explains, or the terms of a motor that are sought together.
(Play explains less in logs of 40 simulated servos without play, ``scripts/bench identify``.)"""

EXPLAINED = 0.25
"""Share of the standard deviation of the motion that the enlarged joint misses at most: what
explains less is another joint."""

INERTIAS, LIMITS = (0.15, 0.5), (0.02, 0.2, 0.6, 2.0)
"""Time constants as shares of a motor's delay, and acceleration limits times that delay over its
highest speed, from which the search begins again. (Without limits that bind the lift of an SO-101
ends 4 % above its least loss, and misses unseen motions by 10.3 mrad, not 8.1.)"""

SOME_FRICTION = 2.0
"""Dead band from which a search for friction begins, in standard deviations of the residuals."""

TRIAL = TERM._replace(evaluations=12, tolerance=1e-3)
ENOUGH = TERM._replace(evaluations=100, tolerance=1e-5)
"""How far each of several beginnings is followed, and the best of them."""


def with_terms(fit: Fit) -> Fit:
    """Add one term after another, and keep those that reduce the loss by (16a).

    Terms that the fit has are kept. The interval of a dead band that cannot be told from a sag has
    no upper end.
    """
    fit = replace(fit, terms={name: term for name, term in fit.terms.items() if term.kept})
    for name in ORDER:
        if not fit.has(name) and _shows(name, fit):
            fit = _with_term(name, fit)
    return fit.again()


def _with_term(name: str, fit: Fit, known: Fit | None = None) -> Fit:
    """The fit with a term that is kept, or the same fit; it is noted, with its partners.

    The fit with it is ``known`` of an overloaded joint.
    """
    trial = replace(known or _fitted_with(name, fit), terms=fit.terms)
    kept = pays(fit, trial)
    if name == "sag_sin":
        kept = kept and _sag_is_determined(trial)
        if known is None:
            kept = kept and not has_large_sag(trial)
    ends = {each: model_interval(trial, each) for each in (name, *PARTNERS.get(name, ()))}
    if name == "dead_band" and not kept and _any_dead_band_does(fit, trial):
        ends[name] = Interval(0.0, math.inf)
    return (trial if kept else fit).noting(fit, trial, ends)


def with_motor(fit: Fit, begin: Parameters | None = None) -> Fit:
    """The fit with those of :data:`MOTOR` that reduce the loss, sought together; or the same fit.

    A load and a sag by the angle that were not kept are tried again beside them: they may show only
    there. Where the fit is poor a wide box is searched, too, and with the sag: first without a
    sag, then, where that is new, with it. (Of twelve overloaded servos, whose fits without inertia
    miss 20 to 30 % of the motion, all are found so, and none in a box by the fit's own delay.) The
    motor found on other rows of the joint may be given to begin with instead.
    """
    excerpt, loaded = _excerpt_to_search(fit, spread=True), None
    if excerpt is None:
        return fit
    free = fit.free | only(*MOTOR)
    begins = [begin] if begin else _beginnings(fit, excerpt, free, partial(_near, fit), 7)
    motor = _motor(fit, begins, free, fit.starts)
    if fit.rms > 0.1 * float(np.std(fit.grid.angles)):
        sag = only(*SAG) & ~free & fit.grid.unloaded
        if not begin:
            begins = _beginnings(fit, excerpt, free | sag, partial(_anywhere, fit), 9)
        bare = found = _motor(fit, begins, free | sag, fit.grid.measured_starts)
        if (found.free & sag).any():
            bare, loaded = found.without(*SAG, effort=ENOUGH), found
        if _saving(fit, bare) >= SAVING:
            motor = min(motor, bare, key=lambda each: huber(each.weighted, fit.scale))
    for name, by in (("compliance", None), ("slowing", None), ("sag_sin", loaded)):
        untried = TERMS[name] in fit.terms and not fit.terms[TERMS[name]].kept
        if untried and (by is not None or motor.response is not fit.response):
            motor = _with_term(name, motor, by)
    if motor.response is fit.response:
        return fit
    ends = dict.fromkeys(MOTOR, Interval(0.0, math.inf))
    ends["asymmetry"] = Interval(-math.inf, math.inf)
    for name in MOTOR[1:]:  # another one may pay now
        if not motor.has(name) and _shows(name, motor):
            motor = _with_term(name, motor)
            ends[name] = motor.terms[TERMS[name]].interval
    motor = motor.again()
    ends |= {name: model_interval(motor, name) for name in MOTOR if motor.has(name)}
    return motor.noting(fit, motor, ends)


def with_integral(fit: Fit) -> Fit:
    """The fit with the integral of a loop of the servo, and the terms of a motor, if that pays.

    A slow integral imitates a drift: a speed loop's has to act in a time not far above the joint's
    delay, and the log has to determine it, and the time constant beside it. Without inertia it
    imitates play, with a dead band as wide.
    """
    excerpt = _excerpt_to_search(fit, spread=True)
    if excerpt is None or fit.has(*INTEGRALS):
        return fit
    pair = _fitted_with_integral(fit, excerpt)
    if pair is None:
        return fit
    (bare, trial), tick = pair, fit.grid.tick
    at = trial.parameters
    ends = {name: model_interval(trial, name) for name in (*INTEGRALS, *MOTOR, *SAG, "compliance")}
    needed = ("time_constant", *(name for name in INTEGRALS if trial.has(name)))
    possible = at.time_constant >= 0.5 * tick  # with less it reproduces play
    possible &= at.integral < at.fastest_integral(tick)
    possible &= not _imitates_drift(at)
    determined = all(ends[name].lower > 0.0 for name in needed)
    pays_alone = pays(bare, trial) and _saving(bare, trial) >= LEAST_SAVING
    if not (possible and determined and pays_alone and pays(fit, trial)):
        return fit
    names = [name for name in ends if name in INTEGRALS or fit.has(name) != trial.has(name)]
    return trial.noting(fit, trial, {name: ends[name] for name in names})


def _imitates_drift(at: Parameters) -> bool:
    """Whether the integral of a speed loop is far slower than the joint.

    Of seven simulated cascades its rate is 1.1 to 2.9 times that of the joint; one that reproduces
    small errors of a joint that rings has 0.1 to 0.2 times.
    """
    return 0.0 < at.integral_rate < 0.3 / at.whole_delay


def _fitted_with_integral(fit: Fit, excerpt: Grid) -> tuple[Fit, Fit] | None:
    """The best fits of a motor, with the terms of (16a): without and with an integral.

    None where the second saves little.
    """
    at, sag = fit.parameters, SAG if fit.grid.unloaded else ()
    sag = (*sag, *(["compliance"] if _shows("compliance", fit) else []))
    rate, friction = 0.5 / at.whole_delay, SOME_FRICTION * fit.scale
    motors = _divisions(fit, [None])
    if at.time_constant > 0.0:
        motors.insert(0, at)
    begins = [each._replace(dead_band=max(each.dead_band, friction)) for each in motors]
    near, trials = partial(fit.trial, grid=excerpt, effort=TRIAL), []
    for name in INTEGRALS:
        free = fit.free | only(name, *MOTOR, *sag)
        trials += [near(each._replace(**{name: rate}), free=free) for each in begins]
    best = min(trials, key=lambda each: (_imitates_drift(each.parameters), each.cost))
    if _saving(near(), best) < 0.5 * LEAST_SAVING:
        return None
    best = fit.trial(best.parameters, free=best.free)
    if _saving(fit, best) < 0.5 * LEAST_SAVING:
        return None
    best = best.trial(effort=ENOUGH)
    bare = best.without(*INTEGRALS)
    if _saving(bare, best) < 0.5 * LEAST_SAVING:
        return None
    best = _redivided(best)
    for names in (SAG, ("compliance",), *((name,) for name in MOTOR if name != "time_constant")):
        if best.free[only(*names)].all():
            without = best.without(*names, effort=ENOUGH)
            believed = names != SAG or not has_large_sag(best)
            best = best if believed and pays(without, best) else without
    return best.without(*INTEGRALS, effort=ENOUGH), best


def without_top_speed(fit: Fit, tick: float) -> tuple[Fit, ...]:
    """The fit with limited acceleration but no top speed, if that fits about as well.

    Where requests step from row to row, such a limit slows a joint the more, the faster it moves,
    and only short ticks show it. Alone it may save too little to be kept, but the log then does not
    bound the top speed. (Of 40 logs of two sines at half the speed that simulated servos can reach,
    14 seemed to bound it, at 0.4 to 0.8 of theirs.)
    """
    allowed, free = fit.cost + rise_allowed(fit, "v_max"), fit.free & ~only("v_max")
    at = fit.parameters._replace(v_max=math.inf)
    if fit.exact or math.isinf(fit.parameters.v_max) or math.isfinite(at.acceleration):
        return ()
    bare = fit.trial(at, free=free)
    if not allowed < bare.cost < 2.0 * fit.cost:
        return ()
    grid, at, begins = resampled_like(fit.grid, fit.grid.logs, tick), bare.parameters, []
    delay, latency = at.whole_delay, at.lag + at.acceleration_time / 2.0
    for window, gain, limit in itertools.product(
        (tick, 0.15 * delay, 0.3 * delay), (1.0, 1.3), (0.6, 2.0)
    ):
        acceleration = limit * grid.fastest / delay
        times = {"lag": max(latency - window / 2.0, 0.0), "acceleration_time": window}
        begins.append(at._replace(gain=gain * at.gain, acceleration=acceleration, **times))
    free |= only("acceleration")
    trials = [bare.trial(each, grid=grid, free=free, effort=TRIAL) for each in begins]
    best = min(trials, key=lambda each: each.cost).trial(effort=ENOUGH)
    return (best,) if best.cost <= allowed else ()


def with_needed(fit: Fit, names: Sequence[str], *, effort: Effort) -> Fit:
    """The fit without those of some terms that do not reduce the loss by (16a), one by one."""
    for name in names:
        if fit.has(name):
            without = fit.without(name, *PARTNERS.get(name, ()), effort=effort)
            fit = fit if pays(without, fit) else without
    return fit


def with_calm_friction(fit: Fit) -> Fit:
    """The fit with the dead band of the log that surely shows most of it; or the same fit.

    Whatever shakes a joint hides its dry friction; the largest is that of calm motion. A log counts
    where the lower end of its own interval lies above what all logs together show, and its angles
    spread at least half as far as those of the widest log: static friction is more than what slows
    a joint down. (Without that a log of an SO-101 that spreads 0.3 times as far gives its wrist a
    dead band 1.3 to 1.4 times as large, and motions that were not fitted are missed by 4.1 and 3.9
    mrad, not by 3.8 and 3.1.)
    """
    grid, at, logs = fit.grid, fit.parameters, fit.grid.logs
    if len(logs) < 2 or not fit.has("dead_band"):
        return fit
    least, size = at.dead_band, at.dead_band
    spreads = [float(np.std(log.angles[log.torque_on])) for log in logs]
    for log, spread in zip(logs, spreads, strict=True):
        if spread < 0.5 * max(spreads):
            continue
        part = resampled([log], tick=grid.tick, reach=grid.reach, burn_in=grid.burn_in)
        if len(part.angles) < 100:
            continue
        alone = least_squares(part, at, free=only("dead_band", "offset", "gain"), effort=TERM)
        if alone.rms > EXPLAINED * float(np.std(part.angles)) or at_edge(alone, "dead_band"):
            continue
        lower = model_interval(alone, "dead_band").lower
        if lower > least:
            least, size = lower, alone.parameters.dead_band
    if size == at.dead_band:
        return fit
    at, free = at._replace(dead_band=size), fit.free & ~only("dead_band")
    return replace(fit.trial(at, free=free, effort=FULL), free=fit.free)


def _motor(fit: Fit, begins: Sequence[Parameters], free: Free, starts: Array) -> Fit:
    """The best fit from several beginnings; or the same fit, where none saves enough.

    Those of :data:`MOTOR` without which the loss is no larger are left out again.
    """
    if not begins:
        return fit
    begins = [Parameters(*np.where(free, each, fit.parameters).tolist()) for each in begins]
    trials = (fit.trial(begin, free=free, starts=starts) for begin in begins)
    trial = min(trials, key=lambda each: each.cost).trial(effort=ENOUGH)
    if len(begins) > 1 and _saving(fit, trial) >= 0.5 * SAVING:
        trial = _redivided(trial)
    if not pays(fit, trial):
        return fit
    trial = with_needed(trial, MOTOR, effort=TERM)
    return trial if _saving(fit, trial) >= SAVING else fit


def _redivided(fit: Fit) -> Fit:
    """The fit, or a better one that begins with another division of its delay.

    Lag, window, inertia and gain can replace one another, so that the search by derivatives may end
    in a local optimum in which one takes the place of another, or of the dead band.
    """
    while True:
        trials = [fit.trial(at, effort=TRIAL) for at in _divisions(fit, [*LIMITS, None])]
        best = min(trials, key=lambda each: each.cost).trial(effort=ENOUGH)
        if best.cost >= 0.99 * fit.cost:
            return fit
        fit = best


def _divisions(fit: Fit, limits: Sequence[float | None]) -> list[Parameters]:
    """The joint of a fit with its delay divided by :data:`INERTIAS`, its error a dead band.

    Acceleration limits are those of :data:`LIMITS`, or its own where None stands.
    """
    at, begins = fit.parameters, []
    delay, speed = at.whole_delay, min(at.v_max, fit.grid.fastest)
    divided = at._replace(
        acceleration_time=max(0.1 * delay, fit.grid.tick),
        lag=0.1 * delay,
        dead_band=max(at.dead_band, fit.rms),
    )
    for share, limit in itertools.product(INERTIAS, limits):
        begin = divided._replace(time_constant=share * delay)
        if limit is not None:
            begin = begin._replace(acceleration=limit * speed / delay, asymmetry=0.0)
        begins.append(begin)
    return begins


def _shows(name: str, fit: Fit) -> bool:
    """Whether the rows depend on a term."""
    grid = fit.grid
    if fit.exact:
        return False
    if name in ("dead_band", "time_constant"):
        return True
    loads_differ = bool(np.ptp(grid.loads) > 0.1 * grid.heaviest)
    if name == "compliance":
        return loads_differ
    if name == "sag_sin":
        return grid.unloaded
    errors = fit.response.errors
    saturated = ~fit.parameters.inside(errors, grid.loads[:, np.newaxis])
    if name == "slowing":
        return bool(saturated.any()) and loads_differ
    return bool((saturated & (errors > 0.0)).any() and (saturated & (errors < 0.0)).any())


def _fitted_with(name: str, fit: Fit) -> Fit:
    """The best fit with one term more."""
    free = fit.free | only(name, *PARTNERS.get(name, ()))
    at = fit.parameters
    begins = [at]
    if name == "dead_band":
        begins = [at._replace(dead_band=max(at.dead_band, SOME_FRICTION * fit.scale))]
    if name == "time_constant":
        begins = [  # it replaces a part of the window, and of the lag
            at._replace(
                time_constant=share * at.whole_delay,
                acceleration_time=max(window * at.acceleration_time, fit.grid.tick),
                lag=lag * at.lag,
            )
            for share, window, lag in ((0.2, 0.5, 1.0), (0.4, 0.2, 0.5))
        ]
    found = min((fit.trial(each, free=free) for each in begins), key=lambda each: each.cost)
    at, shown = found.parameters, found.peak_command
    if name == "dead_band" and at.v_max > shown:
        # Friction hides how fast the joint is called to move: v_max had no slope until here.
        # (Without this one of 29 reference logs is fitted 0.4 % worse.)
        lower = at._replace(v_max=0.7 * shown)
        found = min(found, found.trial(lower), key=lambda each: each.cost)
    return found


def has_large_sag(fit: Fit) -> bool:
    """Whether a sag by the angle is believed of an overloaded joint only.

    It may be a table on which the joint stands, and one of theta_0 exceeds the torque of the joint,
    which then stops as at a mechanical stop.
    """
    at = fit.parameters
    return math.hypot(at.sag_sin, at.sag_cos) >= min(0.3, at.v_max / at.gain)


def _any_dead_band_does(fit: Fit, trial: Fit) -> bool:
    """Whether a dead band of half the errors fits as well, with another sag.

    In motion of one direction friction holds the joint back by as much as a sag would.
    """
    at = trial.parameters
    errors = np.mean(fit.response.errors, axis=1)
    size = 0.5 * rms(errors)
    moved = math.copysign(size - at.dead_band, float(np.sum(errors)))
    at = at._replace(dead_band=size, offset=at.offset + moved)
    held = trial.trial(at, free=fit.free, effort=PROFILE)
    return held.cost <= trial.cost + rise_allowed(trial, "dead_band")


def _sag_is_determined(fit: Fit) -> bool:
    """Whether a sag by the angle is far from 0 in the metric of its covariance, and bounded.

    What the model does not explain, such as a mechanical stop, may be like a sag, and logs of few
    or close angles do not tell a sag by the angle from a constant one. (In logs of servos without
    one it is at most 1.7 half widths of its 95 % region from 0, with one of 0.25 degrees or more at
    least 2.7.)
    """
    pair, uncertainty = np.flatnonzero(only(*SAG)), uncertainty_of(fit)
    sag = coordinates_of(fit.grid, fit.parameters)[pair]
    covariance = uncertainty.covariance[np.ix_(pair, pair)]
    if any(at_edge(fit, name) for name in SAG) or not np.isfinite(covariance).all():
        return False
    if np.linalg.matrix_rank(covariance) < len(pair):  # no noise, or no information
        return False
    far = float(sag @ np.linalg.solve(covariance, sag))
    return far > (2.0 * uncertainty.quantile) ** 2


def pays(without: Fit, with_it: Fit) -> bool:
    """Whether another joint lowers the information criterion and 1 % of the loss: (16a)."""
    before, after = (huber(fit.weighted, without.scale) for fit in (without, with_it))
    return not without.exact and after < 0.99 * before and better(without, with_it)


class Backlash(NamedTuple):
    """Play between motor and angle, which no model has."""

    size: float  # 2 h [rad]
    without: float  # error of the joint without it [rad], rms over the rows that were compared
    rms: float  # the same with it [rad]
    difference: Array  # by how much they differ at each used row [rad]; 0 where not compared
    gained: Array  # by how much the squared error of each used row is less with it [rad^2]


def backlash_of(fit: Fit) -> Backlash | None:
    """The play of the joint of a fit, if it explains much; inertia and friction are free, too.

    A joint whose play is more than half of its motion hardly moves. (That keeps a play of 2 degrees
    of a humanoid's shoulder that moved by 4.)
    """
    excerpt = _excerpt_to_search(fit)
    if excerpt is None:
        return None
    free, at = fit.free | only("dead_band", "time_constant"), fit.parameters

    def fitted(begin: Parameters, effort: Effort) -> Fit:  # what begins without stays without
        ways = free | only("play") if begin.play > 0.0 else free
        return fit.trial(begin, grid=excerpt, free=ways, effort=effort)

    def best(begins: Iterable[Parameters]) -> Fit:
        trials = (fitted(begin, TRIAL) for begin in begins)
        return fitted(min(trials, key=lambda trial: trial.cost).parameters, ENOUGH)

    delay = at.whole_delay
    divided = at._replace(  # of the same delay, most of which is inertia and a low gain
        lag=0.25 * delay,
        acceleration_time=max(0.1 * delay, fit.grid.tick),
        gain=min(2.0 / delay, at.gain),
        time_constant=0.2 * delay,
    )
    bare = best([at._replace(time_constant=0.1 * at.acceleration_time), at, divided])
    sizes = (2.0 * bare.rms, 5.0 * bare.rms)
    found = best(each._replace(play=size) for each in (bare.parameters, divided) for size in sizes)
    if _saving(bare, found) >= SAVING:  # or is there a better optimum without it
        bare = min(bare, fitted(found.parameters._replace(play=0.0), ENOUGH), key=lambda f: f.cost)
    motion, play = float(np.std(excerpt.angles)), found.parameters.play
    named = _saving(bare, found) >= SAVING
    if not (named and found.rms <= EXPLAINED * motion and play <= 0.5 * motion):
        return None
    places = zip(excerpt.places, fit.grid.places, strict=True)
    compared = np.concatenate([used[rows] for used, rows in places])
    difference, gained = np.zeros((2, len(compared)))
    difference[compared] = np.abs(found.residuals - bare.residuals)
    gained[compared] = bare.residuals**2 - found.residuals**2
    return Backlash(play, bare.rms, found.rms, difference, gained)


def _saving(without: Fit, with_it: Fit) -> float:
    """Share of the loss that is explained."""
    return 1.0 - with_it.cost / max(without.cost, 1e-300)


def _beginnings(
    fit: Fit, excerpt: Grid, free: Free, joint: Callable[[Array], Parameters], dimensions: int
) -> list[Parameters]:
    """Motors of a box that are good on an excerpt, where the search on all rows begins.

    The loss has many local optima. Points fill the box evenly (Roberts' additive sequence, 2018);
    of the 24 with the least loss the search by derivatives is begun, and the best four are to be
    followed on all rows. None where the best explains less than half of what a motor has to. (Of 60
    logs that is 0 to 13 % of the loss where no motor is found, 18 % and more where one is.)
    """
    ratio = 2.0  # the root above 1 of x^(dimensions + 1) = x + 1
    for _ in range(50):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1.0))
    steps = ratio ** -np.arange(1.0, dimensions + 1.0)
    points = [joint(point) for point in (0.5 + np.outer(np.arange(256), steps)) % 1.0]

    def loss(at: Parameters) -> float:
        errors = respond(excerpt, at, excerpt.measured_starts).predicted - excerpt.angles
        return huber(excerpt.weights * errors, fit.scale)

    near = partial(fit.trial, grid=excerpt, effort=TRIAL)
    trials = [near(at, free=free) for at in sorted(points, key=loss)[:24]]
    trials.sort(key=lambda trial: trial.cost)
    explains = _saving(near(), trials[0]) >= 0.5 * SAVING
    return [trial.parameters for trial in trials[:4]] if explains else []


def _anywhere(fit: Fit, place: Array) -> Parameters:
    """The motor at a point of a wide box of nine dimensions, which does not depend on the fit.

    The fitted delay of a model without inertia, friction and sag may be seconds where a load
    overcomes the servo, so that it cannot scale the box.
    """
    grid = fit.grid
    longest, tick, fastest = min(0.1, 0.4 * grid.reach), grid.tick, max(grid.fastest, 1e-3)
    lag, window, constant, gain, limit, band, top, by_sine, by_cosine = place.tolist()
    found = fit.parameters._replace(
        lag=longest * lag,
        acceleration_time=max(longest * window**2, tick),
        time_constant=min(0.002 * 250.0**constant, 0.9 * grid.reach),
        gain=min(0.5 * 200.0**gain, 1.9 / tick),
        acceleration=0.5 * 1000.0**limit * fastest,
        dead_band=0.2 * grid.span * band**2,
        v_max=0.8 * 10.0**top * fastest,
    )
    if not grid.unloaded:
        return found
    sags = [MOST_SAG * (2.0 * each - 1.0) for each in (by_sine, by_cosine)]
    return found._replace(offset=0.0, sag_sin=sags[0], sag_cos=sags[1])


def _near(fit: Fit, place: Array) -> Parameters:
    """The motor at a point of a box of seven dimensions that the delay of a fit scales."""
    at, grid = fit.parameters, fit.grid
    delay, speed = at.whole_delay, min(at.v_max, grid.fastest)
    lag, window, constant, gain, limit, band, top = place.tolist()
    return at._replace(
        lag=0.9 * lag * delay,
        acceleration_time=max(0.8 * window**2 * delay, grid.tick),
        time_constant=0.94 * max(constant - 0.2, 0.0) ** 2 * delay,  # a fifth without
        gain=0.5 * 20.0**gain / delay,
        acceleration=0.03 * 1000.0**limit * speed / delay,
        dead_band=0.01 * 200.0**band * max(at.dead_band, SOME_FRICTION * fit.scale),
        v_max=max(at.v_max, grid.fastest) * 0.8 * 4.0**top,
    )


def _excerpt_to_search(fit: Fit, *, spread: bool = False) -> Grid | None:
    """Parts of about 4 s, as runs of their own, in which to seek more: at most some 6,000 ticks.

    They are those that the model misses most, or, with ``spread``, spread over the logs. Their
    first half seconds are left out, in which the unknown speed at the start matters. None where the
    residuals are noise, or the rows are few.
    """
    if fit.exact or fit.structure < 0.2:
        return None
    grid, length, most = fit.grid, 4.0, 6000
    since = grid.times - grid.times[grid.first_rows][grid.run]
    of_run = np.stack([grid.run, np.floor(since / length)])
    part = np.cumsum(np.any(np.diff(of_run, prepend=of_run[:, :1]) != 0.0, axis=0))
    ticks = np.bincount(part) * (len(grid.ticks) / len(part))
    if spread:
        count = max(1, int(len(ticks) * min(1.0, most / np.sum(ticks))))
        parts = np.unique(np.linspace(0, len(ticks) - 1, count).round().astype(np.intp))
    else:
        worst = np.argsort(-np.bincount(part, fit.weighted**2), kind="stable")
        longest = np.searchsorted(np.cumsum(ticks[worst]), most, side="right")
        parts = worst[: max(1, int(longest))]
    kept = np.isin(part, parts)
    settles = (since % length < 0.5) & (np.diff(part, prepend=-1) == 0)
    pieces = (grid.per_log(each.astype(float), fill=0.0) for each in (kept, settles))
    logs = [
        replace(log, torque_on=on > 0.0, measured=log.measured & (settling == 0.0))
        for log, on, settling in zip(grid.logs, *pieces, strict=True)
    ]
    excerpt = resampled_like(grid, logs, grid.tick)
    angles, predicted = excerpt.angles.copy(), grid.per_log(fit.predicted)
    angles[excerpt.first_rows] = [predicted[log][row] for log, row in excerpt.firsts]
    excerpt = replace(excerpt, angles=angles)  # the parts begin where the fit is
    return excerpt if len(excerpt.angles) >= 2 * np.sum(fit.free) else None
