"""``request-planner compare``: the ways to plan, and how much better one is than another."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options, types
from planner.cli.console import Progress, print_json, summarise, terminal_width
from planner.cli.settings import Run
from planner.files.staging import MANIFEST, claimed, list_files, output_folder
from planner.files.text import to_json, write_text
from planner.report.table import fitted_to

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.desired import Desired
    from planner.cli.planning import Prepared
    from planner.evaluation.cross_check import CrossCheck


PICTURES = (".png", ".svg")
"""Endings of picture files."""

PAGE = "report.html"
"""The page in a folder of results."""


@click.command()
@click.argument("path", type=types.INPUT)
@options.settings(
    *options.LEG,
    "leg.unreachable",
    "model.file",
    "path.joints",
    "path.rate_hz",
    "plan.cyclic",
    "plan.load",
    "plan.segments",
    "plan.norm",
    "output.level",
    "limits.deg",
    segments="Lines of the approximation.",
    norm="Error that optimised requests make small.",
    load="Torque on the joints: gravity at the desired angles by the masses of the leg's URDF, all "
    "of its dynamics, or columns <joint>_load_Nm of the path.",
    level="Sharpest bound to compute; 'exact' takes seconds to a minute.",
)
@click.option("--figure", type=types.OUTPUT, help="Write the picture; .png or .svg.")
@click.option("--report", type=types.OUTPUT, help="Write a page (HTML) about the comparison.")
@click.option(
    "--out",
    type=types.FOLDER,
    help="Write JSON, requests (CSV), pictures and the page to a folder.",
)
@options.as_json
def compare(
    *,
    run: Run,
    path: str,  # noqa: ARG001
    figure: str | None,
    report: str | None,
    out: str | None,
    as_json: bool,
) -> None:
    """Plan PATH by the closed form, by optimisation, and by CasADi with IPOPT, and compare.

    PATH is what `plan` takes. Prints the error of each plan and the lower bound of any, how far
    the requests differ, and whether the plans agree with an independent simulation and with each
    other. Exit status 1 if they do not.

    \b
    Example, a foot path, with a page about it:
        request-planner gait -o foot.csv
        request-planner compare foot.csv --leg reference --unreachable clamp --report compare.html
    """  # noqa: D301
    from planner.cli.answer import comparison_report
    from planner.cli.desired import check_angles
    from planner.cli.models import model_words
    from planner.cli.planning import load
    from planner.report.comparison import comparison_figure, comparison_text, verdict_line
    from planner.report.matplotlib_figure import write_picture

    if figure is not None and Path(figure).suffix.lower() not in PICTURES:
        raise click.UsageError(f"--figure: got '{figure}', expected a name in .png or .svg.")
    prepared = load(run)
    options.warn_of(prepared.desired.remarks)
    check_angles(prepared.desired.names, prepared.desired.units)
    if out is not None:
        click.get_current_context().with_resource(claimed(out))
    with_foot = _in_leg_order(prepared.desired)[1] is not None
    with Progress(len(prepared.desired.names) + with_foot) as progress:
        check = comparison_of(prepared, progress)
    unreachable = prepared.desired.unreachable
    document = {**check.to_dict(), "unreachable_samples": unreachable}
    if figure is not None:
        write_picture(figure, comparison_figure(check))
    page = partial(comparison_report, prepared, check)
    if out is not None:
        _write_folder(out, check, document, page)
    if report is not None:
        files = [] if out is None else [(file.stem, file) for file in sorted(Path(out).iterdir())]
        write_text(report, page(page=report, written=[("picture", figure), *files]))
    if as_json:
        print_json(document)
    else:
        with fitted_to(terminal_width(sys.stdout)):
            click.echo(f"{model_words(run.model)}\n{comparison_text(check)}")
        if unreachable:
            summarise(f"{unreachable} samples were out of the leg's reach")
    if not check.passed:
        raise click.ClickException(verdict_line(check))
    if not as_json:
        summarise(verdict_line(check))


def _write_folder(
    out: str, check: CrossCheck, document: dict[str, Any], page: Callable[..., str]
) -> None:
    import numpy as np

    from planner.files.paths import write_joint_path
    from planner.report.comparison import comparison_figure
    from planner.report.matplotlib_figure import write_picture

    names = [joint.name for joint in check.joints]
    with output_folder(out) as folder:
        plans = {
            method: np.column_stack([joint.plans[method].requests for joint in check.joints])
            for method in check.methods
        }
        if check.foot is not None:
            plans["foot_optimal"] = check.foot.plans["foot_optimal"].requests
        for method, requests in plans.items():
            file = folder / f"requests_{method}.csv"
            write_joint_path(file, names, requests, period=check.period)
        for ending in PICTURES:
            write_picture(folder / f"comparison{ending}", comparison_figure(check))
        files = [(Path(name).stem, folder / name) for name in (*list_files(folder), MANIFEST)]
        write_text(folder / PAGE, page(page=folder / PAGE, written=files))
        manifest = {**document, "files": list_files(folder)}
        write_text(folder / MANIFEST, to_json(manifest))


def comparison_of(
    prepared: Prepared, progress: Callable[[str], None] = lambda _: None
) -> CrossCheck:
    """The plans for the desired path, compared under its load."""
    from planner.evaluation.cross_check import cross_check
    from planner.planning.arguments import limits_of_each

    run, torques = prepared.settings, prepared.load
    desired, leg = _in_leg_order(prepared.desired)
    if callable(torques):
        torques = torques(prepared.desired.angles)
    if torques is not None:
        torques = torques[:, [prepared.desired.names.index(name) for name in desired.names]]
    return cross_check(
        desired.models,
        desired.angles,
        cyclic=desired.cyclic,
        limits=limits_of_each(prepared.limits, desired.names) if prepared.limits else None,
        segments=run.plan.segments,
        leg=leg,
        norm=run.plan.norm or "rms",
        level=run.output.level or "envelope",
        names=desired.names,
        load=torques,
        progress=progress,
    )


def _in_leg_order(desired: Desired) -> tuple[Desired, Leg | None]:
    """The joints in the order of the leg; no leg if some of its joints are missing."""
    leg = desired.leg
    if leg is None or set(desired.names) != set(leg.joint_names):
        return desired, None
    columns = [desired.names.index(name) for name in leg.joint_names]
    models = tuple(desired.models[column] for column in columns)
    angles = desired.angles[:, columns]
    return replace(desired, names=leg.joint_names, models=models, angles=angles), leg
