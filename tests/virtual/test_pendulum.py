"""The pendulum on a virtual STS3215: data sheet, statics and gravity, and no planner's model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from kinematics import Leg
from planner.virtual.robot import Pendulum, Sts3215, VirtualRobot

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


def test_a_joint_that_friction_holds_does_not_creep():
    angles = at_rest(1.2, 0.2).play(np.full((100, 1), 1.2)).angles[:, 0]
    assert np.ptp(angles) < 2e-4  # rad in two seconds


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
