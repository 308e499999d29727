"""Parts of the benchmark, each a module whose ``measure`` makes tables of options."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple


class Options(NamedTuple):
    """How much is measured."""

    instances: int = 20  # random ones of each kind
    repeats: int = 5  # calls of which the median time is taken
    samples: int = 88  # of the random instances
    lengths: tuple[int, ...] = (88, 880, 8800)  # of the long trajectories
    fit_lengths: tuple[int, ...] = (88, 10_000, 100_000)  # of those that are approximated
    exact: float = 0.0  # seconds for each exact bound; 0 for none


def recordings() -> Path | None:
    """The folder with recordings of real servos, where it is at hand."""
    folder = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    return Path(folder) if folder and Path(folder).is_dir() else None
