"""Requests in the formats of robots, and what each format can hold."""

from __future__ import annotations

from importlib.util import find_spec

from planner.exceptions import InvalidInput, MissingExtra
from planner.files.exports.controller_csv import Ticks, check_zeros
from planner.files.exports.lerobot import frame_rate
from planner.files.exports.ros_trajectory import TOPIC, check_times, check_topic
from planner.robot.schedule import Schedule

NEEDS = {
    "yaml": ("yaml", "a trajectory as YAML", "yaml"),
    "bag": ("rosbags", "a ROS 2 bag", "bags"),
    "mcap": ("rosbags", "a ROS 2 bag", "bags"),
    "lerobot": ("pyarrow", "a LeRobot dataset", "parquet"),
}
"""By format: the package that writes it, its name in messages, and the extra with the package."""


def check_format(
    form: str,
    schedule: Schedule,
    *,
    ticks: Ticks | None = None,
    lead: float = 0.0,
    topic: str = TOPIC,
) -> None:
    """Refuse rows whose number, times or joints a format cannot hold, for any angles.

    Args:
        form: ``csv``, or one of :data:`NEEDS`.
        schedule: Rows with the joints and times to be written.
        ticks: With ``csv``: how servos count.
        lead: With a format of ROS: time of the first point [s].
        topic: With a bag: its topic.

    Raises:
        MissingExtra: The format's package is not installed.
        InvalidInput: The rows or an option do not fit the format.
    """
    if form != "csv" and form not in NEEDS:
        raise InvalidInput(f"format: got '{form}', expected csv, {', '.join(NEEDS)}")
    if form in NEEDS:
        package, what, extra = NEEDS[form]
        if find_spec(package) is None:
            raise MissingExtra(what, extra)
    if ticks is not None:
        check_zeros(schedule, ticks)
    if form == "lerobot":
        frame_rate(schedule.period)
    elif form in NEEDS:
        check_times(schedule, lead)
    if form in ("bag", "mcap"):
        check_topic(topic)
