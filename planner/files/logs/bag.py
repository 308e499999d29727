"""Logs from bags: a controller's state, or joint states held against the commands before them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidFile, InvalidInput
from planner.files.logs.bag_file import open_bag
from planner.files.logs.bag_topics import choose_topics
from planner.files.logs.joints import choose_joints
from planner.files.logs.options import LogOptions
from planner.files.logs.recording import Recording, read_recording
from planner.files.logs.rows import Columns, Source, Switch, make_log
from planner.files.logs.series import Series
from planner.files.logs.units import scale

if TYPE_CHECKING:
    from planner.identification.log import Log


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return (path / "metadata.yaml").is_file()


def read_bag(path: Path | str, options: LogOptions) -> tuple[Log, ...]:
    """Read the chosen joints of a bag.

    Raises:
        InvalidFile: It is none, or does not tell requested from actual angles; the message says
            what it holds.
        MissingExtra: rosbags is not installed.
    """
    recording = _recording(path, options)
    names = recording.joints
    chosen = choose_joints(path, names, options.joint)
    return tuple(_log(path, recording, names[k], options) for k in chosen)


def bag_joints(path: Path | str, options: LogOptions) -> tuple[str, ...]:
    """Names of the joints of which a bag holds requested and actual angles."""
    return _recording(path, options).joints


def _recording(path: Path | str, options: LogOptions) -> Recording:
    with open_bag(path) as bag:
        return read_recording(bag, choose_topics(bag, options), options.joint)


def _log(path: Path | str, recording: Recording, joint: str, options: LogOptions) -> Log:
    actual, requested = recording.of(joint)
    order = np.argsort(actual.stamps, kind="stable")
    stamps, angles = actual.stamps[order], actual.values[order]
    fresh = np.ones(len(stamps), dtype=bool)  # a row that is there twice is there once
    fresh[1:] = (np.diff(stamps) != 0) | (angles[1:] != angles[:-1])
    stamps, angles = stamps[fresh], angles[fresh]
    last = _last_before(requested, stamps)
    begun = last >= 0
    source = Source(path=path, part=f"joint {joint}" if joint else "", row="state")
    if not begun.any():
        raise InvalidFile(
            source.name,
            f"no request before the last state: {len(requested.stamps)} requests on topic "
            f"{recording.topics.requested}; expected the same clock and time in both topics",
        )
    stamps, angles, requests = stamps[begun], angles[begun], requested.values[last[begun]]
    try:
        angle_scale = options.scale_of(joint) or scale("rad", None)
    except InvalidInput as error:
        raise InvalidFile(path, str(error)) from error
    columns = Columns(
        times=(stamps - stamps[0]) * 1e-9,
        requests=requests,
        angles=angles,
        request_scale=angle_scale,
        angle_scale=angle_scale,
    )
    notes = (*recording.notes, *_left_out(fresh, begun), _unit(angle_scale.name, options, joint))
    return make_log(source, columns, joint=joint, notes=notes)


def _last_before(series: Series, stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """Place in the series that was the last at each stamp; -1 before its first."""
    order = np.argsort(series.stamps, kind="stable")
    places = np.searchsorted(series.stamps[order], stamps, side="right") - 1
    return np.where(places >= 0, order[places], -1)


def _left_out(fresh: Switch, begun: Switch) -> tuple[str, ...]:
    notes = []
    if not fresh.all():
        notes.append(f"{int((~fresh).sum())} repeated states left out")
    if not begun.all():
        notes.append(f"{int((~begun).sum())} states before the first request left out")
    return tuple(notes)


def _unit(name: str, options: LogOptions, joint: str) -> str:
    said = options.unit_of(joint) is not None
    return f"angles in {name}, as {'--unit said' if said else 'is the custom of ROS (REP 103)'}"
