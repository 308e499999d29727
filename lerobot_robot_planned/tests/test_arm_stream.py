"""Goal positions for actions, on joints that are the models; LeRobot is not needed."""

from __future__ import annotations

import numpy as np
import pytest
from lerobot_robot_planned.arm_stream import ArmStream, models_of_arm

import planner

RATE = 30.0
JOINT = planner.JointModel(
    v_max=5.0, theta_0=0.35, lag=0.02, acceleration_time=0.06, tick=0.005, hold=4
)
JAW = planner.JointModel(
    v_max=1.2, theta_0=0.1, lag=0.02, acceleration_time=0.05, tick=0.005, hold=4
)
UNITS = {"pan": "degrees", "lift": "range_m100_100", "gripper": "range_0_100"}


@pytest.fixture
def models(tmp_path):
    file = tmp_path / "arm.toml"
    JOINT.to_toml(file)
    return models_of_arm(str(file), ["pan"], {"pan": "degrees"}, RATE)


def actions(count: int = 240) -> np.ndarray:
    time = np.arange(count) / RATE
    return 25.0 * np.sin(np.pi * time) + 8.0 * np.sin(2.2 * np.pi * time + 1.0)


def played(arm: ArmStream, path: np.ndarray, joint: str = "pan") -> np.ndarray:
    """Angles of the joint under the goal positions for these actions [deg]."""
    goals = [arm.step({joint: each})[joint] for each in path]
    model = arm.stream.models[0]
    return np.degrees(planner.simulate(model, np.radians(goals), cyclic=False))


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def test_a_joint_follows_actions_that_are_held_back(models):
    path, arm = actions(), ArmStream(models, {"pan": "degrees"}, delay=0.2)
    late, settled = arm.rows - 1, 30
    angles = played(arm, path)
    errors = angles[late + settled :] - path[settled : len(path) - late]
    as_they_are = np.degrees(planner.simulate(arm.stream.models[0], np.radians(path), cyclic=False))
    assert rms(errors) < 0.1
    assert rms(as_they_are - path) > 4.0


def test_extrapolated_actions_leave_a_third_of_the_error_and_no_delay(models):
    path = actions()
    arm = ArmStream(models, {"pan": "degrees"}, delay=0.2, ahead="extrapolated")
    as_they_are = np.degrees(planner.simulate(arm.stream.models[0], np.radians(path), cyclic=False))
    assert rms((played(arm, path) - path)[30:]) < rms((as_they_are - path)[30:]) / 3.0


def test_joints_without_a_model_get_their_actions_as_late_as_the_others(models):
    arm = ArmStream(models, {"pan": "degrees", "gripper": "range_0_100"}, delay=0.2)
    sent = [arm.step({"pan": 0.0, "gripper": float(k)})["gripper"] for k in range(40)]
    late = arm.rows - 1
    assert np.allclose(sent[late:], np.arange(40 - late))


def test_shares_of_a_range_keep_their_unit(tmp_path):
    (tmp_path / "arm.toml").write_text("")
    JAW.to_toml(tmp_path / "arm.toml")
    for unit, low, high in (("range_0_100", 20.0, 80.0), ("range_m100_100", -60.0, 60.0)):
        models = models_of_arm(str(tmp_path / "arm.toml"), ["gripper"], {"gripper": unit}, RATE)
        arm = ArmStream(models, {"gripper": unit}, delay=0.2)
        sent = [arm.step({"gripper": low})["gripper"] for _ in range(5)]
        assert np.allclose(sent, low, atol=1e-6)
        sent = [arm.step({"gripper": high})["gripper"] for _ in range(60)]
        assert sent[-1] == pytest.approx(high, abs=1e-3)


def test_goal_positions_stay_within_limits(models):
    arm = ArmStream(models, {"pan": "degrees"}, limits={"pan": (-20.0, 20.0)})
    sent = [arm.step({"pan": each})["pan"] for each in actions()]
    assert np.max(np.abs(sent)) <= 20.0 + 1e-9


def test_actions_of_missed_periods_lie_on_a_line(models):
    arm = ArmStream(models, {"pan": "degrees", "gripper": "range_0_100"}, delay=0.2)
    for _ in range(10):
        arm.step({"pan": 0.0, "gripper": 0.0})
    arm.step({"pan": 0.0, "gripper": 30.0}, missed=2)
    sent = [arm.step({"pan": 0.0, "gripper": 30.0})["gripper"] for _ in range(arm.rows)]
    assert {10.0, 20.0, 30.0} <= {round(each, 6) for each in sent}


def test_a_joint_that_an_action_leaves_out_stays(models):
    arm = ArmStream(models, {"pan": "degrees", "gripper": "range_0_100"})
    with pytest.raises(ValueError, match="the first one lacks gripper"):
        arm.step({"pan": 3.0})
    arm.step({"pan": 3.0, "gripper": 40.0})
    sent = [arm.step({"gripper": 40.0}) for _ in range(3)]
    assert all(set(each) == {"gripper"} for each in sent)


def test_a_file_without_the_arms_joints_is_refused(tmp_path):
    file = tmp_path / "leg.toml"
    JOINT.to_toml(file)
    file.write_text("[knee]\n" + file.read_text())
    with pytest.raises(ValueError, match="models of knee, of none of the arm's joints pan"):
        models_of_arm(str(file), ["pan"], {"pan": "degrees"}, RATE)


def test_wrong_settings_are_refused(models):
    with pytest.raises(ValueError, match="expected 'held back' or 'extrapolated'"):
        ArmStream(models, {"pan": "degrees"}, ahead="guessed")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="delay: got 0"):
        ArmStream(models, {"pan": "degrees"}, delay=0)
