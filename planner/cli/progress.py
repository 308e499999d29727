"""One line on a terminal that says what is being done, how far it is, and how long it takes."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping

import click

from planner.cli.verbosity import coloured, verbosity

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

    def __init__(
        self,
        expected: Mapping[str, float] | Iterable[str] = (),
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Look whether anybody is watching.

        Args:
            expected: The steps that are to come, in order, and how long each takes in proportion to
                the others; all take equally long where that is not said. Without steps there is no
                bar, and no time left.
            clock: Tells the time [s].
        """
        self._expected = (
            dict(expected) if isinstance(expected, Mapping) else dict.fromkeys(expected, 1.0)
        )
        self._verbose = verbosity() == "verbose"
        watched = sys.stderr is not None and sys.stderr.isatty()
        self._watched = watched and verbosity() != "quiet"
        self._doing = ""
        self._done: list[str] = []
        self._time = clock
        self._began = self._step_began = self._time()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
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
        if self._thread is None:
            self._around = Progress.shown
        Progress.shown = self
        self._draw()
        if self._thread is None:
            self._thread = threading.Thread(target=self._keep_time, daemon=True)
            self._thread.start()

    def done(self) -> None:
        """Clear the line."""
        self._finish_step()
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if Progress.shown is self:
            Progress.shown = self._around
            self.erase()

    def erase(self) -> None:
        """Make room for a line of another kind; the next beat draws this one again."""
        click.echo(_ERASE, nl=False, err=True, color=True)

    def line(self) -> str:
        """What the line says now."""
        now = self._time()
        if not self._expected or self._doing not in self._expected:
            return f"{self._doing} …{_spent(now - self._began)}"
        total = sum(self._expected.values())
        done = sum(self._expected.get(name, 0.0) for name in self._done)
        left = self._left(total, done, now)
        share = done / total if left is None else (now - self._began) / (now - self._began + left)
        bar = ("█" * int(BAR * share)).ljust(BAR, "░")
        if not left or now - self._began < SOON:
            return f"{self._doing} …  {bar}{_spent(now - self._began)}"
        return f"{self._doing} …  {bar}  {_duration(left)} left"

    def _left(self, total: float, done: float, now: float) -> float | None:
        """How long it still takes at the pace of the steps that are done [s]; None without any."""
        spent = self._step_began - self._began
        if done <= 0.0 or spent <= 0.0:
            return None
        pace = spent / done
        now_of_step = min((now - self._step_began) / pace, self._expected[self._doing])
        return (total - done - now_of_step) * pace

    def _finish_step(self) -> None:
        now = self._time()
        if self._doing:
            self._done.append(self._doing)
            if self._verbose:
                detail(f"{self._doing}: {now - self._step_began:.3g} s")
        self._doing = ""
        self._step_began = now

    def _draw(self) -> None:
        width = shutil.get_terminal_size().columns - 1
        text = self.line()[:width]
        click.echo(f"{_ERASE}{text}", nl=False, err=True, color=True)

    def _keep_time(self) -> None:
        while not self._ended.wait(BEAT):
            if self._doing and Progress.shown is self:
                self._draw()


def detail(message: str) -> None:
    """Say on standard error what only ``--verbose`` asks for."""
    if verbosity() == "verbose":
        print_line(click.style(f"request-planner: {message}", dim=True))


def print_line(text: str) -> None:
    """A line on standard error, where no progress is shown meanwhile."""
    if Progress.shown is not None:
        Progress.shown.erase()
    click.echo(text, err=True, color=coloured())


def _spent(seconds: float) -> str:
    return f"  {_duration(seconds)}" if seconds >= SOON else ""


def _duration(seconds: float) -> str:
    """A duration, as exact as anybody wants to know it while waiting."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes / 60.0:.1f} h"
