"""The files for robots of a run: from their keys to the options of `export`, checked beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from planner.cli.export_options import check_options
from planner.cli.run_words import in_export_keys

if TYPE_CHECKING:
    from planner.cli.wanted import Wanted
    from planner.files.schema import Settings


def exports_of_run(settings: Settings) -> tuple[Mapping[str, Any], ...]:
    """The tables ``[[export]]`` as the options of `export`.

    Raises:
        InvalidFile: Some do not go together.
    """
    return tuple(_options(settings, number, each) for number, each in enumerate(settings["export"]))


def check_exports(settings: Settings, exports: Sequence[Mapping[str, Any]], wanted: Wanted) -> None:
    """Refuse exports that cannot be written, before anything is planned for them.

    Raises:
        InvalidFile: A package is missing, or the format does not take these joints and times.
    """
    from planner.cli.export_rows import check_rows, rows_to_write
    from planner.exceptions import InvalidInput
    from planner.robot.schedule import Schedule

    for number, choices in enumerate(exports):
        like_them = Schedule(wanted.names, wanted.angles, wanted.period)
        try:
            rows, _ = rows_to_write(like_them, choices)
            check_rows(rows, choices)
        except (click.UsageError, InvalidInput) as error:
            raise _fault(settings, number, error) from error


def _options(settings: Settings, number: int, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """An export as the options of `export`, or an error."""
    zero = table["zero_tick"]
    zeros = (table["zero_ticks"] or {}).items()
    names = table["joint_names"]
    choices = {
        **table,
        "joint_names": None if names is None else ",".join(names),
        "velocities": bool(table["velocities"]),
        "zero_tick": (
            *(() if zero is None else (str(zero),)),
            *(f"{joint}={tick}" for joint, tick in zeros),
        ),
    }
    try:
        check_options(choices, table["file"])
    except click.UsageError as error:
        raise _fault(settings, number, error) from error
    return choices


def _fault(settings: Settings, number: int, error: Exception) -> Exception:
    said = error.message if isinstance(error, click.UsageError) else str(error)
    return settings.fault(f"export[{number}]", in_export_keys(said).rstrip("."))
