"""Equation 3 for CasADi: one request period as an expression, and the exact run, compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    """``samples`` request periods of several joints in a row, for several plans, compiled.

    All arrays are allocated once: write to the first three and call :meth:`run`, or write to the
    first plan of them and call :meth:`linearise`. An answer is overwritten by the next.

    Attributes:
        starts: Angle before the first sample [rad], shape (joints, plans).
        requests: Every request that acts, the oldest first [rad], shape (joints, plans, width - 1 +
            samples), where width is that of the ages: the youngest that acts in period i has the
            number width - 1 + i.
        loads: Torque in each period [N m], shape (joints, plans, samples).
        angles: Angles of the exact joints at the samples [rad], shape (joints, plans, samples).
        slopes: Derivatives of the angles under the first plan by the last ``samples`` requests,
            with rounded corners, shape (joints, samples, samples).
    """

    def __init__(
        self,
        models: Sequence[JointModel],
        ages: RequestAges,
        samples: int,
        *,
        plans: int = 1,
        radii: tuple[float, ...] = (),
    ) -> None:
        """Compile the periods, and lay out the arrays.

        Args:
            models: The joints.
            ages: Ages that contain those of the requests that act on any of them.
            samples: Request periods in a row.
            plans: How many plans are run together.
            radii: Radius of the rounded corners in each period [theta_0], for the derivatives.
        """
        joints, acting = len(models), ages.width - 1 + samples
        self.starts = np.zeros((joints, plans))
        self.requests = np.zeros((joints, plans, acting))
        self.loads = np.zeros((joints, plans, samples))
        self.angles = np.zeros((joints, plans, samples))
        self.slopes = np.zeros((joints, samples, samples))
        given = self.starts, self.requests, self.loads
        self._buffers: list[Any] = []
        self._runs, self._linearised = [], []
        for joint, model in enumerate(models):
            exact = _run(model, ages, samples).map(plans)
            self._runs.append(self._call(exact, joint, given, (self.angles,)))
            if radii:
                first = self.starts[:, :1], self.requests[:, :1], self.loads[:, :1]
                answers = self.angles[:, :1], self.slopes
                linearised = _linearised_run(model, ages, samples, radii)
                self._linearised.append(self._call(linearised, joint, first, answers))

    def run(self) -> Array:
        """Angles of the exact joints under every plan, shape (joints, plans, samples)."""
        for evaluate in self._runs:
            evaluate()
        return self.angles

    def linearise(self) -> tuple[Array, Array]:
        """Angles under the first plan, (joints, samples), and their derivatives."""
        for evaluate in self._linearised:
            evaluate()
        return self.angles[:, 0], self.slopes

    def _call(
        self, function: Any, joint: int, arguments: Sequence[Array], answers: Sequence[Array]
    ) -> Callable[[], object]:
        """One call of a compiled function that reads and writes the arrays of a joint."""
        buffer, evaluate = function.buffer()
        for i in range(function.n_in()):
            buffer.set_arg(i, memoryview(arguments[i][joint].reshape(-1)))
        for i, answer in enumerate(answers):
            buffer.set_res(i, memoryview(answer[joint].reshape(-1)))
        self._buffers.append(buffer)
        call: Callable[[], object] = evaluate
        return call


@lru_cache(maxsize=64)
def _run(model: JointModel, ages: RequestAges, samples: int) -> Any:
    """Angles of the exact joint at so many samples."""
    return _unrolled(model, ages, samples, ())


@lru_cache(maxsize=64)
def _linearised_run(
    model: JointModel, ages: RequestAges, samples: int, radii: tuple[float, ...]
) -> Any:
    """These angles, and their derivatives with rounded corners, row by row."""
    return _unrolled(model, ages, samples, radii)


def _unrolled(model: JointModel, ages: RequestAges, samples: int, radii: tuple[float, ...]) -> Any:
    import casadi

    def symbols(name: str, count: int) -> Any:
        return casadi.SX.sym(name, count)

    angle, requests = symbols("angle", 1), symbols("requests", ages.width - 1 + samples)
    load, window, radius = symbols("load", samples), symbols("window", ages.width), symbols("e", 1)
    own = request_ages(model)
    first = own.youngest - ages.youngest
    acting = window[first : first + own.width]
    torque = load[0] if model.feels_load else 0.0
    one = [angle, window, load[0], radius]
    exact = casadi.Function("exact", one, [period(model, angle, acting, load=torque)])
    after = period(model, angle, acting, load=torque, radius=radius)
    derivatives = casadi.jacobian(after, angle), casadi.jacobian(after, window)
    slope = casadi.Function("slope", one, derivatives, {"cse": True})
    reached, slopes = [angle], [casadi.SX(1, samples)]
    for i in range(samples):
        each = reached[-1], requests[i : i + ages.width][::-1], load[i]
        if radii:
            kept, moved = slope(*each, radii[i] * model.theta_0)
            row = kept * slopes[-1]
            for j in range(min(i + 1, ages.width)):
                row[i - j] += moved[j]
            slopes.append(row)
        reached.append(exact(*each, 0.0))
    answers = [casadi.vertcat(*reached[1:])]
    if radii:
        answers.append(casadi.densify(casadi.vertcat(*slopes[1:])).T)
    given = [angle, requests, *([load] if model.feels_load else [])]
    return casadi.Function("run", given, answers)
