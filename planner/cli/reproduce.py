"""``request-planner reproduce``: the paper's experiment again, with a report."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, terminal_width
from planner.cli.declared import option
from planner.files.staging import list_files, output_folder
from planner.files.text import to_json, write_bytes, write_text
from planner.report.wording import fitted_to

if TYPE_CHECKING:
    from planner.report.figure import Figure

STEPS = {"model": 16, "virtual": 27}  # number of steps that are reported, by robot


@options.command()
def reproduce(
    *,
    out: options.Folder = option("Folder for the results; an earlier run's is replaced."),
    robot: Literal["model", "virtual"] = option(
        "What the joints are: the paper's model, or servos in MuJoCo (extra 'mujoco').",
        default="model",
    ),
) -> Answer:
    """Run the paper's experiment again and put every figure beside the paper's own.

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
    models identified from them, the walk planned on these and executed over 20 cycles, and the
    plan for the foot refined in 10 trials of learning. The distances are then means over the
    cycles; beside each stand

    \b
        std, sensed         standard deviations; the same distances by the sensors
        predicted, loss     what the plan predicted, and how much of it was lost
        identified.JOINT    the model, its intervals, and "table1" in the paper's units
        learning            the foot's L2 and Linf in each trial, and how it ended

    \b
    Example:
        request-planner reproduce --out out/paper
        request-planner reproduce --robot virtual --out out/virtual
    """  # noqa: D301
    from planner.report.paper_figures import pictures_of
    from planner.report.paper_results import experiment_page, experiment_text

    experiment = on_virtual_robot if robot == "virtual" else on_model
    with (
        Progress(STEPS[robot]) as progress,
        output_folder(out) as folder,
        fitted_to(terminal_width(sys.stdout)),
    ):
        document, figures, failures = experiment(folder, progress)
        text = experiment_text(document)
        linked = ["results.json", *list_files(folder)]
        (folder / "figures").mkdir()
        for figure in figures:
            svg, png = pictures_of(figure)
            write_text(folder / "figures" / f"{figure.name}.svg", svg)
            write_bytes(folder / "figures" / f"{figure.name}.png", png)
        write_text(folder / "report.html", experiment_page(document, figures, linked))
        document["files"] = list_files(folder)
        write_text(folder / "results.json", to_json(document))
    text = f"{text}\n\nReport, figures and CSV files: {out}"
    return Answer(document, "", lambda _: click.echo(text), failure="; ".join(failures))


Experiment = tuple[dict[str, Any], Sequence["Figure"], list[str]]
"""``results.json`` but for its list of files, the figures, and the checks that failed."""


def on_model(folder: Path, progress: Callable[[str], None]) -> Experiment:
    """The paper's experiment on the paper's own model."""
    from planner.evaluation.reproduction import reproduce
    from planner.files.paths import write_foot_path, write_joint_path
    from planner.report.paper_figures import paper_figures
    from planner.report.paper_results import joint_paths, paper_results

    reproduction = reproduce(progress=progress)
    progress("the report")
    period, names = reproduction.models[0].period, reproduction.walk.joint_names
    for name, angles in joint_paths(reproduction).items():
        write_joint_path(folder / f"{name}.csv", names, angles, period=period)
    feet = {method: plan.foot for method, plan in reproduction.plans.items()}
    for name, path in {"desired": reproduction.walk.desired_foot, **feet}.items():
        write_foot_path(folder / f"foot_{name}.csv", path, period=period)
    return paper_results(reproduction), paper_figures(reproduction), []


def on_virtual_robot(folder: Path, progress: Callable[[str], None]) -> Experiment:
    """The paper's experiment on the virtual robot, with models, logs and every walk as files."""
    import numpy as np

    from planner.evaluation.virtual_experiment import play_experiment
    from planner.files.paths import write_joint_path
    from planner.files.table import write_table
    from planner.report.paper_figures import virtual_figures
    from planner.report.paper_results import virtual_results

    outcome = play_experiment(progress=progress)
    progress("the report")
    period, walk = outcome.constants.request_period, outcome.planned.walk
    failures = []
    for name, identification in zip(walk.joint_names, outcome.identifications, strict=True):
        identification.model.to_toml(folder / f"{name}.toml")
        for log in (fit.log for fit in identification.fits):
            height = np.degrees(np.ptp(log.requests))
            write_table(
                folder / f"step_test_{name}_{height:.0f}.csv",
                ["t_s", "requested_deg", "actual_deg"],
                np.column_stack([log.times, np.degrees(log.requests), np.degrees(log.angles)]),
            )
        if not identification.accepted:
            failures.append(
                f"{name}: the model that was identified does not describe the joint; see its "
                "warnings in results.json"
            )
    write_joint_path(folder / "desired.csv", walk.joint_names, walk.desired, period=period)
    for method, run in outcome.runs.items():
        for kind, angles in (
            ("requests", run.requests),
            ("angles", np.concatenate(run.angles)),
            ("sensed", np.concatenate(run.sensed)),
        ):
            path = folder / f"{kind}_{method}.csv"
            write_joint_path(path, walk.joint_names, angles, period=period)
    return virtual_results(outcome), virtual_figures(outcome), failures
