"""From the options ``--leg`` or ``--urdf``, ``--base`` and ``--foot`` to a leg."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import click

if TYPE_CHECKING:
    from kinematics import Leg


class Place(NamedTuple):
    """Where a leg is described, and the frames at its two ends."""

    urdf: str
    base: str
    foot: str


SHIPPED = {
    "reference": Place("reference_leg.urdf", "hip", "foot"),
    **{
        f"{end}-{side}": Place("ers210a.urdf", "body", f"{end}_{side}_ball")
        for end in ("front", "hind")
        for side in ("left", "right")
    },
}
"""The simplified leg of the reference walk, and the four legs of the ERS-210A."""

Command = Callable[..., Any]

unreachable = click.option(
    "--unreachable",
    type=click.Choice(["raise", "nearest", "clamp"]),
    default="raise",
    show_default=True,
    help="What to do with positions out of reach: stop and list them, take the nearest, or clamp "
    "each joint as the reference walk does.",
)


def options(command: Command) -> Command:
    """Add the options that choose a leg."""
    for option in (
        click.option("--foot", metavar="FRAME", help="Frame of the foot in the URDF."),
        click.option("--base", metavar="FRAME", help="Frame of the foot positions in the URDF."),
        click.option("--urdf", metavar="FILE", help="Leg of your own robot, with --base, --foot."),
        click.option(
            "--leg",
            type=click.Choice(list(SHIPPED)),
            help="A shipped leg; positions are in the body's frame, for 'reference' in the hip's.",
        ),
    ):
        command = option(command)
    return command


def load_leg(leg: str | None, urdf: str | None, base: str | None, foot: str | None) -> Leg | None:
    """The leg that the options describe; None where they name none.

    Raises:
        click.UsageError: The options contradict each other or do not suffice.
        KinematicsError: The leg cannot be made.
    """
    place = find_leg(leg, urdf, base, foot)
    if place is None:
        return None
    from kinematics import Leg

    return Leg.from_urdf(place.urdf, base=place.base, foot=place.foot)


def find_leg(leg: str | None, urdf: str | None, base: str | None, foot: str | None) -> Place | None:
    """Where that leg is described; None where the options name none.

    Raises:
        click.UsageError: The options contradict each other or do not suffice.
    """
    if leg is not None:
        if urdf is not None or base is not None or foot is not None:
            raise click.UsageError("--leg is a shipped leg: leave out --urdf, --base and --foot.")
        from kinematics import urdf_path

        shipped = SHIPPED[leg]
        return shipped._replace(urdf=str(urdf_path(shipped.urdf)))
    if urdf is None:
        if base is not None or foot is not None:
            raise click.UsageError("--base and --foot name frames of a URDF: add --urdf.")
        return None
    if base is None or foot is None:
        raise click.UsageError("--urdf needs --base and --foot, the frames at the leg's two ends.")
    return Place(urdf, base, foot)
