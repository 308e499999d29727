"""From the options that choose a leg, ``--leg``, ``--base``, ``--foot`` and others, to the leg."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from planner.cli.limits import finite

if TYPE_CHECKING:
    from kinematics import Leg


class Place(NamedTuple):
    """Where a leg is described, and what is to be known to find it there.

    Attributes:
        urdf: The file.
        base: The frame at its upper end.
        foot: The frame at its lower end.
        locked: Joints between them that are held, and where [rad; m for one that slides].
        near: A pose near which paths start [rad]; None for any.
    """

    urdf: str
    base: str
    foot: str
    locked: Mapping[str, float] = {}
    near: Mapping[str, float] | None = None


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


class LegName(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """The name of a shipped leg, or the URDF of a robot."""

    name = "leg"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The same text, if it is either."""
        text = str(value)
        if text not in SHIPPED and not _is_file(text):
            names = ", ".join(f"'{name}'" for name in SHIPPED)
            self.fail(f"'{text}' is not one of {names}, nor a .urdf file.", param, ctx)
        return text

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002
        param: click.Parameter,  # noqa: ARG002
        incomplete: str,
    ) -> list[CompletionItem]:
        """The names that begin like this, or files where none does."""
        names = [CompletionItem(name) for name in SHIPPED if name.startswith(incomplete)]
        return names or [CompletionItem(incomplete, type="file")]


def _is_file(text: str) -> bool:
    return text.lower().endswith((".urdf", ".xml")) or os.sep in text


def options(command: Command) -> Command:
    """Add the options that choose a leg."""
    for option in (
        click.option(
            "--near",
            multiple=True,
            metavar="JOINT=DEG",
            help="A pose near which to start, of several that reach the first point; several times "
            "for several joints.",
        ),
        click.option(
            "--lock",
            multiple=True,
            metavar="JOINT=DEG",
            help="With a URDF: hold a joint, so that three remain; JOINT=0.1m one that slides.",
        ),
        click.option("--foot", metavar="FRAME", help="Frame of the foot in the URDF."),
        click.option("--base", metavar="FRAME", help="Frame of the foot positions in the URDF."),
        click.option("--urdf", metavar="FILE", help="The same as --leg FILE.urdf."),
        click.option(
            "--leg",
            type=LegName(),
            metavar="NAME|FILE.urdf",
            help="A leg of your own robot, with --base and --foot; or a shipped one: "
            f"{', '.join(SHIPPED)}. Positions are in the base's frame: the body's, and for "
            "'reference' the hip's.",
        ),
    ):
        command = option(command)
    return command


def load_leg(choices: Mapping[str, Any]) -> Leg | None:
    """The leg that the options describe; None where they name none.

    Raises:
        click.UsageError: The options contradict each other or do not suffice.
        KinematicsError: The leg cannot be made.
    """
    place = find_leg(choices)
    if place is None:
        return None
    from kinematics import Leg

    return Leg.from_urdf(
        place.urdf, base=place.base, foot=place.foot, locked=place.locked, near=place.near
    )


def find_leg(choices: Mapping[str, Any]) -> Place | None:
    """Where that leg is described; None where the options name none.

    Raises:
        click.UsageError: The options contradict each other or do not suffice.
    """
    leg, urdf, base, foot = (choices[key] for key in ("leg", "urdf", "base", "foot"))
    lock, near = choices.get("lock", ()), choices.get("near", ())
    if leg is not None and leg not in SHIPPED:
        if urdf is not None:
            raise click.UsageError("--leg and --urdf name a file each: leave one out.")
        leg, urdf = None, leg
    posed = _positions(near, "--near") if near else None
    if leg is not None:
        if urdf is not None or base is not None or foot is not None or lock:
            raise click.UsageError(
                "--leg is a shipped leg: leave out --urdf, --base, --foot and --lock."
            )
        from kinematics import urdf_path

        shipped = SHIPPED[leg]
        return shipped._replace(urdf=str(urdf_path(shipped.urdf)), near=posed)
    if urdf is None:
        if base is not None or foot is not None or lock or near:
            raise click.UsageError("--base, --foot, --lock and --near are of a leg: add --leg.")
        return None
    if base is None or foot is None:
        raise click.UsageError("a URDF needs --base and --foot, the frames at the leg's two ends.")
    return Place(urdf, base, foot, _positions(lock, "--lock", slides=True), posed)


def title(choices: Mapping[str, Any]) -> str:
    """What the leg that the options describe is called on pages; nothing where they name none."""
    leg = choices.get("leg") or choices.get("urdf") or ""
    return leg if leg in SHIPPED or not leg else f"{PurePath(leg).name} · {choices['foot']}"


def _positions(given: Sequence[str], option: str, *, slides: bool = False) -> dict[str, float]:
    """Positions by joint [rad; m where they say so]."""
    positions = {}
    for entry in given:
        joint, _, text = entry.rpartition("=")
        metres = slides and text.endswith("m")
        number = finite(text.removesuffix("m") if metres else text)
        if not joint or math.isnan(number):
            raise click.UsageError(
                f"{option}: got '{entry}', expected JOINT=DEG, such as wrist=-90."
            )
        positions[joint] = number if metres else math.radians(number)
    return positions
