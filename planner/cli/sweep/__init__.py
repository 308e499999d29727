"""``request-planner sweep``: many plans over parameters, towards speed at a small error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options, types
from planner.cli.console import Progress, print_answer, remark

if TYPE_CHECKING:
    from planner.cli.sweep.space import Space

HEADING = (
    "A sweep of request-planner: `request-planner sweep FILE` carries it out.",
    "All tables but [sweep] are those of a run file, in which each point sets its parameters.",
    "Every key is here, set to its default or, in comments, shown by an example.",
)
"""Comments at the top of a template."""


@click.command()
@click.argument("file", type=types.INPUT, metavar="[SWEEP.toml]", required=False)
@click.option("--out", type=types.FOLDER, help="Folder for the results, whatever the file says.")
@click.option(
    "--at",
    multiple=True,
    type=types.PARAMETER,
    metavar="NAME=VALUE",
    help="Only this point, with all files of `run`: a value of each parameter.",
)
@click.option("--template", is_flag=True, help="Print a file with every key, to begin with.")
@options.parallel
@options.as_json
def sweep(
    *,
    file: str | None,
    out: str | None,
    at: tuple[tuple[str, float], ...],
    template: bool,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    as_json: bool,
) -> None:
    """Plan for ranges of gaits or speeds, and say which are fast at a small error.

    SWEEP.toml is a run file with a table [sweep]: parameters such as stride, height and period of
    a gait, or the speed of a path, tried on a grid or sought by CMA-ES. The folder of the results
    has all points as CSV and Parquet, and a page with the Pareto front of speed and error.

    \b
    Example, gaits on a grid, and the plan for one of them:
        request-planner sweep --template > gaits.toml
        request-planner sweep gaits.toml --out gaits
        request-planner sweep gaits.toml --at length=0.04 --at period_s=0.704 --out gait
    """  # noqa: D301
    if template:
        from planner.cli.declared import template as template_of
        from planner.cli.sweep.space import Sweep
        from planner.files.text import STANDARD_STREAM, write_text

        write_text(STANDARD_STREAM, template_of(Sweep, HEADING))
        return
    if file is None:
        raise click.UsageError("name a sweep file, or begin one with --template.")
    options.check_parallel(workers, scheduler)
    if file == "-":
        raise click.UsageError("a sweep is read from a file: the commands that it shows name it.")
    from planner.cli.sweep.space import point_of, read_sweep

    space = read_sweep(file)
    named = out or (space.settings.out and str(Path(file).parent / space.settings.out))
    if named is None and not Path(file).suffix:
        raise click.UsageError("name a folder for the results with --out.")
    folder = named or str(Path(file).with_suffix(""))
    if at:
        from planner.cli.run import carry_out_run

        if out is None:
            raise click.UsageError("--at: name a folder for its results with --out.")
        carry_out_run(space.run_file(point_of(space, at)), out, as_json=as_json)
        return
    _carry_out(space, folder, workers=workers, scheduler=scheduler, resume=resume, as_json=as_json)


def _carry_out(
    space: Space,
    out: str,
    *,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    as_json: bool,
) -> None:
    """Plan all points, and write the folder of the results."""
    from planner.cli.sweep.files import summary, write_sweep
    from planner.cli.sweep.search import sweep
    from planner.cli.sweep.space import identity, number_of_points, origin
    from planner.files.results import Results, finished
    from planner.files.staging import MANIFEST, check_folder, claimed, output_folder
    from planner.parallel import executor_of

    check_folder(out)
    click.get_current_context().with_resource(claimed(out))
    options.warn_of(space.refused_models())
    if resume and (before := finished(out, MANIFEST, origin(space))):
        count = len(before["points"])
        remark(f"nothing is missing: {out} holds all {count} points, planned like this")
        _print_summary(before, before["verdict"], as_json=as_json)
        return
    results = Results(out, identity(space), resume=resume)
    if results.removed:
        remark(f"{results.removed} results of an earlier sweep removed; --resume keeps them")
    with (
        Progress(count=number_of_points(space)) as progress,
        executor_of(workers, scheduler) as executor,
    ):
        swept = sweep(space, results, executor, progress=lambda task: progress(task.name))
    with output_folder(out) as folder:
        document = write_sweep(folder, space, swept)
    results.remove()
    _print_summary(
        document, f"{summary(swept)}\n{len(document['files']) + 1} files in {out}", as_json=as_json
    )


def _print_summary(document: Mapping[str, Any], words: str, *, as_json: bool) -> None:
    """Print the answer, and fail if no point meets the requirement."""
    print_answer(document, words, as_json=as_json)
    if document["missed"]:
        raise click.ClickException(f"{document['missed']}; the files are written all the same")
