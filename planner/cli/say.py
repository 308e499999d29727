"""How commands speak: results on standard output, everything about them on standard error."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

from planner.cli.progress import Progress, detail, print_line
from planner.cli.verbosity import verbosity
from planner.exceptions import PlannerError, printable

__all__ = [
    "Progress",
    "complain",
    "deliver",
    "detail",
    "naming",
    "print_json",
    "remark",
    "summarise",
    "to_json",
    "warn",
]


def print_json(content: Mapping[str, Any]) -> None:
    """Print a JSON document on standard output."""
    from planner.files.text import STANDARD_STREAM, write_text

    write_text(STANDARD_STREAM, to_json(content))


def to_json(content: Mapping[str, Any]) -> str:
    """JSON text; numbers that are not finite, which JSON has not, become null."""
    return json.dumps(_finite(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def summarise(text: str) -> None:
    """Print a summary on standard error, out of the way of the data; the first line stands out."""
    if verbosity() == "quiet":
        return
    first, newline, rest = text.partition("\n")
    print_line(click.style(first, bold=True) + newline + rest)


def complain(message: str) -> None:
    """Say in one line on standard error why there is no answer, or none to be trusted."""
    line = printable(" ".join(message.split()))
    print_line(f"{click.style('request-planner:', fg='red', bold=True)} {line}")


def warn(message: str) -> None:
    """Say in one line on standard error what to beware of."""
    print_line(f"request-planner: {click.style('warning:', fg='yellow')} {message}")


def remark(message: str) -> None:
    """Say in one line on standard error what is good to know."""
    if verbosity() != "quiet":
        print_line(f"request-planner: {message}")


@contextmanager
def naming(joint: str) -> Iterator[None]:
    """Note on an error of ours that is raised within which joint it is about."""
    try:
        yield
    except PlannerError as error:
        error.add_note(joint)
        raise


def deliver(
    document: Mapping[str, Any],
    summary: str,
    write: Callable[[str], None],
    *,
    output: str,
    as_json: bool,
) -> None:
    """Hand over a command's answer.

    Args:
        document: The answer for machines.
        summary: The answer in a few words for people, for standard error.
        write: Writes the CSV to the file that it is given.
        output: That file; ``-`` is standard output, which JSON takes for itself.
        as_json: Whether a machine is asking.
    """
    if not as_json or output != "-":
        write(output)
    if as_json:
        print_json(document)
    else:
        summarise(summary)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
