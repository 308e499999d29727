"""``request-planner compare``: the ways to plan, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from planner.cli import legs, options
from planner.cli.limits import option as limits_option
from planner.cli.limits import parse_limits
from planner.cli.say import print_json, summarise
from planner.cli.wanted import load_wanted

if TYPE_CHECKING:
    from planner.inversion.result import Inversion


@click.command(short_help="Closed form and optimised requests, side by side.")
@click.argument("path")
@legs.options
@legs.unreachable
@options.model
@options.joints
@options.cyclic
@options.segments
@limits_option
@options.as_json
def compare(*, path: str, segments: int | None, as_json: bool, **choices: Any) -> None:
    """Plan PATH by the closed form with both of its rules and by optimisation, and compare.

    PATH is what `plan` takes. For each joint: the error of each plan, its gap over what no requests
    whatever can go below, and how far its requests are from the optimised ones at most.

    \b
    Example, on a foot path:
        request-planner gait | request-planner compare - --leg reference --unreachable clamp
    """  # noqa: D301
    from planner.inversion.closed_form import invert_closed_form
    from planner.inversion.optimal import invert_optimal

    leg = legs.load_leg(*(choices[key] for key in ("leg", "urdf", "base", "foot")))
    wanted = load_wanted(
        path,
        model=choices["model"],
        joints=choices["joints"],
        leg=leg,
        unreachable=choices["unreachable"],
    )
    limits = parse_limits(choices["limits"], wanted.names, wanted.limits)
    cyclic = choices["cyclic"]
    plans: dict[str, dict[str, Inversion]] = {}
    for j, (name, joint) in enumerate(zip(wanted.names, wanted.models, strict=True)):
        desired = wanted.angles[:, j]
        plans[name] = {
            "closed_form_paper": invert_closed_form(
                joint, desired, cyclic=cyclic, segments=segments, rule="paper"
            ),
            "closed_form_exact": invert_closed_form(
                joint, desired, cyclic=cyclic, segments=segments, rule="exact"
            ),
            "optimal": invert_optimal(joint, desired, cyclic=cyclic, limits=limits.get(name)),
        }
    document = {
        name: {
            "lower_bound_deg": _degrees(methods["optimal"].lower_bound),
            "methods": {key: _document(each, methods["optimal"]) for key, each in methods.items()},
        }
        for name, methods in plans.items()
    }
    if as_json:
        print_json({"cyclic": cyclic, "period_s": wanted.period, "joints": document})
        return
    click.echo(_table(document))
    if wanted.moved:
        summarise(f"{wanted.moved} samples were out of the leg's reach")


def _document(inversion: Inversion, optimal: Inversion) -> dict[str, float]:
    import numpy as np

    return {
        "rms_deg": _degrees(inversion.rms),
        "max_deg": _degrees(inversion.max_error),
        "gap": inversion.gap,
        "largest_request_difference_deg": _degrees(
            float(np.max(np.abs(inversion.requests - optimal.requests)))
        ),
    }


def _table(document: dict[str, Any]) -> str:
    from planner.report.text_table import percent, text_table

    rows = []
    for name, joint in document.items():
        for key, method in joint["methods"].items():
            rows.append(
                [
                    f"{name}, {key.replace('_', ' ')}",
                    f"{method['rms_deg']:.3f}",
                    f"{method['max_deg']:.3f}",
                    percent(method["gap"]),
                    f"{method['largest_request_difference_deg']:.2f}",
                ]
            )
        rows.append([f"{name}, no plan below", f"{joint['lower_bound_deg']:.3f}", "", "", ""])
    header = ["joint, method", "rms [deg]", "max [deg]", "gap", "requests differ by [deg]"]
    return text_table(header, rows)


def _degrees(angle: float) -> float:
    import numpy as np

    return float(np.degrees(angle))
