"""``request-planner plan`` and ``compare``: a path in, requests out, or how ways to plan differ."""

from __future__ import annotations

import sys
from typing import Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, terminal_width
from planner.cli.declared import argument, option
from planner.cli.settings import SMOOTHING, Run
from planner.report.wording import fitted_to


@options.command("Write a page (HTML) about the plan.")
def plan(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: joints rate_hz speed",
        "plan: cyclic",
        "start: deg",
        f"plan: method segments rule load norm solver {SMOOTHING} robust",
        "limits: deg",
        "tolerance: deg cm",
        path=argument(),
    ),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
    """Plan requests that make the joints follow PATH, a CSV; '-' is standard input.

    PATH holds desired angles (columns <joint>_deg or <joint>_rad), or positions of a foot (x_m,
    y_m, z_m, or _cm, _mm) for a leg.

    \b
    Example, requests for a foot path inside the joints' limits, joint by joint and all at once:
        request-planner plan foot.csv --leg front-left -o requests.csv
        request-planner plan foot.csv --leg front-left --method foot-optimal -o requests.csv

    \b
    Example, the first of them with requests that change by at most 500 degrees per second:
        request-planner plan foot.csv --leg front-left --max-request-speed-deg-s 500 -o requests.csv

    \b
    Example, requests that are good for every model that the intervals of an identified one allow:
        request-planner plan path.csv --model joint.toml --robust worst -o requests.csv

    \b
    Example, a second opinion on the first of them:
        request-planner plan foot.csv --leg front-left --solver ipopt -o requests.csv
    """  # noqa: D301
    from planner.cli.planning import answer_of, origins_of, page_of, plan_of, prepare

    desired = prepare(run)
    options.warn_of(desired.remarks)
    with Progress(len(desired.names)) as progress:
        result = plan_of(desired, progress)
    answer, remarks = answer_of(desired, result)
    options.warn_of(remarks)
    missed = "; ".join(answer.missed or ())
    return Answer(
        answer.document(),
        answer.text(),
        lambda file: desired.write(file, result.requests, result.task.load),
        lambda: page_of(desired, answer),
        origins_of(run),
        failure=f"{missed}; the requests are written all the same" if missed else "",
    )


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
    from planner.cli.desired import desired_of, model_words, scaled, units_in_messages
    from planner.cli.planning import notes_of, origins_of
    from planner.evaluation.cross_check import cross_check
    from planner.files.columns import SHARES
    from planner.report.comparison_page import comparison_page, comparison_text, verdict_line
    from planner.report.wording import CARRIED, renamed

    desired = desired_of(run)
    options.warn_of(desired.remarks)
    leg, units = desired.leg, desired.shown_units
    whole = leg if leg is not None and set(desired.names) == set(leg.joint_names) else None
    desired = desired if whole is None else desired.of_leg(whole)  # in its order
    steps = len(desired.names) + (whole is not None)
    with Progress(steps) as progress, units_in_messages(units):
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
        table = f"{model_words(run.model)}\n{comparison_text(check, units)}"
    verdict, words = verdict_line(check), []
    if unreachable:
        words.append(f"{unreachable} samples were out of the leg's reach")
    if check.passed:
        words.append(verdict)
    document = {**check.to_dict(), "unreachable_samples": unreachable}
    for name, model in zip(desired.names, desired.models, strict=True):
        if units[name] == "percent":
            own = renamed(document["joints"][name], CARRIED["percent"])
            own["model"] = scaled(model, 1.0 / SHARES["range"]).parameters()  # as in its file
            document["joints"][name] = own
    return Answer(
        document,
        "\n".join(words),
        lambda _: click.echo(table),
        lambda: comparison_page(
            check, units, title=title, leg=whole, unreachable=unreachable, notes=notes
        ),
        [*origins_of(run), ("bounds up to", level)],
        failure="" if check.passed else verdict,
    )
