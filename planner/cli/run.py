"""``request-planner run``: one file that describes a whole run, from the leg to the outputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.say import Progress, print_json, summarise, to_json

if TYPE_CHECKING:
    from planner.cli.run_file import Run

HEADING = (
    "A run of request-planner: `request-planner run FILE` makes it.",
    "Every key is here, set to its default or, in comments, shown by an example. Files that are",
    "read are named from the place of this file, files that are written from the folder of the",
    "results. Angles are in degrees where the key says so.",
)
"""What a template begins with."""


@click.command(short_help="Do all that one TOML file describes.")
@click.argument("file", metavar="[RUN.toml]", required=False)
@click.option("--out", metavar="DIR", help="Folder for the results, whatever the file says.")
@click.option("--check", is_flag=True, help="Only say whether the file and what it names hold.")
@click.option("--template", is_flag=True, help="Print a file with every key, to begin with.")
@options.as_json
def run(*, file: str | None, out: str | None, check: bool, template: bool, as_json: bool) -> None:
    """Do all that RUN.toml describes: leg, models, path, method, limits and outputs.

    The folder of the results appears whole or not at all, and nothing is written outside it. Every
    key is told in the template, and in docs/run.md; an unknown one is refused.

    \b
    Example, the paper's walk from its template:
        request-planner run --template > walk.toml
        request-planner run walk.toml --check
        request-planner run walk.toml --out walk
    """  # noqa: D301
    if template:
        _print_template()
        return
    if file is None:
        raise click.UsageError("name a run file, or begin one with --template.")
    from planner.cli.run_file import read_run

    ready = read_run(file)
    if check:
        summarise(_described(file, ready))
        return
    _make(ready, _folder(file, out, ready), as_json=as_json)


def _print_template() -> None:
    from planner.cli.run_keys import RUN
    from planner.files.schema_text import template
    from planner.files.text import STANDARD_STREAM, write_text

    write_text(STANDARD_STREAM, template(RUN, HEADING))


def _described(file: str, ready: Run) -> str:
    """What a run would do, in a line."""
    wanted = ready.wanted
    return (
        f"{file}: holds; {len(wanted.angles)} samples, {wanted.period:g} s apart, of "
        f"{', '.join(wanted.names)}; method {ready.choices['method']}"
    )


def _folder(file: str, out: str | None, ready: Run) -> str:
    """Where the results go.

    Raises:
        click.UsageError: Nobody has said.
    """
    if out is not None:
        return out
    named = ready.settings["out"]
    if named is not None:
        return str(Path(file).parent / named)
    if file == "-" or not Path(file).suffix:
        raise click.UsageError("name a folder for the results with --out.")
    return str(Path(file).with_suffix(""))


def _make(ready: Run, out: str, *, as_json: bool) -> None:
    from planner.cli import planning, run_outputs, tolerance
    from planner.cli.plan_answer import document, summary
    from planner.cli.run_words import speaking_of_keys
    from planner.files.output_folder import list_files, output_folder
    from planner.files.text import write_text
    from planner.report.comparison_text import verdict_line
    from planner.report.results import versions

    wanted, choices = ready.wanted, ready.choices
    failures: list[str] = []
    steps = ["the foot"] if choices["method"] == "foot-optimal" else list(wanted.names)
    steps += ["the comparison"] if ready.settings["output.comparison"] else []
    with (
        Progress([*steps, "the files"]) as progress,
        speaking_of_keys(ready.settings),
        output_folder(out) as folder,
    ):
        made = planning.make_plan(choices, wanted, ready.limits, ready.starts, progress=progress)
        planning.prove(made, progress=progress)
        missed = tolerance.misses(choices, wanted, made)
        failures += missed
        progress("the files")
        run_outputs.write_paths(folder, ready, made)
        exports, rows = run_outputs.write_exports(folder, ready, made.requests)
        if ready.settings["output.comparison"]:
            progress("the comparison")
            check = run_outputs.write_comparison(folder, ready)
            if not check.passed:
                failures.append(verdict_line(check))
        run_outputs.write_report(folder, ready, made, missed)
        run_outputs.write_scene(folder, ready, made)
        answer: dict[str, Any] = {
            "made_by": "request-planner run",
            "settings": dict(ready.settings.values),
            **document(choices, wanted, made, missed),
            "exports": exports,
            "versions": versions(),
        }
        answer["files"] = list_files(folder)
        write_text(folder / "results.json", to_json(answer))
    if as_json:
        print_json(answer)
    else:
        summarise(f"{summary(wanted, made)}{rows}\n{len(answer['files']) + 1} files in {out}")
    if failures:
        raise click.ClickException(f"{'; '.join(failures)}; the files are written all the same")
