"""The servo, its battery, and the pendulum on it: torque, voltage and statics."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from kinematics import Leg
from planner.virtual.robot import Constants, Pendulum, Servo, Sts3215, VirtualRobot

CONSTANTS = Constants()


EXACT = 1e-12
"""Rounding of a few operations [1, N m]."""


def test_the_whole_voltage_is_used_from_an_error_of_about_seven_degrees_on():
    for degrees, duty in ((8.0, 1.0), (-8.0, -1.0), (6.0, 8.0 * math.radians(6.0))):
        servo = Servo(CONSTANTS, 0.0)
        servo.request = math.radians(degrees)
        servo.control(0.0)
        assert servo.duty == pytest.approx(duty, abs=0.5 / CONSTANTS.duty_steps)


def test_the_motor_stalls_at_the_stall_torque_and_gives_none_at_its_no_load_speed():
    servo = Servo(CONSTANTS, 0.0)
    servo.duty = 1.0
    voltage = CONSTANTS.battery_voltage
    assert servo.drive(voltage, 0.0) == pytest.approx(CONSTANTS.stall_torque, abs=EXACT)
    no_load = voltage / CONSTANTS.joint_torque_constant
    assert servo.drive(voltage, no_load) == pytest.approx(0.0, abs=EXACT)
    assert servo.drive(voltage, 1.1 * no_load) < 0.0


mujoco = pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")


SERVO, PENDULUM = Sts3215(), Pendulum()


QUIET = replace(SERVO, supply_noise=0.0)


DITHER = 0.02
"""Torque by which rounding of sensor and duty blurs a balance [N m]: a count is 0.014."""


def at_rest(request: float, start: float) -> VirtualRobot:
    robot = VirtualRobot((start,), constants=QUIET, pendulum=PENDULUM)
    robot.rest(1.0, (start,))
    robot.rest(2.0, (request,))
    return robot


def test_the_free_servo_is_as_fast_as_the_data_sheet_says():
    free = replace(SERVO, coulomb_friction=0.052, battery_resistance=0.0)
    assert free.top_speed * 60.0 / (2.0 * math.pi) == pytest.approx(52.0, rel=0.01)


@pytest.mark.parametrize("start", [-0.5, 0.2, 1.8])
@pytest.mark.parametrize("request_", [0.0, 0.9, 1.5])
def test_at_rest_motor_and_weight_differ_by_no_more_than_friction(request_, start):
    angle = float(at_rest(request_, start).play([[request_]]).angles[0, 0])
    stiffness = SERVO.proportional_gain * SERVO.stall_torque
    weight = PENDULUM.mass * PENDULUM.length * 9.81 * math.sin(angle)
    balance = stiffness * (request_ - angle) - weight
    assert abs(balance) <= SERVO.coulomb_friction + DITHER


def test_its_description_says_which_load_it_carries(tmp_path):
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM.urdf(), encoding="utf-8")
    leg = Leg.from_urdf(path, base="base", foot="tip")
    model = PENDULUM.model(SERVO)
    data = mujoco.MjData(model)
    gravity = (0.0, 0.0, float(model.opt.gravity[2]))
    for angle in (-2.0, 0.0, 0.4, 1.5):
        data.qpos[:] = angle
        mujoco.mj_forward(model, data)
        found = leg.load_torques([[angle]], gravity=gravity)
        assert found[0, 0] == pytest.approx(-data.qfrc_bias[0], abs=1e-9)
