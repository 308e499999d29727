"""A pendulum on a Feetech STS3215 in MuJoCo, on the virtual robot's electronics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from planner.virtual.robot import CONSTANTS, Constants, drive_joint, load_mujoco

STS3215 = replace(
    CONSTANTS,
    # Rhoban/bam, params/feetech_sts3215_7_4V/m1.json, fitted to pendulum recordings. Its figures
    # hold at the joint: its torque constant of 1.2116 N m/A is here divided by the gear ratio, its
    # armature of 0.0284 kg m^2 by the ratio's square. With them the top speed is 5.4 rad/s, the 52
    # turns a minute of the data sheet.
    terminal_resistance=2.676,
    torque_constant=1.2116 / 345.0,
    rotor_inertia=0.0284 / 345.0**2,
    viscous_friction=0.059,
    # Feetech's data sheet; a turn has 4096 counts, by a magnetic encoder before the gears
    gear_ratio=345.0,
    battery_voltage=7.4,
    sensor_bits=12,
    sensor_range=2.0 * math.pi,
    sensor_noise=0.0,
    # recordings of an SO-101 (isaac-sim2real/sage): the elbow holds errors of 0.030 to 0.046 rad,
    # times 8.9 N m/rad; BAM has 0.052 N m for a servo without a load
    coulomb_friction=0.3,
    battery_resistance=0.1,  # chosen: a power supply and its wires
    request_period=0.02,  # LeRobot on an SO-101: 50 requests a second
    transport_delay=0.01,  # chosen: USB and bus, half a request period
    # Rhoban/bam, feetech/actuator.py: duty 0.166 per rad and unit of gain, which LeRobot sets to 16
    proportional_gain=16 * 0.166,
    integral_gain=0.0,  # LeRobot sets none
    # chosen: recorded steps of an SO-101 do not overshoot; LeRobot sets 32 in a unit that is not
    # known
    derivative_gain=0.12,
    duty_steps=1000,  # the register of its PWM goes to 1000 either way
)
"""A Feetech STS3215 at 7.4 V with the position gain 16, as LeRobot sets it."""


@dataclass(frozen=True, kw_only=True)
class Pendulum:
    """A ball at the end of a rod without mass; at 0 it hangs."""

    mass: float = 0.3  # of the ball [kg]
    length: float = 0.2  # from the joint to its middle [m]
    reach: float = 2.5  # the joint turns so far either way [rad]

    def urdf(self) -> str:
        """The pendulum as a URDF: link ``base``, joint ``pendulum``, links ``arm`` and ``tip``."""
        inertia = 0.4 * self.mass * 0.01**2  # the ball's radius [m]
        turning = " ".join(f'i{axis}{axis}="{inertia!r}"' for axis in "xyz")
        return (
            f'<robot name="pendulum"><link name="base"/><link name="arm"><inertial>'
            f'<origin xyz="0 0 {-self.length!r}"/><mass value="{self.mass!r}"/>'
            f'<inertia {turning} ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>'
            '<joint name="pendulum" type="revolute"><parent link="base"/><child link="arm"/>'
            f'<axis xyz="0 -1 0"/><limit lower="{-self.reach!r}" upper="{self.reach!r}" effort="3" '
            'velocity="5.4"/></joint><joint name="mount" type="fixed"><parent link="arm"/>'
            f'<child link="tip"/><origin xyz="0 0 {-self.length!r}"/></joint></robot>'
        )

    def model(self, constants: Constants) -> Any:
        """The pendulum in MuJoCo, read from :meth:`urdf`, on a servo of these constants.

        Raises:
            MissingExtra: MuJoCo is not installed.
        """
        spec = load_mujoco().MjSpec.from_string(self.urdf())
        spec.option.timestep = constants.control_period
        spec.option.integrator = load_mujoco().mjtIntegrator.mjINT_IMPLICITFAST
        joint: Any = spec.joint("pendulum")
        drive_joint(joint, constants)
        # MuJoCo lets a joint that friction holds creep: less than 0.1 mrad/s so.
        joint.solimp_friction = [0.99, 0.99, 0.001, 0.5, 2.0]
        return spec.compile()
