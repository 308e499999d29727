"""What a LeRobot dataset says of itself: its files and the names of its joints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.exceptions import InvalidFile
from planner.files.logs.bam import parse_json

ACTION, STATE = "action", "observation.state"
"""Features that hold the requested and the actual angles."""

INFO = Path("meta", "info.json")
"""Where a dataset describes itself."""

VERSIONS = ("v2.0", "v2.1", "v3.0")
"""Versions whose layout is known."""

PREFIX, SUFFIX = "main_", ".pos"
"""What LeRobot puts around the names of joints."""

_EPISODE = re.compile(r"episode_(\d+)\.parquet", re.ASCII)


@dataclass(frozen=True)
class Dataset:
    """A dataset as its meta/info.json describes it.

    Attributes:
        root: The folder that holds ``meta`` and ``data``.
        names: Names of the columns of ``action`` and of ``observation.state``; None where a
            feature does not name its joints.
    """

    root: Path
    names: Mapping[str, tuple[str, ...] | None]

    def files(self, episodes: frozenset[int] | None) -> tuple[Path, ...]:
        """Its Parquet files, but for those whose name says that no wanted episode is in them.

        Raises:
            InvalidFile: There is none.
        """
        every = sorted(self.root.glob("data/chunk-*/*.parquet"))
        if not every:
            raise InvalidFile(self.root, "no data/chunk-*/*.parquet; download the dataset's data")
        return tuple(file for file in every if episodes is None or _may_hold(file, episodes))

    def episodes_named(self) -> frozenset[int]:
        """The episodes that files are named after; v3 names no file so."""
        matches = (_EPISODE.fullmatch(file.name) for file in self.files(None))
        return frozenset(int(match[1]) for match in matches if match is not None)


def is_dataset(path: Path) -> bool:
    """Whether a folder is a LeRobot dataset."""
    return (path / INFO).is_file()


def find_dataset(path: Path) -> Dataset:
    """The dataset that a folder is, or that a Parquet file is a part of.

    Raises:
        InvalidFile: No description beside the file, or one that cannot be understood.
    """
    if not path.exists():
        raise InvalidFile(path, "no such file; check the name and the folder")
    places = [path] if path.is_dir() else list(path.absolute().parents)[:3]
    root = next((place for place in places if is_dataset(place)), None)
    if root is None:
        raise InvalidFile(
            path,
            "no meta/info.json, which names the joints, in the folders above; keep the file in "
            "its LeRobot dataset, or give the log as CSV",
        )
    info = parse_json(root / INFO)
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version not in VERSIONS:
        raise InvalidFile(
            root / INFO,
            f"codebase_version: got {version!r:.20}, expected one of {', '.join(VERSIONS)}; "
            "convert the dataset with LeRobot's own scripts",
        )
    features = info.get("features")
    names: dict[str, tuple[str, ...] | None] = {}
    for key in (ACTION, STATE):
        feature = features.get(key) if isinstance(features, dict) else None
        if not isinstance(feature, dict):
            known = ", ".join(features) if isinstance(features, dict) else "none"
            raise InvalidFile(root / INFO, f"no feature '{key}'; features: {known}")
        flat = tuple(_flat(feature.get("names")))
        shape = feature.get("shape", [len(flat)])
        # some datasets name the axis ("motors") and not the joints on it
        names[key] = tuple(plain_names(flat)) if flat and shape == [len(flat)] else None
    return Dataset(root, names)


def plain_names(names: tuple[str, ...]) -> list[str]:
    """Names of joints without what LeRobot puts around them, where they stay apart."""
    plain = [name.removesuffix(SUFFIX).removeprefix(PREFIX) for name in names]
    return plain if len(set(plain)) == len(plain) and all(plain) else list(names)


def _flat(names: Any) -> Iterable[str]:
    """Names in a list, in lists within, or in an object ({"motors": [...]} or name: place)."""
    if isinstance(names, str):
        yield names
    elif isinstance(names, list):
        for item in names:
            yield from _flat(item)
    elif isinstance(names, dict):
        if names and all(isinstance(place, int) for place in names.values()):
            yield from sorted(names, key=lambda name: names[name])
        else:
            for item in names.values():
                yield from _flat(item)


def _may_hold(file: Path, episodes: frozenset[int]) -> bool:
    match = _EPISODE.fullmatch(file.name)
    return match is None or int(match[1]) in episodes
