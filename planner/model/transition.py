"""One request period of the joint and its derivatives, written by CasADi, sample after sample."""

from __future__ import annotations

from functools import lru_cache
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.model.joint import JointModel, advance
from planner.trajectory import Array

UNSMOOTHED = 1e-150
"""Smoothing that stands for none [rad]: no angle feels it, and at a corner, where the exact model
has no derivative, the derivative becomes the mean of those on either side."""


class Reach(NamedTuple):
    """Which requests act between two samples: those ``youngest`` to ``oldest`` requests back."""

    youngest: int
    oldest: int

    @property
    def width(self) -> int:
        """Number of requests that act."""
        return self.oldest - self.youngest + 1


def reach(model: JointModel) -> Reach:
    """The requests that act on the joint between samples k-1 and k, as ages from k."""
    ticks = np.arange(1 - model.hold, 1)  # relative to the tick of sample k
    youngest = (int(ticks[-1]) - model.window.first) // model.hold
    oldest = (int(ticks[0]) - model.window.last) // model.hold
    return Reach(-youngest, -oldest)


def acting(reach: Reach, samples: int, *, cyclic: bool) -> npt.NDArray[np.int_]:
    """Number of the request that acts before sample k, the j-th youngest: shape (samples, count).

    From rest -1 stands for the requests before the first, which the first one stands in for.
    """
    ages = reach.youngest + np.arange(reach.width)
    numbers = np.arange(samples)[:, np.newaxis] - ages
    return numbers % samples if cyclic else np.maximum(numbers, -1)


class Linearised(NamedTuple):
    """Angles of a run and their derivatives, sample by sample.

    ``d angles[k] = by_angle[k] d angles[k-1] + sum_j by_request[k, j] d requests[acting[k, j]]``
    """

    angles: Array  # (n,) [rad]
    by_angle: Array  # (n,)
    by_request: Array  # (n, reach.width)


class Transitions:
    """``samples`` request periods of the joint in a row, compiled once for many requests."""

    def __init__(self, model: JointModel, samples: int) -> None:
        """Let CasADi write the period, its derivatives and the run over all samples."""
        import casadi

        self.reach = reach(model)
        angle = casadi.SX.sym("angle")
        requests = casadi.SX.sym("requests", self.reach.width)
        smoothing = casadi.SX.sym("smoothing")
        after = _period(model, angle, requests, smoothing)
        period = casadi.Function(
            "period",
            [angle, requests, smoothing],
            [after, casadi.jacobian(after, angle), casadi.jacobian(after, requests)],
        )
        self._one_at_a_time = Lock()  # the buffers below belong to the instance
        self._seam = np.zeros(1)
        self._windows = np.zeros((samples, self.reach.width))
        self._smoothing = np.zeros(samples)
        self._result = Linearised(
            np.zeros(samples), np.zeros(samples), np.zeros((samples, self.reach.width))
        )
        self._function = period.mapaccum("run", samples)
        self._buffer, self._evaluate = self._function.buffer()
        for i, argument in enumerate((self._seam, self._windows.ravel(), self._smoothing)):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        for i, result in enumerate(self._result):
            view = memoryview(result.reshape(-1))  # type: ignore[arg-type]
            self._buffer.set_res(i, view)  # type: ignore[call-arg]

    def run(self, seam: float, windows: Array, smoothing: float) -> Linearised:
        """Angles from ``seam`` on, with derivatives.

        Args:
            seam: Angle before the first sample [rad].
            windows: Requests that act before each sample, youngest first [rad], shape
                (samples, reach.width).
            smoothing: See :func:`planner.model.joint.saturation` [rad].

        Returns:
            Copies that stay as they are.
        """
        with self._one_at_a_time:
            self._seam[0] = seam
            self._windows[:] = windows
            self._smoothing[:] = max(smoothing, UNSMOOTHED)
            self._evaluate()
            return Linearised(*(result.copy() for result in self._result))


class ExactRun:
    """``samples`` request periods of the exact joint in a row, compiled once: angles alone.

    A third of the time of :class:`Transitions`, for plans that are to be judged, not improved.
    """

    def __init__(self, model: JointModel, samples: int) -> None:
        """Let CasADi write the run."""
        import casadi

        angle = casadi.SX.sym("angle")
        requests = casadi.SX.sym("requests", reach(model).width)
        after = angle
        gain = model.v_max_per_tick / model.theta_0
        for weights in weights_by_tick(model):
            # Equation 3 for weights that sum to 1: as far as the requests are within theta_0.
            low, high = after - model.theta_0, after + model.theta_0
            near = sum(
                weight * casadi.fmin(casadi.fmax(requests[j] + model.offset, low), high)
                for j, weight in enumerate(weights.tolist())
                if weight
            )
            after = after + gain * (near - after)
        period = casadi.Function("period", [angle, requests], [after])
        self._one_at_a_time = Lock()  # the buffers below belong to the instance
        self._seam = np.zeros(1)
        self._windows = np.zeros((samples, reach(model).width))
        self._angles = np.zeros(samples)
        self._function = period.mapaccum("run", samples)
        self._buffer, self._evaluate = self._function.buffer()
        for i, argument in enumerate((self._seam, self._windows.ravel())):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        self._buffer.set_res(0, memoryview(self._angles))  # type: ignore[call-arg, arg-type]

    def __call__(self, seam: float, windows: Array) -> Array:
        """Angles from ``seam`` on [rad]; ``windows`` as in :meth:`Transitions.run`."""
        with self._one_at_a_time:
            self._seam[0] = seam
            self._windows[:] = windows
            self._evaluate()
            return self._angles.copy()


def weights_by_tick(model: JointModel) -> Array:
    """How much each request of the reach counts at each tick of a period: (hold, width)."""
    at = reach(model)
    weights = np.zeros((model.hold, at.width))
    for number, tick in enumerate(range(1 - model.hold, 1)):
        for j, weight in enumerate(model.window.weights):
            age = -((tick - model.window.first - j) // model.hold)
            weights[number, age - at.youngest] += weight
    return weights


def _period(model: JointModel, angle: Any, requests: Any, smoothing: Any) -> Any:
    """Angle after one request period, as a CasADi expression."""
    youngest = reach(model).youngest
    weights = model.window.weights.tolist()
    for tick in range(1 - model.hold, 1):
        ages = [-((tick - model.window.first - j) // model.hold) for j in range(len(weights))]
        window = [requests[age - youngest] + model.offset for age in ages]
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


@lru_cache(maxsize=32)
def exact_run(model: JointModel, samples: int) -> ExactRun:
    """The exact run for this model and length: built at the first call, then kept."""
    return ExactRun(model, samples)
