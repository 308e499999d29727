"""``request-planner plan``: a joint or foot path in, requests out."""

from __future__ import annotations

from typing import Any

import click

from planner.cli import legs, options, planning, starts, tolerance
from planner.cli.limits import option as limits_option
from planner.cli.limits import parse_limits
from planner.cli.plan_answer import document, summary
from planner.cli.say import Progress, deliver
from planner.cli.wanted import load_chosen


@click.command(short_help="Plan requests for joint angles or a foot path.")
@click.argument("path")
@legs.options
@legs.unreachable
@options.model
@options.joints
@options.cyclic
@starts.option
@click.option(
    "--method",
    type=click.Choice(list(planning.IGNORED)),
    default="optimal",
    show_default=True,
    help="The paper's inversion, or requests optimised joint by joint, or all at once for a foot.",
)
@options.segments
@click.option(
    "--rule",
    type=click.Choice(["paper", "exact"]),
    help="How the closed form inverts a line.  [default: paper]",
)
@click.option(
    "--norm",
    type=click.Choice(["rms", "max"]),
    help="Error that optimised requests make small.  [default: rms]",
)
@click.option(
    "--solver",
    type=click.Choice(["gauss-newton", "ipopt", "fatrop"]),
    help="With --method optimal: our own, or CasADi's with the same problem.  "
    "[default: gauss-newton]",
)
@click.option(
    "--weights",
    type=float,
    nargs=3,
    metavar="X Y Z",
    help="With --method foot-optimal: how much each axis counts.  [default: 1 1 1]",
)
@limits_option
@tolerance.options
@options.output
@click.option("--report", metavar="FILE", help="Write a page (HTML) about the plan.")
@options.as_json
def plan(*, path: str, output: str, report: str | None, as_json: bool, **choices: Any) -> None:
    """Plan requests that make the joints follow PATH, a CSV; '-' is standard input.

    PATH holds desired angles (columns <joint>_deg or <joint>_rad), or positions of a foot (x_m,
    y_m, z_m, or _cm, _mm) for a leg.

    \b
    Example, requests for a foot path inside the joints' limits, joint by joint and all at once:
        request-planner plan foot.csv --leg front-left -o requests.csv
        request-planner plan foot.csv --leg front-left --method foot-optimal -o requests.csv

    \b
    Example, a second opinion on the first of them:
        request-planner plan foot.csv --leg front-left --solver ipopt -o requests.csv
    """  # noqa: D301
    from planner.files.joint_path import write_joint_path

    _, wanted = load_chosen(path, choices)
    planning.check_choices(choices, wanted)
    tolerance.check_choices(choices, foot=wanted.foot is not None)
    limits = parse_limits(choices["limits"], wanted.names, wanted.limits)
    rest = starts.parse_starts(choices["start_deg"], wanted.names, cyclic=choices["cyclic"])
    with Progress(wanted.names) as progress:
        made = planning.make_plan(choices, wanted, limits, rest, progress=progress)
        planning.prove(made, progress=progress)
    missed = tolerance.misses(choices, wanted, made)
    if report is not None:
        from planner.cli.plan_report import plan_report
        from planner.files.text import write_text

        page = plan_report(
            path,
            choices,
            wanted,
            made,
            limits=limits,
            missed=missed,
            page=report,
            written=[("requests", output)],
        )
        write_text(report, page)
    deliver(
        document(choices, wanted, made, missed),
        summary(wanted, made),
        lambda file: write_joint_path(file, wanted.names, made.requests, period=wanted.period),
        output=output,
        as_json=as_json,
    )
    if missed:
        raise click.ClickException(f"{'; '.join(missed)}; the requests are written all the same")
