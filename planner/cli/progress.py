"""One line on a terminal that says what is being done, how far it is, and how long it takes."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Iterable, Mapping

import click

from planner.cli.manner import manner

BAR = 24
"""Characters of the bar."""

BEAT = 0.5
"""Time between two looks at the clock [s]."""

SOON = 2.0
"""Work that has taken less than this [s] is not worth an estimate."""

_ERASE = "\r\x1b[K"


class Progress:
    """What long work tells of itself: on a terminal as it goes, with ``--verbose`` at each end.

    A thread keeps the clock of a long step going; where nobody is watching, there is none.
    """

    shown: Progress | None = None
    """The one whose line is on the terminal: of work inside other work, the inner one's."""

    def __init__(self, expected: Mapping[str, float] | Iterable[str] = ()) -> None:
        """Look whether anybody is watching.

        Args:
            expected: The steps that are to come, in order, and how long each takes in proportion to
                the others; all take equally long where that is not said. Without steps there is no
                bar, and no time left.
        """
        self._expected = (
            dict(expected) if isinstance(expected, Mapping) else dict.fromkeys(expected, 1.0)
        )
        self._verbose = manner() == "verbose"
        self._watched = sys.stderr.isatty() and manner() != "quiet"
        self._doing = ""
        self._done: list[str] = []
        self._began = self._step_began = time.monotonic()
        self._ended = threading.Event()
        self._clock: threading.Thread | None = None
        self._around: Progress | None = None

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.done()

    def __call__(self, doing: str) -> None:
        """Say what is being done; what was being done before is finished."""
        self._finish_step()
        self._doing = doing
        if not self._watched:
            return
        if self._clock is None:
            self._around = Progress.shown
        Progress.shown = self
        self._draw()
        if self._clock is None:
            self._clock = threading.Thread(target=self._keep_time, daemon=True)
            self._clock.start()

    def done(self) -> None:
        """Clear the line."""
        self._finish_step()
        self._ended.set()
        if self._clock is not None:
            self._clock.join()
            self._clock = None
        if Progress.shown is self:
            Progress.shown = self._around
            self.erase()

    def erase(self) -> None:
        """Make room for a line of another kind; the next beat draws this one again."""
        click.echo(_ERASE, nl=False, err=True, color=True)

    def line(self, now: float) -> str:
        """The line at a time of the monotonic clock [s]."""
        if not self._expected or self._doing not in self._expected:
            return f"{self._doing} …{_spent(now - self._began)}"
        total = sum(self._expected.values())
        done = sum(self._expected.get(name, 0.0) for name in self._done)
        filled = int(BAR * done / total) if total else 0
        bar = "█" * filled + "░" * (BAR - filled)
        return f"{self._doing} …  {bar}{self._left(done, total, now)}"

    def _left(self, done: float, total: float, now: float) -> str:
        """How long it still takes, at the pace of the steps that are done."""
        spent = self._step_began - self._began
        if done <= 0.0 or now - self._began < SOON:
            return _spent(now - self._began)
        left = (total - done) * spent / done - (now - self._step_began)
        return f"  {_duration(left)} left" if left > 0.0 else _spent(now - self._began)

    def _finish_step(self) -> None:
        now = time.monotonic()
        if self._doing:
            self._done.append(self._doing)
            if self._verbose:
                from planner.cli.say import detail

                detail(f"{self._doing}: {now - self._step_began:.3g} s")
        self._doing = ""
        self._step_began = now

    def _draw(self) -> None:
        width = shutil.get_terminal_size().columns - 1
        text = self.line(time.monotonic())[:width]
        click.echo(f"{_ERASE}{text}", nl=False, err=True, color=True)

    def _keep_time(self) -> None:
        while not self._ended.wait(BEAT):
            if self._doing and Progress.shown is self:
                self._draw()


def _spent(seconds: float) -> str:
    return f"  {_duration(seconds)}" if seconds >= SOON else ""


def _duration(seconds: float) -> str:
    """A duration, as exact as anybody wants to know it while waiting."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes / 60.0:.1f} h"
