"""Joints that are not the planner's model: other parameters, and a servo from its physics."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

import planner
from planner.trajectory import Array


@dataclass
class MadeJoint:
    """A :class:`planner.JointModel` with gravity, whose sensor has noise and steps.

    Attributes:
        model: The true model of the joint.
        gravity: Torque at 90 degrees [N m], as of a pendulum that hangs at 0.
        noise: Standard deviation of the sensor's noise [rad].
        count: Step of the sensor [rad]; 0 for none.
        cyclic: Whether requests repeat for ever.
        late: Samples by which the sensor is late.
        seed: Of the noise.
    """

    model: planner.JointModel
    gravity: float = 0.0
    noise: float = 0.0
    count: float = 0.0
    cyclic: bool = True
    late: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    def angles(self, requests: Array) -> Array:
        """True angles [rad], (n,): the load is that of these angles."""
        answer, load = None, np.zeros(len(requests))
        for _ in range(30 if self.gravity and self.model.feels_load else 1):
            before = answer
            answer = planner.simulate(self.model, requests, cyclic=self.cyclic, load=load)
            load = -self.gravity * np.sin(answer)
            if before is not None and np.max(np.abs(answer - before)) < 1e-7:
                break
        return answer

    def play(self, requests: Array, cycles: int = 1) -> tuple[Array, Array]:
        """True angles (n,) and the sensor's readings of several cycles (cycles, n) [rad]."""
        true = self.angles(requests)
        seen = np.roll(true, self.late) if self.cyclic else true[self._before(len(true))]
        seen = seen + self.noise * self._random.standard_normal((cycles, len(true)))
        return true, self.count * np.round(seen / self.count) if self.count else seen

    def _before(self, count: int) -> Array:
        return np.maximum(np.arange(count) - self.late, 0)


def random_joint(seed: int, *, spread: float = 0.3) -> MadeJoint:
    """A joint with parameters within a spread of the ERS-210A's, and effects that its model lacks.

    Top speed, threshold, lag and acceleration time are scaled by up to ``spread`` either way; dry
    friction up to 1 degree, top speeds that differ by up to a tenth, a sag of up to 2 degrees, up
    to 1 more by gravity, noise of up to 0.2 degrees, steps of 0, 0.09 or 0.3 degrees.
    """
    random = np.random.default_rng(seed)
    base = planner.JointModel.ers210a()
    scale = 1.0 + spread * random.uniform(-1.0, 1.0, 4)
    model = replace(
        base,
        v_max=base.v_max * scale[0],
        theta_0=base.theta_0 * scale[1],
        lag=base.lag * scale[2],
        acceleration_time=base.acceleration_time * scale[3],
        dead_band=math.radians(random.uniform(0.0, 1.0)),
        v_offset=0.1 * base.v_max * random.uniform(-1.0, 1.0),
        offset=math.radians(random.uniform(-2.0, 2.0)),
        compliance=math.radians(1.0),
    )
    return MadeJoint(
        model,
        gravity=float(random.uniform(0.0, 1.0)),
        noise=math.radians(random.uniform(0.0, 0.2)),
        count=math.radians(float(random.choice([0.0, 0.09, 0.3]))),
        seed=seed,
    )


@dataclass
class Servo:
    """A position servo from its physics, at 1 ms: cascaded loops, a motor, friction and gravity.

    A proportional position loop asks for a speed, within a limit; a PI loop of the speed asks for a
    torque, which current and back-EMF limit. Coulomb friction is exact: it holds a joint at rest.

    Attributes:
        position_gain: Target speed per error [1/s].
        top_speed: Largest target speed [rad/s].
        speed_gain: Torque per speed error [N m s/rad].
        integral_gain: Torque per integrated speed error [N m/rad].
        derivative: Share of the measured speed that the torque takes off besides [N m s/rad].
        stall: Torque limit at rest [N m].
        free_speed: Speed at which back-EMF leaves no torque [rad/s].
        inertia: Of joint and load [kg m^2].
        coulomb: Dry friction [N m].
        viscous: Friction by speed [N m s/rad].
        gravity: Torque of the load at 90 degrees [N m]; it hangs at 0.
        delay: Before a request arrives [s].
        count: Step of the sensor [rad].
        noise: Of the sensor [rad].
        period: Between requests [s].
        seed: Of the noise.
    """

    position_gain: float = 20.0
    top_speed: float = 5.5
    speed_gain: float = 0.6
    integral_gain: float = 4.0
    derivative: float = 0.0
    stall: float = 2.0
    free_speed: float = 7.0
    inertia: float = 0.012
    coulomb: float = 0.08
    viscous: float = 0.02
    gravity: float = 0.3
    delay: float = 0.012
    count: float = math.radians(0.088)
    noise: float = 0.0
    period: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self.rest(0.0)

    def rest(self, angle: float) -> None:
        """Stand at an angle, its request the same."""
        self.angle, self._speed, self._sum = angle, 0.0, 0.0
        self._queue = deque([angle] * round(self.delay / STEP))

    def play(self, requests: Array, cycles: int = 1, *, settle: int = 2) -> tuple[Array, Array]:
        """True and sensed angles of cycles, after some to settle [rad], both (cycles, n)."""
        rows = np.tile(requests, settle + cycles).tolist()
        true = np.reshape([self.send(each) for each in rows], (-1, len(requests)))[settle:]
        seen = true + self.noise * self._random.standard_normal(true.shape)
        seen = self.count * np.round(seen / self.count) if self.count else seen
        return true, seen

    def log(self, requests: Array) -> planner.Log:
        """Log of requests, executed once from rest at the first."""
        self.rest(float(requests[0]))
        _, seen = self.play(requests, settle=0)
        return planner.Log(
            times=self.period * np.arange(len(requests)), requests=requests, angles=seen[0]
        )

    @property
    def sensed(self) -> float:
        """Angle in steps of the sensor [rad]."""
        return self.count * round(self.angle / self.count) if self.count else self.angle

    def send(self, request: float) -> float:
        """The angle [rad] at which a request arrives that is held for a period."""
        before = self.angle
        for _ in range(round(self.period / STEP)):
            self._queue.append(request)
            self._advance(self._queue.popleft())
        return before

    def _advance(self, request: float) -> None:
        target = self.position_gain * (request - self.sensed)
        target = min(max(target, -self.top_speed), self.top_speed)
        error = target - self._speed
        torque = self.speed_gain * error + self._sum - self.derivative * self._speed
        high = self.stall * min(max(1.0 - self._speed / self.free_speed, 0.0), 1.0)
        low = -self.stall * min(max(1.0 + self._speed / self.free_speed, 0.0), 1.0)
        if low < torque < high:
            self._sum += self.integral_gain * error * STEP
        torque = min(max(torque, low), high)
        torque -= self.gravity * math.sin(self.angle) + self.viscous * self._speed
        grip = self.coulomb * STEP / self.inertia  # the speed that friction takes in a step
        speed = self._speed + torque * STEP / self.inertia
        self._speed = math.copysign(max(abs(speed) - grip, 0.0), speed)
        self.angle += self._speed * STEP


STEP = 1e-3
"""Time step of the servo's physics [s]."""


def random_servo(seed: int) -> Servo:
    """A servo whose constants are within 30 % of the default, friction, gravity and delay more."""
    random = np.random.default_rng(seed)
    scale = dict(
        zip(
            ("position_gain", "top_speed", "speed_gain", "stall", "free_speed", "inertia"),
            1.0 + 0.3 * random.uniform(-1.0, 1.0, 6),
            strict=True,
        )
    )
    middle = Servo()
    return Servo(
        **{name: getattr(middle, name) * share for name, share in scale.items()},
        integral_gain=float(random.choice([0.0, 4.0])),
        coulomb=float(random.uniform(0.0, 0.15)),
        gravity=float(random.uniform(0.0, 0.6)),
        delay=float(random.uniform(0.002, 0.03)),
        count=math.radians(float(random.choice([0.0, 0.088, 0.3]))),
        noise=math.radians(float(random.uniform(0.0, 0.1))),
        seed=seed,
    )


def random_path(seed: int, samples: int, *, span: float, fastest: float) -> Array:
    """A cycle of some harmonics [rad], (n,), within a span [rad], steps of at most ``fastest``."""
    random = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.arange(samples) / samples
    path = sum(
        random.uniform(0.3, 1.0) / order * np.sin(order * phase + random.uniform(0.0, 6.28))
        for order in range(1, 5)
    )
    path = path - (path.max() + path.min()) / 2.0
    size = min(span / np.ptp(path), fastest / np.max(np.abs(np.diff(path))))
    return np.asarray(size * path)
