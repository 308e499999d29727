"""``request-planner compare``: the ways to plan, and how much better one is than another."""

from __future__ import annotations

import sys
from typing import Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, terminal_width
from planner.cli.declared import argument, option
from planner.cli.settings import Run
from planner.report.wording import fitted_to


@options.command("Write a page (HTML) about the comparison.")
def compare(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: joints rate_hz",
        "plan: cyclic load segments norm",
        "limits: deg",
        path=argument(),
        segments="Lines of the approximation.",
        norm="Error that optimised requests make small.",
        load="Torque on the joints: gravity at the desired angles by the masses of the leg's URDF, "
        "all of its dynamics, or columns <joint>_load_Nm of the path.",
    ),
    level: Literal["slope", "envelope", "exact"] = option(
        "Sharpest bound to compute; 'exact' takes seconds to a minute.", default="envelope"
    ),
) -> Answer:
    """Plan PATH by the closed form, by optimisation, and by CasADi with IPOPT, and compare.

    PATH is what `plan` takes. Prints the error of each plan and the lower bound of any, how far
    the requests differ, and whether the plans agree with an independent simulation and with each
    other. Exit status 1 if they do not.

    \b
    Example, a foot path, with a page about it:
        request-planner gait -o foot.csv
        request-planner compare foot.csv --leg reference --unreachable clamp --report compare.html
    """  # noqa: D301
    from planner.cli.desired import check_angles, desired_of, model_words
    from planner.cli.planning import inputs_of, notes_of, origins_of
    from planner.evaluation.cross_check import cross_check
    from planner.report.comparison_page import comparison_page, comparison_text, verdict_line

    desired = desired_of(run)
    options.warn_of(desired.remarks)
    check_angles(desired.names, desired.units)
    leg = desired.leg
    whole = leg if leg is not None and set(desired.names) == set(leg.joint_names) else None
    desired = desired if whole is None else desired.of_leg(whole)  # in its order
    with Progress(len(desired.names) + (whole is not None)) as progress:
        check = cross_check(
            desired.models,
            desired.angles,
            cyclic=desired.cyclic,
            limits=desired.limits,
            segments=run.plan.segments,
            leg=whole,
            norm=run.plan.norm,
            level=level,
            names=desired.names,
            load=desired.torques,
            progress=progress,
        )
    title, unreachable, notes = desired.title, desired.unreachable, notes_of(desired)
    with fitted_to(terminal_width(sys.stdout)):
        table = f"{model_words(run.model)}\n{comparison_text(check)}"
    verdict, words = verdict_line(check), []
    if unreachable:
        words.append(f"{unreachable} samples were out of the leg's reach")
    if check.passed:
        words.append(verdict)
    return Answer(
        {**check.to_dict(), "unreachable_samples": unreachable},
        "\n".join(words),
        lambda _: click.echo(table),
        lambda: comparison_page(
            check, title=title, leg=whole, unreachable=unreachable, notes=notes
        ),
        [*origins_of(run), ("bounds up to", level)],
        inputs_of(desired),
        failure="" if check.passed else verdict,
    )
