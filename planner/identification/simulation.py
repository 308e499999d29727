"""The joint through all runs of a grid at once: Equation 3 in chunks that are run side by side."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.identification.parameters import Parameters
from planner.identification.resampling import Grid
from planner.model.response import run_columns
from planner.trajectory import Array

AGREED = 1e-13
"""Chunks meet when their ends agree to this, relative to the largest angle."""

CHUNKS_PER_TICK = 0.5
"""Length of a chunk over the square root of the number of ticks: shorter chunks are wider steps,
longer ones fewer corrections; anything within a factor of 2 takes the same time."""


class ActiveRequests(NamedTuple):
    """The requests that act at each tick, those in force in [t - lag - a, t - lag]."""

    weights: Array  # (t, m), sums to 1
    targets: Array  # request + offset [rad], (t, m)


def active_requests(grid: Grid, parameters: Parameters) -> ActiveRequests:
    """The requests that act at each tick: each counts by the time it is in force within the window.

    With even rows and whole ticks these are the weights of :attr:`JointModel.window`.
    """
    young = grid.ticks - parameters.lag
    old = young - parameters.acceleration_time
    last = len(grid.edges) - 1
    first = np.maximum(np.searchsorted(grid.edges, old, side="right") - 1, 0)
    final = np.maximum(np.searchsorted(grid.edges, young, side="left") - 1, first)
    width = int(np.max(final - first, initial=0)) + 1
    numbers = np.minimum(first[:, np.newaxis] + np.arange(width), last)
    ends = np.append(grid.edges[1:], np.inf)
    overlap = np.minimum(ends[numbers], young[:, np.newaxis])
    overlap -= np.maximum(grid.edges[numbers], old[:, np.newaxis])
    overlap[first[:, np.newaxis] + np.arange(width) > last] = 0.0
    np.maximum(overlap, 0.0, out=overlap)
    overlap /= np.sum(overlap, axis=1, keepdims=True)
    targets = grid.requests[numbers] + parameters.offset
    if parameters.compliance:
        targets += parameters.compliance * grid.loads[:, np.newaxis]
    return ActiveRequests(overlap, targets)


def respond(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    *,
    active: ActiveRequests | None = None,
    guess: Array | None = None,
) -> Array:
    """Angles at all states: Equation 3, run.

    A joint without a dead band that does not saturate answers to the mean of the requests in its
    window, which is one request a tick; where the guess does not saturate that is tried first.

    Args:
        grid: The runs.
        parameters: The joint.
        starts: Angle at the start of each run [rad], shape (runs,).
        active: What :func:`active_requests` says, where it is known already.
        guess: Angles at all states that are nearly right [rad], shape (s,).

    Returns:
        Angles [rad], shape (s,).
    """
    active = active or active_requests(grid, parameters)
    never = parameters.v_max == math.inf
    likely = guess is not None and not _saturated(grid, parameters, active, guess)
    if parameters.linear and (never or likely):
        mean = np.sum(active.weights * active.targets, axis=1, keepdims=True)
        chunks = _Chunks(grid, np.ones_like(mean), mean, parameters._replace(v_max=math.inf))
        states = _joined(grid, chunks, starts, guess)
        if never or not _saturated(grid, parameters, active, states):
            return states
    chunks = _Chunks(grid, active.weights, active.targets, parameters)
    return _joined(grid, chunks, starts, guess)


def _saturated(grid: Grid, parameters: Parameters, active: ActiveRequests, states: Array) -> bool:
    """Whether any request that counts calls for more than the top speed."""
    errors = active.targets - states[grid.states - 1][:, np.newaxis]
    inside = parameters.inside(errors, grid.loads[:, np.newaxis])
    return not bool(np.all(inside | (active.weights <= 0.0)))


def _joined(grid: Grid, chunks: _Chunks, starts: Array, guess: Array | None) -> Array:
    """Angles at all states once the chunks meet.

    The chunks begin where they are guessed to; where they then fail to meet, Newton's method, exact
    between two corners of f, moves their beginnings until they do. The first chunk of a run is
    right at once and each round settles at least one more, so this ends, usually in three rounds.
    """
    count = len(grid.ticks)
    states = np.empty(count + len(starts) + 1)  # one more, for ticks that move nothing
    states[grid.starts] = starts
    if not count:
        return states[:-1]
    fresh = np.isin(chunks.before, grid.starts)
    if guess is None:
        nearest = np.minimum(np.searchsorted(grid.before, chunks.before), len(grid.before) - 1)
        begins = np.where(fresh, states[chunks.before], grid.angles[nearest])
    else:
        begins = np.where(fresh, states[chunks.before], guess[chunks.before])
    largest = max(float(np.max(np.abs(grid.requests))), float(np.max(np.abs(begins))))
    tolerance = AGREED * max(1e-300, largest)
    moving = np.arange(len(begins))
    slopes = np.ones(len(begins))
    for _ in range(len(begins) + 1):
        angles = chunks.angles(moving, begins[moving])
        states[chunks.states[:, moving]] = angles
        meant = np.where(fresh, begins, np.append(0.0, states[chunks.last[:-1]]))
        if np.max(np.abs(meant - begins)) <= tolerance:
            break
        slopes[moving] = chunks.slopes(moving, begins[moving], angles)
        moved = _moved(begins, meant, np.where(fresh, 0.0, np.append(0.0, slopes[:-1])))
        moving = np.flatnonzero(moved != begins)
        begins = moved
    return states[:-1]


def _moved(begins: Array, meant: Array, slopes: Array) -> Array:
    """Where the chunks should begin, each end following its beginning with its slope."""
    moved, change = [], 0.0
    for begin, end, slope in zip(begins.tolist(), meant.tolist(), slopes.tolist(), strict=True):
        now = end + slope * change
        change = now - begin
        moved.append(now)
    return np.array(moved)


class _Chunks:
    """The ticks of a grid, a column a chunk; short columns are padded with ticks of weight 0."""

    def __init__(self, grid: Grid, weights: Array, targets: Array, parameters: Parameters) -> None:
        self._joint = parameters
        count = len(grid.ticks)
        length = max(1, round(CHUNKS_PER_TICK * math.sqrt(count)))
        run_begins = grid.starts - np.arange(len(grid.starts))  # a start is no tick
        bounds = np.append(run_begins, count)
        begins = np.concatenate([np.arange(a, b, length) for a, b in pairwise(bounds)]).astype(int)
        beyond = np.append(begins[1:], count)
        ticks = np.minimum(begins + np.arange(length)[:, np.newaxis], count)
        ticks[ticks >= beyond] = count
        padding = np.zeros_like(weights[:1])
        self.before = grid.states[begins] - 1  # the state from which each chunk sets out
        self.last = grid.states[beyond - 1]
        self.states = np.append(grid.states, len(grid.states) + len(grid.starts))[ticks]
        places = ticks[:, np.newaxis, :], np.arange(weights.shape[1])[:, np.newaxis]
        self._weights = np.vstack([weights * grid.tick, padding])[places]  # (length, m, chunks)
        self._targets = np.vstack([targets, padding])[places]
        self._loads = np.append(grid.loads, 0.0)[ticks] if parameters.slowing else None

    def angles(self, some: npt.NDArray[np.int_], begin: Array) -> Array:
        """Angles of some chunks, (length, some), from where they begin."""
        weights, targets = self._of(some)
        if self._loads is None:
            return run_columns(begin, targets, weights=weights, speed=self._joint.law())
        laws = (self._joint.law(load) for load in self._loads[:, some])
        return run_columns(begin, targets, weights=weights, speed=laws)

    def slopes(self, some: npt.NDArray[np.int_], begin: Array, angles: Array) -> Array:
        """Derivative of each chunk's end by its beginning, (some,)."""
        weights, targets = self._of(some)
        if self._joint.v_max < math.inf or not self._joint.linear:
            before = np.vstack([begin, angles[:-1]])[:, np.newaxis, :]
            load = 0.0 if self._loads is None else self._loads[:, np.newaxis, some]
            weights = weights * self._joint.inside(targets - before, load)
        return np.asarray(np.prod(1.0 - self._joint.gain * np.sum(weights, axis=1), axis=0))

    def _of(self, some: npt.NDArray[np.int_]) -> tuple[Array, Array]:
        """Weights times tick, and targets, of some chunks."""
        if len(some) == self.states.shape[1]:
            return self._weights, self._targets
        return self._weights[:, :, some], self._targets[:, :, some]
