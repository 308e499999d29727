"""A robot and processor steps for LeRobot that plan goal positions on models of the servos."""

from lerobot_robot_planned.arm_stream import ArmStream
from lerobot_robot_planned.chunk import ArmState, PlanChunk
from lerobot_robot_planned.follower import PlannedSO101Follower, PlannedSO101FollowerConfig

__all__ = [
    "ArmState",
    "ArmStream",
    "PlanChunk",
    "PlannedSO101Follower",
    "PlannedSO101FollowerConfig",
]
