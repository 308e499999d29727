"""Load on the command line: from the masses of a URDF, from columns, and back into simulate."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from kinematics import Leg, urdf_path
from planner.cli.planning import with_load
from planner.cli.settings import Run
from planner.files.paths import read_joint_path, write_joint_path
from planner.recording.recorded_path import recorded_path
from planner.virtual.robot import Pendulum

SOFT = planner.JointModel(
    v_max=4.8,
    theta_0=0.33,
    lag=0.01,
    acceleration_time=0.06,
    tick=0.02,
    dead_band=0.03,
    compliance=0.11,
    speed_per_torque=1.7,
)
DESIRED = 0.8 + 0.5 * np.sin(2.0 * np.pi * np.arange(50)[:, np.newaxis] / 50)
ARM = ("--urdf", "pendulum.urdf", "--base", "base", "--foot", "tip")
LEG = (*ARM, "--model", "soft.toml")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum.urdf").write_text(Pendulum().urdf(), encoding="utf-8")
    SOFT.to_toml(tmp_path / "soft.toml")
    write_joint_path("path.csv", ["pendulum"], DESIRED, period=SOFT.period)
    return tmp_path


def test_a_plan_for_gravity_is_that_of_the_library_and_carries_its_load(run):
    result = run("plan", "path.csv", *LEG, "--load", "urdf", "-o", "requests.csv")
    assert result.exit_code == 0, result.output
    assert "no lower bound under a load that depends on the pose" in result.stderr
    leg = Leg.from_urdf("pendulum.urdf", base="base", foot="tip")
    made = planner.plan(SOFT, read_joint_path("path.csv").angles, load=leg.load_torques)
    written = read_joint_path("requests.csv")
    np.testing.assert_allclose(written.angles, made.requests, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(written.loads[:, 0], made.inversions[0].load, rtol=0.0, atol=1e-9)


def test_a_joint_that_is_not_planned_weighs_where_it_was_recorded():
    leg = Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")
    angles = np.linspace([0.2, 0.1, 0.5], [0.4, 0.3, 0.9], 20)
    logs = [
        planner.Log(
            times=SOFT.period * np.arange(20), requests=column + 0.3, angles=column, joint=name
        )
        for name, column in zip(leg.joint_names, angles.T, strict=True)
    ]
    path = recorded_path(logs, dict.fromkeys(leg.joint_names[:2], SOFT), track="action")
    given = Run.of({"path": {"file": "path.csv"}, "plan": {"load": "urdf"}}).plan
    torques = with_load(given, path, leg).load_at(path.moments(1.0))(angles[:, :2])
    np.testing.assert_allclose(torques, leg.load_torques(angles)[:, :2], atol=1e-12)
