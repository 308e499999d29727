"""A run file: read with all that it names, checked before anything is computed, and carried out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from kinematics.exceptions import KinematicsError
from planner.cli import settings
from planner.cli.answer import document, plan_report
from planner.cli.console import BadSetting, FailedCheck, Key, as_key
from planner.cli.declared import flat, understand
from planner.cli.desired import check_angles
from planner.cli.export import (
    check_export,
    check_rows,
    rows_document,
    rows_of,
    rows_summary,
    write_rows,
)
from planner.cli.planning import Prepared, misses, prepare
from planner.exceptions import InvalidFile, InvalidInput, PlannerError
from planner.files.paths import write_foot_path
from planner.files.staging import MANIFEST, list_files
from planner.files.text import Toml, read_toml, to_json, write_text
from planner.planning.plan import Plan
from planner.report.page import versions
from planner.robot.schedule import Schedule

WRITTEN = ("requests", "angles", "desired", "foot", "report")
"""Keys of [output] that name a file."""

ARGUMENTS = {
    "unreachable='nearest'": as_key(Key("leg.unreachable", "nearest")),
    "cyclic=False": as_key(Key("plan.cyclic", False)),
}
"""Arguments that messages of the library advise, as keys of a run file."""


def read_run(path: str) -> tuple[Toml, Prepared]:
    """Read a run file, or standard input for ``-``, and prepare the plan that it describes."""
    file = read_toml(path, example='method = "optimal"')
    run = understand(file, settings.Run)
    with speaking_of(file):
        for number, export in enumerate(run.export):
            with _in_export(number):
                check_export(export)
        _check_names(run)
        prepared = prepare(run, str(Path(path).parent))
        _check_outputs(prepared)
    return file, prepared


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
    except (PlannerError, KinematicsError) as error:
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


def _check_outputs(prepared: Prepared) -> None:
    """Refuse outputs that this path or the installed packages cannot give, before computing."""
    run, desired = prepared.settings, prepared.desired
    if run.export:
        check_angles(desired.names, desired.units)
    draft = Schedule(desired.names, desired.angles, desired.period)
    for number, export in enumerate(run.export):
        with _in_export(number):
            rows, _ = rows_of(export, draft)
            check_rows(export, rows)


def write_run(
    folder: Path, file: str, prepared: Prepared, plan: Plan, *, progress: Callable[[str], None]
) -> tuple[dict[str, Any], str, list[str]]:
    """Write all outputs of a run file, whose path the page names.

    Returns:
        ``results.json``, the exports in words, and the missed tolerances.
    """
    run = prepared.settings
    missed = misses(run, prepared.desired, plan)
    progress("the files")
    _write_paths(folder, prepared, plan)
    exports, words = _write_exports(folder, prepared, plan)
    if page := _place(folder, run, "report"):
        names = [*list_files(folder), MANIFEST]
        files: list[tuple[str, Path | str | None]] = [("run", file)]
        files += [(Path(name).stem, folder / name) for name in names]
        write_text(page, plan_report(prepared, plan, missed=missed, page=page, written=files))
    results = {
        "made_by": "request-planner run",
        "settings": flat(run),
        **document(prepared, plan, missed),
        "exports": exports,
        "versions": versions(),
        "files": list_files(folder),
    }
    write_text(folder / MANIFEST, to_json(results))
    return results, words, missed


def _write_paths(folder: Path, prepared: Prepared, plan: Plan) -> None:
    """Requests, predicted and desired angles, and positions of the foot, as CSV."""
    run, desired = prepared.settings, prepared.desired
    for key, angles in (
        ("requests", plan.requests),
        ("angles", plan.predicted),
        ("desired", desired.angles),
    ):
        if file := _place(folder, run, key):
            desired.write(file, angles, plan.task.load if key == "requests" else None)
    if desired.foot is not None and (file := _place(folder, run, "foot")):
        write_foot_path(file, plan.foot, period=desired.period)


def _write_exports(
    folder: Path, prepared: Prepared, plan: Plan
) -> tuple[list[dict[str, Any]], str]:
    """The files for robots; their rows, for machines and for people."""
    documents, words = [], ""
    for export in prepared.settings.export:
        schedule = Schedule(prepared.desired.names, plan.requests, plan.period)
        rows, skipped = rows_of(export, schedule)
        file = folder / export.file
        file.parent.mkdir(parents=True, exist_ok=True)
        write_rows(str(file), export, rows)
        documents.append({"file": export.file, **rows_document(export, rows, skipped)})
        words += f"\n{export.file}: {rows_summary(rows, skipped)}"
    return documents, words


def _place(folder: Path, run: settings.Run, key: str) -> Path | None:
    """The path of an output; None if the run leaves it out."""
    name = getattr(run.output, key)
    if not name:
        return None
    place: Path = folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    return place
