"""The virtual robot: the leg's and the motors' physics, and nothing of the planner's model."""

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import planner.virtual
from kinematics import Leg, urdf_path
from planner.virtual.robot import CONSTANTS, JOINTS, VirtualRobot, front_leg

mujoco = pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
QUIET = replace(CONSTANTS, supply_noise=0.0, sensor_noise=0.0)
PERIOD = QUIET.request_period
TICK = math.degrees(1.0) * PERIOD  # from rad/s to degrees per tick
WEIGHT = 0.05  # share by which the leg's weight and inertia may speed up or slow down a joint


def hold(row, ticks):
    return np.tile(np.asarray(row, dtype=float), (ticks, 1))


def fastest(constants, joint=2, start=0.0, end=1.6):
    """Top speed of a joint on its way to a far request [rad/s]."""
    pose = np.zeros(3)
    pose[joint] = start
    robot = VirtualRobot(pose, constants=constants)
    pose[joint] = end
    angles = robot.play(hold(pose, 60)).angles[:, joint]
    return float(np.max(np.abs(np.diff(angles)))) / PERIOD


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def test_nothing_of_the_planners_model_is_in_the_robot():
    files = sorted(Path(planner.virtual.__file__).parent.glob("*.py"))
    allowed = (
        *("planner.virtual", "planner.exceptions", "planner.arrays"),
        *("planner.compilation", "planner.robot.protocols"),  # no model: compiled code, packets
    )
    for file in files:
        for name in imports_of(file):
            assert not name.startswith("planner") or name.startswith(allowed), (file.name, name)
        for word in ("theta_0", "v_max", "acceleration_time", "JointModel"):
            assert word not in file.read_text(encoding="utf-8"), (file.name, word)
    assert len(files) > 3


def test_the_top_speed_is_where_torque_and_friction_balance():
    assert fastest(QUIET) == pytest.approx(QUIET.top_speed, rel=WEIGHT)
    assert fastest(QUIET) * TICK == pytest.approx(2.5, rel=WEIGHT)


@pytest.mark.parametrize("delay", [0.016, 0.032, 0.040])
def test_a_request_moves_nothing_before_its_delay_and_the_joint_right_after(delay):
    robot = VirtualRobot(constants=replace(QUIET, transport_delay=delay))
    robot.rest(0.4, (0.0, 0.0, 0.0))
    angles = robot.play(hold((0.8, 0.0, 0.0), 12)).angles[:, 0]
    late = round(delay / PERIOD)
    moved = np.abs(angles - angles[0])
    assert np.max(moved[: late + 1]) < 1e-4
    assert moved[late + 1] > 1e-3


def test_a_leg_that_is_left_alone_never_gains_energy():
    constants = replace(
        QUIET, proportional_gain=0.0, integral_gain=0.0, derivative_gain=0.0, coulomb_friction=0.0
    )
    start = (1.2, 0.6, 0.3)
    robot = VirtualRobot(start, constants=constants)
    energies = []
    for _ in range(100):
        robot.play(hold(start, 1))
        mujoco.mj_energyPos(robot._model, robot._data)
        mujoco.mj_energyVel(robot._model, robot._data)
        energies.append(float(robot._data.energy.sum()))
    assert np.max(np.diff(energies)) < 1e-9
    assert energies[-1] < energies[0] - 0.001


def test_the_leg_is_that_of_the_urdf():
    model = front_leg(QUIET)
    data = mujoco.MjData(model)
    assert [model.joint(j).name for j in range(model.njnt)] == list(JOINTS)
    assert model.body_mass.sum() == pytest.approx(0.05 + 0.073 + 0.073)
    leg = Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_lower")
    random = np.random.default_rng(5)
    for _ in range(5):
        angles = random.uniform(-0.1, 1.2, size=3)
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        assert data.body("front_left_lower").xpos == pytest.approx(
            leg.foot_positions([angles])[0], abs=1e-9
        )


def test_requests_beyond_the_limits_are_cut():
    robot = VirtualRobot((0.0, 1.5, 0.0))
    angles = robot.play(hold((0.0, 3.0, 0.0), 60)).angles[:, 1]
    assert math.degrees(angles[-1]) == pytest.approx(89.0, abs=1.0)
