"""``request-planner compare``: the ways to plan, side by side, with a verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import legs, options
from planner.cli.limits import Limits, parse_limits
from planner.cli.limits import option as limits_option
from planner.cli.say import Progress, print_json, summarise, to_json
from planner.cli.wanted import Wanted, load_chosen

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.evaluation.cross_check import CrossCheck

PICTURES = (".png", ".svg")
"""Endings of picture files."""

PAGE = "report.html"
"""The page in a folder of results."""


@click.command(short_help="Closed form against optimised requests, with a verdict.")
@click.argument("path")
@legs.options
@legs.unreachable
@options.model
@options.joints
@options.cyclic
@options.segments
@click.option(
    "--norm",
    type=click.Choice(["rms", "max"]),
    default="rms",
    show_default=True,
    help="Error that optimised requests make small.",
)
@click.option(
    "--level",
    type=click.Choice(["slope", "envelope", "exact"]),
    default="envelope",
    show_default=True,
    help="Sharpest bound to compute; 'exact' takes seconds to a minute.",
)
@limits_option
@click.option("--figure", metavar="FILE", help="Write the picture; .png or .svg.")
@click.option("--report", metavar="FILE", help="Write a page (HTML) about the comparison.")
@click.option(
    "--out", metavar="DIR", help="Write JSON, requests (CSV), pictures and the page to a folder."
)
@options.as_json
def compare(
    *,
    path: str,
    figure: str | None,
    report: str | None,
    out: str | None,
    as_json: bool,
    **choices: Any,
) -> None:
    """Plan PATH by the closed form, by optimisation, and by CasADi with IPOPT, and compare.

    PATH is what `plan` takes. Says how good each plan is and how good any could be, where the
    requests differ and why, and whether the plans agree with an independent simulation and with
    each other. Exit status 1 if they do not.

    \b
    Example, a foot path, with a page about it:
        request-planner gait -o foot.csv
        request-planner compare foot.csv --leg reference --unreachable clamp --report compare.html
    """  # noqa: D301
    from planner.report.comparison_text import comparison_text, verdict_line

    if figure is not None and Path(figure).suffix.lower() not in PICTURES:
        raise click.UsageError(f"--figure: got '{figure}', expected a name in .png or .svg.")
    leg, wanted = load_chosen(path, choices)
    limits = parse_limits(choices["limits"], wanted.names, wanted.limits)
    check = cross_checked(leg, wanted, limits, choices)
    document = {**check.to_dict(), "unreachable_samples": wanted.moved}
    if figure is not None:
        write_picture(Path(figure), check)
    page = partial(_page, path, choices, wanted, check)
    if out is not None:
        _write_folder(out, check, document, page)
    if report is not None:
        from planner.files.text import write_text

        files = [] if out is None else [(file.stem, file) for file in sorted(Path(out).iterdir())]
        write_text(report, page(report, [("picture", figure), *files]))
    if as_json:
        print_json(document)
    else:
        click.echo(comparison_text(check))
        if wanted.moved:
            summarise(f"{wanted.moved} samples were out of the leg's reach")
    if not check.passed:
        raise click.ClickException(verdict_line(check))
    if not as_json:
        summarise(verdict_line(check))


def cross_checked(
    leg: Leg | None, wanted: Wanted, limits: Limits, choices: Mapping[str, Any]
) -> CrossCheck:
    """The plans for what is wanted, held against each other."""
    from planner.evaluation.cross_check import cross_check

    wanted, leg = _in_order_of(leg, wanted)
    with Progress([*wanted.names, *(["foot"] if leg is not None else [])]) as progress:
        return cross_check(
            wanted.models,
            wanted.angles,
            cyclic=choices["cyclic"],
            limits=_by_column(limits, wanted.names),
            segments=choices["segments"],
            leg=leg,
            norm=choices["norm"],
            level=choices["level"],
            names=wanted.names,
            progress=progress,
        )


def _in_order_of(leg: Leg | None, wanted: Wanted) -> tuple[Wanted, Leg | None]:
    """The joints in the order of the leg; no leg where some of its joints are not there."""
    if leg is None or set(wanted.names) != set(leg.joint_names):
        return wanted, None
    columns = [wanted.names.index(name) for name in leg.joint_names]
    models = tuple(wanted.models[column] for column in columns)
    angles = wanted.angles[:, columns]
    return replace(wanted, names=leg.joint_names, models=models, angles=angles), leg


def _by_column(
    limits: Limits, names: tuple[str, ...]
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Limits of all joints [rad]; infinite for those that have none."""
    if not limits:
        return None
    free = (float("-inf"), float("inf"))
    lower, upper = zip(*(limits.get(name, free) for name in names), strict=True)
    return lower, upper


def write_picture(file: Path, check: CrossCheck) -> None:
    """Write the picture of a comparison, as PNG or SVG by the file's ending."""
    from planner.files.text import write_bytes, write_text
    from planner.report.draw_comparison import draw_comparison
    from planner.report.render import to_png, to_svg

    drawn = draw_comparison(check)
    if file.suffix.lower() == ".svg":
        write_text(file, to_svg(drawn))
    else:
        write_bytes(file, to_png(drawn))


def _page(
    path: str,
    choices: Mapping[str, Any],
    wanted: Wanted,
    check: CrossCheck,
    page: Path | str,
    written: Sequence[tuple[str, Path | str | None]],
) -> str:
    """The page about a comparison, which will stand at ``page``."""
    from planner.cli.compare_report import compare_report

    return compare_report(page, path, choices, wanted, check, written=written)


def _write_folder(
    out: str, check: CrossCheck, document: dict[str, Any], page: Callable[..., str]
) -> None:
    import numpy as np

    from planner.files.joint_path import write_joint_path
    from planner.files.output_folder import MANIFEST, list_files, output_folder
    from planner.files.text import write_text

    names = [joint.name for joint in check.joints]
    with output_folder(out) as folder:
        for method in check.methods:
            requests = np.column_stack([joint.plans[method].requests for joint in check.joints])
            write_joint_path(
                folder / f"requests_{method}.csv", names, requests, period=check.period
            )
        if check.foot is not None:
            requests = check.foot.plans["foot_optimal"].requests
            write_joint_path(
                folder / "requests_foot_optimal.csv", names, requests, period=check.period
            )
        for ending in PICTURES:
            write_picture(folder / f"comparison{ending}", check)
        made = [(Path(name).stem, folder / name) for name in (*list_files(folder), MANIFEST)]
        write_text(folder / PAGE, page(folder / PAGE, made))
        written = {**document, "files": list_files(folder)}
        write_text(folder / MANIFEST, to_json(written))
