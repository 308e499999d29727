"""``request-planner run``: one file that describes a whole run, from the leg to the outputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from planner.cli import options
from planner.cli.console import Progress, print_answer, warn
from planner.cli.declared import template as template_of
from planner.cli.settings import Run
from planner.files.staging import output_folder
from planner.files.text import STANDARD_STREAM, write_text

if TYPE_CHECKING:
    from planner.cli.desired import Desired
    from planner.files.text import Toml

HEADING = (
    "A run of request-planner: `request-planner run FILE` makes it.",
    "Every key is here, set to its default or, in comments, shown by an example. Files that are",
    "read are named from the place of this file, files that are written from the folder of the",
    "results. Angles are in degrees where the key says so.",
)
"""Comments at the top of a template."""


@click.command()
@click.argument("file", type=options.INPUT, metavar="[RUN.toml]", required=False)
@options.option("--out", "Folder for the results, whatever the file says.", options.FOLDER)
@options.option("--check", "Only check the file and the files that it names.", bool)
@options.option("--template", "Print a file with every key, to begin with.", bool)
@options.as_json
def run(*, file: str | None, out: str | None, check: bool, template: bool, as_json: bool) -> None:
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
        write_text(STANDARD_STREAM, template_of(Run, HEADING))
        return
    if file is None:
        raise click.UsageError("name a run file, or begin one with --template.")
    from planner.cli.run_file import read_run

    run_file, desired = read_run(file)
    if check:
        for remark in desired.remarks:
            warn(str(remark))
        samples, method = len(desired.angles), desired.settings.plan.method
        content = {"holds": True, "samples": samples, "period_s": desired.period}
        print_answer(
            {**content, "joints": list(desired.names), "method": method},
            f"{file}: holds; {samples} samples, {desired.period:g} s apart, of "
            f"{', '.join(desired.names)}; method {method}",
            as_json=as_json,
        )
        return
    place = folder_of(file, out, desired.settings.out)
    carry_out_run(run_file, desired, place, as_json=as_json)


def folder_of(file: str, out: str | None, in_file: str | None) -> str:
    """The folder of the results: that of --out, else that of the file, else one of its name."""
    if out is not None:
        return out
    if in_file is not None:
        return str(Path(file).parent / in_file)
    if file == "-" or not Path(file).suffix:
        raise click.UsageError("name a folder for the results with --out.")
    return str(Path(file).with_suffix(""))


def carry_out_run(file: Toml, desired: Desired, out: str, *, as_json: bool) -> None:
    """Plan, and write the folder of the results."""
    from planner.cli.answer import summary
    from planner.cli.planning import beyond_limits, doubted, plan_of
    from planner.cli.run_file import speaking_of, write_run

    steps = 1 if desired.settings.plan.method == "foot-optimal" else len(desired.names)
    with (
        Progress(steps + 1) as progress,
        speaking_of(file),
        output_folder(out) as folder,
    ):
        plan = plan_of(desired, progress)
        results, exports, failures = write_run(folder, file.path, desired, plan, progress=progress)
    remarks = (*desired.remarks, *beyond_limits(desired, plan), *doubted(desired, plan))
    for remark in remarks:
        warn(str(remark))
    words = f"{summary(desired, plan)}{exports}\n{len(results['files']) + 1} files in {out}"
    print_answer(results, words, as_json=as_json)
    if failures:
        raise click.ClickException(f"{'; '.join(failures)}; the files are written all the same")
