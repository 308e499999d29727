"""Equation 3 for CasADi: one request period as an expression, and the exact run, compiled."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from planner.model.joint import (
    JointModel,
    RequestAges,
    request_ages,
    rounded_clip,
    weights_by_tick,
)
from planner.model.response import advance
from planner.trajectory import Array


def period(
    model: JointModel, angle: Any, requests: Any, *, load: Any = 0.0, radius: Any = None
) -> Any:
    """Angle after one request period: Equation 3 at each of its ``hold`` ticks.

    Args:
        model: The joint.
        angle: Angle at the sample before [rad], a CasADi expression.
        requests: Those of the ages :func:`planner.model.joint.request_ages`, youngest first
            [rad], a CasADi expression of that many entries.
        load: Torque on the joint in this period [N m], a number or a CasADi expression.
        radius: Radius of the rounded corners of Equation 2 [rad]; None for the exact model.

    Returns:
        Angle at the next sample [rad], a CasADi expression.
    """
    clip = _clip if radius is None else rounded_clip(model.gain_per_tick * radius)
    speed = model.law_per_tick(load, clip=clip)
    sag = model.offset + model.compliance * load
    relative = angle - sag
    for weights in weights_by_tick(model).tolist():
        acting = [j for j, weight in enumerate(weights) if weight]
        relative = advance(
            relative,
            [requests[j] for j in acting],
            weights=[weights[j] for j in acting],
            speed=speed,
        )
    return relative + sag


def _clip(value: Any, low: Any, high: Any) -> Any:
    import casadi

    return casadi.fmin(casadi.fmax(value, low), high)


class ExactRun:
    """``samples`` request periods of the exact joint in a row, compiled once for many requests."""

    def __init__(self, model: JointModel, samples: int) -> None:
        """Build the run as a CasADi function."""
        import casadi

        width = request_ages(model).width
        angle, requests = casadi.SX.sym("angle"), casadi.SX.sym("requests", width)
        load = casadi.SX.sym("load")
        felt = [load] if model.feels_load else []
        after = period(model, angle, requests, load=load if felt else 0.0)
        one = casadi.Function("period", [angle, requests, *felt], [after])
        self._one_at_a_time = Lock()  # the buffers below belong to the instance
        self._start = np.zeros(1)
        self._windows = np.zeros((samples, width))
        self._load = np.zeros(samples)
        self._angles = np.zeros(samples)
        self._function = one.mapaccum("run", samples)
        self._buffer, self._evaluate = self._function.buffer()
        arguments = (self._start, self._windows.ravel(), self._load)
        for i, argument in enumerate(arguments[: 2 + len(felt)]):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        self._buffer.set_res(0, memoryview(self._angles))  # type: ignore[call-arg, arg-type]

    def __call__(self, start: float, windows: Array, load: Array | None = None) -> Array:
        """Angles at the samples [rad], shape (samples,), a copy.

        Args:
            start: Angle before the first sample [rad].
            windows: Requests that act before each sample, youngest first [rad], shape
                (samples, width of the request ages).
            load: Torque on the joint in the period that ends in each sample [N m], (samples,).
        """
        with self._one_at_a_time:
            self._start[0] = start
            self._windows[:] = windows
            self._load[:] = 0.0 if load is None else load
            self._evaluate()
            return self._angles.copy()


@lru_cache(maxsize=32)
def exact_run(model: JointModel, samples: int) -> ExactRun:
    """The exact run for this model and length: built at the first call, then kept."""
    return ExactRun(model, samples)


class Runs:
    """``samples`` request periods of several exact joints in a row, compiled.

    All arrays are allocated once: write to the first three and call :meth:`run`, whose answer is
    overwritten by the next.

    Attributes:
        starts: Angle before the first sample [rad], shape (joints, 1).
        requests: Every request that acts, the oldest first [rad], shape (joints, width - 1 +
            samples), where width is that of the ages: the youngest that acts in period i has the
            number width - 1 + i.
        loads: Torque in each period [N m], shape (joints, samples).
    """

    def __init__(self, models: Sequence[JointModel], ages: RequestAges, samples: int) -> None:
        """Compile the periods, and lay out the arrays.

        Args:
            models: The joints.
            ages: Ages that contain those of the requests that act on any of them.
            samples: Request periods in a row.
        """
        joints = len(models)
        self.starts = np.zeros((joints, 1))
        self.requests = np.zeros((joints, ages.width - 1 + samples))
        self.loads = np.zeros((joints, samples))
        self._angles = np.zeros((joints, samples))
        self._runs = [
            Call(
                _run(model, ages, samples),
                (self.starts[joint], self.requests[joint], self.loads[joint]),
                (self._angles[joint],),
            )
            for joint, model in enumerate(models)
        ]

    def run(self) -> Array:
        """Angles at the samples [rad], shape (joints, samples)."""
        for run in self._runs:
            run()
        return self._angles


class Call:
    """A call of a compiled function that reads and writes the same arrays every time."""

    def __init__(self, function: Any, arguments: Sequence[Array], answers: Sequence[Array]) -> None:
        """Take a CasADi function and contiguous arrays, in the order of its inputs and outputs."""
        self._buffer, self._evaluate = function.buffer()
        for i, argument in enumerate(arguments):
            self._buffer.set_arg(i, memoryview(argument.reshape(-1)))  # type: ignore[arg-type]
        for i, answer in enumerate(answers):
            self._buffer.set_res(i, memoryview(answer.reshape(-1)))  # type: ignore[arg-type]

    def __call__(self) -> None:
        """Evaluate the function."""
        self._evaluate()


def one_period(model: JointModel, ages: RequestAges) -> tuple[Any, Any]:
    """Where a period of the exact joint leads, and derivatives with rounded corners, compiled.

    Two CasADi functions of the angle before, the requests of all ages, youngest first, the load,
    and the radius of the corners [rad], on which only the derivatives depend: those by the angle
    and by each request, shape (1, width).
    """
    import casadi

    angle, window = casadi.SX.sym("angle"), casadi.SX.sym("window", ages.width)
    load, radius = casadi.SX.sym("load"), casadi.SX.sym("radius")
    own = request_ages(model)
    first = own.youngest - ages.youngest
    acting = window[first : first + own.width]
    torque = load if model.feels_load else 0.0
    exact = period(model, angle, acting, load=torque)
    rounded = period(model, angle, acting, load=torque, radius=radius)
    by_request = casadi.jacobian(rounded, window)
    # Angle and requests moved by as much move what they lead to by as much.
    by_angle = 1.0 - casadi.sum2(by_request)
    given = [angle, window, load, radius]
    return (
        casadi.Function("exact", given, [exact]),
        casadi.Function("slopes", given, [by_angle, by_request], {"cse": True}),
    )


@lru_cache(maxsize=64)
def _run(model: JointModel, ages: RequestAges, samples: int) -> Any:
    """Angles of the exact joint at so many samples."""
    import casadi

    start, loads = casadi.SX.sym("start"), casadi.SX.sym("loads", samples)
    requests = casadi.SX.sym("requests", ages.width - 1 + samples)
    exact, _ = one_period(model, ages)
    angles = [start]
    for i in range(samples):
        angles.append(exact(angles[-1], requests[i : i + ages.width][::-1], loads[i], 0.0))
    return casadi.Function("run", [start, requests, loads], [casadi.vertcat(*angles[1:])])
