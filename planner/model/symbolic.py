"""Equation 3 for CasADi: one request period as an expression, and the exact run, compiled."""

from __future__ import annotations

from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from planner.model.joint import JointModel, request_ages, rounded_clip, weights_by_tick
from planner.model.response import advance
from planner.trajectory import Array


def period(model: JointModel, angle: Any, requests: Any, *, radius: Any = None) -> Any:
    """Angle after one request period: Equation 3 at each of its ``hold`` ticks.

    Args:
        model: The joint.
        angle: Angle at the sample before [rad], a CasADi expression.
        requests: Those of the ages :func:`planner.model.joint.request_ages`, youngest first
            [rad], a CasADi expression of that many entries.
        radius: Radius of the rounded corners of Equation 2 [rad]; None for the exact model.

    Returns:
        Angle at the next sample [rad], a CasADi expression.
    """
    gain = model.gain_per_tick
    clip = _clip if radius is None else rounded_clip(gain * radius)
    relative = angle - model.offset
    for weights in weights_by_tick(model).tolist():
        acting = [j for j, weight in enumerate(weights) if weight]
        relative = advance(
            relative,
            [requests[j] for j in acting],
            weights=[weights[j] for j in acting],
            gain=gain,
            v_max=model.v_max_per_tick,
            clip=clip,
        )
    return relative + model.offset


def _clip(value: Any, low: Any, high: Any) -> Any:
    import casadi

    return casadi.fmin(casadi.fmax(value, low), high)


class ExactRun:
    """``samples`` request periods of the exact joint in a row, compiled once for many requests."""

    def __init__(self, model: JointModel, samples: int) -> None:
        """Let CasADi write the run."""
        import casadi

        width = request_ages(model).width
        angle, requests = casadi.SX.sym("angle"), casadi.SX.sym("requests", width)
        one = casadi.Function("period", [angle, requests], [period(model, angle, requests)])
        self._one_at_a_time = Lock()  # the buffers below belong to the instance
        self._start = np.zeros(1)
        self._windows = np.zeros((samples, width))
        self._angles = np.zeros(samples)
        self._function = one.mapaccum("run", samples)
        self._buffer, self._evaluate = self._function.buffer()
        for i, argument in enumerate((self._start, self._windows.ravel())):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        self._buffer.set_res(0, memoryview(self._angles))  # type: ignore[call-arg, arg-type]

    def __call__(self, start: float, windows: Array) -> Array:
        """Angles at the samples [rad], shape (samples,), a copy.

        Args:
            start: Angle before the first sample [rad].
            windows: Requests that act before each sample, youngest first [rad], shape
                (samples, width of the request ages).
        """
        with self._one_at_a_time:
            self._start[0] = start
            self._windows[:] = windows
            self._evaluate()
            return self._angles.copy()


@lru_cache(maxsize=32)
def exact_run(model: JointModel, samples: int) -> ExactRun:
    """The exact run for this model and length: built at the first call, then kept."""
    return ExactRun(model, samples)
