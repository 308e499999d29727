"""The physical constants of the virtual robot, each with its unit and where it comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

MOTOR = "data sheet of the FAULHABER 1331T006SR, 13 mm across"
GUESS = "guess"
CHOICE = "choice"


def constant(value: float | int, unit: str, source: str) -> Any:
    """A field of constants: its value, with unit and source as metadata."""
    return field(default=value, metadata={"unit": unit, "source": source})


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Constants of the virtual robot; ``docs/virtual_robot.md`` has the equations.

    The motors of the ERS-210A are unknown. These are those of a coreless motor of a size
    that fits the leg; top speed, lag and acceleration follow from it and are set nowhere. Every
    field carries its unit and its source as metadata; a guess is marked as one.
    """

    terminal_resistance: float = constant(2.83, "ohm", MOTOR)
    torque_constant: float = constant(5.35e-3, "N m/A", f"{MOTOR}; in SI the back-EMF's as well")
    rotor_inertia: float = constant(7.1e-8, "kg m^2", MOTOR)
    gear_ratio: float = constant(
        235.0, "1", f"{CHOICE}: with this motor the leg's top speed comes near the paper's"
    )
    coulomb_friction: float = constant(
        0.1, "N m", f"{GUESS}: a thirtieth of the stall torque, for a train of small spur gears"
    )
    viscous_friction: float = constant(
        0.01, "N m s/rad", f"{GUESS}: a fiftieth of what the back-EMF brakes"
    )
    battery_voltage: float = constant(7.2, "V", "nominal, two lithium-ion cells in series")
    battery_resistance: float = constant(0.1, "ohm", f"{GUESS}: two cells and their wires")
    supply_noise: float = constant(
        0.03, "V", f"{GUESS}: standard deviation, from what else draws current"
    )
    supply_correlation_time: float = constant(0.1, "s", f"{GUESS}: correlation time of that noise")
    control_period: float = constant(1e-3, "s", f"{CHOICE}: 1 kHz, usual for such servos")
    request_period: float = constant(8e-3, "s", "Stronger and Stone: one request per frame")
    transport_delay: float = constant(
        32e-3, "s", f"{CHOICE}: four frames between a request and its servo, after the paper"
    )
    proportional_gain: float = constant(
        8.0, "1/rad", f"{CHOICE}: the whole voltage at an error of about 7 degrees"
    )
    integral_gain: float = constant(
        0.5, "1/(rad s)", f"{CHOICE}: slow, as the Aibo's own integral gain is small"
    )
    derivative_gain: float = constant(0.005, "s/rad", f"{CHOICE}: no overshoot to be seen")
    derivative_filter: float = constant(4e-3, "s", f"{CHOICE}: time constant of the speed's filter")
    integral_share: float = constant(
        0.02, "1", f"{CHOICE}: largest duty that the integral may ask for, against wind-up"
    )
    duty_steps: int = constant(255, "1", "the Aibo's PWM saturates at 255 steps either way")
    sensor_bits: int = constant(10, "bit", "Sony: the potentiometer is read with 10 bits")
    sensor_range: float = constant(
        math.radians(300.0), "rad", f"{GUESS}: a turning range of 300 degrees; 0.29 degrees a count"
    )
    sensor_noise: float = constant(
        math.radians(0.1), "rad", f"{GUESS}: standard deviation of the wiper and its converter"
    )
    stop_margin: float = constant(
        math.radians(3.0), "rad", "Sony: the stops lie 3 degrees beyond the limits"
    )

    @property
    def count(self) -> float:
        """One step of the sensor [rad]."""
        return self.sensor_range / float(2**self.sensor_bits)

    @property
    def sensor_error(self) -> float:
        """Standard deviation of the sensor's reading [rad]: its noise and its rounding."""
        return math.hypot(self.sensor_noise, self.count / math.sqrt(12.0))

    @property
    def armature(self) -> float:
        """Rotor inertia as the joint feels it [kg m^2]: times the gear ratio squared."""
        return self.rotor_inertia * self.gear_ratio**2

    @property
    def joint_torque_constant(self) -> float:
        """Torque at the joint per current [N m/A], and voltage per speed of the joint [V s/rad]."""
        return self.torque_constant * self.gear_ratio

    @property
    def stall_torque(self) -> float:
        """Torque at the joint, held still under the battery's voltage [N m], before friction."""
        return self.joint_torque_constant * self.battery_voltage / self.terminal_resistance

    @property
    def top_speed(self) -> float:
        """Speed at which torque and friction balance, no leg attached [rad/s].

        At the duty 1 the battery's resistance adds to the motor's.
        """
        resistance = self.terminal_resistance + self.battery_resistance
        constant = self.joint_torque_constant
        driving = constant * self.battery_voltage / resistance - self.coulomb_friction
        return driving / (constant**2 / resistance + self.viscous_friction)

    def to_dict(self) -> Mapping[str, Mapping[str, Any]]:
        """Every constant with its unit and source, for reports."""
        return {
            each.name: {"value": getattr(self, each.name), **each.metadata} for each in fields(self)
        }
