"""What a joint has beside the paper's five numbers: terms that are kept, departures that are named.

A further parameter of the model is 0 unless it reduces the loss: inertia, dry friction, asymmetry,
load. Backlash and an acceleration limit are no part of an identified model. They are detected by
fitting a joint that has them to the same rows::

    m(t) = m(t-1) + w(t),  M(t) = clip(M(t-1), m(t) - h, m(t) + h)

``w`` is the speed of (1a) of ``docs/math.md`` with a time constant T and an acceleration limit A,
and 2 h the play between the motor m and the angle M. The limit is named where T and A explain
the rows much better than T alone, the play where T and h do: T is the inertia of every servo.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.identification.fit import ROUNDED, peak_command
from planner.identification.grid import Grid
from planner.identification.intervals import (
    Uncertainty,
    correlation_time,
    model_interval,
    rise_allowed,
    structure_of,
    uncertainty_of,
)
from planner.identification.least_squares import (
    PROFILE,
    TERM,
    Effort,
    Fit,
    huber,
    least_squares,
)
from planner.identification.parameters import TERMS, Parameters, only
from planner.identification.result import Interval, Term
from planner.trajectory import Array, Indices, Mask, rms

ORDER = ("time_constant", "compliance", "dead_band", "slowing", "asymmetry")
"""In which order the terms are tried, each beside those that were kept before it."""

SAVING = 0.2
"""Least share of the loss that play, or a limit, has to explain. Of 40 made servos with neither
none reaches it (``scripts/bench identify``)."""

EXPLAINED = 0.25
"""Share of the standard deviation of the motion that the enlarged joint misses at most: what
explains less is another joint."""

MOST_PLAY = 0.5
"""Largest play, as a share of the same: a joint whose play is wider hardly moves. It keeps a play
of 2 degrees from a humanoid's shoulder that moved by 4, and one of 38 from an overloaded servo."""

MOST_TICKS = 6000
"""Of longer logs only so many ticks are compared, in the chunks that the model misses most."""

TRIAL = TERM._replace(evaluations=12, tolerance=1e-3)
ENOUGH = TERM._replace(evaluations=100, tolerance=1e-5)
"""How far each of several beginnings is followed, and the best of them."""


def with_terms(fit: Fit) -> tuple[Fit, tuple[Term, ...]]:
    """Add one term after another, and keep those that reduce the loss by (16a).

    A term is kept where it lowers the Bayesian information criterion (Schwarz, 1978) of as many
    rows as are independent, ``n_eff log(loss without / loss with) > log(n_eff)`` with
    ``n_eff = n / correlation time of the residuals``, and saves at least 1 % of the loss.

    Returns:
        The fit with the terms that are kept, and the errors with and without each that was tried.
        The interval of a dead band that cannot be told from a sag has no upper end.
    """
    terms: list[Term] = []
    for name in ORDER:
        if not _shows(name, fit):
            continue
        trial = _fitted_with(name, fit)
        kept = _pays(fit, trial)
        uncertainty = uncertainty_of(trial)
        interval = model_interval(trial, uncertainty, name)
        if name == "dead_band" and not kept and _any_dead_band_does(fit, trial, uncertainty):
            interval = Interval(0.0, math.inf)
        terms.append(
            Term(
                name=TERMS[name],
                kept=kept,
                rms_without=fit.rms,
                rms_with=trial.rms,
                interval=interval,
            )
        )
        fit = trial if kept else fit
    fit = least_squares(fit.grid, fit.parameters, free=fit.free, starts=fit.starts)
    return fit, tuple(terms)


def _shows(name: str, fit: Fit) -> bool:
    """Whether the rows depend on a term."""
    grid = fit.grid
    if fit.scale <= ROUNDED * float(np.std(grid.angles)):
        return False
    if name in ("dead_band", "time_constant"):
        return True
    if name == "compliance":
        return _loads_differ(grid)
    errors = fit.response.errors
    saturated = ~fit.parameters.inside(errors, grid.loads[:, np.newaxis])
    if name == "slowing":
        return bool(saturated.any()) and _loads_differ(grid)
    return bool((saturated & (errors > 0.0)).any() and (saturated & (errors < 0.0)).any())


def _loads_differ(grid: Grid) -> bool:
    return bool(np.ptp(grid.loads) > 0.1 * grid.heaviest)


def _fitted_with(name: str, fit: Fit) -> Fit:
    """The best fit with one term more."""
    free = fit.free.copy()
    free[Parameters._fields.index(name)] = True
    at = fit.parameters
    begins = [at]
    if name == "dead_band":
        begins = [at._replace(dead_band=2.0 * fit.scale)]
    if name == "time_constant":
        begins = [  # it replaces a part of the window, and of the lag
            at._replace(
                time_constant=share * at.whole_delay,
                acceleration_time=max(window * at.acceleration_time, fit.grid.tick),
                lag=lag * at.lag,
            )
            for share, window, lag in ((0.2, 0.5, 1.0), (0.4, 0.2, 0.5))
        ]
    search = partial(least_squares, fit.grid, free=free, scale=fit.scale, effort=TERM)
    found = min((search(each, starts=fit.starts) for each in begins), key=lambda each: each.cost)
    at, shown = found.parameters, peak_command(found)
    if name == "dead_band" and at.v_max > shown:
        # Friction hides how fast the joint is called to move: v_max had no slope until here.
        # (Without this one of 29 reference logs is fitted 0.4 % worse.)
        lower = at._replace(v_max=0.7 * shown)
        found = min(found, search(lower, starts=found.starts), key=lambda each: each.cost)
    return found


def _any_dead_band_does(fit: Fit, trial: Fit, uncertainty: Uncertainty) -> bool:
    """Whether a dead band of half the errors fits as well, with another sag.

    In motion of one direction friction holds the joint back by as much as a sag would.
    """
    at, grid = trial.parameters, fit.grid
    errors = np.mean(fit.response.errors, axis=1)
    size = 0.5 * rms(errors)
    moved = math.copysign(size - at.dead_band, float(np.sum(errors)))
    held = least_squares(
        grid,
        at._replace(dead_band=size, offset=at.offset + moved),
        free=fit.free,
        starts=trial.starts,
        scale=trial.scale,
        effort=PROFILE,
    )
    return held.cost <= trial.cost + rise_allowed(trial, uncertainty, "dead_band")


def _pays(without: Fit, with_it: Fit) -> bool:
    """Whether the information criterion, and the least saving, speak for a term."""
    before, after = (huber(fit.residuals, without.scale) for fit in (without, with_it))
    if not after < (1.0 - 0.01) * before:
        return False
    alike = correlation_time(with_it.weights * with_it.residuals)
    independent = max(len(with_it.residuals) / alike, 2.0)
    return independent * math.log(before / max(after, 1e-300)) > math.log(independent)


class Departure(NamedTuple):
    """What a joint has beside the model.

    Attributes:
        name: "backlash" or "acceleration limit".
        size: The play 2 h [rad], or A [rad/s^2].
        without: Error of the joint with T alone [rad], rms over the rows that were compared.
        rms: Error of the joint with both [rad].
        difference: By how much they differ at each used row [rad]; 0 where not compared.
        gained: By how much the squared error of each used row is less with both [rad^2].
    """

    name: str
    size: float
    without: float
    rms: float
    difference: Array
    gained: Array


def unmodelled(fit: Fit) -> list[Departure]:
    """What the joint has beside the model of a fit, that which explains most first.

    Where the residuals are noise from row to row nothing is sought.
    """
    if structure_of(fit) < SAVING:
        return []
    excerpt = excerpt_of(fit)
    if np.sum(excerpt.compared) < 2 * np.sum(fit.free):
        return []

    def fitted(begin: Parameters, effort: Effort) -> Fit:  # what begins without stays without
        further = {"dead_band", "time_constant"}
        further |= {"play"} if begin.play > 0.0 else set()
        further |= {"max_acceleration"} if math.isfinite(begin.max_acceleration) else set()
        return least_squares(
            excerpt.grid,
            begin,
            free=fit.free | only(*further),
            starts=excerpt.starts,
            scale=fit.scale,
            effort=effort,
        )

    def best(begins: Iterable[Parameters]) -> Fit:
        trials = (fitted(begin, TRIAL) for begin in begins)
        return fitted(min(trials, key=lambda trial: trial.cost).parameters, ENOUGH)

    at, delay, tick = fit.parameters, fit.parameters.whole_delay, fit.grid.tick
    divided = at._replace(
        lag=0.25 * delay,
        acceleration_time=max(0.1 * delay, tick),
        gain=min(2.0 / delay, at.gain),
        time_constant=0.2 * delay,
    )
    bare = best([at._replace(time_constant=0.1 * at.acceleration_time), divided])
    both = bare.parameters, divided
    found = {
        "acceleration limit": best(_limited(joint, fit.grid) for joint in both),
        "backlash": best(
            joint._replace(play=size * bare.rms) for size in (2.0, 5.0) for joint in both
        ),
    }
    for each in found.values():
        if _saving(bare, each) >= SAVING:  # or is there a better optimum without it
            without = each.parameters._replace(max_acceleration=math.inf, play=0.0)
            bare = min(bare, fitted(without, ENOUGH), key=lambda trial: trial.cost)
    motion = float(np.std(excerpt.grid.angles))
    named = []
    for name, each in found.items():
        play, limit = each.parameters.play, each.parameters.max_acceleration
        if (
            _saving(bare, each) >= SAVING
            and each.rms <= EXPLAINED * motion
            and play <= MOST_PLAY * motion
        ):
            difference, gained = np.zeros((2, len(excerpt.compared)))
            difference[excerpt.compared] = np.abs(each.residuals - bare.residuals)
            gained[excerpt.compared] = bare.residuals**2 - each.residuals**2
            size = play if name == "backlash" else limit
            named.append(Departure(name, size, bare.rms, each.rms, difference, gained))
    return sorted(named, key=lambda departure: departure.rms)


def _saving(without: Fit, with_it: Fit) -> float:
    """Share of the loss that is explained."""
    return 1.0 - with_it.cost / max(without.cost, 1e-300)


def _limited(at: Parameters, grid: Grid) -> Parameters:
    """Where the search for an acceleration limit begins: it takes half of the ramp."""
    speed = min(at.v_max, grid.fastest)
    limit = speed / max(at.acceleration_time + at.time_constant, grid.tick)
    constant = max(0.5 * at.time_constant, grid.tick)
    return at._replace(
        acceleration_time=max(0.5 * at.acceleration_time, grid.tick),
        time_constant=constant,
        max_acceleration=limit,
        dead_band=min(at.dead_band, 0.5 * limit * constant / at.gain),  # or it never moves
    )


class Excerpt(NamedTuple):
    """Chunks of a fit's rows, as runs of their own.

    Attributes:
        grid: The chunks.
        compared: Which of the fit's rows they hold.
        starts: Angle of the fit where each chunk begins [rad].
    """

    grid: Grid
    compared: Mask
    starts: Array


def excerpt_of(fit: Fit) -> Excerpt:
    """The chunks that the model misses most, without their first half seconds."""
    grid, settling = fit.grid, round(0.5 / fit.grid.tick)
    chunks = _chunks(fit)
    lengths = np.diff(chunks)[:, 0]
    ticks = np.concatenate([np.arange(*chunk) for chunk in chunks.tolist()])
    number = np.repeat(np.arange(len(chunks)), lengths)
    starts = np.concatenate([[0], np.cumsum(lengths + 1)[:-1]])
    states = np.arange(len(ticks)) + number + 1
    place = np.full(len(fit.response.states), -1)  # of each state of the fit in the excerpt
    place[grid.states[ticks]] = states
    chunk = np.zeros(len(place), dtype=int)
    chunk[grid.states[ticks]] = number
    before, after = place[grid.before], place[np.minimum(grid.before + 1, len(place) - 1)]
    since = before - starts[chunk[grid.before]]
    compared = (before >= 0) & (since >= settling) & (after == before + 1)
    part = replace(
        grid,
        ticks=grid.ticks[ticks],
        loads=grid.loads[ticks],
        states=states,
        starts=starts,
        before=before[compared],
        share=grid.share[compared],
        run=chunk[grid.before[compared]],
        angles=grid.angles[compared],
        firsts=(),
        places=(),
    )
    return Excerpt(part, compared, fit.response.states[grid.states[chunks[:, 0]] - 1])


def _chunks(fit: Fit) -> Indices:
    """First tick of each chunk and the one after its last, (chunks, 2): those that fit worst."""
    grid = fit.grid
    length = max(1, round(4.0 / grid.tick))
    firsts = grid.starts - np.arange(len(grid.starts))  # a start is no tick
    found = []
    for first, beyond in zip(firsts, np.append(firsts[1:], len(grid.ticks)), strict=True):
        edges = np.linspace(first, beyond, max(1, round((beyond - first) / length)) + 1).astype(int)
        found.append(np.column_stack([edges[:-1], edges[1:]]))
    chunks = np.concatenate(found)
    at_ticks = np.searchsorted(grid.states, grid.before + 1)  # the tick that ends at each row
    losses = np.bincount(at_ticks, fit.residuals**2, len(grid.ticks))
    per_chunk = np.add.reduceat(losses, chunks[:, 0])
    worst = np.argsort(-per_chunk, kind="stable")
    total = np.cumsum(np.diff(chunks)[worst, 0])
    kept = worst[: max(1, int(np.searchsorted(total, MOST_TICKS, side="right")))]
    return np.asarray(chunks[np.sort(kept)])
