"""An SO-101 follower of LeRobot that plans its goal positions on models of its servos."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import Any

from lerobot.robots.config import RobotConfig
from lerobot.robots.so_follower import SO101Follower, SOFollowerRobotConfig

from lerobot_robot_planned.arm_stream import ArmStream, models_of_arm

LOG = logging.getLogger(__name__)

PAUSE = 1.0
"""After such a time without an action the next one is a first one [s]: an episode has ended."""


@RobotConfig.register_subclass("planned_so101_follower")
@dataclass
class PlannedSO101FollowerConfig(SOFollowerRobotConfig):
    """LeRobot's configuration of an SO-101 follower, and how its goal positions are planned.

    Attributes:
        models: Model file of the joints, named as LeRobot names them.
        delay: How much of the path a plan looks ahead [s].
        extrapolate: Whether actions are continued as they go, so that nothing comes late; else they
            are held back by ``delay``.
        rate: Actions a second [Hz]: the ``fps`` of the loop. ``lerobot-record`` sends 30,
            ``lerobot-teleoperate`` 60.
    """

    models: str = ""
    delay: float = 0.2
    extrapolate: bool = False
    rate: float = 30.0


class PlannedSO101Follower(SO101Follower):
    """LeRobot's SO-101 follower, whose goal positions are planned before they are sent.

    Calibration, gains, cameras and ``max_relative_target`` are LeRobot's own. Its name stays that
    of the follower, so that a calibration of the arm serves both.
    """

    config_class = PlannedSO101FollowerConfig
    clock = staticmethod(time.perf_counter)

    def __init__(self, config: PlannedSO101FollowerConfig) -> None:
        super().__init__(config)
        units = {name: motor.norm_mode.value for name, motor in self.bus.motors.items()}
        if not config.models:
            raise ValueError(
                "--robot.models: expected a model file, such as request-planner calibrate writes"
            )
        self._models = models_of_arm(config.models, tuple(units), units, config.rate)
        self._units = units
        self._arm: ArmStream | None = None
        self._sent_at: float | None = None
        self._read: tuple[float, dict[str, float]] | None = None
        unplanned = [joint for joint in units if joint not in self._models]
        if unplanned:
            LOG.warning("%s: no model of %s", config.models, ", ".join(unplanned))

    def connect(self, calibrate: bool = True) -> None:
        """Connect as LeRobot does; the limits of plans are those of the calibration."""
        super().connect(calibrate)
        self._arm = ArmStream(
            self._models,
            self._units,
            delay=self.config.delay,
            ahead="extrapolated" if self.config.extrapolate else "held back",
            limits={joint: self._range(joint) for joint in self._models},
        )
        self._sent_at = self._read = None

    def _range(self, joint: str) -> tuple[float, float]:
        """Least and greatest goal position of a joint, in its unit."""
        unit, known = self._units[joint], self.bus.calibration[joint]
        if unit == "range_0_100":
            return 0.0, 100.0
        if unit == "range_m100_100":
            return -100.0, 100.0
        half = (known.range_max - known.range_min) / 2.0
        steps = self.bus.model_resolution_table[self.bus.motors[joint].model] - 1
        return -360.0 * half / steps, 360.0 * half / steps

    def get_observation(self) -> Any:
        """What LeRobot reads; the positions correct what the models predict."""
        observation = super().get_observation()
        read = {joint: float(observation[f"{joint}.pos"]) for joint in self._units}
        self._read = self.clock(), read
        return observation

    def send_action(self, action: Any) -> Any:
        """Plan, send, and return what LeRobot sent: ``max_relative_target`` may have clipped it."""
        if self._arm is None:  # not connected: LeRobot says so
            return super().send_action(action)
        now, missed = self.clock(), 0
        if self._sent_at is not None:
            missed = max(round((now - self._sent_at) / self._arm.period) - 1, 0)
            if now - self._sent_at > PAUSE:
                self._arm.reset()
                missed = 0
        self._sent_at = now
        desired = {
            key.removesuffix(".pos"): each for key, each in action.items() if key.endswith(".pos")
        }
        measured = None
        if self._read is not None and now - self._read[0] < self._arm.period:
            measured = self._read[1]
        goals = self._arm.step(desired, measured, missed=missed)
        if self._arm.stream.problem:
            LOG.warning("%s", self._arm.stream.problem)
        return super().send_action({f"{joint}.pos": goal for joint, goal in goals.items()})
