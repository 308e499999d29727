"""Logs of any supported format, which follows from the path; JSON of BAM; recordings to replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.columns import LARGEST, scale
from planner.files.logs.bag import bag_joints, is_bag_folder, read_bag
from planner.files.logs.csv_log import csv_joints, read_csv_log
from planner.files.logs.lerobot import (
    EpisodeFile,
    is_dataset,
    lerobot_episodes,
    lerobot_joints,
    read_lerobot,
)
from planner.files.logs.make_log import (
    ALL_JOINTS,
    ROLES,
    Columns,
    LogOptions,
    Source,
    Switch,
    choose_joints,
    make_log,
)
from planner.files.text import STANDARD_STREAM, read_json
from planner.identification.log import Log
from planner.trajectory import Array
from planner.validation import shown

TIME, REQUESTED, ACTUAL, TORQUE = "timestamp", "goal_position", "position", "torque_enable"
"""Keys of an entry that are read; an entry may leave the torque's out."""

MASS, LENGTH, ARM_MASS = "mass", "length", "arm_mass"
"""Keys beside the entries: of the pendulum on the servo [kg, m, kg], the last of a few files."""

UNIT = "rad"
"""The unit of the angles, by the format's definition."""


def read_bam(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the one log of a BAM file."""
    content = read_json(path, what="a log")
    entries = _entries(path, content)
    choose_joints(path, [""], options.joint)
    if options.unit_of("") not in (None, UNIT):
        raise InvalidFile(
            path,
            f"angles of BAM are in {UNIT} by definition, but --unit says {options.unit_of('')}; "
            "leave the option out",
        )
    source = Source(path=path, row="entry")
    torque_on = _torque(source, entries)
    angles = _numbers(source, entries, ACTUAL)
    requests = _numbers(source, entries, REQUESTED)
    if torque_on is not None:  # a servo that is switched off may have no goal
        no_goal = np.isnan(requests) & ~torque_on
        requests[no_goal] = angles[no_goal]
    moment = _moment(path, content)
    load = None if moment is None else -moment * np.sin(angles)
    radians = scale(UNIT, None)
    columns = Columns(
        times=_numbers(source, entries, TIME),
        requests=requests,
        angles=angles,
        request_scale=radians,
        angle_scale=radians,
        torque_on=torque_on,
        load=load,
    )
    torque = "" if torque_on is None else f", torque from '{TORQUE}'"
    notes = (
        f"time from '{TIME}', requested from '{REQUESTED}', actual from '{ACTUAL}'{torque}",
        f"angles in {UNIT}, as BAM defines them",
        *(() if moment is None else (f"load of a pendulum, {moment:.3g} N m where it is level",)),
    )
    return (make_log(source, columns, joint="", notes=notes),)


def _moment(path: Path | str, content: Mapping[str, Any]) -> float | None:
    """Largest torque of the pendulum's weight [N m], (m + m_arm / 2) g l; None without one.

    The pendulum hangs at 0 and is ``length`` long, its arm of one thickness.
    """
    if MASS not in content or LENGTH not in content:
        return None
    values = {}
    for key in (MASS, LENGTH, ARM_MASS):
        value = values[key] = content.get(key, 0.0)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and 0.0 <= value < LARGEST):
            raise InvalidFile(path, f"'{key}': got {value!r:.20}, expected a number, 0 or more")
    return float((values[MASS] + values[ARM_MASS] / 2.0) * 9.80665 * values[LENGTH])  # [m/s^2]


def _entries(path: Path | str, content: Any) -> Sequence[Mapping[str, Any]]:
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list):
        keys = ", ".join(map(repr, list(content)[:8])) if isinstance(content, dict) else ""
        raise InvalidFile(
            path,
            f"got {'the keys ' + keys if keys else 'no entries'}, expected BAM's object with a "
            "list 'entries'; give another format as CSV",
        )
    source = Source(path=path, row="entry")
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise source.fault(f"got {type(entry).__name__}, expected an object with keys", k)
    return entries


def _numbers(source: Source, entries: Sequence[Mapping[str, Any]], key: str) -> Array:
    values = np.empty(len(entries))
    for k, entry in enumerate(entries):
        if key not in entry:
            raise source.fault(
                f"no '{key}'{nearest(key, list(entry))}; keys: {', '.join(entry)}", k
            )
        number = entry[key]
        if number is None:
            number = math.nan
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise source.fault(f"'{key}': got {type(number).__name__}, expected a number", k)
        values[k] = number if abs(number) < 1e300 or number != number else math.inf
    return values


def _torque(source: Source, entries: Sequence[Mapping[str, Any]]) -> Switch | None:
    if not any(TORQUE in entry for entry in entries):
        return None
    switch = np.empty(len(entries), dtype=bool)
    for k, entry in enumerate(entries):
        value = entry.get(TORQUE)
        if value not in (0, 1):  # False and True among them
            raise source.fault(f"'{TORQUE}': got {value!r:.20}, expected true or false", k)
        switch[k] = bool(value)
    return switch


class Format(NamedTuple):
    """A format of logs, with its own options beside joint, unit and ticks_per_turn."""

    name: str
    read: Callable[[Path | str, LogOptions], tuple[Log, ...]]
    joints: Callable[[Path | str, LogOptions], tuple[str, ...]]
    options: tuple[str, ...] = ()


CSV = Format("CSV", read_csv_log, csv_joints, ("time", "requested", "actual", "torque"))
BAM = Format(
    "JSON of BAM",
    read_bam,
    lambda path, options: tuple(log.joint for log in read_bam(path, options)),
)
LEROBOT = Format("a LeRobot dataset", read_lerobot, lerobot_joints, ("episodes",))
BAG = Format("a bag", read_bag, bag_joints, ("topic", "command_topic"))

BY_SUFFIX = {".parquet": LEROBOT, ".json": BAM, ".mcap": BAG, ".bag": BAG, ".db3": BAG}
"""Formats by the end of a file's name; any other is CSV."""

OWN = tuple(name for form in (CSV, LEROBOT, BAG) for name in form.options)
"""Options of one format only."""


def read_logs(
    paths: Path | str | Sequence[Path | str], *, options: LogOptions | None = None
) -> tuple[Log, ...]:
    r"""Read logs of requested and actual angles, in any supported format.

    Args:
        paths: CSV files (``-`` is standard input), LeRobot datasets or single Parquet files of one,
            JSON of BAM, ROS bags and MCAP files; or one of these.
        options: Which joint, columns, topics, episodes and units.

    Returns:
        One log for each joint of each file, bag or episode, in this order.

    Raises:
        InvalidInput: No path, a path that holds no log, or options that do not fit it.
        MissingExtra: The format needs a package that is not installed.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "log.csv")
        ...     rows = "\n".join(f"{0.02 * k:.2f},{k},{k - 1}" for k in range(9))
        ...     _ = file.write_text(f"t_s,requested_deg,actual_deg\n{rows}\n")
        ...     (log,) = read_logs(file)
        >>> len(log.times), round(float(log.requests[-1]), 3)
        (9, 0.14)
    """
    chosen = _checked(options)
    every = [paths] if isinstance(paths, Path | str) else paths
    if not isinstance(every, Sequence) or isinstance(every, bytes):
        raise InvalidInput(f"logs: got {type(every).__name__}, expected a path, or several")
    if not every:
        raise InvalidInput("no log; give at least one file")
    logs = tuple(log for path in every for log in format_of(path, chosen).read(path, chosen))
    unread = set(chosen.units()) - {"", *ROLES, *(log.joint for log in logs)}
    if unread and STANDARD_STREAM not in map(str, every):
        names = [name for path in every for name in joints_in(path, chosen)]
        for joint in sorted(unread - set(names)):
            raise InvalidInput(
                f"--unit: no joint '{joint}'{nearest(joint, names)}; joints: "
                + ", ".join(each or "(one without a name)" for each in names)
            )
    return logs


def joints_in(path: Path | str, options: LogOptions | None = None) -> tuple[str, ...]:
    r"""Names of the joints that a log holds; "" for one that has no name.

    Raises as :func:`read_logs` does.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "log.csv")
        ...     _ = file.write_text("t_s,knee_requested_deg,knee_actual_deg\n0,1,2\n1,2,3\n")
        ...     joints_in(file)
        ('knee',)
    """
    chosen = _checked(options)
    return format_of(path, chosen).joints(path, chosen)


def _checked(options: LogOptions | None) -> LogOptions:
    if not isinstance(options, LogOptions | None):
        raise InvalidInput(f"options: got {shown(options)}, expected a planner.LogOptions")
    return LogOptions() if options is None else options


def format_of(path: Path | str, options: LogOptions) -> Format:
    """The format of a path, to which the options must apply."""
    if not isinstance(path, Path | str) or "\0" in str(path):
        raise InvalidInput(f"log: got {shown(path)}, expected a path")
    try:
        form = _recognised(path)
    except OSError as error:  # not allowed to look, or a name that is too long
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(path, f"cannot be read ({reason}); check the name") from error
    for name in OWN:
        if getattr(options, name) is not None and name not in form.options:
            raise InvalidFile(
                path, f"--{name.replace('_', '-')} means nothing to {form.name}; leave it out"
            )
    return form


def _recognised(path: Path | str) -> Format:
    place = Path(path)
    if str(path) == STANDARD_STREAM:
        return CSV
    if not place.is_dir():
        if place.suffix.lower() == ".toml":
            raise InvalidFile(place, "TOML, such as a model file, expected a log of the joint")
        return BY_SUFFIX.get(place.suffix.lower(), CSV)
    if is_dataset(place):
        return LEROBOT
    if is_bag_folder(place):
        return BAG
    endings = {file.suffix.lower() for file in place.iterdir()} & {*BY_SUFFIX, ".csv"}
    files = " or ".join(str(place / f"*{ending}") for ending in sorted(endings))
    raise InvalidFile(
        path,
        "a folder that is no log; expected a LeRobot dataset (meta/info.json), a bag "
        "(metadata.yaml), or " + (f"its files: {files}" if files else "a file"),
    )


@dataclass(frozen=True)
class Recording:
    """Where a recording is, so that another process can read it.

    One in a dataset has its number; ``folder`` is the base of a relative path, for a process that
    works elsewhere.
    """

    path: str
    options: LogOptions
    dataset: str = ""
    episode: int | None = None
    folder: str = ""

    @property
    def name(self) -> str:
        """The recording in words."""
        if not self.dataset:
            return self.path
        return f"{self.dataset}, episode {self.episode}" if self.episode is not None else self.path

    @property
    def place(self) -> EpisodeFile:
        """Where its rows are, of an episode of a dataset."""
        return EpisodeFile(Path(self._file), self.episode)

    def read(self) -> tuple[Log, ...]:
        """Its logs, one for each joint."""
        return read_logs(self._file, options=self.options)

    @property
    def _file(self) -> str:
        return str(Path(self.folder, self.path)) if self.folder else self.path


def recordings_in(paths: Sequence[str], options: LogOptions) -> tuple[Recording, ...]:
    """The recordings that files hold, with all joints; of datasets the chosen episodes."""
    if not paths:
        raise InvalidInput("no recording; give at least one file")
    every = replace(options, joint=ALL_JOINTS)
    recordings: list[Recording] = []
    for path in paths:
        if format_of(path, every) is not LEROBOT:
            recordings.append(Recording(str(path), every))
            continue
        for file, episode in lerobot_episodes(path, every):
            own = every if episode is None else replace(every, episodes=str(episode))
            recordings.append(Recording(str(file), own, str(path), episode))
    return tuple(recordings)
