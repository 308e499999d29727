"""The last look at a plan before it is handed over; an answer that fails it ends with status 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from planner.cli.say import warn

if TYPE_CHECKING:
    from planner.inversion.result import Inversion
    from planner.trajectory import Array

ROUNDING = 1e-9
"""Limits and bounds hold up to this [rad]; files carry 12 decimals of a degree."""


def check_bound(joint: str, inversion: Inversion) -> None:
    """Make sure that the error is not below what no requests can go below.

    Raises:
        click.ClickException: It is, so that one of the two is wrong.
    """
    import numpy as np

    error = inversion.error
    if error < inversion.lower_bound - ROUNDING:
        raise click.ClickException(
            f"{joint}: an error of {np.degrees(error):.6g} deg is below its own lower bound of "
            f"{np.degrees(inversion.lower_bound):.6g} deg; please report this with the path and "
            "the model"
        )


def check_limits(
    joint: str, requests: Array, limits: tuple[float, float], *, may_exceed: bool
) -> None:
    """Make sure that the requests [rad] of a joint keep to its limits [rad].

    Args:
        joint: The joint, for the message.
        requests: Its requests [rad], shape (n,).
        limits: Smallest and largest of them that are allowed [rad].
        may_exceed: Whether requests beyond them deserve a warning only: the closed form knows no
            limits, so those of the leg, which the user has not asked for, do not fail it.

    Raises:
        click.ClickException: A request is beyond them.
    """
    import numpy as np

    lower, upper = limits
    excess = np.maximum(lower - requests, requests - upper)
    worst = int(np.argmax(excess))
    if excess[worst] <= ROUNDING:
        return
    message = (
        f"{joint}: request {worst} is {np.degrees(requests[worst]):.2f} deg, beyond the "
        f"limits {np.degrees(lower):.2f} to {np.degrees(upper):.2f}; "
        "--method optimal keeps to them"
    )
    if not may_exceed:
        raise click.ClickException(message)
    warn(message)
