"""``request-planner sweep``: many plans over parameters, towards speed at a small error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, remark
from planner.cli.declared import Source, argument, flat, option
from planner.cli.declared import template as template_of
from planner.cli.run import carried_out, folder_of
from planner.cli.settings import Sweep
from planner.files.staging import MANIFEST, claimed, list_files, output_folder
from planner.files.text import STANDARD_STREAM, to_json, write_text

if TYPE_CHECKING:
    from planner.cli.points import Space
    from planner.evaluation.pareto_front import Swept

HEADING = (
    "A sweep of request-planner: `request-planner sweep FILE` carries it out.",
    "All tables but [sweep] are those of a run file, in which each point sets its parameters.",
    "Every key is here, set to its default or, in comments, shown by an example.",
)
"""Comments at the top of a template."""


@options.command()
def sweep(
    *,
    file: Source | None = argument(form="[SWEEP.toml]"),
    out: options.Folder | None = option("Folder for the results, whatever the file says."),
    at: Annotated[tuple[tuple[str, float], ...], options.PARAMETER] = option(
        "Only this point, with all files of `run`: a value of each parameter.", form=""
    ),
    template: bool = option("Print a file with every key, to begin with."),
    work: Mapping[str, Any] = options.parallel,
) -> Answer | None:
    """Plan for ranges of gaits or speeds, and say which are fast at a small error.

    SWEEP.toml is a run file with a table [sweep]: parameters such as stride, height and period of
    a gait, or the speed of a path, tried on a grid or sought by CMA-ES. The folder of the results
    has all points as CSV, and a page with the Pareto front of speed and error.

    \b
    Example, gaits on a grid, and the plan for one of them:
        request-planner sweep --template > gaits.toml
        request-planner sweep gaits.toml --out gaits
        request-planner sweep gaits.toml --at length=0.04 --at period_s=0.704 --out gait
    """  # noqa: D301
    if template:
        write_text(STANDARD_STREAM, template_of(Sweep, HEADING))
        return None
    if file is None:
        raise click.UsageError("name a sweep file, or begin one with --template.")
    if file == "-":
        raise click.UsageError("a sweep is read from a file: the commands that it shows name it.")
    from planner.cli.points import planned_points, read_sweep
    from planner.files.results import Results, finished
    from planner.parallel import executor_of
    from planner.report.sweep_page import sweep_text

    space = read_sweep(file)
    place = folder_of(file, out, space.settings.out)
    if at:
        if out is None:
            raise click.UsageError("--at: name a folder for its results with --out.")
        chosen, names = dict(at), list(space.values)
        if {*chosen} != {*names}:
            got, expected = ", ".join(chosen) or "nothing", ", ".join(names)
            raise click.UsageError(f"--at: got {got}, expected a value for each of {expected}.")
        return carried_out(space.desired(space.point(chosen[name] for name in names)), out)
    click.get_current_context().with_resource(claimed(place))
    options.warn_of(space.remarks())
    inputs = space.inputs()
    origin = {**inputs, "sweep": space.settings.sweep.values()}
    if work["resume"] and (before := finished(place, MANIFEST, origin)):
        count = len(before["points"])
        remark(f"nothing is missing: {place} holds all {count} points, planned like this")
        return _answer(before, before["verdict"])
    results = Results(place, inputs, resume=work["resume"])
    if results.removed:
        remark(f"{results.removed} results of an earlier sweep removed; --resume keeps them")
    with (
        Progress(space.most_points, parallel=True) as progress,
        executor_of(work["workers"], work["scheduler"]) as executor,
    ):
        swept = planned_points(space, results, executor, progress=lambda task: progress(task.name))
    with output_folder(place) as folder:
        document = write_sweep(folder, space, swept, origin)
    results.remove()
    return _answer(document, f"{sweep_text(swept)}\n{len(document['files']) + 1} files in {place}")


def _answer(document: Mapping[str, Any], words: str) -> Answer:
    """The answer, which fails if no point meets the requirement."""
    failure = ""
    if document["missed"]:
        missed = document["missed"] if document["front"] else "no plan"
        failure = f"{missed}; the files are written all the same"
    return Answer(document, words, failure=failure)


def write_sweep(
    folder: Path, space: Space, swept: Swept, origin: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the table as CSV, and the page; returns ``results.json``."""
    from planner.cli.planning import origins_of
    from planner.files.results import made_from
    from planner.files.table import csv_text
    from planner.report.page import versions
    from planner.report.sweep_page import command, missed, sweep_page, sweep_results, verdict

    run, page, rows = space.settings, folder / "report.html", sweep_results(swept)
    write_text(folder / "points.csv", csv_text([*rows[0]], [[*row.values()] for row in rows]))
    files: list[tuple[str, Path | str]] = [("sweep", swept.file)]
    files += [(Path(name).suffix[1:], folder / name) for name in list_files(folder)]
    write_text(page, sweep_page(swept).html(page, origins_of(run), files))
    document = {
        "made_by": "request-planner sweep",
        "made_from": "",
        "verdict": verdict(swept),
        "missed": missed(swept) or None,
        "settings": {name: value for name, (value, _) in flat(run).items()},
        "points": rows,
        "front": [each.number for each in swept.front],
        "best": None if swept.best is None else swept.best.number,
        "commands": {f"{each.number}": command(swept, each) for each in swept.front},
        "versions": versions(),
        "files": list_files(folder),
    }
    document |= made_from(origin, document)
    write_text(folder / MANIFEST, to_json(document))
    return document
