"""Requests in the formats of robots, and what each format can hold."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, MissingExtra, importing
from planner.files.columns import ANGLES, TIME
from planner.files.lerobot_export import frame_rate
from planner.files.staging import cannot_write, output_folder
from planner.files.table import DECIMALS, csv_text, write_table
from planner.files.text import write_text
from planner.robot.schedule import NANOSECONDS, Schedule
from planner.validation import shown

NEEDS = {
    "yaml": ("yaml", "a trajectory as YAML", "yaml"),
    "bag": ("rosbags", "a ROS 2 bag", "bags"),
    "mcap": ("rosbags", "a ROS 2 bag", "bags"),
    "lerobot": ("pyarrow", "a LeRobot dataset", "parquet"),
}
"""By format: the package that writes it, its name in messages, and the extra with the package."""

TYPE = "trajectory_msgs/msg/JointTrajectory"
"""The message's type in ROS 2."""

TOPIC = "/joint_trajectory_controller/joint_trajectory"
"""Where ros2_control's joint trajectory controller listens by default."""


def check_format(
    form: str,
    schedule: Schedule,
    *,
    ticks: Ticks | None = None,
    lead: float = 0.0,
    topic: str = TOPIC,
) -> None:
    """Refuse rows whose number, times or joints a format cannot hold, for any angles.

    ``lead`` is the time to the first point of a trajectory [s], ``topic`` that of a bag.
    """
    if form != "csv" and form not in NEEDS:
        raise InvalidInput(f"format: got '{form}', expected csv, {', '.join(NEEDS)}")
    check_installed(form)
    if ticks is not None:
        for key, names in (("zero tick", ticks.zeros), ("reverse", ticks.reversed)):
            if unknown := [name for name in names if name not in schedule.names]:
                joints = ", ".join(schedule.names)
                raise InvalidInput(f"{key}: no joint '{unknown[0]}'; joints: {joints}")
    if form == "lerobot":
        frame_rate(schedule.period)
    elif form in NEEDS:
        if not 0.0 <= lead < math.inf:
            raise InvalidInput(f"lead: got {lead:g} s, expected 0 or more")
        longest = 2**31 - 1  # that builtin_interfaces/Duration holds [s]
        if schedule.duration + lead >= longest or schedule.period * NANOSECONDS < 1.0:
            raise InvalidInput(
                f"a request every {schedule.period:g} s until {schedule.duration + lead:g} s: ROS "
                f"has whole nanoseconds up to {longest} s; export fewer cycles, or at another rate"
            )
    if form in ("bag", "mcap") and (not topic.strip("/") or any(map(str.isspace, topic))):
        raise InvalidInput(f"topic: got '{topic}', expected a name such as {TOPIC}")


def check_installed(form: str) -> None:
    """Refuse a format whose package is missing."""
    if form in NEEDS:
        package, what, extra = NEEDS[form]
        if find_spec(package) is None:
            raise MissingExtra(what, extra)


@dataclass(frozen=True)
class Ticks:
    """How a servo counts its angle: in ticks, or a hobby servo in microseconds of its pulses.

    ``per_turn`` are the counts of a full turn. Angle 0 is at the count ``zero``, of single joints
    at ``zeros``; the servos of the joints ``reversed`` are mounted the other way round.
    """

    per_turn: int = 4096
    zero: int = 2048
    zeros: Mapping[str, int] = field(default_factory=dict)
    reversed: Sequence[str] = ()
    unit: str = "ticks"

    @property
    def range(self) -> tuple[int, int]:
        """Least and largest tick that a servo takes."""
        return (500, 2500) if self.unit == "us" else (0, self.per_turn - 1)

    def __post_init__(self) -> None:
        if not 2 <= self.per_turn <= 2**31:  # counters have 32 bits
            raise InvalidInput(f"ticks per turn: got {shown(self.per_turn)}, expected 2 to {2**31}")


def write_controller_csv(
    path: Path | str, schedule: Schedule, *, unit: str = "rad", ticks: Ticks | None = None
) -> None:
    """Write ``t_s`` and one ``<joint>_<unit>`` column per joint; ``-`` is standard output."""
    names = [TIME, *(f"{name}_{unit}" for name in schedule.names)]
    if unit in ANGLES:
        angles = schedule.requests / ANGLES[unit]
        write_table(path, names, np.column_stack([schedule.times, angles]))
        return
    times = np.round(schedule.times, DECIMALS).tolist()
    rows = zip(times, to_ticks(schedule, ticks or Ticks()).tolist(), strict=True)
    write_text(path, csv_text(names, ([time, *row] for time, row in rows)))


def to_ticks(schedule: Schedule, ticks: Ticks) -> npt.NDArray[np.int64]:
    """The nearest tick to every request, shape (n, k)."""
    zeros = np.array([ticks.zeros.get(name, ticks.zero) for name in schedule.names])
    signs = np.array([-1.0 if name in ticks.reversed else 1.0 for name in schedule.names])
    counted = np.rint(zeros + signs * schedule.requests * (ticks.per_turn / (2.0 * math.pi)))
    least, most = ticks.range
    beyond = np.argwhere((counted < least) | (counted > most))
    if beyond.size:
        k, j = beyond[0]
        pulse = f"a pulse of {counted[k, j]:.0f} us"
        raise InvalidInput(
            f"{schedule.names[j]}: request {k}, {np.degrees(schedule.requests[k, j]):.2f} deg, is "
            f"{pulse if ticks.unit == 'us' else f'tick {counted[k, j]:.0f}'}, expected {least} to "
            f"{most}; check the zero tick, the ticks per turn and the direction"
        )
    return counted.astype(np.int64)


def joint_trajectory(
    schedule: Schedule, *, lead: float = 0.0, velocities: bool = False
) -> dict[str, Any]:
    """The message: a point per request, at its time after the lead [s], by position [rad].

    With a stamp of zero controllers begin when the message arrives, and lead the joints to the
    first point until the lead is over. With velocities they follow cubic splines.
    """
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
        # Central differences; the joints stand at the last point, or controllers refuse it.
        speeds = np.zeros_like(schedule.requests)
        if len(speeds) > 1:
            speeds[:-1] = np.gradient(schedule.requests, schedule.period, axis=0)[:-1]
        for point, row in zip(points, (np.round(speeds, DECIMALS) + 0.0).tolist(), strict=True):
            point["velocities"] = row
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(schedule.names),
        "points": points,
    }


def write_trajectory_yaml(path: Path | str, message: Mapping[str, Any]) -> None:
    """Write the message of :func:`joint_trajectory` to a file, or to standard output for ``-``.

    By PyYAML, with which ROS reads it. Names such as ``on``, which YAML 1.1 would read as other
    types, are quoted.
    """
    with importing("a trajectory as YAML", "yaml"):
        import yaml
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # in C where there is one
    text = yaml.dump(
        dict(message),
        Dumper=dumper,
        default_flow_style=None,  # a line for a row of numbers
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
    )
    write_text(path, text)


def write_bag(
    path: Path | str,
    message: Mapping[str, Any],
    *,
    storage: Literal["sqlite3", "mcap"] = "sqlite3",
    topic: str = TOPIC,
) -> None:
    """Write the message of :func:`joint_trajectory` as a ROS 2 bag, at time 0."""
    with importing("a ROS 2 bag", "bags"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    types = get_typestore(Stores.ROS2_HUMBLE)
    content = types.serialize_cdr(_as_message(types.types, message), TYPE)
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    with output_folder(path, export=f"ROS 2 bag ({storage})") as folder:
        inner = folder / Path(path).resolve().name  # the writer names its files after its folder
        try:
            # version 8 is the last that ROS 2 reads before Jazzy
            with Writer(inner, version=8, storage_plugin=plugin) as writer:
                connection = writer.add_connection(topic, TYPE, typestore=types)
                writer.write(connection, 0, content)
        except sqlite3.Error as error:  # such as where the disk is full
            raise cannot_write(path, error) from error
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()


def _as_message(types: Any, message: Mapping[str, Any]) -> Any:
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    duration = types["builtin_interfaces/msg/Duration"]
    time = types["builtin_interfaces/msg/Time"]
    nothing = np.zeros(0)
    return types[TYPE](
        header=types["std_msgs/msg/Header"](
            stamp=time(**message["header"]["stamp"]), frame_id=message["header"]["frame_id"]
        ),
        joint_names=message["joint_names"],
        points=[
            point(
                positions=np.array(each["positions"]),
                velocities=np.array(each.get("velocities", nothing), dtype=np.float64),
                accelerations=nothing,
                effort=nothing,
                time_from_start=duration(**each["time_from_start"]),
            )
            for each in message["points"]
        ],
    )
