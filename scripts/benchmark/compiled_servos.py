"""Servos from their physics, compiled: three kinds, none of which is the planner's model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

import planner
from planner.identification.excitation import excite

Array = npt.NDArray[np.float64]

STEP = 2e-4
"""Time step of the physics [s]."""

SEEN = math.radians(0.088), math.radians(0.03)
"""Step and noise of the sensor [rad]."""

_compile: Any = numba.njit(cache=True)


@_compile
def cascaded(numbers: Array, error: float, angle: float, speed: float, memory: float) -> Any:
    """A position loop above a PI loop of the speed, a motor, friction, gravity.

    Numbers: position gain, top speed, speed gain, integral gain, stall torque, free speed,
    inertia, Coulomb and viscous friction, gravity.
    """
    gain, top, by_speed, integral, stall, free, inertia, coulomb, viscous, gravity = numbers[:10]
    asked = min(max(gain * error, -top), top) - speed
    torque = by_speed * asked + memory
    high = stall * min(max(1.0 - speed / free, 0.0), 1.0)
    low = -stall * min(max(1.0 + speed / free, 0.0), 1.0)
    if low < torque < high:
        memory += integral * asked * STEP
    torque = min(max(torque, low), high) - gravity * math.sin(angle) - viscous * speed
    return _slowed(speed + torque * STEP / inertia, coulomb * STEP / inertia), memory


@_compile
def proportional(numbers: Array, error: float, angle: float, speed: float, memory: float) -> Any:
    """A voltage by the error, back-EMF, a current limit, friction, gravity.

    Numbers: voltage per error, largest voltage, motor constant, resistance, largest current,
    inertia, Coulomb friction, gravity.
    """
    gain, supply, constant, resistance, most, inertia, coulomb, gravity = numbers[:8]
    voltage = min(max(gain * error, -supply), supply)
    current = min(max((voltage - constant * speed) / resistance, -most), most)
    torque = constant * current - gravity * math.sin(angle)
    return _slowed(speed + torque * STEP / inertia, coulomb * STEP / inertia), memory


@_compile
def hobby(numbers: Array, error: float, _: float, speed: float, memory: float) -> Any:
    """A dead zone of the controller, unequal top speeds, a slow start.

    Numbers: gain, top speeds up and down, dead zone, largest acceleration.
    """
    gain, up, down, zone, most = numbers[:5]
    asked = 0.0 if abs(error) <= zone else min(max(gain * error, -down), up)
    return speed + min(max(asked - speed, -most * STEP), most * STEP), memory


@_compile
def _slowed(speed: float, by: float) -> float:
    return math.copysign(max(abs(speed) - by, 0.0), speed)


@_compile
def _run(law: Any, numbers: Array, late: int, requests: Array, steps: int) -> Array:
    angle, speed, memory, at = requests[0], 0.0, 0.0, 0
    waiting, angles = np.full(late + 1, angle), np.empty(len(requests))
    for k in range(len(requests)):
        angles[k] = angle
        for _ in range(steps):
            waiting[at] = requests[k]
            at = (at + 1) % len(waiting)
            speed, memory = law(numbers, waiting[at] - angle, angle, speed, memory)
            angle += speed * STEP
    return angles


@dataclass(frozen=True)
class CompiledServo:
    """A servo.

    Attributes:
        name: What it is.
        law: :func:`cascaded`, :func:`proportional` or :func:`hobby`.
        numbers: Its constants.
        delay: Before a request arrives [s].
        period: Between requests [s].
    """

    name: str
    law: Any
    numbers: tuple[float, ...]
    delay: float
    period: float = 0.02

    def angles(self, requests: Array, *, before: int = 0) -> Array:
        """True angles [rad], (n,), after so many cycles of the same requests."""
        late, steps = round(self.delay / STEP), round(self.period / STEP)
        played = np.tile(requests, before + 1)
        angles = _run(self.law, np.array(self.numbers), late, played, steps)
        return np.asarray(angles[-len(requests) :])

    def logs(self, seed: int = 0) -> list[planner.Log]:
        """What ``excite`` proposes by default, a minute, as its sensor reports it."""
        random, (count, noise) = np.random.default_rng(seed), SEEN
        signal = excite(
            "combined", limits=(-0.85, 0.85), period=self.period, duration=60.0, cycles=1
        )
        angles = self.angles(signal.requests)
        angles = count * np.round((angles + noise * random.standard_normal(len(angles))) / count)
        return [planner.Log(times=signal.times, requests=signal.requests, angles=angles)]


CASCADED = CompiledServo(
    "cascaded loops with an integral term",
    cascaded,
    (20.0, 5.5, 0.6, 4.0, 2.0, 7.0, 0.012, 0.08, 0.02, 0.3),
    0.012,
)
PROPORTIONAL = CompiledServo(
    "P control, gravity", proportional, (90.0, 12.0, 1.1, 2.2, 3.0, 0.012, 0.2, 0.5), 0.008
)
HOBBY = CompiledServo(
    "hobby servo, slow start", hobby, (16.0, 5.5, 4.6, math.radians(0.7), 30.0), 0.02
)


def with_friction(degrees: float) -> CompiledServo:
    """P control without gravity whose dead band is of so many degrees."""
    gain, supply, constant, resistance, _, inertia, _, _ = PROPORTIONAL.numbers
    coulomb = math.radians(degrees) * gain * constant / resistance
    numbers = (gain, supply, constant, resistance, math.inf, inertia, coulomb, 0.0)
    name = f"P control, dead band {degrees:g} degrees"
    return replace(PROPORTIONAL, name=name, numbers=numbers)


SERVOS: Sequence[CompiledServo] = (
    CASCADED,
    PROPORTIONAL,
    HOBBY,
    *map(with_friction, (0.49, 0.9, 1.23)),
)
