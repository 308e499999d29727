"""The paper's Figure 5 from data: the speed of the joint against the error that called for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.identification.identification import LogFit
from planner.identification.log import Log
from planner.model.joint import JointModel
from planner.trajectory import Array


class SpeedCloud(NamedTuple):
    """One point per interval between two rows.

    Attributes:
        errors: Mean request over the window of the model, plus its offset, minus the angle [rad].
        speeds: Change of the angle over the interval [rad/s].
        saturated: Points whose whole window calls for the top speed.
        apart: Points whose window lies on both sides of a corner of f: there the mean of f is not
            f of the mean, so that they need not lie on its curve.
    """

    errors: Array
    speeds: Array
    saturated: npt.NDArray[np.bool_]
    apart: npt.NDArray[np.bool_]


def speed_cloud(model: JointModel, fit: LogFit) -> SpeedCloud:
    """The points of one log, from intervals between neighbouring rows that were both used.

    Over an interval with its middle at t, Equation 3 averages f over the requests of
    ``[t - lag - acceleration_time, t - lag]``, moved by half a tick.
    """
    log = fit.log
    intervals = np.flatnonzero(fit.used[:-1] & fit.used[1:])
    after = intervals + 1
    steps = log.times[after] - log.times[intervals]
    middle = 0.5 * (log.times[after] + log.times[intervals]) + 0.5 * model.tick
    speeds = (log.angles[after] - log.angles[intervals]) / steps
    # Equation 3 compares with the angle one tick before, on average half a tick before the middle.
    here = 0.5 * (log.angles[after] + log.angles[intervals] - speeds * model.tick)
    mean, least, most = _windows(
        log, middle - model.lag - model.acceleration_time, middle - model.lag
    )
    errors, low, high = (values + model.offset - here for values in (mean, least, most))
    saturated = (low >= model.theta_0) | (high <= -model.theta_0)
    inside = (low >= -model.theta_0) & (high <= model.theta_0)
    return SpeedCloud(errors, speeds, saturated, ~(inside | saturated))


def _windows(log: Log, starts: Array, ends: Array) -> tuple[Array, Array, Array]:
    """Mean, least and largest of the requests, each held until the next, between given times."""
    steps = np.diff(log.times)
    summed = np.concatenate([[0.0], np.cumsum(log.requests[:-1] * steps)])

    def integral(times: Array) -> Array:
        inner = np.interp(times, log.times, summed)
        before = np.minimum(times - log.times[0], 0.0) * log.requests[0]
        after = np.maximum(times - log.times[-1], 0.0) * log.requests[-1]
        total: Array = inner + before + after
        return total

    mean = (integral(ends) - integral(starts)) / (ends - starts)
    last = len(log.times) - 1
    first_row = np.clip(np.searchsorted(log.times, starts, side="right") - 1, 0, last)
    last_row = np.clip(np.searchsorted(log.times, ends, side="left") - 1, first_row, last)
    padded = np.append(log.requests, log.requests[-1])  # reduceat's ends must lie inside
    edges = np.column_stack([first_row, last_row + 1]).ravel()
    least = np.minimum.reduceat(padded, edges)[::2]
    most = np.maximum.reduceat(padded, edges)[::2]
    return mean, least, most
