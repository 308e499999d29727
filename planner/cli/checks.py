"""The last look at a plan before it is handed over; an answer that fails it ends with status 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from planner.inversion.result import Inversion

ROUNDING = 1e-9
"""Limits and bounds hold up to this [rad]; files carry 12 decimals of a degree."""


def check_plan(
    joint: str, inversion: Inversion, limits: tuple[float, float] | None, *, by_user: bool
) -> None:
    """Make sure that the requests keep to their limits, and that the error is not below its bound.

    The closed form knows no limits: beyond those of the leg it earns a warning, beyond those that
    the user has asked for it fails.

    Raises:
        click.ClickException: A check failed.
    """
    import numpy as np

    error = inversion.rms if inversion.norm == "rms" else inversion.max_error
    if error < inversion.lower_bound - ROUNDING:
        raise click.ClickException(
            f"{joint}: an error of {np.degrees(error):.6g} deg is below its own lower bound of "
            f"{np.degrees(inversion.lower_bound):.6g} deg; please report this with the path and "
            "the model"
        )
    if limits is None:
        return
    lower, upper = limits
    excess = np.maximum(lower - inversion.requests, inversion.requests - upper)
    worst = int(np.argmax(excess))
    if excess[worst] <= ROUNDING:
        return
    message = (
        f"{joint}: request {worst} is {np.degrees(inversion.requests[worst]):.2f} deg, beyond the "
        f"limits {np.degrees(lower):.2f} to {np.degrees(upper):.2f}; "
        "--method optimal keeps to them"
    )
    if by_user or inversion.method != "closed_form":
        raise click.ClickException(message)
    click.echo(f"request-planner: warning: {message}", err=True)
