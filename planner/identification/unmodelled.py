"""Backlash and an acceleration limit: found by fitting a joint that has them to the same rows.

The model is enlarged by what many servos have and Equation 3 does not, and fitted again::

    m(t) = m(t-1) + w(t),  M(t) = clip(M(t-1), m(t) - h, m(t) + h)

``w`` is the speed of (1a) of ``docs/math.md`` with a time constant T and an acceleration limit A,
and 2 h the play between the motor m and the angle M. The limit is named where T and A explain
the rows much better than T alone, the play where T and h do: T is the inertia of every servo.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.identification.intervals import structure_of
from planner.identification.least_squares import TERM, Effort, Fit, least_squares
from planner.identification.parameters import Parameters, only
from planner.identification.resampling import Grid
from planner.trajectory import Array, Indices, Mask

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
    at, delay, tick = fit.parameters, fit.parameters.whole_delay, fit.grid.tick
    divided = at._replace(
        lag=0.25 * delay,
        acceleration_time=max(0.1 * delay, tick),
        gain=min(2.0 / delay, at.gain),
        time_constant=0.2 * delay,
    )
    bare = excerpt.best([at._replace(time_constant=0.1 * at.acceleration_time), divided])
    bends = np.diff(bare.residuals, 2)  # of noise six times its variance
    if 1.0 - float(np.mean(bends**2)) / 6.0 / max(bare.rms, 1e-300) ** 2 < SAVING:
        return []
    both = bare.parameters, divided
    found = {
        "acceleration limit": excerpt.best(
            limited for joint in both for limited in _limited(joint, fit.grid)
        ),
        "backlash": excerpt.best(
            joint._replace(play=size * bare.rms) for size in (2.0, 5.0) for joint in both
        ),
    }
    for each in found.values():
        if _saving(bare, each) >= SAVING:  # or is there a better optimum without it
            without = each.parameters._replace(max_acceleration=math.inf, play=0.0)
            again = excerpt.fitted(without, ENOUGH)
            bare = min(bare, again, key=lambda trial: trial.cost)
    motion = float(np.std(excerpt.grid.angles))
    named = [
        excerpt.departure(name, bare, each)
        for name, each in found.items()
        if _saving(bare, each) >= SAVING
        and each.rms <= EXPLAINED * motion
        and each.parameters.play <= MOST_PLAY * motion
    ]
    return sorted(named, key=lambda departure: departure.rms)


def _saving(without: Fit, with_it: Fit) -> float:
    """Share of the loss that is explained."""
    return 1.0 - with_it.cost / max(without.cost, 1e-300)


def _limited(at: Parameters, grid: Grid) -> list[Parameters]:
    """Where the search for an acceleration limit begins: its share of the ramp is not known."""
    speed = min(at.v_max, grid.fastest)
    highest = speed / max(at.acceleration_time + at.time_constant, grid.tick)
    found = []
    for share, ramp in ((2.0, 1.0), (1.0, 0.5), (0.5, 0.3)):
        limit, constant = share * highest, max(ramp * at.time_constant, grid.tick)
        found.append(
            at._replace(
                acceleration_time=max(ramp * at.acceleration_time, grid.tick),
                time_constant=constant,
                max_acceleration=limit,
                dead_band=min(at.dead_band, 0.5 * limit * constant / at.gain),  # or it never moves
            )
        )
    return found


class Excerpt(NamedTuple):
    """Chunks of a fit's rows, as runs of their own.

    Attributes:
        fit: The fit.
        grid: The chunks.
        compared: Which of the fit's rows they hold.
        starts: Angle of the fit where each chunk begins [rad].
    """

    fit: Fit
    grid: Grid
    compared: Mask
    starts: Array

    def best(self, begins: Iterable[Parameters]) -> Fit:
        """The better of the two best joints that a few evaluations lead to, fitted."""
        trials = [self.fitted(begin, TRIAL) for begin in begins]
        trials.sort(key=lambda trial: trial.cost)
        fits = [self.fitted(trial.parameters, ENOUGH) for trial in trials[:2]]
        return min(fits, key=lambda fit: fit.cost)

    def fitted(self, begin: Parameters, effort: Effort) -> Fit:
        """The fit from there; an acceleration that is infinite, and a play of 0, stay so."""
        free = self.fit.free | only("dead_band", "time_constant")
        if begin.play > 0.0:
            free |= only("play")
        if math.isfinite(begin.max_acceleration):
            free |= only("max_acceleration")
        return least_squares(
            self.grid, begin, free=free, starts=self.starts, scale=self.fit.scale, effort=effort
        )

    def departure(self, name: str, without: Fit, with_it: Fit) -> Departure:
        """What is to be said of a joint."""
        difference, gained = np.zeros((2, len(self.compared)))
        difference[self.compared] = np.abs(with_it.residuals - without.residuals)
        gained[self.compared] = without.residuals**2 - with_it.residuals**2
        at = with_it.parameters
        size = at.play if name == "backlash" else at.max_acceleration
        return Departure(name, size, without.rms, with_it.rms, difference, gained)


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
    return Excerpt(fit, part, compared, fit.response.states[grid.states[chunks[:, 0]] - 1])


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
