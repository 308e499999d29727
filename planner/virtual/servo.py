"""A position servo: requests come late, a PID loop sets the duty, a motor turns it into torque."""

from __future__ import annotations

from planner.virtual.constants import Constants


class Servo:
    """The electronics and the motor of one joint; the joint itself is somebody else's.

    With the error e between the request that has arrived and the sensed angle, and the filtered
    speed of the latter w::

        duty    = clip(kp e + ki ∫e - kd w, -1, 1), in steps of the PWM
        current = (duty U - k speed) / R
        torque  = k current

    k is the motor's constant times the gear ratio, U the supply's voltage. The integral rests while
    the duty is at its limit, and never asks for more than its share.
    """

    def __init__(self, constants: Constants, angle: float) -> None:
        """A servo at rest.

        Args:
            constants: What it is made of.
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
        wanted = (
            constants.proportional_gain * error
            + self._integral
            - constants.derivative_gain * self._speed
        )
        if abs(wanted) < 1.0:
            share = constants.integral_share
            summed = self._integral + constants.integral_gain * error * period
            self._integral = max(-share, min(share, summed))
        steps = constants.duty_steps
        self.duty = round(steps * max(-1.0, min(1.0, wanted))) / steps

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
