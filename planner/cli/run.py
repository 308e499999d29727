"""``request-planner run`` and ``sweep``: a file that describes a whole run, or many plans."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any

import click

from planner.cli import options
from planner.cli.console import Answer, BadSetting, Progress, in_keys, remark, speaking_of
from planner.cli.declared import Source, argument, flat, option, understand
from planner.cli.declared import template as template_of
from planner.cli.export import exported
from planner.cli.settings import Run, Sweep
from planner.exceptions import InvalidInput
from planner.files.staging import MANIFEST, claimed, list_files, output_folder
from planner.files.text import STANDARD_STREAM, read_toml, to_json, write_text

if TYPE_CHECKING:
    from planner.cli.desired import Desired
    from planner.cli.points import Space
    from planner.evaluation.pareto_front import Swept

RUN_HEADING = (
    "A run of request-planner: `request-planner run FILE` makes it.",
    "Every key is here, set to its default or, in comments, shown by an example. Files that are",
    "read are named from the place of this file, files that are written from the folder of the",
    "results. Angles are in degrees where the key says so.",
)

SWEEP_HEADING = (
    "A sweep of request-planner: `request-planner sweep FILE` carries it out.",
    "All tables but [sweep] are those of a run file, in which each point sets its parameters.",
    "Every key is here, set to its default or, in comments, shown by an example.",
)
"""Comments at the top of templates."""


@options.command()
def run(
    *,
    file: Source | None = argument(form="[RUN.toml]"),
    out: options.Folder | None = option("Folder for the results, whatever the file says."),
    check: bool = option("Only check the file and the files that it names."),
    template: bool = option("Print a file with every key, to begin with."),
) -> Answer | None:
    """Carry out what RUN.toml describes: leg, models, path, method, limits and outputs.

    The folder of the results appears whole or not at all, and nothing is written outside it. Every
    key is described in the template, and in docs/run.md; an unknown one is refused.

    \b
    Example, the paper's walk from its template:
        request-planner run --template > walk.toml
        request-planner run walk.toml --check
        request-planner run walk.toml --out walk
    """  # noqa: D301
    if template:
        write_text(STANDARD_STREAM, template_of(Run, RUN_HEADING))
        return None
    if file is None:
        raise click.UsageError("name a run file, or begin one with --template.")
    desired = read_run(file)
    if not check:
        return carried_out(desired, folder_of(file, out, desired.settings.out))
    options.warn_of(desired.remarks, in_keys)
    samples, method = len(desired.angles), desired.settings.plan.method
    content = {"holds": True, "samples": samples, "period_s": desired.period}
    return Answer(
        {**content, "joints": list(desired.names), "method": method},
        f"{file}: holds; {samples} samples, {desired.period:g} s apart, of "
        f"{', '.join(desired.names)}; method {method}",
    )


def folder_of(file: str, out: str | None, in_file: str | None) -> str:
    """The folder of the results: that of --out, else that of the file, else one of its name."""
    if out is not None:
        return out
    if in_file is not None:
        return str(Path(file).parent / in_file)
    if file == "-" or not Path(file).suffix:
        raise click.UsageError("name a folder for the results with --out.")
    return str(Path(file).with_suffix(""))


def read_run(path: str) -> Desired:
    """Read a run file, or standard input for ``-``, and prepare the plan that it describes."""
    from planner.cli.planning import prepare
    from planner.files.exports import Schedule

    run = understand(read_toml(path, example='method = "optimal"'), Run)
    with speaking_of(run.source):
        _check_names(run)
        desired = prepare(run)
        schedule = Schedule(desired.names, desired.angles, desired.period, desired.units)
        for number, export in enumerate(run.export):
            try:
                exported(export, schedule)
            except BadSetting as error:
                raise BadSetting(
                    error.args[0].replace("‹export.", f"‹export[{number}].")
                ) from error
            except InvalidInput as error:  # what the path or the packages cannot give
                raise BadSetting(f"‹export[{number}]›: {error}") from error
    return desired


def _check_names(run: Run) -> None:
    """Make sure that no two files of the folder have one name, or one inside the other."""
    owners = {PurePosixPath(MANIFEST): MANIFEST}
    names = {f"output.{key}": name for key, name in run.output.values().items() if name}
    names |= {f"export[{number}].file": each.file for number, each in enumerate(run.export)}
    for key, name in names.items():
        path = PurePosixPath(name.casefold())
        for other, owner in owners.items():
            if path.is_relative_to(other) or other.is_relative_to(path):
                raise BadSetting(f"‹{key}›: got '{name}', which {owner} takes; choose another name")
        owners[path] = key


def carried_out(desired: Desired, out: str) -> Answer:
    """Plan, and write the folder of the results, ``results.json`` among them."""
    from planner.cli.planning import answer_of, inputs_of, origins_of, page_of, plan_of
    from planner.files.exports import Schedule
    from planner.files.paths import write_foot_path
    from planner.report.page import versions

    run, failure = desired.settings, ""
    steps = 1 if run.plan.method == "foot-optimal" else len(desired.names)
    with Progress(steps + 1) as progress, speaking_of(run.source), output_folder(out) as folder:
        plan = plan_of(desired, progress)
        answer, remarks = answer_of(desired, plan)
        progress("the files")
        for name, angles, loads in (
            (run.output.requests, plan.requests, plan.task.load),
            (run.output.angles, plan.predicted, None),
            (run.output.desired, desired.angles, None),
        ):
            if name:
                desired.write(folder / name, angles, loads)
        if desired.foot is not None and run.output.foot:
            write_foot_path(folder / run.output.foot, plan.foot, period=desired.period)
        exports, words = [], ""
        for export in run.export:
            schedule = Schedule(desired.names, plan.requests, desired.period, desired.units)
            document, summary, write = exported(export, schedule)
            write(str(folder / export.file))
            exports.append({"file": export.file, **document})
            words += f"\n{export.file}: {summary}"
        if run.output.report:
            page = folder / run.output.report
            files: list[tuple[str, Path | str | None]] = [*inputs_of(desired)]
            files += [("run", run.source.path)]
            files += [(Path(name).stem, folder / name) for name in [*list_files(folder), MANIFEST]]
            write_text(page, page_of(desired, answer).html(page, origins_of(run), files))
        results = {
            "made_by": "request-planner run",
            "settings": {name: value for name, (value, _) in flat(run).items()},
            **answer.document(),
            "exports": exports,
            "versions": versions(),
            "files": list_files(folder),
        }
        write_text(folder / MANIFEST, to_json(results))
    options.warn_of([*desired.remarks, *remarks], in_keys)
    if answer.missed:
        failure = f"{'; '.join(answer.missed)}; the files are written all the same"
    words += f"\n{len(results['files']) + 1} files in {out}"
    return Answer(results, answer.text() + words, failure=failure)


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
        write_text(STANDARD_STREAM, template_of(Sweep, SWEEP_HEADING))
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
        chosen, names = options.by_name("--at", at), list(space.values)
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
        swept = planned_points(space, results, executor, progress=progress)
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
