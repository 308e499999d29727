"""Recordings to replay: one file, or one episode of a dataset, each read by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from planner.exceptions import InvalidInput
from planner.files.logs.lerobot import EpisodeFile, lerobot_episodes
from planner.files.logs.options import ALL_JOINTS, LogOptions
from planner.files.logs.read import LEROBOT, format_of, read_logs
from planner.identification.log import Log


@dataclass(frozen=True)
class Recording:
    """Where a recording is, so that another process can read it.

    Attributes:
        path: The file that holds it; of a bag the folder.
        options: How to read it; the episode of a dataset among them.
        dataset: Its dataset, as the user named it; "" where it has none.
        episode: Its number in the dataset; None where it has none.
        folder: Base of a relative path, for a process that works elsewhere.
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
        """Its logs, one for each joint.

        Raises:
            InvalidFile: It cannot be read.
        """
        return read_logs(self._file, options=self.options)

    @property
    def _file(self) -> str:
        return str(Path(self.folder, self.path)) if self.folder else self.path


def recordings_in(paths: Sequence[str], options: LogOptions) -> tuple[Recording, ...]:
    """The recordings that files hold, in order; of datasets the chosen episodes.

    Args:
        paths: Paths as for :func:`planner.read_logs`.
        options: How to read it. All joints are read, whatever joint they name.

    Raises:
        InvalidInput: A path holds no log, or options do not fit it.
        MissingExtra: The format needs a package that is not installed.
    """
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
