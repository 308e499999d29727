"""``request-planner plan``: a joint or foot path in, requests out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from planner.cli import legs, options
from planner.cli.checks import check_plan
from planner.cli.limits import option as limits_option
from planner.cli.limits import parse_limits
from planner.cli.say import deliver
from planner.cli.wanted import load_wanted

if TYPE_CHECKING:
    from planner.inversion.result import Inversion


@click.command(short_help="Plan requests for joint angles or a foot path.")
@click.argument("path")
@legs.options
@legs.unreachable
@options.model
@options.joints
@options.cyclic
@click.option(
    "--method",
    type=click.Choice(["closed-form", "optimal"]),
    default="optimal",
    show_default=True,
    help="The paper's inversion, or optimised requests.",
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
@limits_option
@options.output
@options.as_json
def plan(*, path: str, output: str, as_json: bool, **choices: Any) -> None:
    """Plan requests that make the joints follow PATH, a CSV; '-' is standard input.

    PATH holds desired angles (columns <joint>_deg or <joint>_rad), or positions of a foot (x_m,
    y_m, z_m, or _cm, _mm) for a leg.

    \b
    Example, requests for a foot path, inside the joints' limits:
        request-planner plan foot.csv --leg front-left -o requests.csv
    """  # noqa: D301
    import numpy as np

    from planner.files.joint_path import write_joint_path
    from planner.report.text_table import percent, text_table

    _check_choices(choices)
    leg = legs.load_leg(*(choices[key] for key in ("leg", "urdf", "base", "foot")))
    wanted = load_wanted(
        path,
        model=choices["model"],
        joints=choices["joints"],
        leg=leg,
        unreachable=choices["unreachable"],
    )
    limits = parse_limits(choices["limits"], wanted.names, wanted.limits)
    plans = {
        name: _invert(choices, joint, wanted.angles[:, j], limits.get(name))
        for j, (name, joint) in enumerate(zip(wanted.names, wanted.models, strict=True))
    }
    for name, inversion in plans.items():
        check_plan(name, inversion, limits.get(name), by_user=bool(choices["limits"]))
    document = {
        "method": choices["method"],
        "cyclic": choices["cyclic"],
        "period_s": wanted.period,
        "unreachable_samples": wanted.moved,
        "joints": {name: _document(inversion) for name, inversion in plans.items()},
    }
    rows = [
        [
            name,
            f"{np.degrees(each.rms):.3f}",
            f"{np.degrees(each.max_error):.3f}",
            f"{np.degrees(each.lower_bound):.3f}",
            percent(each.gap),
        ]
        for name, each in plans.items()
    ]
    header = ["joint", "rms [deg]", "max [deg]", "no plan below", "gap"]
    requests = np.column_stack([inversion.requests for inversion in plans.values()])
    moved = f"\n{wanted.moved} samples were out of the leg's reach" if wanted.moved else ""
    deliver(
        document,
        text_table(header, rows) + moved,
        lambda file: write_joint_path(file, wanted.names, requests, period=wanted.period),
        output=output,
        as_json=as_json,
    )


def _check_choices(choices: dict[str, Any]) -> None:
    """Refuse options that the method would silently ignore."""
    ignored = ("norm",) if choices["method"] == "closed-form" else ("segments", "rule")
    for name in ignored:
        if choices[name] is not None:
            raise click.UsageError(f"--{name} has no effect with --method {choices['method']}.")


def _invert(
    choices: dict[str, Any], joint: Any, desired: Any, limits: tuple[float, float] | None
) -> Inversion:
    from planner.inversion.closed_form import invert_closed_form
    from planner.inversion.optimal import invert_optimal

    if choices["method"] == "closed-form":
        return invert_closed_form(
            joint,
            desired,
            cyclic=choices["cyclic"],
            segments=choices["segments"],
            rule=choices["rule"] or "paper",
        )
    return invert_optimal(
        joint, desired, cyclic=choices["cyclic"], limits=limits, norm=choices["norm"] or "rms"
    )


def _document(inversion: Inversion) -> dict[str, Any]:
    import numpy as np

    return {
        "rms_deg": float(np.degrees(inversion.rms)),
        "max_deg": float(np.degrees(inversion.max_error)),
        "norm": inversion.norm,
        "lower_bound_deg": float(np.degrees(inversion.lower_bound)),
        "gap": inversion.gap,
        "requests_deg": np.degrees(inversion.requests).tolist(),
        "predicted_deg": np.degrees(inversion.predicted).tolist(),
    }
