"""The virtual robot: the leg of the URDF, and nothing of the planner's model."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import planner.virtual
from kinematics import Leg, urdf_path
from planner.virtual.robot import CONSTANTS, JOINTS, front_leg

mujoco = pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
QUIET = replace(CONSTANTS, supply_noise=0.0, sensor_noise=0.0)


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
