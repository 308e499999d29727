"""One request period of the joint and its derivatives, written by CasADi, at every sample at once."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.model.joint import JointModel, advance
from planner.trajectory import Array


class Reach(NamedTuple):
    """Which requests act between two samples: those ``youngest`` to ``oldest`` requests back."""

    youngest: int
    oldest: int

    @property
    def count(self) -> int:
        """Number of requests that act."""
        return self.oldest - self.youngest + 1


def reach(model: JointModel) -> Reach:
    """The requests that act on the joint between samples k-1 and k, as ages from k."""
    ticks = np.arange(1 - model.hold, 1)  # relative to the tick of sample k
    youngest = (int(ticks[-1]) - model.window.first) // model.hold
    oldest = (int(ticks[0]) - model.window.last) // model.hold
    return Reach(-youngest, -oldest)


class Linearised(NamedTuple):
    """Angles of a run and their derivatives, sample by sample.

    ``d angles[k] = by_angle[k] * d angles[k-1] + sum_j by_request[k, j] * d request[k - youngest - j]``
    """

    angles: Array  # (n,) [rad]
    by_angle: Array  # (n,)
    by_request: Array  # (n, reach.count)


class Transitions:
    """``samples`` request periods of the joint in a row, compiled once and used for many requests.

    Not shared between threads: the buffers belong to the instance.
    """

    def __init__(self, model: JointModel, samples: int) -> None:
        """Let CasADi write the period, its derivatives and the run over all samples."""
        import casadi

        self.reach = reach(model)
        angle = casadi.SX.sym("angle")
        requests = casadi.SX.sym("requests", self.reach.count)
        smoothing = casadi.SX.sym("smoothing")
        after = _period(model, angle, requests, smoothing)
        period = casadi.Function(
            "period",
            [angle, requests, smoothing],
            [after, casadi.jacobian(after, angle), casadi.jacobian(after, requests)],
        )
        self._seam = np.zeros(1)
        self._windows = np.zeros((samples, self.reach.count))
        self._smoothing = np.zeros(samples)
        self._result = Linearised(
            np.zeros(samples), np.zeros(samples), np.zeros((samples, self.reach.count))
        )
        self._function = period.mapaccum("run", samples)
        self._buffer, self._evaluate = self._function.buffer()
        for i, argument in enumerate((self._seam, self._windows.ravel(), self._smoothing)):
            self._buffer.set_arg(i, memoryview(argument))
        for i, result in enumerate(self._result):
            self._buffer.set_res(i, memoryview(result.reshape(-1)))

    def run(self, seam: float, windows: Array, smoothing: float) -> Linearised:
        """Angles from ``seam`` on, with derivatives.

        Args:
            seam: Angle before the first sample [rad].
            windows: Requests that act before each sample, youngest first [rad], shape
                (samples, reach.count).
            smoothing: See :func:`planner.model.joint.saturation` [rad].

        Returns:
            Copies that stay as they are.
        """
        self._seam[0] = seam
        self._windows[:] = windows
        self._smoothing[:] = smoothing
        self._evaluate()
        return Linearised(*(result.copy() for result in self._result))


def _period(model: JointModel, angle: object, requests: object, smoothing: object) -> object:
    """Angle after one request period, as a CasADi expression."""
    youngest = reach(model).youngest
    weights = model.window.weights.tolist()
    for tick in range(1 - model.hold, 1):
        ages = [-((tick - model.window.first - j) // model.hold) for j in range(len(weights))]
        window = [requests[age - youngest] + model.offset for age in ages]  # type: ignore[index]
        angle = advance(
            angle,
            window,
            weights=weights,
            v_max=model.v_max_per_tick,
            theta_0=model.theta_0,
            smoothing=smoothing,
        )
    return angle


@lru_cache(maxsize=32)
def transitions(model: JointModel, samples: int) -> Transitions:
    """The compiled run for this model and length: built at the first call, then kept."""
    return Transitions(model, samples)
