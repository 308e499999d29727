"""How long each part of an experiment takes, told as it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable


class Clock:
    """Adds up the time that each part takes, and tells what is being done."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        """A clock at rest; ``progress`` is told what is being done."""
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
