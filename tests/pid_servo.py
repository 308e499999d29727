"""A servo with a cascaded controller: a plant that is not the planner's model."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PidServo:
    """A joint under position and speed control, in SI units.

    The position error asks for a speed, the speed error (proportional and integral) for a voltage;
    the motor has back-EMF and a torque limit, the joint inertia, Coulomb and viscous friction and
    gravity. Requests arrive late, angles are read in counts of the sensor.
    """

    position_gain: float = 14.0  # [1/s]
    speed_gain: float = 6.0  # [V s/rad]
    integral_gain: float = 60.0  # [V/rad]
    voltage: float = 12.0
    motor: float = 1.6  # torque constant at the joint [N m/A] = [V s/rad]
    resistance: float = 3.0  # [ohm]
    torque_limit: float = 4.0  # [N m]
    inertia: float = 0.03  # [kg m^2]
    coulomb: float = 0.15  # [N m]
    viscous: float = 0.05  # [N m s/rad]
    gravity: float = 0.4  # torque where the arm is level [N m]
    delay: float = 0.012  # [s]
    counts: int = 4096  # a turn
    period: float = 0.02  # [s]
    inner: float = 0.001  # [s]

    def start(self, angle: float) -> Running:
        """The servo at rest."""
        return Running(self, angle)

    def run(self, requests, start: float) -> np.ndarray:
        """Sensed angles right after each request [rad], like a log's rows."""
        running = self.start(start)
        return np.array([running.period(request) for request in requests])


class Running:
    """A servo that runs."""

    def __init__(self, servo: PidServo, angle: float) -> None:
        self.servo, self.angle, self.speed = servo, angle, 0.0
        self.integral = servo.gravity * math.sin(angle) / servo.motor * servo.resistance
        self.under_way = deque([angle] * round(servo.delay / servo.inner))

    def sensed(self) -> float:
        count = 2.0 * math.pi / self.servo.counts
        return count * round(self.angle / count)

    def period(self, request: float) -> float:
        """Send a request and hold it; the angle that was sensed right after it."""
        before = self.sensed()
        for _ in range(round(self.servo.period / self.servo.inner)):
            self.under_way.append(float(request))
            self._advance(self.under_way.popleft())
        return before

    def _advance(self, request: float) -> None:
        s, dt = self.servo, self.servo.inner
        error = s.position_gain * (request - self.sensed()) - self.speed
        asked = s.speed_gain * error + self.integral + s.motor * self.speed
        volts = max(-s.voltage, min(s.voltage, asked))
        if volts == asked:
            self.integral += s.integral_gain * error * dt
        torque = s.motor * (volts - s.motor * self.speed) / s.resistance
        torque = max(-s.torque_limit, min(s.torque_limit, torque))
        torque -= s.gravity * math.sin(self.angle) + s.viscous * self.speed
        if self.speed == 0.0 and abs(torque) <= s.coulomb:
            return
        way = math.copysign(1.0, self.speed if self.speed else torque)
        after = self.speed + (torque - way * s.coulomb) / s.inertia * dt
        self.speed = 0.0 if after * way < 0.0 else after
        self.angle += self.speed * dt
