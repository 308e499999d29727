"""Backlash and an acceleration limit: found by fitting a joint that has them to the same rows.

The model is enlarged by what many servos have and Equation 3 does not, and fitted again::

    m(t) = m(t-1) + w(t),  M(t) = clip(M(t-1), m(t) - h, m(t) + h)

``w`` is the speed of (1a) of ``docs/math.md`` with a time constant T and an acceleration limit A,
and 2 h the play between the motor m and the angle M. The limit is named where T and A explain
the rows much better than T alone, the play where T and h do: T is the inertia of every servo.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import optimize

from planner.identification.intervals import structure_of
from planner.identification.least_squares import Fit
from planner.identification.parameters import (
    Parameters,
    bounds_of,
    coordinates_of,
    only,
    parameters_at,
)
from planner.identification.robust_loss import OPTIONS as LOSS
from planner.identification.robust_loss import huber, rms
from planner.identification.simulation import ActiveRequests, active_requests
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class UnmodelledOptions:
    """When a joint has more than the model, and how that is sought.

    Attributes:
        saving: Least share of the loss that play, or a limit, has to explain. Of 40 made servos
            with neither none reaches it (``scripts/bench identify``).
        explained: Share of the standard deviation of the motion that the enlarged joint misses at
            most: what explains less is another joint.
        most_play: Largest play, as a share of the standard deviation of the motion: a joint whose
            play is wider hardly moves. It keeps a play of 2 degrees from a humanoid's shoulder that
            moved by 4, and one of 38 from an overloaded servo.
        chunk: Rows are simulated in chunks of this time side by side, each from where the model
            is by then [s]; a fifth of the time of a run in one piece.
        settling: Rows so soon after the start of a chunk do not count [s].
        most_ticks: Of longer logs only so many ticks are simulated, the chunks that the model
            misses most.
        trials: Evaluations after which the best of several beginnings is chosen.
        evaluations: Evaluations that then follow at most.
        tolerance: Relative change of the loss that ends them.
        steps: Steps of the finite differences, in the coordinates of ``parameters.COORDINATES``:
            of logarithms, of times [ticks], and of angles [spans].
    """

    saving: float = 0.2
    explained: float = 0.25
    most_play: float = 0.5
    chunk: float = 4.0
    settling: float = 0.5
    most_ticks: int = 6000
    trials: int = 12
    evaluations: int = 40
    tolerance: float = 1e-3
    steps: tuple[float, float, float] = (1e-3, 0.05, 1e-4)


OPTIONS = UnmodelledOptions()


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


class Enlarged(NamedTuple):
    """A joint with more than the model has."""

    parameters: Parameters
    time_constant: float  # T [s]
    acceleration: float = math.inf  # A [rad/s^2]
    play: float = 0.0  # 2 h [rad]


class Trial(NamedTuple):
    """An enlarged joint on the rows that are compared."""

    joint: Enlarged
    residuals: Array
    cost: float


def unmodelled(fit: Fit) -> list[Departure]:
    """What the joint has beside the model of a fit, that which explains most first.

    Where the residuals are noise from row to row nothing is sought.
    """
    if structure_of(fit) < OPTIONS.saving:
        return []
    excerpt = _Excerpt(fit)
    if np.sum(excerpt.compared) < 2 * len(fit.free):
        return []
    at, delay, tick = fit.parameters, fit.parameters.whole_delay, fit.grid.tick
    divided = Enlarged(
        at._replace(
            lag=0.25 * delay,
            acceleration_time=max(0.1 * delay, tick),
            gain=min(2.0 / delay, at.gain),
        ),
        0.2 * delay,
    )
    bare = excerpt.best([Enlarged(at, 0.1 * at.acceleration_time), divided])
    error = rms(bare.residuals)
    bends = np.diff(bare.residuals, 2)  # of noise six times its variance
    if 1.0 - float(np.mean(bends**2)) / 6.0 / max(error, 1e-300) ** 2 < OPTIONS.saving:
        return []
    plays = [
        joint._replace(play=size * error) for size in (2.0, 5.0) for joint in (bare.joint, divided)
    ]
    found = {
        "acceleration limit": excerpt.best([*_limited(bare.joint, fit), *_limited(divided, fit)]),
        "backlash": excerpt.best(plays),
    }
    for each in found.values():
        if _saving(bare, each) >= OPTIONS.saving:  # or is there a better optimum without it
            without = each.joint._replace(acceleration=math.inf, play=0.0)
            again = excerpt.fitted(without, OPTIONS.evaluations)
            bare = min(bare, again, key=lambda trial: trial.cost)
    motion = float(np.std(excerpt.angles))
    named = [
        excerpt.departure(name, bare, each)
        for name, each in found.items()
        if _saving(bare, each) >= OPTIONS.saving
        and rms(each.residuals) <= OPTIONS.explained * motion
        and each.joint.play <= OPTIONS.most_play * motion
    ]
    return sorted(named, key=lambda departure: departure.rms)


def _saving(without: Trial, with_it: Trial) -> float:
    """Share of the loss that is explained."""
    return 1.0 - with_it.cost / max(without.cost, 1e-300)


def _limited(joint: Enlarged, fit: Fit) -> list[Enlarged]:
    """Where the search for an acceleration limit begins: its share of the ramp is not known."""
    at, tick = joint.parameters, fit.grid.tick
    speed = min(at.v_max, fit.grid.fastest)
    highest = speed / max(at.acceleration_time + joint.time_constant, tick)
    return [
        Enlarged(
            at._replace(acceleration_time=max(ramp * at.acceleration_time, tick)),
            max(ramp * joint.time_constant, tick),
            acceleration=share * highest,
        )
        for share, ramp in ((2.0, 1.0), (1.0, 0.5), (0.5, 0.3))
    ]


class _Excerpt:
    """Some rows of a fit, and how enlarged joints are fitted to them."""

    def __init__(self, fit: Fit) -> None:
        self._fit = fit
        self._windows: tuple[tuple[float, ...], ActiveRequests] | None = None
        self._free = np.flatnonzero(fit.free | only("dead_band"))
        grid = fit.grid
        chunks = _chunks(fit)
        lengths = np.diff(chunks)[:, 0]
        self._ticks = np.concatenate([np.arange(*chunk) for chunk in chunks.tolist()])
        # States of the chunks, one after the other, each after the one that it begins from.
        chunk = np.repeat(np.arange(len(chunks)), lengths)
        self._begins = grid.states[chunks[:, 0]] - 1
        self._starts = np.concatenate([[0], np.cumsum(lengths + 1)[:-1]])
        self._places = np.arange(len(self._ticks)) + chunk + 1
        self._states = grid.states[self._ticks]
        since = np.full(len(fit.states) + 1, -1.0)
        since[self._states] = grid.tick * (self._places - self._starts[chunk])
        before = since[grid.before]
        self.compared = (before >= OPTIONS.settling) & (since[grid.before + 1] > before)
        self.angles = grid.angles[self.compared]

    def best(self, begins: Sequence[Enlarged]) -> Trial:
        """The best joint of those that a few evaluations lead to, fitted."""
        trials = [self.fitted(begin, OPTIONS.trials) for begin in begins]
        joint = min(trials, key=lambda trial: trial.cost).joint
        return self.fitted(joint, OPTIONS.evaluations)

    def fitted(self, begin: Enlarged, evaluations: int) -> Trial:
        """The fit from there; an acceleration that is infinite, and a play of 0, stay so."""
        grid = self._fit.grid
        held = coordinates_of(grid, begin.parameters)
        lower, upper = (coordinates_of(grid, ends) for ends in bounds_of(grid))
        sizes = np.array(begin[1:])
        added = np.flatnonzero(np.isfinite(sizes) & (sizes > 0.0))
        by_log, by_tick, by_span = OPTIONS.steps
        own = {"gain": by_log, "v_max": by_log, "lag": by_tick, "acceleration_time": by_tick}
        names = np.array(Parameters._fields)[self._free]
        steps = np.array([own.get(name, by_span) for name in names] + [by_log] * len(added))
        cache: dict[bytes, Array] = {}

        def joint_at(unknowns: Array) -> Enlarged:
            coordinates = held.copy()
            coordinates[self._free] = np.clip(
                held[self._free] + unknowns[: len(self._free)],
                lower[self._free],
                upper[self._free],
            )
            now = sizes.copy()
            now[added] *= np.exp(np.clip(unknowns[len(self._free) :], -20.0, 20.0))
            return Enlarged(parameters_at(grid, coordinates), *now.tolist())

        def columns(unknowns: Array) -> Array:
            key = unknowns.tobytes()
            if key not in cache:
                cache.clear()
                beside = [unknowns, *(unknowns + np.diag(steps))]
                cache[key] = self._residuals([joint_at(each) for each in beside])
            return cache[key]

        def derivatives(unknowns: Array) -> Array:
            found = columns(unknowns)
            return np.asarray((found[:, 1:] - found[:, :1]) / steps)

        def residuals_at(unknowns: Array) -> Array:
            return np.asarray(columns(unknowns)[:, 0])

        solved = optimize.least_squares(
            residuals_at,
            np.zeros(len(steps)),
            derivatives,
            loss="huber",
            f_scale=LOSS.corner * self._fit.scale,
            x_scale="jac",
            ftol=OPTIONS.tolerance,
            max_nfev=evaluations,
        )
        residuals = residuals_at(solved.x).copy()
        return Trial(joint_at(solved.x), residuals, huber(residuals, self._fit.scale)[0])

    def departure(self, name: str, without: Trial, with_it: Trial) -> Departure:
        """What is to be said of a joint."""
        difference, gained = np.zeros((2, len(self.compared)))
        difference[self.compared] = np.abs(with_it.residuals - without.residuals)
        gained[self.compared] = without.residuals**2 - with_it.residuals**2
        size = with_it.joint.play if name == "backlash" else with_it.joint.acceleration
        errors = rms(without.residuals), rms(with_it.residuals)
        return Departure(name, size, *errors, difference, gained)

    def _residuals(self, joints: Sequence[Enlarged]) -> Array:
        """Predicted minus actual angle at the rows that are compared, (rows, joints)."""
        return np.column_stack([self._residuals_of(joint) for joint in joints])

    def _residuals_of(self, joint: Enlarged) -> Array:
        from planner.model import kernel

        fit, grid, at = self._fit, self._fit.grid, joint.parameters
        key = at.lag, at.acceleration_time, at.offset, at.compliance
        if self._windows is None or self._windows[0] != key:
            self._windows = key, active_requests(grid, at, some=self._ticks)
        active = self._windows[1]
        law = at._replace(time_constant=joint.time_constant).law_per_tick(grid.tick)
        angles, speeds = np.zeros((2, len(self._ticks) + len(self._starts)))
        angles[self._starts] = fit.states[self._begins]
        moving = ~np.isin(self._begins, grid.starts)
        earlier = fit.states[np.maximum(self._begins - 1, 0)]
        speeds[self._starts] = np.where(moving, angles[self._starts] - earlier, 0.0)
        kernel.follow(
            law._replace(acceleration=joint.acceleration * grid.tick**2),
            active.weights,
            active.targets,
            grid.tick * at.faster(grid.loads[self._ticks]),
            joint.play,
            self._places,
            angles,
            speeds,
        )
        states = np.empty(len(fit.states))
        states[self._states] = angles[self._places]
        states[self._begins] = fit.states[self._begins]
        return np.asarray(grid.at_rows(states)[self.compared] - self.angles)


def _chunks(fit: Fit) -> npt.NDArray[np.int_]:
    """First tick of each chunk and the one after its last, (chunks, 2): those that fit worst."""
    grid = fit.grid
    length = max(1, round(OPTIONS.chunk / grid.tick))
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
    kept = worst[: max(1, int(np.searchsorted(total, OPTIONS.most_ticks, side="right")))]
    return np.asarray(chunks[np.sort(kept)])
