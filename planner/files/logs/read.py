"""Logs of any known format, told apart by what a path is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from planner.exceptions import InvalidFile, InvalidInput
from planner.files.logs.csv_log import csv_joints, read_csv_log
from planner.files.logs.options import LogOptions
from planner.files.text import STANDARD_STREAM

if TYPE_CHECKING:
    from planner.identification.log import Log


class Format(NamedTuple):
    """What one format can do.

    Attributes:
        read: The logs of a path.
        joints: The joints of a path.
    """

    read: Callable[[Path | str, LogOptions], tuple[Log, ...]]
    joints: Callable[[Path | str, LogOptions], tuple[str, ...]]


def read_logs(
    paths: Path | str | Sequence[Path | str], *, options: LogOptions | None = None
) -> tuple[Log, ...]:
    """Read logs of requested against actual angles, whatever their format.

    Args:
        paths: CSV files (``-`` is standard input), LeRobot datasets or single Parquet files of one,
            JSON of BAM, ROS bags and MCAP files; or one of these.
        options: Which joint, columns, topics, episodes and units.

    Returns:
        One log for each joint of each file, bag or episode, in this order.

    Raises:
        InvalidInput: No path, a path that holds no log, or options that do not fit it.
        MissingExtra: The format needs a package that is not installed.
    """
    chosen = LogOptions() if options is None else options
    every = [paths] if isinstance(paths, Path | str) else list(paths)
    if not every:
        raise InvalidInput("no log; give at least one file")
    return tuple(log for path in every for log in _format(path).read(path, chosen))


def joints_in(path: Path | str, options: LogOptions | None = None) -> tuple[str, ...]:
    """Names of the joints that a log holds; "" for one that has no name.

    Raises as :func:`read_logs` does.
    """
    return _format(path).joints(path, LogOptions() if options is None else options)


def _format(path: Path | str) -> Format:
    place = Path(path)
    if str(path) != STANDARD_STREAM and place.is_dir():
        raise InvalidFile(
            path, "a folder; expected a file, or a folder with meta/info.json or metadata.yaml"
        )
    return Format(read_csv_log, csv_joints)
