"""Angles of an encoder that starts again after a turn, made continuous."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.identification.log import Log
from planner.trajectory import Array

TURN = 2.0 * np.pi
"""What an encoder loses or gains when it starts again [rad]."""

SUDDEN = 0.75 * TURN
"""A step between two rows beyond this is the encoder's [rad], where rows are close enough."""

FASTEST = 50.0
"""No joint is as fast as this [rad/s]: rows must be close enough that a sudden step exceeds it."""


def continued(log: Log) -> tuple[Log, int]:
    """The log with angles that go on where the encoder started again, and how often it did.

    Requests may start again as well. They are made continuous too if that brings them nearer to the
    angles; the angles then take the turn in which they are nearest to the requests. A log that
    comes no nearer to its requests so, or that is a share of a range, stays as it is.
    """
    if log.unit != "rad" or log.period * FASTEST > SUDDEN:
        return log, 0
    turns = _turns(log.angles)
    jumps = int(np.count_nonzero(np.diff(turns)))
    if not jumps:
        return log, 0
    angles = log.angles + TURN * turns
    requests = min(
        (log.requests, log.requests + TURN * _turns(log.requests)),
        key=lambda each: float(np.std(each - angles)),
    )
    if np.std(requests - angles) >= np.std(log.requests - log.angles):
        return log, 0
    angles = angles + TURN * np.round(np.median(requests - angles) / TURN)
    return replace(log, requests=requests, angles=angles), jumps


def _turns(angles: Array) -> Array:
    """Turns to add to each row; none for glitches, which jump away and back within two rows."""
    turns: Array = np.round((np.unwrap(angles, discont=SUDDEN) - angles) / TURN)
    padded = np.pad(turns, 2, mode="edge")
    lasting = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    return turns if np.ptp(lasting) > 0.0 else np.zeros_like(turns)
