"""The options ``--quiet`` and ``--verbose``, and the library's log on standard error."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import click

from planner.cli.progress import detail
from planner.cli.verbosity import KEY


def add_verbosity(command: click.Command) -> None:
    """Let a command take ``--quiet`` and ``--verbose``, wherever they are given."""
    if any(parameter.name == "quiet" for parameter in command.params):
        return
    for option, about in (
        ("quiet", "Say nothing beside the data but warnings and errors."),
        ("verbose", "Say how long each step took, and what the solvers report."),
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
    asked = option.name
    if context.meta.get(KEY, asked) != asked:
        raise click.UsageError("--quiet and --verbose contradict each other: leave one out.")
    context.meta[KEY] = asked
    if asked == "verbose":
        context.call_on_close(print_log())


def print_log() -> Callable[[], None]:
    """Begin to print what the library logs, the solvers' reports; the answer ends it."""
    log = logging.getLogger("planner")
    before, handler = log.level, _Printing()
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)

    def end() -> None:
        log.removeHandler(handler)
        log.setLevel(before)

    return end


class _Printing(logging.Handler):
    """Prints every entry of the log in a line."""

    def emit(self, record: logging.LogRecord) -> None:
        detail(record.getMessage())
