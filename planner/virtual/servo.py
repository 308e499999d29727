"""A position servo (a PID loop sets the duty of a motor) and the battery that supplies it."""

from __future__ import annotations

import math

import numpy as np

from planner.virtual.constants import Constants


class Servo:
    """The electronics and the motor of one joint; MuJoCo simulates the joint itself.

    With the error e between the request that has arrived and the sensed angle, and the filtered
    speed of the latter w::

        duty    = clip(kp e + ki ∫e - kd w, -1, 1), in steps of the PWM
        current = (duty U - k speed) / R
        torque  = k current

    k is the motor's constant times the gear ratio, U the supply's voltage. The integral is
    constant while the duty is at its limit, and is clipped to its largest share of the duty.
    """

    def __init__(self, constants: Constants, angle: float) -> None:
        """A servo at rest.

        Args:
            constants: Its constants.
            angle: Sensed angle and request that it rests at [rad].
        """
        self._constants = constants
        self.request = angle
        self.duty = 0.0
        self.current = 0.0
        self._sensed = angle
        self._speed = 0.0
        self._integral = 0.0

    def control(self, sensed: float) -> None:
        """Set the duty from the sensed angle [rad]: one period of the PID loop."""
        constants = self._constants
        period = constants.control_period
        fresh = period / (constants.derivative_filter + period)
        self._speed += fresh * ((sensed - self._sensed) / period - self._speed)
        self._sensed = sensed
        error = self.request - sensed
        unclipped = (
            constants.proportional_gain * error
            + self._integral
            - constants.derivative_gain * self._speed
        )
        if abs(unclipped) < 1.0:
            share = constants.integral_share
            summed = self._integral + constants.integral_gain * error * period
            self._integral = max(-share, min(share, summed))
        steps = constants.duty_steps
        self.duty = round(steps * max(-1.0, min(1.0, unclipped))) / steps

    def drive(self, voltage: float, speed: float) -> float:
        """Torque on the joint [N m] at the supply's voltage [V] and the joint's speed [rad/s]."""
        constant = self._constants.joint_torque_constant
        induced = constant * speed
        self.current = (self.duty * voltage - induced) / self._constants.terminal_resistance
        return constant * self.current

    @property
    def drawn(self) -> float:
        """Current drawn from the supply [A]: the motor's, for the share of time it is on."""
        return self.duty * self.current


class Supply:
    """A battery, whose voltage falls with the current and has slow noise from a seed."""

    def __init__(self, constants: Constants, random: np.random.Generator) -> None:
        """A supply from which nothing is drawn yet."""
        self._constants = constants
        self._random = random
        self._noise = 0.0
        self._keep = math.exp(-constants.control_period / constants.supply_correlation_time)
        self._fresh = constants.supply_noise * math.sqrt(1.0 - self._keep**2)

    def voltage(self, drawn: float) -> float:
        """Voltage one control period later while so much current [A] is drawn [V]."""
        self._noise = self._keep * self._noise + self._fresh * self._random.standard_normal()
        constants = self._constants
        return constants.battery_voltage + self._noise - constants.battery_resistance * drawn
