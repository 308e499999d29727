"""How long each part of an experiment takes."""

from __future__ import annotations

import time
from collections.abc import Callable


class Clock:
    """Adds up the wall-clock time [s] of each part, and reports each part when it begins."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        """A stopped clock; ``progress`` is called with the name of each part."""
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._part: str | None = None
        self._since = 0.0

    def start(self, part: str, doing: str) -> None:
        """End the part before, and begin this one."""
        self.stop()
        self._progress(doing)
        self._part, self._since = part, time.perf_counter()

    def stop(self) -> None:
        """End the part that is under way, if any."""
        if self._part is not None:
            spent = time.perf_counter() - self._since
            self.seconds[self._part] = self.seconds.get(self._part, 0.0) + spent
        self._part = None
