"""Logs of any supported format, which follows from the path; recordings to replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from planner.arrays import shown
from planner.exceptions import InvalidFile, InvalidInput, nearest
from planner.files.logs.bag import read_bag
from planner.files.logs.csv_log import read_bam, read_csv_log
from planner.files.logs.lerobot import is_dataset, lerobot_episodes, read_lerobot
from planner.files.logs.rows import ROLES, LogOptions, Recorded, chosen_joints, make_log
from planner.files.staging import reason
from planner.files.text import STANDARD_STREAM
from planner.identification.log import Log


class Format(NamedTuple):
    """A format of logs, with its own options beside joint, unit and ticks_per_turn."""

    name: str
    read: Callable[[Path | str, LogOptions], Iterator[Recorded]]
    options: tuple[str, ...] = ()


CSV = Format("CSV", read_csv_log, ("time", "requested", "actual", "torque"))
BAM = Format("JSON of BAM", read_bam)
LEROBOT = Format("a LeRobot dataset", read_lerobot, ("episodes",))
BAG = Format("a bag", read_bag, ("topic", "command_topic"))

# Formats by the end of a file's name; any other is CSV.
BY_SUFFIX = {".parquet": LEROBOT, ".json": BAM, ".mcap": BAG, ".bag": BAG, ".db3": BAG}


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
    logs: list[Log] = []
    names, units = dict[str, None](), dict[str, None]()
    for path in every:
        for recorded in format_of(path, chosen).read(path, chosen):
            names |= dict.fromkeys(recorded)
            for joint in chosen_joints(path, [*recorded], chosen.joint):
                rows = recorded[joint]()
                units |= dict.fromkeys(scale.name for scale in rows.scales)
                logs.append(make_log(rows))
    if chosen.ticks_per_turn is not None and not units.keys() & {"ticks", "us"}:
        words = f"has no effect on angles in {' and '.join(units)}, only on ticks and us"
        raise InvalidInput(f"--ticks-per-turn {words}; leave it out, or name the unit with --unit")
    for joint in sorted(set(chosen.units()) - {"", *ROLES, *names}):
        known = ", ".join(each or "(one without a name)" for each in names)
        hint = nearest(joint, list(names))
        raise InvalidInput(f"--unit: no joint '{joint}'{hint}; joints: {known}")
    return tuple(logs)


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
    return tuple(next(format_of(path, chosen).read(path, chosen)))


def _checked(options: LogOptions | None) -> LogOptions:
    if not isinstance(options, LogOptions | None):
        raise InvalidInput(f"options: got {shown(options)}, expected a planner.LogOptions")
    return LogOptions() if options is None else options


def format_of(path: Path | str, options: LogOptions) -> Format:
    """The format of a path, to which the options must apply."""
    if not isinstance(path, Path | str) or "\0" in str(path):
        raise InvalidInput(f"log: got {shown(path)}, expected a path")
    place = Path(path)
    try:
        if place.is_dir():
            form = LEROBOT if is_dataset(place) else BAG
            if form is BAG and not (place / "metadata.yaml").is_file():
                endings = {file.suffix.lower() for file in place.iterdir()} & {*BY_SUFFIX, ".csv"}
                names = " or ".join(str(place / f"*{ending}") for ending in sorted(endings))
                words = "expected a LeRobot dataset (meta/info.json), a bag (metadata.yaml), or"
                files = f"its files: {names}" if names else "a file"
                raise InvalidFile(place, f"a folder that is no log; {words} {files}")
        else:
            suffix = "" if str(path) == STANDARD_STREAM else place.suffix.lower()
            if suffix == ".toml":
                raise InvalidFile(place, "TOML, such as a model file, expected a log of the joint")
            form = BY_SUFFIX.get(suffix, CSV)
            if form is not CSV and not place.exists():
                raise InvalidFile(path, "no such file; check the name and the folder")
    except OSError as error:  # not allowed to look, or a name that is too long
        raise InvalidFile(path, f"cannot be read ({reason(error)}); check the name") from error
    for name in (*CSV.options, *LEROBOT.options, *BAG.options):
        if getattr(options, name) is not None and name not in form.options:
            words = f"--{name.replace('_', '-')} means nothing to {form.name}; leave it out"
            raise InvalidFile(path, words)
    return form


@dataclass(frozen=True)
class Recording:
    """Where a recording is, so that another process can read it."""

    name: str  # in words
    path: str
    options: LogOptions
    is_episode: bool = False  # of a dataset
    episode: int | None = None  # its number, if it is known
    folder: str = ""  # the base of a relative path, for a process that works elsewhere

    @property
    def file(self) -> Path:
        """Where its rows are."""
        return Path(self.folder, self.path)

    def read(self) -> tuple[Log, ...]:
        """Its logs, one for each joint."""
        return read_logs(self.file if self.folder else self.path, options=self.options)


def recordings_in(paths: Sequence[str], options: LogOptions) -> tuple[Recording, ...]:
    """The recordings that files hold; of datasets the chosen episodes."""
    recordings: list[Recording] = []
    for path in paths:
        if format_of(path, options) is not LEROBOT:
            recordings.append(Recording(path, path, options))
            continue
        for file, episode in lerobot_episodes(path, options):
            name, own = str(file), options
            if episode is not None:
                name, own = f"{path}, episode {episode}", replace(options, episodes=str(episode))
            recordings.append(Recording(name, str(file), own, is_episode=True, episode=episode))
    return tuple(recordings)
