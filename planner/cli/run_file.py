"""A run file: read with all that it names, checked before anything is computed, and carried out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from planner.cli import settings
from planner.cli.answer import document, plan_report
from planner.cli.console import BadSetting, FailedCheck, Key, as_key
from planner.cli.declared import flat, understand
from planner.cli.desired import Desired, check_angles
from planner.cli.export import (
    check_export,
    check_rows,
    rows_document,
    rows_of,
    rows_summary,
    write_rows,
)
from planner.cli.planning import misses, prepare
from planner.exceptions import InvalidFile, InvalidInput, PlannerError
from planner.files.paths import write_foot_path
from planner.files.staging import MANIFEST, list_files
from planner.files.text import Toml, read_toml, to_json, write_text
from planner.planning.plan import Plan
from planner.report.page import versions
from planner.robot.schedule import Schedule
from planner.trajectory import Array

WRITTEN = ("requests", "angles", "desired", "foot", "report")
"""Keys of [output] that name a file."""

ARGUMENTS = {
    "unreachable='nearest'": as_key(Key("leg.unreachable", "nearest")),
    "cyclic=False": as_key(Key("plan.cyclic", False)),
}
"""Arguments that messages of the library advise, as keys of a run file."""


def read_run(path: str) -> tuple[Toml, Desired]:
    """Read a run file, or standard input for ``-``, and prepare the plan that it describes."""
    file = read_toml(path, example='method = "optimal"')
    run = understand(file, settings.Run)
    with speaking_of(file):
        for number, export in enumerate(run.export):
            with _in_export(number):
                check_export(export)
        _check_names(run)
        desired = prepare(run, str(Path(path).parent))
        if run.export:
            check_angles(desired.names, desired.units)
        for number, export in enumerate(run.export):  # what the path or the packages cannot give
            with _in_export(number):
                check_rows(export, rows_of(export, _schedule(desired, desired.angles))[0])
    return file, desired


def _schedule(desired: Desired, requests: Array) -> Schedule:
    """When requests [rad], (n, k), are due."""
    return Schedule(desired.names, requests, desired.period)


@contextmanager
def speaking_of(file: Toml) -> Iterator[None]:
    """Let errors in settings inside the block name keys and lines of a file."""
    try:
        yield
    except BadSetting as error:
        lines = (file.line_of(part.place) for part in error.parts if isinstance(part, Key))
        line = next((line for line in lines if line is not None), None)
        raise InvalidFile(file.path, str(error), line=line) from error
    except FailedCheck as error:
        raise PlannerError(str(error)) from error
    except PlannerError as error:
        message = str(error)
        for argument, key in ARGUMENTS.items():
            message = message.replace(argument, key)
        error.args = (message,)
        raise


@contextmanager
def _in_export(number: int) -> Iterator[None]:
    """Let errors in an export inside the block name its number."""
    place = f"export[{number}]"
    try:
        yield
    except BadSetting as error:
        parts = (
            replace(part, name=part.name.replace("export", place, 1))
            if isinstance(part, Key)
            else part
            for part in error.parts
        )
        raise BadSetting(*parts) from error
    except InvalidInput as error:
        raise BadSetting(Key(place), f": {error}") from error


def _check_names(run: settings.Run) -> None:
    """Make sure that no two files of the folder have one name, or one inside the other."""
    owners = {PurePosixPath(MANIFEST): MANIFEST}
    names = {f"output.{key}": getattr(run.output, key) for key in WRITTEN}
    names |= {f"export[{number}].file": each.file for number, each in enumerate(run.export)}
    for key, name in names.items():
        if not name:
            continue
        path = PurePosixPath(name.casefold())
        for other, owner in owners.items():
            if path == other or path in other.parents or other in path.parents:
                raise BadSetting(
                    Key(key), f": got '{name}', which {owner} takes; choose another name"
                )
        owners[path] = key


def write_run(
    folder: Path, file: str, desired: Desired, plan: Plan, *, progress: Callable[[str], None]
) -> tuple[dict[str, Any], str, list[str]]:
    """Write all outputs of a run file, whose path the page names.

    Returns:
        ``results.json``, the exports in words, and the missed tolerances.
    """
    run, task = desired.settings, plan.task
    missed = misses(desired, plan)
    progress("the files")
    for key, angles, loads in (
        ("requests", plan.requests, task.load),
        ("angles", plan.predicted, None),
        ("desired", desired.angles, None),
    ):
        if place := _place(folder, getattr(run.output, key)):
            desired.write(place, angles, loads)
    if desired.foot is not None and (place := _place(folder, run.output.foot)):
        write_foot_path(place, plan.foot, period=desired.period)
    exports, words = [], ""
    for export in run.export:
        rows, skipped = rows_of(export, _schedule(desired, plan.requests))
        write_rows(str(_place(folder, export.file)), export, rows)
        exports.append({"file": export.file, **rows_document(export, rows, skipped)})
        words += f"\n{export.file}: {rows_summary(rows, skipped)}"
    if page := _place(folder, run.output.report):
        names = [*list_files(folder), MANIFEST]
        files: list[tuple[str, Path | str | None]] = [("run", file)]
        files += [(Path(name).stem, folder / name) for name in names]
        write_text(page, plan_report(desired, plan, missed=missed, page=page, written=files))
    results = {
        "made_by": "request-planner run",
        "settings": flat(run),
        **document(desired, plan, missed),
        "exports": exports,
        "versions": versions(),
        "files": list_files(folder),
    }
    write_text(folder / MANIFEST, to_json(results))
    return results, words, missed


def _place(folder: Path, name: str) -> Path | None:
    """The path of an output, whose folder is made; None where its name is empty."""
    place = folder / name
    if name:
        place.parent.mkdir(parents=True, exist_ok=True)
    return place if name else None
