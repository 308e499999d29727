"""``request-planner reproduce``: the paper's experiment again, with a report."""

from __future__ import annotations

import click

from planner.cli import options
from planner.cli.say import Progress, print_json, to_json


@click.command(short_help="Run the paper's experiment again, with a report.")
@click.option(
    "--out",
    required=True,
    metavar="DIR",
    help="Folder for the results; an earlier run's is replaced.",
)
@click.option(
    "--robot",
    type=click.Choice(["model", "virtual"]),
    default="model",
    show_default=True,
    help="What the joints are: the paper's model, or servos in MuJoCo (extra 'mujoco').",
)
@options.as_json
def reproduce(*, out: str, robot: str, as_json: bool) -> None:
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

    With --robot virtual the joints are servos simulated in MuJoCo: step tests are recorded,
    models identified from them, the walk planned on these and executed over 20 cycles. The
    distances are then means over the cycles; beside each stand

    \b
        std, sensed         standard deviations; the same distances by the sensors
        predicted, loss     what the plan had promised, and what was lost of it
        identified.JOINT    the model, its intervals, and "table1" in the paper's units

    \b
    Example:
        request-planner reproduce --out out/paper
        request-planner reproduce --robot virtual --out out/virtual
    """  # noqa: D301
    from planner.cli.durations import DURATIONS
    from planner.cli.experiments import on_model, on_virtual_robot
    from planner.files.output_folder import list_files, output_folder
    from planner.files.text import write_text

    progress = Progress(DURATIONS[robot])
    experiment = on_virtual_robot if robot == "virtual" else on_model
    try:
        with output_folder(out) as folder:
            document, text, failures = experiment(folder, progress)
            document["files"] = list_files(folder)
            write_text(folder / "results.json", to_json(document))
    finally:
        progress.done()
    if as_json:
        print_json(document)
    else:
        click.echo(text)
        click.echo(f"\nReport, figures and CSV files: {out}")
    if failures:
        raise click.ClickException("; ".join(failures))
