"""How the state of a joint trajectory controller was laid out over the years.

A bag without definitions of its types, as ROS 2 wrote them before Iron, does not tell which one it
holds. Only the right one explains all the bytes of a message.
"""

from __future__ import annotations

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
"""The type."""


def _layout(points: str, multi_dof_points: str = "") -> str:
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"trajectory_msgs/JointTrajectoryPoint {name}" for name in points.split()]
    if multi_dof_points:
        lines.append("string[] multi_dof_joint_names")
    lines += [
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}"
        for name in multi_dof_points.split()
    ]
    return "\n".join(lines)


LAYOUTS = (
    _layout("desired actual error"),
    _layout(*("reference feedback error output desired actual",) * 2),
    _layout(*("reference feedback error output",) * 2),
)
"""Up to Galactic; Humble; since Iron."""
