"""LeRobot's own SO-101 follower and ours, on servos that move behind the real protocol.

Each loop is LeRobot's: an observation, an action, the next period. The servos run in lock step with
it, and no time-out of the vendor's package counts: the machine may be as busy as it likes.
"""

from __future__ import annotations

import builtins
import json
import threading
from contextlib import contextmanager

import numpy as np
import pytest
import scservo_sdk
from lerobot.robots.so_follower import SO101Follower, SOFollowerRobotConfig
from lerobot.robots.utils import make_robot_from_config

import planner
from lerobot_robot_planned import PlannedSO101Follower, PlannedSO101FollowerConfig
from planner.identification.excitation import excite
from planner.robot.protocols import SYNC_READ
from planner.virtual.servo_bus import WIRE, VirtualServos, serve, terminal

RATE = 30.0
JOINTS = (
    "shoulder_pan",
    "shoulder_lift",
    "elbow_flex",
    "wrist_flex",
    "wrist_roll",
    "gripper",
)
MODELLED = ("shoulder_pan", "shoulder_lift", "gripper")


class InLockStep(VirtualServos):
    """Servos to which a period passes before each sync read, with which LeRobot's loop begins."""

    def feed(self, content: bytes) -> bytes:
        self._received += content
        answers = b""
        while (packet := self.protocol.take(self._received, answers=False)) is not None:
            begins = packet.code == SYNC_READ
            self.run(self._tick + self.step if begins else self.motors.time + WIRE)
            self._tick = self.motors.time if begins else self._tick
            answers += b"".join(self._carry_out(packet))
        return answers


@pytest.fixture(scope="module")
def patient():
    """No time-outs of the vendor's package, and Enter at every question."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scservo_sdk.PortHandler, "getCurrentTime", lambda _: 0.0)
        patch.setattr(builtins, "input", lambda *_: "")
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory, patient):
    folder = tmp_path_factory.mktemp("calibration")
    calibration = {
        joint: {
            "id": k + 1,
            "drive_mode": 0,
            "homing_offset": 0,
            "range_min": 1024,
            "range_max": 3072,
        }
        for k, joint in enumerate(JOINTS)
    }
    (folder / "arm.json").write_text(json.dumps(calibration))
    return folder


@contextmanager
def connected(config):
    """The robot of a configuration, on an arm of its own, calibrated by LeRobot."""
    servos, stop = InLockStep(6, step=1.0 / RATE), threading.Event()
    servos.run(0.01)
    with terminal() as (end, port):
        answers = threading.Thread(
            target=serve, args=(servos, end), kwargs={"stopped": stop.is_set}, daemon=True
        )
        answers.start()
        config.port = port
        robot = make_robot_from_config(config)
        if isinstance(robot, PlannedSO101Follower):  # two looks at the clock in each period
            robot.clock = iter(np.arange(10_000) / (2.0 * RATE)).__next__
        robot.connect()
        try:
            yield robot
        finally:
            robot.disconnect()
            stop.set()
            answers.join()


def played(robot, actions: np.ndarray) -> np.ndarray:
    """Positions before each action, (rows, 6)."""
    seen = []
    for row in actions:
        observation = robot.get_observation()
        seen.append([observation[f"{joint}.pos"] for joint in JOINTS])
        robot.send_action({f"{j}.pos": float(each) for j, each in zip(JOINTS, row, strict=True)})
    return np.array(seen)


def plain(folder):
    return SOFollowerRobotConfig(port="", id="arm", calibration_dir=folder, use_degrees=True)


def planned(folder, **settings):
    return PlannedSO101FollowerConfig(
        port="", id="arm", calibration_dir=folder, use_degrees=True, rate=RATE, **settings
    )


@pytest.fixture(scope="module")
def models(folder):
    """Models of three joints, from a minute that LeRobot's own follower recorded."""
    signal = excite("combined", limits=(-28.0, 28.0), period=1.0 / RATE, duration=60.0)
    time = signal.times
    actions = np.column_stack([signal.requests] * 5 + [50.0 + signal.requests])
    with connected(plain(folder)) as robot:
        seen = played(robot, actions)
    parts = []
    for joint in MODELLED:
        k = JOINTS.index(joint)
        unit = 0.01 if joint == "gripper" else np.pi / 180.0
        log = planner.Log(times=time, requests=unit * actions[:, k], angles=unit * seen[:, k])
        planner.identify(log).model.to_toml(folder / "one.toml")
        parts.append(f"[{joint}]\n" + (folder / "one.toml").read_text())
    (folder / "arm.toml").write_text("\n".join(parts))
    return str(folder / "arm.toml")


@pytest.fixture(scope="module")
def path():
    time, k = np.arange(240)[:, np.newaxis] / RATE, np.arange(6)
    slow = 20.0 * np.sin(2.0 * np.pi * (0.3 + 0.05 * k) * time)
    quick = 6.0 * (np.sin(2.0 * np.pi * (0.7 + 0.05 * k) * time + k) - np.sin(k))
    return slow + quick + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 50.0])


def errors(seen: np.ndarray, path: np.ndarray, late: int = 0) -> np.ndarray:
    """Root mean square of each joint from half a second on, of actions so many periods late."""
    begin = 15
    return np.sqrt(np.mean((seen[begin + late :] - path[begin : len(path) - late]) ** 2, axis=0))


@pytest.fixture(scope="module")
def as_it_is(folder, path):
    with connected(plain(folder)) as robot:
        return played(robot, path)


def test_planned_joints_stay_within_a_tenth_of_what_the_best_shift_leaves(
    folder, models, path, as_it_is
):
    with connected(planned(folder, models=models)) as robot:
        seen = played(robot, path)
    best = np.min([errors(as_it_is, path, late) for late in range(10)], axis=0)
    found = errors(seen, path, late=6)[: len(JOINTS)]
    shares = {joint: found[k] / best[k] for k, joint in enumerate(JOINTS) if joint in MODELLED}
    assert max(shares.values()) < 0.1
    raw = errors(as_it_is, path)
    assert all(found[JOINTS.index(joint)] < 0.1 * raw[JOINTS.index(joint)] for joint in MODELLED)


def test_extrapolated_actions_come_without_a_delay(folder, models, path, as_it_is):
    with connected(planned(folder, models=models, extrapolate=True)) as robot:
        seen = played(robot, path)
    found, raw = errors(seen, path), errors(as_it_is, path)
    assert all(found[JOINTS.index(joint)] < 0.5 * raw[JOINTS.index(joint)] for joint in MODELLED)


def test_the_configuration_is_known_to_lerobot_by_its_name(folder, models):
    config = planned(folder, models=models)
    assert config.type == "planned_so101_follower"
    with connected(config) as robot:
        assert isinstance(robot, PlannedSO101Follower)
        assert robot.name == SO101Follower.name  # its calibration serves both
        assert set(robot.action_features) == {f"{joint}.pos" for joint in JOINTS}


def test_a_configuration_without_models_is_refused(folder):
    with pytest.raises(ValueError, match=r"--robot.models: expected a model file"):
        make_robot_from_config(planned(folder))
