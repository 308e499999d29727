"""How much the command line says, and in which colours: ``--quiet``, ``--verbose``, NO_COLOR."""

from __future__ import annotations

import os
from typing import Any, Literal

import click

Manner = Literal["quiet", "normal", "verbose"]

_KEY = "planner.cli.manner"


def manner() -> Manner:
    """How much is to be said beside the data."""
    context = click.get_current_context(silent=True)
    said: Manner = "normal" if context is None else context.meta.get(_KEY, "normal")
    return said


def coloured() -> bool | None:
    """Whether to use colours; None is where they go to a terminal.

    https://no-color.org and https://force-color.org, of which the first has the last word.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return False if os.environ.get("TERM") == "dumb" else None


def add_to(command: click.Command) -> None:
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
    if context.meta.get(_KEY, asked) != asked:
        raise click.UsageError("--quiet and --verbose contradict each other: leave one out.")
    context.meta[_KEY] = asked
    if asked == "verbose":
        from planner.cli.solver_words import listen

        context.call_on_close(listen())
