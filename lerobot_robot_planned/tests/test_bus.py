"""The bus of LeRobot's own follower, as ``calibrate --bus lerobot:so101`` takes it."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import scservo_sdk
from lerobot.robots.so_follower import SO101Follower  # noqa: F401

from planner.exceptions import BusError, InvalidInput
from planner.robot.arm import Arm, Servo
from planner.robot.bus import lerobot_bus, robot_of
from planner.virtual.servo_bus import VirtualServos, serve, terminal

PERIOD = 0.02


@pytest.fixture
def port(monkeypatch):
    """Six servos in lock step with the packets."""
    monkeypatch.setattr(scservo_sdk.PortHandler, "getCurrentTime", lambda _: 0.0)
    servos, stop = VirtualServos(6, step=PERIOD), threading.Event()
    servos.run(0.01)
    with terminal() as (end, path):
        kept = {"stopped": stop.is_set}
        answers = threading.Thread(target=serve, args=(servos, end), kwargs=kept, daemon=True)
        answers.start()
        yield path
        stop.set()
        answers.join()


def test_the_joints_have_lerobots_names():
    names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    motors = robot_of("so101", "").bus.motors
    assert {motor.id: joint for joint, motor in motors.items()} == dict(enumerate(names, start=1))


def test_a_joint_moves_under_lerobots_settings(port):
    with lerobot_bus("so101", port) as bus:
        bus.patience = 30.0
        arm = Arm(bus, {"shoulder_pan": Servo(id=1)})
        settings = arm.settings()["shoulder_pan"]
        assert (settings["p_gain"], settings["i_gain"], settings["d_gain"]) == (16, 0, 32)
        assert settings["profile_acceleration"] == 254
        kept = []
        with arm.powered():
            path = 0.2 * np.sin(np.linspace(0.0, np.pi, 40))[:, None]
            arm.perform(path, period=PERIOD, keep=lambda _, __, angles: kept.append(angles[0]))
    assert len(kept) == 40
    assert max(kept) > 0.15


def test_a_robot_that_lerobot_does_not_have_is_named():
    with pytest.raises(InvalidInput, match=r"got lerobot:so999, expected a robot .*so101"):
        robot_of("so999", "")


def test_a_port_that_is_missing_is_a_fault_of_the_bus(tmp_path):
    with (
        pytest.raises(BusError, match="LeRobot cannot connect"),
        lerobot_bus("so101", str(tmp_path / "none")),
    ):
        pass
