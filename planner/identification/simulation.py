"""The joint through all runs of a grid at once, with derivatives by its parameters."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from planner.identification.grid import Grid
from planner.model.joint import JointModel
from planner.trajectory import Array

AGREED = 1e-13
"""Chunks meet when their ends agree to this, relative to the largest angle."""

CHUNKS_PER_TICK = 0.7
"""Length of a chunk over the square root of the number of ticks: shorter chunks are wider steps,
longer ones fewer corrections; anything within a factor of 2 takes the same time."""


class Parameters(NamedTuple):
    """A joint by what its motion shows; v_max may be infinite: then it never saturates."""

    gain: float  # v_max / theta_0 [1/s]
    v_max: float  # [rad/s]
    lag: float  # [s]
    acceleration_time: float  # [s]
    offset: float  # [rad]

    @classmethod
    def of(cls, model: JointModel) -> Self:
        """The parameters of a model."""
        return cls(
            gain=model.v_max / model.theta_0,
            v_max=model.v_max,
            lag=model.lag,
            acceleration_time=model.acceleration_time,
            offset=model.offset,
        )

    def model(self, *, tick: float, hold: int) -> JointModel:
        """The model with these parameters."""
        return JointModel(
            v_max=self.v_max,
            theta_0=self.v_max / self.gain,
            lag=self.lag,
            acceleration_time=self.acceleration_time,
            tick=tick,
            hold=hold,
            offset=self.offset,
        )


class Pulls(NamedTuple):
    """The requests that act at each tick, those in force in [t - lag - a, t - lag]."""

    weights: Array  # (t, m), sums to 1
    targets: Array  # request + offset [rad], (t, m)


class Response(NamedTuple):
    """Angles at the states of a grid and, if asked for, their derivatives."""

    states: Array  # (s,) [rad]
    by_parameter: Array  # (s, 5), in the order of Parameters
    by_start: Array  # (s,), each by the start of its own run


def pulls_of(grid: Grid, parameters: Parameters) -> Pulls:
    """What pulls at each tick: a request counts by the time it is in force within the window.

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
    return Pulls(overlap, grid.requests[numbers] + parameters.offset)


def respond(grid: Grid, parameters: Parameters, starts: Array, guess: Array | None = None) -> Array:
    """Angles at all states (Equation 3), simulated in chunks side by side.

    The chunks begin where they are guessed to; where they then fail to meet, Newton's method, exact
    between two corners of f, moves their beginnings until they do. The first chunk of a run is
    right at once and each round settles at least one more, so this ends, usually in three rounds.

    Args:
        grid: The runs.
        parameters: The joint.
        starts: Angle at the start of each run [rad], shape (runs,).
        guess: Angles at all states that are nearly right [rad], shape (s,).

    Returns:
        Angles [rad], shape (s,).
    """
    return _walk(grid, parameters, starts, pulls_of(grid, parameters), guess)


def _walk(
    grid: Grid, parameters: Parameters, starts: Array, pulls: Pulls, guess: Array | None
) -> Array:
    count = len(grid.ticks)
    states = np.empty(count + len(starts))
    states[grid.starts] = starts
    if not count:
        return states
    length = max(1, round(CHUNKS_PER_TICK * math.sqrt(count)))
    begins = _chunk_begins(grid, length)
    chunks = np.minimum(begins + np.arange(length)[:, np.newaxis], count)  # (length, chunks)
    chunks[chunks >= np.append(begins[1:], count)] = count  # a tick that moves nothing
    weights = np.vstack([pulls.weights, np.zeros_like(pulls.weights[:1])]) * grid.tick
    targets = np.vstack([pulls.targets, np.zeros_like(pulls.targets[:1])])
    wide_weights = np.ascontiguousarray(weights[chunks].transpose(0, 2, 1))  # (length, m, chunks)
    wide_targets = np.ascontiguousarray(targets[chunks].transpose(0, 2, 1))
    to_states = np.append(grid.states, len(states))
    before = grid.states[begins] - 1  # the state from which each chunk sets out
    fresh = np.isin(before, grid.starts)
    if guess is None:
        nearest = np.minimum(np.searchsorted(grid.before, before), len(grid.before) - 1)
        seams = grid.angles[nearest]
    else:
        seams = guess[before]
    seams = np.where(fresh, states[before], seams)
    padded = np.append(states, 0.0)
    moving = np.arange(len(begins))
    slopes = np.ones(len(begins))
    tolerance = AGREED * max(
        1e-300, float(np.max(np.abs(grid.requests))), float(np.max(np.abs(seams)))
    )
    for _ in range(len(begins) + 1):
        angle = seams[moving]
        some = slice(None) if len(moving) == len(begins) else moving
        w, r = wide_weights[:, :, some], wide_targets[:, :, some]
        angles, slopes[moving] = _step_through(parameters, w, r, angle)
        padded[to_states[chunks[:, some]]] = angles
        ends = padded[_last_states(grid, begins)]
        meant = np.where(fresh, seams, np.append(0.0, ends[:-1]))
        if np.max(np.abs(meant - seams)) <= tolerance:
            break
        moved = seams.copy()
        for k in range(1, len(begins)):
            if not fresh[k]:
                moved[k] = meant[k] + slopes[k - 1] * (moved[k - 1] - seams[k - 1])
        moving = np.flatnonzero(moved != seams)
        seams = moved
    return padded[:-1]


def _step_through(
    parameters: Parameters, weights: Array, targets: Array, angle: Array
) -> tuple[Array, Array]:
    """Angles of every chunk, (length, chunks), and the slopes of their ends by their beginnings."""
    gain, v_max = parameters.gain, parameters.v_max
    wanted = gain * targets
    angles = np.empty((len(weights), len(angle)))
    slope = np.ones(len(angle))
    for k in range(len(weights)):
        speeds = wanted[k] - gain * angle
        slack = weights[k]
        if v_max < math.inf:
            slack = slack * (np.abs(speeds) < v_max)
            np.minimum(speeds, v_max, out=speeds)
            np.maximum(speeds, -v_max, out=speeds)
        slope = slope * (1.0 - gain * slack.sum(axis=0))
        speeds *= weights[k]
        angle = angle + speeds.sum(axis=0)
        angles[k] = angle
    return angles, slope


def _chunk_begins(grid: Grid, length: int) -> Array:
    """First tick of every chunk: chunks never reach from one run into the next."""
    run_begins = grid.starts - np.arange(len(grid.starts))  # a start is no tick
    bounds = np.append(run_begins, len(grid.ticks))
    return np.concatenate(
        [
            np.arange(first, beyond, length)
            for first, beyond in zip(bounds[:-1], bounds[1:], strict=True)
        ]
    ).astype(int)


def _last_states(grid: Grid, begins: Array) -> Array:
    lasts = np.append(begins[1:], len(grid.ticks)) - 1
    return grid.states[lasts]


def respond_with_derivatives(
    grid: Grid,
    parameters: Parameters,
    starts: Array,
    guess: Array | None = None,
    *,
    blur: float = 0.0,
) -> Response:
    """Angles at all states and their derivatives by the parameters and by the starts.

    Where an edge of the window meets a change of the request the derivative jumps; there it is the
    mean of those ``blur`` to either side.

    Args:
        grid: The runs.
        parameters: The joint.
        starts: Angle at the start of each run [rad], shape (runs,).
        guess: See :func:`respond`.
        blur: Distance over which derivatives by lag and acceleration time are averaged [s].
    """
    from scipy.linalg import solve_banded

    pulls = pulls_of(grid, parameters)
    states = _walk(grid, parameters, starts, pulls, guess)
    gain, v_max = parameters.gain, parameters.v_max
    before = states[grid.states - 1]
    errors = pulls.targets - before[:, np.newaxis]
    called = gain * errors
    limited = np.clip(called, -v_max, v_max)
    inside = (np.abs(called) < v_max) * pulls.weights
    young = grid.ticks - parameters.lag
    newest, oldest = (
        _speed_at(grid, parameters, edge, before, blur)
        for edge in (young, young - parameters.acceleration_time)
    )
    slack = np.sum(inside, axis=1)
    by_parameter = np.zeros((len(states), 6))
    drives = np.stack(
        [
            np.sum(inside * errors, axis=1),
            np.sum(np.sign(called) * (pulls.weights - inside), axis=1),
            (oldest - newest) / parameters.acceleration_time,
            (oldest - np.sum(pulls.weights * limited, axis=1)) / parameters.acceleration_time,
            gain * slack,
        ],
        axis=1,
    )
    by_parameter[grid.states, :5] = grid.tick * drives
    by_parameter[grid.starts, 5] = 1.0
    band = np.ones((2, len(states)))
    band[1] = 0.0
    band[1, grid.states - 1] = grid.tick * gain * slack - 1.0
    solved = solve_banded((1, 0), band, by_parameter, overwrite_b=True, check_finite=False)
    return Response(states, solved[:, :5], solved[:, 5])


def _speed_at(
    grid: Grid, parameters: Parameters, times: Array, before: Array, blur: float
) -> Array:
    """Speed called for by the request in force at each time, the mean of a moment to both sides."""
    aside = max(blur, 1e-9 * grid.tick)
    speed = np.zeros(len(times))
    for moment in (times - aside, times + aside):
        number = np.maximum(np.searchsorted(grid.edges, moment, side="right") - 1, 0)
        errors = grid.requests[number] + parameters.offset - before
        speed += np.clip(parameters.gain * errors, -parameters.v_max, parameters.v_max) / 2.0
    return speed
