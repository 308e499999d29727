"""The options ``--tolerance-deg`` and ``--tolerance-cm``: how far off a plan may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from planner.cli.planning import Plan
    from planner.cli.wanted import Wanted
    from planner.inversion.arguments import Norm

Command = Callable[..., Any]


def options(command: Command) -> Command:
    """Add the options that state a tolerance."""
    for unit, of in (("cm", "the foot"), ("deg", "any joint")):
        command = click.option(
            f"--tolerance-{unit}",
            type=float,
            metavar=unit.upper(),
            help=f"Error of {of} to accept, in the plan's norm; where the plan misses it, its "
            "requests are written all the same, and the exit status is 1.",
        )(command)
    return command


def check_choices(choices: Mapping[str, Any], *, foot: bool) -> None:
    """Refuse tolerances that are none, or that the plan cannot be held against.

    Raises:
        click.UsageError: The message says why.
    """
    for unit, name in (("deg", "degrees"), ("cm", "centimetres")):
        tolerance = choices[f"tolerance_{unit}"]
        if tolerance is not None and not 0.0 < tolerance < math.inf:
            raise click.UsageError(
                f"--tolerance-{unit}: got {tolerance:g}, expected more than 0 {name}."
            )
    if choices["tolerance_deg"] is not None and choices["method"] == "foot-optimal":
        raise click.UsageError(
            "--tolerance-deg is for joints, which --method foot-optimal lets err for the foot's "
            "sake: use --tolerance-cm."
        )
    if choices["tolerance_cm"] is not None and not foot:
        raise click.UsageError("--tolerance-cm is for a foot path: use --tolerance-deg.")


def asked(choices: Mapping[str, Any]) -> bool:
    """Whether a tolerance was given."""
    return any(choices[f"tolerance_{unit}"] is not None for unit in ("deg", "cm"))


def misses(choices: Mapping[str, Any], wanted: Wanted, plan: Plan) -> list[str]:
    """Which tolerances the plan misses, in its norm, and by how much; none where it keeps all."""
    import numpy as np

    from planner.inversion.error_norm import error_norm

    norm: Norm = choices["norm"] or "rms"
    found = []
    if choices["tolerance_deg"] is not None:
        for joint, inversion in plan.inversions.items():
            error, least = np.degrees([inversion.error, inversion.lower_bound])
            if error > choices["tolerance_deg"]:
                found.append(
                    f"{joint} is off by {error:.4g} deg ({norm}), expected at most "
                    f"{choices['tolerance_deg']:g}, where no requests reach less than {least:.4g}"
                )
    if choices["tolerance_cm"] is not None:
        distances = 100.0 * plan.foot_distances(wanted)
        error = error_norm(distances, norm)
        if error > choices["tolerance_cm"]:
            found.append(
                f"the foot is off by {error:.4g} cm ({norm}), expected at most "
                f"{choices['tolerance_cm']:g}"
            )
    return found
