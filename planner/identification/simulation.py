"""The joint through all runs of a grid at once: Equation 3 in chunks that are run side by side."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtbtrs

from planner.identification.parameters import Parameters
from planner.identification.resampling import Grid, Indices
from planner.model.response import run_columns
from planner.trajectory import Array

AGREED = 1e-13
"""Chunks meet when their ends agree to this, relative to the largest angle."""


class ActiveRequests(NamedTuple):
    """The requests that act at each tick, those in force in [t - lag - a, t - lag]."""

    weights: Array  # sums to 1 over the window, (m, t)
    targets: Array  # request + offset [rad], (m, t)


def active_requests(
    grid: Grid, parameters: Parameters, *, some: Indices | slice = slice(None)
) -> ActiveRequests:
    """The requests that act at some ticks: each counts by its time in force within the window.

    With even rows and whole ticks these are the weights of :attr:`JointModel.window`.
    """
    young = grid.ticks[some] - parameters.lag
    old = young - parameters.acceleration_time
    last = len(grid.edges) - 1
    first = np.maximum(np.searchsorted(grid.edges, old, side="right") - 1, 0)
    final = np.maximum(np.searchsorted(grid.edges, young, side="left") - 1, first)
    width = int(np.max(final - first, initial=0)) + 1
    numbers = first + np.arange(width + 1)[:, np.newaxis]
    changes = np.append(grid.edges, np.full(width, np.inf))[numbers]
    np.minimum(np.maximum(changes, old, out=changes), young, out=changes)
    overlap = np.diff(changes, axis=0)
    overlap /= np.sum(overlap, axis=0)
    targets = grid.requests[np.minimum(numbers[:-1], last)] + parameters.offset
    if parameters.compliance:
        targets += parameters.compliance * grid.loads[some]
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
    window, a linear recursion; where the guess does not saturate that is tried first.

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
        states = _linear(grid, parameters, active, starts)
        if never or not _saturated(grid, parameters, active, states):
            return states
    return _joined(grid, _Chunks(grid, active, parameters), starts, guess)


def _linear(grid: Grid, parameters: Parameters, active: ActiveRequests, starts: Array) -> Array:
    """Angles at all states of a joint without a dead band that never saturates.

    The recursion is that of the distance to the mean request, which dies away: the angle itself
    would waver about a request by its rounding, and the sign of the error with it.
    """
    mean = np.sum(active.weights * active.targets, axis=0)
    reference = np.empty(len(grid.ticks) + len(starts))
    reference[grid.states] = mean
    reference[grid.starts] = reference[grid.starts + 1]
    factor = 1.0 - parameters.gain * grid.tick
    apart = factor * (reference[grid.states - 1] - mean)
    inputs = np.empty(len(reference))
    inputs[grid.states], inputs[grid.starts] = apart, starts - reference[grid.starts]
    return np.asarray(reference + recursion(grid, factor, inputs))


def recursion(grid: Grid, factors: Array | float, inputs: Array) -> Array:
    """x(t) = factor x(t-1) + input(t) through every run, a bidiagonal system.

    Args:
        grid: The runs.
        factors: Factor of every tick, shape (t,) or one for all.
        inputs: Input at every state, that at a start being x there, shape (s,) or (s, k); Fortran's
            order saves a copy.

    Returns:
        x at all states, shape (s,) or (s, k).
    """
    band = np.zeros((2, len(inputs)))
    band[0] = 1.0
    band[1, grid.states - 1] = -factors
    solved, _ = dtbtrs(band, inputs, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(solved.reshape(inputs.shape))


def _saturated(grid: Grid, parameters: Parameters, active: ActiveRequests, states: Array) -> bool:
    """Whether any request that counts calls for more than the top speed."""
    inside = parameters.inside(active.targets - states[grid.states - 1], grid.loads)
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
    layout = grid.chunks
    guess = grid.guess if guess is None else guess
    begins = np.where(layout.fresh, states[layout.before], guess[layout.before])
    largest = max(float(np.max(np.abs(grid.requests))), float(np.max(np.abs(begins))))
    tolerance = AGREED * max(1e-300, largest)
    moving = np.arange(len(begins))
    slopes = np.ones(len(begins))
    for _ in range(len(begins) + 1):
        angles = chunks.angles(moving, begins[moving])
        states[layout.states[:, moving]] = angles
        meant = np.where(layout.fresh, begins, np.append(0.0, states[layout.last[:-1]]))
        if np.max(np.abs(meant - begins)) <= tolerance:
            break
        slopes[moving] = chunks.slopes(moving, begins[moving], angles)
        moved = _moved(begins, meant, np.where(layout.fresh, 0.0, np.append(0.0, slopes[:-1])))
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
    """A joint on the ticks of a grid, a column a chunk; ticks beyond an end have weight 0."""

    def __init__(self, grid: Grid, active: ActiveRequests, parameters: Parameters) -> None:
        self._joint = parameters
        ticks = grid.chunks.ticks
        table = np.zeros((2, len(active.weights), len(grid.ticks) + 1))
        np.multiply(active.weights, grid.tick, out=table[0, :, :-1])
        table[1, :, :-1] = active.targets
        self._weights, self._targets = table[:, :, ticks].transpose(0, 2, 1, 3)  # (length, m, some)
        self._loads = np.append(grid.loads, 0.0)[ticks] if parameters.slowing else None

    def angles(self, some: Indices, begin: Array) -> Array:
        """Angles of some chunks, (length, some), from where they begin."""
        weights, targets = self._of(some)
        if self._loads is None:
            return run_columns(begin, targets, weights=weights, speed=self._joint.law())
        laws = (self._joint.law(load) for load in self._loads[:, some])
        return run_columns(begin, targets, weights=weights, speed=laws)

    def slopes(self, some: Indices, begin: Array, angles: Array) -> Array:
        """Derivative of each chunk's end by its beginning, (some,)."""
        weights, targets = self._of(some)
        before = np.vstack([begin, angles[:-1]])[:, np.newaxis, :]
        load = 0.0 if self._loads is None else self._loads[:, np.newaxis, some]
        weights = weights * self._joint.inside(targets - before, load)
        return np.asarray(np.prod(1.0 - self._joint.gain * np.sum(weights, axis=1), axis=0))

    def _of(self, some: Indices) -> tuple[Array, Array]:
        """Weights times tick, and targets, of some chunks."""
        if len(some) == self._weights.shape[2]:
            return self._weights, self._targets
        return self._weights[:, :, some], self._targets[:, :, some]
