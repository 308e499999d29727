"""Requests as a ROS message, ``trajectory_msgs/JointTrajectory``, in plain lists and numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner.exceptions import InvalidInput
from planner.files.table import DECIMALS
from planner.robot.schedule import NANOSECONDS, Schedule
from planner.trajectory import Array

TYPE = "trajectory_msgs/msg/JointTrajectory"
"""The message's type in ROS 2."""

LONGEST = 2**31 - 1
"""Latest time that ``builtin_interfaces/Duration`` holds [s]."""


def joint_trajectory(
    schedule: Schedule, *, lead: float = 0.0, velocities: bool = False
) -> dict[str, Any]:
    """The message: a point per request, at its time after the lead.

    A stamp of zero tells controllers to begin when the message arrives.

    Args:
        schedule: The requests.
        lead: Time of the first point [s], in which a controller leads the joints there.
        velocities: Whether points carry velocities; a controller then follows cubic splines.

    Returns:
        The message's fields, with points that carry positions [rad], times, and perhaps velocities.

    Raises:
        InvalidInput: A lead below 0, points within a nanosecond, or one too late for a duration
            of ROS.
    """
    check_times(schedule, lead)
    times = schedule.nanoseconds + round(lead * NANOSECONDS)
    positions = np.round(schedule.requests, DECIMALS) + 0.0  # no negative zero
    points = [
        {
            "positions": row,
            "time_from_start": {"sec": time // NANOSECONDS, "nanosec": time % NANOSECONDS},
        }
        for row, time in zip(positions.tolist(), times.tolist(), strict=True)
    ]
    if velocities:
        for point, row in zip(points, _velocities(schedule).tolist(), strict=True):
            point["velocities"] = row
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(schedule.names),
        "points": points,
    }


def check_times(schedule: Schedule, lead: float) -> None:
    """Make sure that ROS has the times of the points.

    Raises:
        InvalidInput: As :func:`joint_trajectory` does.
    """
    if not 0.0 <= lead < math.inf:
        raise InvalidInput(f"lead: got {lead:g} s, expected 0 or more")
    if schedule.duration + lead >= LONGEST or schedule.period * NANOSECONDS < 1.0:
        raise InvalidInput(
            f"a request every {schedule.period:g} s until {schedule.duration + lead:g} s: ROS has "
            f"whole nanoseconds up to {LONGEST} s; export fewer cycles, or at another rate"
        )


def _velocities(schedule: Schedule) -> Array:
    """Central differences [rad/s]; the joints stand at the last point, or controllers refuse it."""
    velocities = np.zeros_like(schedule.requests)
    if len(velocities) > 1:
        velocities[:-1] = np.gradient(schedule.requests, schedule.period, axis=0)[:-1]
    return np.asarray(np.round(velocities, DECIMALS) + 0.0, dtype=np.float64)
