"""Servos from their physics, compiled: kinds of which none is the planner's model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np

import planner
from planner.arrays import Array
from planner.identification.excitation import excite

STEP = 2e-4  # time step of the physics [s]

_compile: Any = numba.njit(cache=True)


@_compile
def cascaded(numbers: Array, error: float, angle: float, speed: float, memory: float) -> Any:
    """A position loop above a PI loop of the speed, a motor, friction, gravity.

    Numbers: position gain, top speed, speed gain, integral gain, stall torque, free speed,
    inertia, Coulomb and viscous friction, gravity.
    """
    gain, top, by_speed, integral, stall, free, inertia, coulomb, viscous, gravity = numbers[:10]
    change = min(max(gain * error, -top), top) - speed
    torque = by_speed * change + memory
    high = stall * min(max(1.0 - speed / free, 0.0), 1.0)
    low = -stall * min(max(1.0 + speed / free, 0.0), 1.0)
    if low < torque < high:
        memory += integral * change * STEP
    torque = min(max(torque, low), high) - gravity * math.sin(angle) - viscous * speed
    return _slowed(speed + torque * STEP / inertia, coulomb * STEP / inertia), memory


@_compile
def proportional(numbers: Array, error: float, angle: float, speed: float, memory: float) -> Any:
    """A voltage by the error, back-EMF, a current limit, friction, gravity.

    Friction is Coulomb's, raised at rest (Stribeck) and by the torque that the gear transmits.

    Numbers: voltage per error, largest voltage, motor constant, resistance, largest current,
    inertia, Coulomb friction, gravity, and, of friction, the share that rest adds, the speed at
    which it has fallen to a third, the share of the torque.
    """
    gain, supply, constant, resistance, most, inertia, coulomb, gravity, rest, fast, by_torque = (
        numbers[:11]
    )
    voltage = min(max(gain * error, -supply), supply)
    current = min(max((voltage - constant * speed) / resistance, -most), most)
    weight = gravity * math.sin(angle)
    friction = coulomb * (1.0 + rest * math.exp(-abs(speed) / fast))
    friction += by_torque * abs(constant * current + weight)
    free = speed + (constant * current - weight) * STEP / inertia
    return _slowed(free, friction * STEP / inertia), memory


@_compile
def integrating(numbers: Array, error: float, angle: float, speed: float, memory: float) -> Any:
    """A position controller with an integral term, limited voltage, back-EMF, friction, gravity.

    Numbers: voltage per error, rate of the integral, largest voltage, motor constant, resistance,
    inertia, Coulomb friction, gravity.
    """
    gain, rate, supply, constant, resistance, inertia, coulomb, gravity = numbers[:8]
    asked = gain * error + memory
    voltage = min(max(asked, -supply), supply)
    if asked == voltage:
        memory += rate * gain * error * STEP
    torque = constant * (voltage - constant * speed) / resistance - gravity * math.sin(angle)
    return _slowed(speed + torque * STEP / inertia, coulomb * STEP / inertia), memory


@_compile
def hobby(numbers: Array, error: float, _: float, speed: float, memory: float) -> Any:
    """A dead zone of the controller, unequal top speeds, a slow start.

    Numbers: gain, top speeds up and down, dead zone, largest acceleration.
    """
    gain, up, down, zone, most = numbers[:5]
    target = 0.0 if abs(error) <= zone else min(max(gain * error, -down), up)
    return speed + min(max(target - speed, -most * STEP), most * STEP), memory


@_compile
def _slowed(speed: float, by: float) -> float:
    return math.copysign(max(abs(speed) - by, 0.0), speed)


@_compile
def _run(
    law: Any, numbers: Array, late: int, play: float, slew: float, requests: Array, steps: int
) -> Array:
    angle = motor = goal = requests[0]
    speed, memory, at = 0.0, 0.0, 0
    waiting, angles = np.full(late + 1, angle), np.empty(len(requests))
    for k in range(len(requests)):
        angles[k] = angle
        for _ in range(steps):
            waiting[at] = requests[k]
            at = (at + 1) % len(waiting)
            goal += min(max(waiting[at] - goal, -slew * STEP), slew * STEP)
            speed, memory = law(numbers, goal - angle, motor, speed, memory)
            motor += speed * STEP
            angle = min(max(angle, motor - 0.5 * play), motor + 0.5 * play)
    return angles


@dataclass(frozen=True)
class CompiledServo:
    """A servo by one of the laws above."""

    name: str
    law: Any
    numbers: tuple[float, ...]
    delay: float  # before a request arrives [s]
    period: float = 0.02  # between requests [s]
    play: float = 0.0  # of the gear, between the motor and the sensor [rad]
    slew: float = math.inf  # largest speed of the goal that the controller follows [rad/s]
    pendulum: float = 0.0  # torque of gravity at 90 degrees that logs and plans know [N m]
    count: float = math.radians(0.088)  # step of the sensor [rad]; 0 for none
    noise: float = math.radians(0.03)  # of the sensor [rad]

    def angles(self, requests: Array, *, before: int = 0) -> Array:
        """True angles [rad], (n,), after so many cycles of the same requests."""
        late, steps = round(self.delay / STEP), round(self.period / STEP)
        played = np.tile(requests, before + 1)
        numbers = np.array(self.numbers)
        angles = _run(self.law, numbers, late, self.play, self.slew, played, steps)
        return np.asarray(angles[-len(requests) :])

    def seen(self, angles: Array, random: np.random.Generator) -> Array:
        """The sensor's readings of the angles [rad]."""
        rows = angles + self.noise * random.standard_normal(np.shape(angles))
        return np.asarray(self.count * np.round(rows / self.count) if self.count else rows)

    def load(self, angles: Array) -> Array | None:
        """Torque of the pendulum on the joint [N m], where it is known."""
        return -self.pendulum * np.sin(angles) if self.pendulum else None

    def log(self, requests: Array | None = None, seed: int = 0) -> planner.Log:
        """Requests from rest, or a minute of the default motion of ``excite``, as sensed."""
        if requests is None:
            limits = (-0.85, 0.85)
            requests = excite("combined", limits=limits, period=self.period, duration=60.0).requests
        angles = self.seen(self.angles(requests), np.random.default_rng(seed))
        times = self.period * np.arange(len(requests))
        return planner.Log(times=times, requests=requests, angles=angles, load=self.load(angles))


CASCADED = CompiledServo(
    "cascaded loops with an integral term",
    cascaded,
    (20.0, 5.5, 0.6, 4.0, 2.0, 7.0, 0.012, 0.08, 0.02, 0.3),
    0.012,
)
INTEGRATING = CompiledServo(
    "position controller with an integral term",
    integrating,
    (60.0, 5.0, 12.0, 1.6, 4.0, 0.02, 0.1, 0.3),
    0.008,
)
PROPORTIONAL = CompiledServo(
    "P control, current limit, gravity, play",
    proportional,
    (90.0, 12.0, 1.1, 2.2, 3.0, 0.012, 0.2, 0.5, 0.0, 1.0, 0.0),
    0.008,
    play=math.radians(0.3),
)
HOBBY = CompiledServo(
    "hobby servo, slow start", hobby, (16.0, 5.5, 4.6, math.radians(0.7), 30.0), 0.02
)


def random_servo(seed: int) -> CompiledServo:
    """A cascade whose constants are within 30 % of that one, friction, gravity and delay more."""
    random = np.random.default_rng(seed)
    gain, top, by_speed, _, stall, free, inertia, _, viscous, _ = CASCADED.numbers
    scaled = np.array([gain, top, by_speed, stall, free, inertia])
    scaled *= 1.0 + 0.3 * random.uniform(-1.0, 1.0, 6)
    gain, top, by_speed, stall, free, inertia = scaled.tolist()
    integral = float(random.choice([0.0, 4.0]))
    coulomb, gravity = random.uniform(0.0, 0.15), random.uniform(0.0, 0.6)
    return replace(
        CASCADED,
        numbers=(gain, top, by_speed, integral, stall, free, inertia, coulomb, viscous, gravity),
        delay=random.uniform(0.002, 0.03),
        count=math.radians(random.choice([0.0, 0.088, 0.3])),
        noise=math.radians(random.uniform(0.0, 0.1)),
    )


def with_friction(degrees: float) -> CompiledServo:
    """P control without gravity whose dead band is of so many degrees."""
    gain, supply, constant, resistance, *_ = PROPORTIONAL.numbers
    coulomb = math.radians(degrees) * gain * constant / resistance
    return replace(
        PROPORTIONAL,
        name=f"P control, dead band {degrees:g} degrees",
        numbers=(
            *(gain, supply, constant, resistance, math.inf),
            *(0.012, coulomb, 0.0, 0.0, 1.0, 0.0),
        ),
        play=0.0,
    )


def with_pendulum(
    name: str, numbers: tuple[float, ...], weight: float, *, slew: float = math.inf
) -> CompiledServo:
    """A servo by its data sheet, P control, with a pendulum whose load is logged.

    Its numbers are the voltage per error [V/rad]; the supply [V]; the torque per current [N m/A],
    the stall torque of the data sheet over its stall current, and a tenth for losses; the supply
    over the stall current [Ohm]; the inertia of motor, gear and pendulum [kg m^2]; and the friction
    without load [N m], to which rest adds a half, and a tenth of the torque adds: gears of such
    servos lose that much. The weight is the torque of the pendulum at 90 degrees [N m].
    """
    *motor, inertia, coulomb = numbers
    known = (*motor, math.inf, inertia, coulomb, weight, 0.5, 0.3, 0.1)
    return CompiledServo(name, proportional, known, 0.01, slew=slew, pendulum=weight)


STS3215 = "STS3215, gain 16, no D, goal at 3,400 counts/s"
PENDULUMS = (
    with_pendulum("XL330, gain 400, overloaded", (11.5, 5.0, 0.39, 3.4, 0.0035, 0.03), 0.24),
    with_pendulum(
        STS3215, (20.0, 7.4, 0.8, 2.8, 0.035, 0.07), 1.0, slew=3400.0 * 2.0 * math.pi / 4096.0
    ),
    with_pendulum("MX-64", (30.0, 12.0, 1.6, 2.9, 0.06, 0.1), 1.2),
    with_pendulum("MX-106", (30.0, 12.0, 1.8, 2.3, 0.1, 0.15), 1.8),
    with_pendulum("XL-320", (5.7, 7.4, 0.39, 6.7, 0.0009, 0.01), 0.06),
)


def overloaded(servo: CompiledServo, times: int) -> CompiledServo:
    """A servo with so many times the pendulum, which neither logs nor plans know."""
    before, weight, after = servo.numbers[:7], servo.numbers[7], servo.numbers[8:]
    kind = servo.name.partition(",")[0]
    return replace(
        servo,
        name=f"{kind}, {times} times the load, not logged",
        numbers=(*before, times * weight, *after),
        pendulum=0.0,
    )


SERVOS: Sequence[CompiledServo] = (
    CASCADED,
    INTEGRATING,
    PROPORTIONAL,
    HOBBY,
    *map(with_friction, (0.49, 0.9, 1.23)),
    *PENDULUMS,
    *(overloaded(PENDULUMS[k], times) for k, times in ((0, 3), (1, 2), (4, 3))),
)
