"""How much the command line says, and in which colours: what the options and NO_COLOR ask for."""

from __future__ import annotations

import os
from typing import Literal

import click

Verbosity = Literal["quiet", "normal", "verbose"]

KEY = "planner.cli.verbosity"
"""Where the command's context keeps it."""


def verbosity() -> Verbosity:
    """How much is to be said beside the data."""
    context = click.get_current_context(silent=True)
    asked: Verbosity = "normal" if context is None else context.meta.get(KEY, "normal")
    return asked


def coloured() -> bool | None:
    """Whether to use colours; None is where they go to a terminal.

    https://no-color.org and https://force-color.org, of which the first has the last word.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return False if os.environ.get("TERM") == "dumb" else None
