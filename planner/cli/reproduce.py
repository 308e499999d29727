"""``request-planner reproduce``: the paper's experiment again, with a report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.say import Progress, print_json, to_json

if TYPE_CHECKING:
    from pathlib import Path

    from planner.evaluation.outcome import Reproduction


@click.command(short_help="Run the paper's experiment again, with a report.")
@click.option(
    "--out",
    required=True,
    metavar="DIR",
    help="Folder for the results; an earlier run's is replaced.",
)
@options.as_json
def reproduce(*, out: str, as_json: bool) -> None:
    """Run the paper's experiment again and set every figure beside the paper's own.

    Writes results.json, report.html, figures (SVG and PNG) and CSVs of the desired angles, the
    approximation, the requests and the angles to a folder, which appears whole or not at all.

    \b
    In results.json, beside each L2 and Linf the paper's own, or null, as "paper":
        table2.JOINT.PAIR   {"L2", "Linf"} in degrees; the pairs are spelt as in
                            the paper: Des,Dir Des,MB Pwl,MB, and Des,Opt Des,Foot;
                            MB has knots refined, Des,Plain Pwl,Plain are the paper's
        foot.METHOD         {"L2", "Linf"} in centimetres; the methods are
                            direct shift closed_form_plain closed_form optimal
                            foot_optimal; closed_form has knots refined,
                            closed_form_plain is the paper's
        bounds.JOINT        {"rms", "gap"}, degrees and a share
        limits.JOINT        {"lower", "upper", "excess"}: limits of the requests, and
                            how far each method goes beyond them, in degrees

    \b
    Example:
        request-planner reproduce --out out/paper
    """  # noqa: D301
    from planner.evaluation.reproduction import reproduce as run
    from planner.files.output_folder import list_files, output_folder
    from planner.files.text import write_text
    from planner.report.paper_tables import paper_text
    from planner.report.results import results

    progress = Progress()
    try:
        with output_folder(out) as folder:
            reproduction = run(progress=progress)
            progress("the report")
            _write_paths(folder, reproduction)
            document = results(reproduction)
            _write_report(folder, reproduction, document)
            document["files"] = list_files(folder)
            write_text(folder / "results.json", to_json(document))
    finally:
        progress.done()
    if as_json:
        print_json(document)
        return
    click.echo(paper_text(document))
    click.echo(f"\nReport, figures and CSV files: {out}")


def _write_paths(folder: Path, reproduction: Reproduction) -> None:
    import numpy as np

    from planner.files.foot_path import write_foot_path
    from planner.files.joint_path import write_joint_path
    from planner.report.paths import joint_paths

    period = reproduction.model.period
    names = reproduction.walk.joint_names
    for name, angles in joint_paths(reproduction).items():
        write_joint_path(folder / f"{name}.csv", names, angles, period=period)
    write_foot_path(folder / "foot_desired.csv", reproduction.walk.desired_foot, period=period)
    for name, outcome in reproduction.foot.items():
        write_foot_path(folder / f"foot_{name}.csv", np.asarray(outcome.positions), period=period)


def _write_report(folder: Path, reproduction: Reproduction, document: dict[str, Any]) -> None:
    from planner.files.output_folder import list_files
    from planner.files.text import write_bytes, write_text
    from planner.report.figures import pictures
    from planner.report.page import page
    from planner.report.render import to_png, to_svg

    linked = ["results.json", *list_files(folder)]
    drawn = pictures(reproduction)
    (folder / "figures").mkdir()
    for picture in drawn:
        write_text(folder / "figures" / f"{picture.name}.svg", to_svg(picture.figure))
        write_bytes(folder / "figures" / f"{picture.name}.png", to_png(picture.figure))
    write_text(folder / "report.html", page(document, drawn, linked))
