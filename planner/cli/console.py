"""Output of the command line: results on standard output, messages on standard error.

``--quiet``, ``--verbose``, NO_COLOR and FORCE_COLOR set how much, and the colours; on a terminal a
line shows the progress of long work.
"""

from __future__ import annotations

import logging
import os
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Literal, TextIO

import click

from kinematics.exceptions import printable
from planner.files.text import STANDARD_STREAM, to_json, write_text

Verbosity = Literal["quiet", "normal", "verbose"]

KEY = "planner.cli.verbosity"
"""Key of the verbosity in the command's context."""

BAR = 24
"""Characters of the bar."""

REDRAWN = 0.5
"""Time after which the line is drawn again [s]."""

BRIEF = 2.0
"""Shortest running time for which an estimate is shown [s]."""

WIDTH = 80
"""Characters of a line of a terminal of unknown width."""

_ERASE = "\r\x1b[K"


def print_json(content: Mapping[str, Any]) -> None:
    """Print a JSON document on standard output."""
    write_text(STANDARD_STREAM, to_json(content))


def summarise(text: str) -> None:
    """Print a summary on standard error, out of the way of the data; the first line stands out."""
    if verbosity() == "quiet":
        return
    escaped = "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)
    first, newline, rest = escaped.partition("\n")
    print_line(click.style(first, bold=True) + newline + rest)


def complain(message: str) -> None:
    """Print an error in one line on standard error."""
    _print_notice(message, fg="red", bold=True)


def warn(message: str) -> None:
    """Print a warning in one line on standard error."""
    _print_notice(message, "warning:", fg="yellow")


def remark(message: str) -> None:
    """Print a remark in one line on standard error."""
    if verbosity() != "quiet":
        _print_notice(message)


def _print_notice(message: str, label: str = "", **style: Any) -> None:
    """Print a message in one line; on a terminal it is wrapped between words."""
    opening = f"request-planner: {label}".strip()
    text = f"{opening} {printable(' '.join(message.split()))}"
    if sys.stderr is not None and sys.stderr.isatty():
        text = textwrap.fill(
            text,
            terminal_width(sys.stderr) or WIDTH,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    styled = label or opening
    print_line(text.replace(styled, click.style(styled, **style), 1) if style else text)


def deliver(
    document: Mapping[str, Any],
    summary: str,
    write: Callable[[str], None],
    *,
    output: str,
    as_json: bool,
) -> None:
    """Write and print a command's answer.

    Args:
        document: The answer for machines.
        summary: The answer in a few words for people, for standard error.
        write: Writes the CSV to a file.
        output: That file; ``-`` is standard output, which JSON takes for itself.
        as_json: Whether to print JSON.
    """
    if not as_json or output != "-":
        write(output)
    print_answer(document, summary, as_json=as_json)


def print_answer(document: Mapping[str, Any], summary: str, *, as_json: bool) -> None:
    """Print an answer as JSON, or in a few words."""
    if as_json:
        print_json(document)
    else:
        summarise(summary)


def detail(message: str) -> None:
    """Print a message of ``--verbose`` on standard error."""
    if verbosity() == "verbose":
        print_line(click.style(f"request-planner: {printable(message)}", dim=True))


def print_line(text: str) -> None:
    """Print a line on standard error; the progress line is erased first."""
    if Progress.current is not None:
        Progress.current.erase()
    click.echo(text, sys.stderr, err=True, color=coloured())  # click's own would be UTF-8


def terminal_width(stream: TextIO | None) -> int | None:
    """Characters of a line: COLUMNS, or the terminal's; None where a stream goes elsewhere."""
    with suppress(KeyError, ValueError):
        columns = int(os.environ["COLUMNS"])
        if columns > 0:
            return columns
    if stream is None or not stream.isatty():
        return None
    with suppress(OSError, ValueError):
        return os.get_terminal_size(stream.fileno()).columns or WIDTH
    return WIDTH


def verbosity() -> Verbosity:
    """How much to print beside the data."""
    context = click.get_current_context(silent=True)
    level: Verbosity = "normal" if context is None else context.meta.get(KEY, "normal")
    return level


def coloured() -> bool | None:
    """Whether to use colours; None leaves it to click, which uses them on a terminal.

    https://no-color.org and https://force-color.org, of which the first overrules the second.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return False if os.environ.get("TERM") == "dumb" else None


def add_verbosity(command: click.Command) -> None:
    """Add ``--quiet`` and ``--verbose`` to a command; both work before and after its name."""
    if any(parameter.name == "quiet" for parameter in command.params):
        return
    for option, about in (
        ("quiet", "Print nothing but data, warnings and errors."),
        ("verbose", "Print the duration of each step and the reports of the solvers."),
    ):
        command.params.append(
            click.Option(
                [f"-{option[0]}", f"--{option}"],
                is_flag=True,
                expose_value=False,
                callback=_settle,
                help=about,
            )
        )


def _settle(context: click.Context, option: click.Parameter, value: Any) -> None:
    if not value:
        return
    level = option.name
    if context.meta.get(KEY, level) != level:
        raise click.UsageError("--quiet and --verbose contradict each other: leave one out.")
    context.meta[KEY] = level
    if level == "verbose":
        context.call_on_close(print_log())
    if level == "quiet":
        compilation = logging.getLogger("planner.compilation")
        context.call_on_close(partial(compilation.setLevel, compilation.level))
        compilation.setLevel(logging.ERROR)


def print_log() -> Callable[[], None]:
    """Print the library's log, such as solvers' reports, until the returned function is called."""
    log = logging.getLogger("planner")
    before, handler = log.level, _Printing()
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)

    def end() -> None:
        log.removeHandler(handler)
        log.setLevel(before)

    return end


class _Printing(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        detail(record.getMessage())


class Progress:
    """The progress of long work: a line on a terminal, and with ``--verbose`` one after each step.

    A thread draws the line again during a long step; without a terminal there is none.
    """

    current: Progress | None = None
    """The progress whose line is on the terminal: the innermost of nested ones."""

    def __init__(
        self,
        expected: Mapping[str, float] | Iterable[str] = (),
        *,
        count: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Find out whether standard error is a terminal.

        Args:
            expected: The steps, in order, with relative durations; by default all take equally
                long. Without steps there is no bar and no remaining time.
            count: Instead, the number of steps, for many steps in parallel: each is reported
                when it is finished, and the line is drawn twice a second.
            clock: Returns the time [s].
        """
        self._expected = (
            dict(expected) if isinstance(expected, Mapping) else dict.fromkeys(expected, 1.0)
        )
        on_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._visible = on_terminal and verbosity() != "quiet"
        self._step = ""
        self._finished_steps: list[str] = []
        self._count, self._counted = count, 0
        self._time = clock
        self._began = self._step_began = self._time()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._outer: Progress | None = None

    def __enter__(self) -> Progress:
        if self._count:
            self._counted = -1
            self("the first")  # no step is finished yet
        return self

    def __exit__(self, *_: object) -> None:
        self.done()

    def __call__(self, step: str) -> None:
        """Begin a step; the step before it is finished."""
        if self._count:
            self._counted += 1
            if self._thread is not None:
                return  # the thread draws the line
        else:
            self._finish_step()
        self._step = step
        if not self._visible:
            return
        if self._thread is None:
            self._outer = Progress.current
        Progress.current = self
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
        if Progress.current is self:
            Progress.current = self._outer
            self.erase()

    def erase(self) -> None:
        """Erase the line, for other output; it is drawn again later."""
        click.echo(_ERASE, sys.stderr, nl=False, err=True, color=True)

    def line(self) -> str:
        """The text of the line now."""
        now = self._time()
        if self._count:
            spent, finished = now - self._began, self._counted
            bar = ("█" * (BAR * finished // self._count)).ljust(BAR, "░")
            estimated = finished > 0 and spent >= BRIEF
            ending = (
                f"  {_duration(spent * (self._count / finished - 1.0))} left" if estimated else ""
            )
            return f"{finished} of {self._count} …  {bar}{ending}"
        if not self._expected or self._step not in self._expected:
            return f"{self._step} …{_spent(now - self._began)}"
        total = sum(self._expected.values())
        done = sum(self._expected.get(name, 0.0) for name in self._finished_steps)
        remaining = self._remaining(total, done, now)
        share = (
            done / total
            if remaining is None
            else (now - self._began) / (now - self._began + remaining)
        )
        bar = ("█" * int(BAR * share)).ljust(BAR, "░")
        if not remaining or now - self._began < BRIEF:
            return f"{self._step} …  {bar}{_spent(now - self._began)}"
        return f"{self._step} …  {bar}  {_duration(remaining)} left"

    def _remaining(self, total: float, done: float, now: float) -> float | None:
        """Estimated remaining time by the pace of the finished steps [s]; None before the first."""
        spent = self._step_began - self._began
        if done <= 0.0 or spent <= 0.0:
            return None
        pace = spent / done
        now_of_step = min((now - self._step_began) / pace, self._expected[self._step])
        return (total - done - now_of_step) * pace

    def _finish_step(self) -> None:
        now = self._time()
        if self._step:
            self._finished_steps.append(self._step)
            detail(f"{self._step}: {now - self._step_began:.3g} s")
        self._step = ""
        self._step_began = now

    def _draw(self) -> None:
        width = shutil.get_terminal_size().columns - 1
        text = printable(self.line())[:width]
        click.echo(f"{_ERASE}{text}", sys.stderr, nl=False, err=True, color=True)

    def _keep_time(self) -> None:
        while not self._ended.wait(REDRAWN):
            if self._step and Progress.current is self:
                self._draw()


def _spent(seconds: float) -> str:
    return f"  {_duration(seconds)}" if seconds >= BRIEF else ""


def _duration(seconds: float) -> str:
    """A duration in two or three digits."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes / 60.0:.1f} h"
