"""Output of the command line: results on standard output, messages on standard error.

Errors in settings name keys of a run file or options, as the user wrote them.
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import click

from planner.exceptions import InvalidFile, InvalidInput, PlannerError, in_degrees, printable
from planner.files.staging import staged
from planner.files.text import (
    STANDARD_STREAM,
    Place,
    Toml,
    key_name,
    place_of,
    to_json,
    toml_value,
    write_text,
)

if TYPE_CHECKING:
    from planner.report.page import Page, Written

KEY = "planner.cli.verbosity"  # key of the verbosity in the command's context
BAR, WIDTH = 24, 80  # characters of the bar, and of a line of a terminal of unknown width

REDRAWN, REPEATED, BRIEF = 0.5, 30.0, 2.0
"""Time after which the line is drawn again on a terminal, and printed again elsewhere, and from
which on an estimate is shown [s]."""

_ERASE = "\r\x1b[K"


def summarise(text: str) -> None:
    """Print a summary on standard error, out of the way of the data; the first line stands out."""
    if verbosity() == "quiet":
        return
    escaped = "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)
    first, newline, rest = escaped.partition("\n")
    print_line(click.style(first, bold=True) + newline + rest)


def _print_notice(message: str, label: str = "", *, in_quiet: bool = True, **style: Any) -> None:
    """Print a message in one line on standard error; on a terminal it is wrapped between words."""
    if verbosity() == "quiet" and not in_quiet:
        return
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


complain = partial(_print_notice, fg="red", bold=True)
"""Print an error in one line on standard error."""

warn = partial(_print_notice, label="warning:", fg="yellow")
"""Print a warning in one line on standard error."""

remark = partial(_print_notice, in_quiet=False)
"""Print a remark in one line on standard error, but for ``--quiet``."""


class Answer(NamedTuple):
    """What a command returns: its answer for machines and in a few words, and files to write."""

    document: Mapping[str, Any]
    summary: str
    write: Callable[[str], None] | None = None  # writes the output, whose name it takes
    page: Callable[[], Page] | None = None  # the report
    origins: Iterable[tuple[str, str]] = ()  # what it says that it comes from, by name
    linked: Written = ()  # files to which it links
    files: Sequence[tuple[str | None, str]] = ()  # other files, by name, and their text
    warnings: Sequence[str] = ()  # said after the summary
    failure: str = ""  # why the exit status is not 0
    status: int = 1  # the exit status of a failure

    def deliver(self, output: str, report: str | None, *, as_json: bool) -> None:
        """Write all files or none, and print; as ``output``, ``-`` is taken by JSON alone."""
        texts = [(name, text) for name, text in self.files if name is not None]
        if report is not None and self.page is not None:
            with Progress() as progress:
                progress("the page")
                texts.append((report, self.page().html(report, self.origins, self.linked)))
        with ExitStack() as files:
            for name, text in texts:
                if name != STANDARD_STREAM:
                    files.enter_context(staged(name, text.encode()))
            if self.write is not None and (not as_json or output != STANDARD_STREAM):
                self.write(output)
        for name, text in texts:
            if name == STANDARD_STREAM:
                write_text(name, text)
        if as_json:
            write_text(STANDARD_STREAM, to_json(self.document))
        elif self.summary:
            summarise(self.summary)
        for words in self.warnings:
            warn(words)
        if self.failure:
            failure: Any = click.ClickException(self.failure)
            failure.exit_code = self.status
            raise failure


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


def verbosity() -> str:
    """How much to print beside the data: quiet, normal or verbose."""
    context = click.get_current_context(silent=True)
    level: str = "normal" if context is None else context.meta.get(KEY, "normal")
    return level


def coloured() -> bool | None:
    """Whether to use colours, by no-color.org, then force-color.org; None leaves it to click."""
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
        names = [f"-{option[0]}", f"--{option}"]
        flag = click.Option(names, is_flag=True, expose_value=False, callback=_settle, help=about)
        command.params.append(flag)


def _settle(context: click.Context, option: click.Parameter, value: Any) -> None:
    if not value:
        return
    level = option.name
    if context.meta.get(KEY, level) != level:
        raise click.UsageError("--quiet and --verbose contradict each other: leave one out.")
    context.meta[KEY] = level
    # the library's log, such as solvers' reports; or no word about compilation
    log = logging.getLogger("planner" if level == "verbose" else "planner.compilation")
    context.call_on_close(partial(log.setLevel, log.level))
    log.setLevel(logging.DEBUG if level == "verbose" else logging.ERROR)
    if level == "verbose":
        handler = logging.Handler()
        handler.emit = lambda record: detail(record.getMessage())  # type: ignore[method-assign]
        log.addHandler(handler)
        context.call_on_close(partial(log.removeHandler, handler))


class Progress:
    """The progress of long work: a line on a terminal, and with ``--verbose`` one after each step.

    A thread draws the line again during a long step; where there is no terminal, it prints a line
    every half minute. With a ``count`` of steps there are a bar and a remaining time. Of
    ``parallel`` steps each is reported when it is finished.
    """

    current: Progress | None = None
    """The progress that is shown: the innermost of nested ones."""

    def __init__(
        self, count: int = 0, *, parallel: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._shown = verbosity() != "quiet"
        self._drawn = self._shown and sys.stderr is not None and sys.stderr.isatty()
        self._count, self._finished, self._parallel = count, 0, parallel
        self._step = "the first" if parallel else ""  # of which none is finished yet
        self._time = clock
        self._began = self._last = clock()  # of the work, and of the step
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep_time, daemon=True)

    def __enter__(self) -> Progress:
        self._outer = Progress.current
        if self._shown:
            Progress.current = self
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._begin("")
        self._ended.set()
        if self._shown:
            self._thread.join()
            Progress.current = self._outer
            self.erase()

    def __call__(self, step: str) -> None:
        """Begin a step; the step before it is finished."""
        self._begin(step)
        if self._drawn and not self._parallel:  # whose line the thread draws
            self._draw()

    def erase(self) -> None:
        """Erase the line, for other output; it is drawn again later."""
        if self._drawn:
            click.echo(_ERASE, sys.stderr, nl=False, err=True, color=True)

    def line(self, *, bar: bool = True) -> str:
        """The text of the line now, with a bar or with numbers."""
        now, finished, share = self._time(), self._finished, ""
        spent = now - self._began
        step = f"{finished} of {self._count}" if self._parallel else self._step
        for_long = _duration(spent) if spent >= BRIEF else ""
        if self._count and finished and for_long:  # at the pace up to the last step's end
            whole = (self._last - self._began) * self._count / finished
            for_long = f"{_duration(whole - spent)} left"
        if self._count and bar:
            share = ("█" * (BAR * finished // self._count)).ljust(BAR, "░")
        elif self._count and not self._parallel:
            share = f"{finished} of {self._count}"
        return "  ".join(filter(None, (f"{step} …", share, for_long)))

    def _begin(self, step: str) -> None:
        now = self._time()
        if self._step:
            self._finished += 1
            if not self._parallel:
                detail(f"{self._step}: {now - self._last:.3g} s")
        self._step, self._last = step, now

    def _draw(self) -> None:
        width = shutil.get_terminal_size().columns - 1
        text = printable(self.line())[:width]
        click.echo(f"{_ERASE}{text}", sys.stderr, nl=False, err=True, color=True)

    def _keep_time(self) -> None:
        while not self._ended.wait(REDRAWN if self._drawn else REPEATED):
            if not self._step or Progress.current is not self:
                continue
            if self._drawn:
                self._draw()
            else:
                print_line(f"request-planner: {printable(self.line(bar=False))}")


def _duration(seconds: float) -> str:
    """A duration in two or three digits."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes / 60.0:.1f} h"


# Settings in messages, between ‹ and ›: ‹plan.cyclic = false›.


MARKED = re.compile("‹(.*?)›")


def in_keys(text: str) -> str:
    """A message with its settings as a run file has them: ``plan.cyclic = false``."""
    return MARKED.sub(r"\1", text)


def marked(place: str | Place, value: str | None = None) -> str:
    """A setting in a message, by its name or the keys and numbers that lead to it."""
    name = place if isinstance(place, str) else key_name(place)
    return f"‹{name}›" if value is None else f"‹{name} = {toml_value(value)}›"


class SettingsError(PlannerError):
    """A message that names settings, which is spelt with keys of a run file, or with options."""

    def __str__(self) -> str:
        return in_keys(super().__str__())


class BadSetting(SettingsError, InvalidInput):
    """Settings that contradict each other, or the files that they name."""


ADVICE = {
    "; if this is in degrees, convert it with numpy.radians": "",
    "; if these are degrees, convert them with numpy.radians": "; check the unit of its column",
    "unreachable='nearest'": '‹leg.unreachable = "nearest"›',
    "cyclic=False": "‹plan.cyclic = false›",
    "forward, sideways and hip_height": "‹path.half_ellipse.forward›, "
    "‹path.half_ellipse.sideways› and ‹path.half_ellipse.hip_height›",
}
"""Arguments that messages of the library advise, as settings."""


def advised(error: PlannerError, spelt: Callable[[str], str] = in_keys) -> str:
    """The message of the library's error, with settings in place of arguments that it advises."""
    message = in_degrees(error)
    for argument, setting in ADVICE.items():
        message = message.replace(argument, spelt(setting))
    return message


@contextmanager
def speaking_of(file: Toml) -> Iterator[None]:
    """Let errors in settings inside the block name keys and lines of a file."""
    try:
        yield
    except BadSetting as error:
        names = (name.partition(" = ")[0] for name in MARKED.findall(error.args[0]))
        lines = (file.line_of(place_of(name)) for name in names)
        line = next((line for line in lines if line is not None), None)
        raise InvalidFile(file.path, str(error), line=line) from error
    except PlannerError as error:
        error.args = (advised(error),)
        raise
