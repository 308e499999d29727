"""The servo: what it asks for, when it stops asking, and the torque that follows."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from planner.virtual.robot import Constants, Servo

CONSTANTS = Constants()
EXACT = 1e-12
"""Rounding of a few operations [1, N m]."""


def test_the_whole_voltage_is_used_from_an_error_of_about_seven_degrees_on():
    for degrees, duty in ((8.0, 1.0), (-8.0, -1.0), (6.0, 8.0 * math.radians(6.0))):
        servo = Servo(CONSTANTS, 0.0)
        servo.request = math.radians(degrees)
        servo.control(0.0)
        assert servo.duty == pytest.approx(duty, abs=0.5 / CONSTANTS.duty_steps)


def test_the_duty_comes_in_steps():
    servo = Servo(CONSTANTS, 0.0)
    servo.request = 0.0123
    servo.control(0.0)
    steps = servo.duty * CONSTANTS.duty_steps
    assert steps == pytest.approx(round(steps), abs=EXACT)
    assert servo.duty > 0.0


def test_the_motor_stalls_at_the_stall_torque_and_gives_none_at_its_no_load_speed():
    servo = Servo(CONSTANTS, 0.0)
    servo.duty = 1.0
    voltage = CONSTANTS.battery_voltage
    assert servo.drive(voltage, 0.0) == pytest.approx(CONSTANTS.stall_torque, abs=EXACT)
    no_load = voltage / CONSTANTS.joint_torque_constant
    assert servo.drive(voltage, no_load) == pytest.approx(0.0, abs=EXACT)
    assert servo.drive(voltage, 1.1 * no_load) < 0.0


def test_a_motor_without_voltage_brakes():
    servo = Servo(CONSTANTS, 0.0)
    assert servo.drive(CONSTANTS.battery_voltage, 2.0) < 0.0
    assert servo.drive(CONSTANTS.battery_voltage, -2.0) > 0.0
    assert servo.drawn == 0.0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_integral_works_slowly_keeps_to_its_share_and_rests_in_saturation(way):
    servo = Servo(CONSTANTS, 0.0)
    servo.request = way * math.radians(2.0)
    servo.control(0.0)
    first = servo.duty
    for _ in range(10_000):
        servo.control(0.0)
    step = 1.0 / CONSTANTS.duty_steps
    assert servo.duty - first == pytest.approx(way * CONSTANTS.integral_share, abs=step)
    saturated = Servo(CONSTANTS, 0.0)
    saturated.request = way
    for _ in range(10_000):
        saturated.control(0.0)
    saturated.request = 0.0
    saturated.control(0.0)
    assert saturated.duty == 0.0


def test_the_derivative_brakes_a_joint_that_comes_near():
    still, moving = Servo(CONSTANTS, 0.0), Servo(CONSTANTS, 0.0)
    constants = replace(CONSTANTS, derivative_gain=0.05)
    moving = Servo(constants, 0.0)
    still = Servo(constants, 0.0)
    still.request = moving.request = 0.1
    for k in range(20):
        moving.control(0.003 * k)
        still.control(0.057)
    assert moving.duty < still.duty


def test_the_derivative_is_of_a_speed_that_is_filtered():
    """A step of the sensor by 0.01 rad in 1 ms is 10 rad/s, of which the filter passes a fifth."""
    constants = Constants(integral_gain=0.0)
    servo = Servo(constants, 0.0)
    servo.control(0.01)
    passed = constants.control_period / (constants.derivative_filter + constants.control_period)
    expected = -0.01 * constants.proportional_gain - 10.0 * passed * constants.derivative_gain
    assert abs(servo.duty - expected) <= 0.5 / constants.duty_steps
