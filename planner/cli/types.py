"""Types of options: each parses a value once, refuses invalid ones, and completes it in a shell.

NAME=VALUE of a joint, numbers above 0, a leg or a URDF, and names of files and folders. A file or a
folder that is to be written is checked here, before anything is computed; so is that no output
overwrites an input.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args

import click
from click.shell_completion import CompletionItem

from planner.files.staging import cannot_write, check_folder, check_writable

ShippedLeg = Literal["reference", "front-left", "front-right", "hind-left", "hind-right"]

SHIPPED = get_args(ShippedLeg)
"""The legs that need no description."""


class Parsed(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """A value that a function parses."""

    name = "value"

    def __init__(self, parse: Callable[[str], Any], expected: str) -> None:
        """Take a function that raises ValueError, and the expected text in words."""
        self.parse = parse
        self.expected = expected

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value of a text."""
        try:
            return self.parse(value)
        except (ValueError, OverflowError):
            option = "" if param is None else f"{param.opts[0]}: "
            message = f"{option}got '{value}', expected {self.expected}."
            raise click.UsageError(message, ctx) from None


def by_joint(parse: Callable[[str], Any], expected: str, *, all_joints: bool = True) -> Parsed:
    """A pair of joint and value: NAME=VALUE for one joint, VALUE for all joints, named ""."""

    def parse_named(text: str) -> tuple[str, Any]:
        joint, equals, value = text.rpartition("=")
        if not joint and (equals or not all_joints):
            raise ValueError
        return joint, parse(value)

    return Parsed(parse_named, expected)


class LegName(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """The name of a shipped leg, or the URDF of a robot."""

    name = "leg"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The same text, if it is a shipped leg or a URDF."""
        text = str(value)
        is_file = text.lower().endswith((".urdf", ".xml")) or os.sep in text
        if text not in SHIPPED and not is_file:
            names = ", ".join(f"'{name}'" for name in SHIPPED)
            self.fail(f"'{text}' is not one of {names}, nor a .urdf file.", param, ctx)
        return text

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002
        """The names that begin like this, or files if no name does."""
        names = [CompletionItem(name) for name in SHIPPED if name.startswith(incomplete)]
        return names or [CompletionItem(incomplete, type="file")]


class Place(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.5 on
    """The name of a file or a folder, which a shell completes; one to write is checked at once."""

    def __init__(
        self,
        kind: str,
        check: Callable[[str], None] = lambda _: None,
        *,
        use: Literal["read", "written"] | None,
    ) -> None:
        """Complete to ``file``, which has folders on the way, or ``dir``, and check the name.

        A written place must not have another use in the same command; a ``use`` of None is of a
        file that may be both input and output.
        """
        self.name = self.kind = kind
        self.check = check
        self.use = use

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The same text, where it passes the check."""
        self.check(value)
        text = str(value)
        if self.use is not None and param is not None and ctx is not None:
            self._check_uses(text, param, ctx)
        return text

    def _check_uses(self, text: str, param: click.Parameter, ctx: click.Context) -> None:
        """Refuse a place that is written and has another use in this command."""
        place = Path(os.path.realpath(text))  # of a link to itself, too
        is_device = place.exists() and not (place.is_file() or place.is_dir())
        if text == "-" and self.use == "written":
            place, text = Path(text), "standard output"
        elif text == "-" or is_device:
            return
        uses = ctx.meta.setdefault(f"{__name__}.places", {}).setdefault(place, {})
        uses[param.name] = self.use
        if len(uses) > 1 and "written" in uses.values():
            reason = "an input too" if "read" in uses.values() else "another output too"
            raise cannot_write(text, ValueError(f"it is {reason}"))

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002
        """Leave it to the shell, which lists files and folders."""
        return [CompletionItem(incomplete, type=self.kind)]


def above_0(unit: str) -> Parsed:
    """A number above 0, in this unit."""

    def parse(text: str) -> float:
        number = finite(text)
        if number <= 0.0:
            raise ValueError
        return number

    return Parsed(parse, f"more than 0 {unit}")


def finite(text: str) -> float:
    """A finite number."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number


def _span(text: str) -> list[float]:
    low, high = (finite(part) for part in text.split(":"))
    if not low < high:
        raise ValueError
    return [low, high]


def _tick(text: str) -> int:
    if not re.fullmatch(r"-?\d{1,9}", text, flags=re.ASCII):
        raise ValueError
    return int(text)


def _position(text: str) -> tuple[str, float]:
    slides = text.endswith("m")
    return "lock_m" if slides else "lock", finite(text.removesuffix("m"))


def _check_file(path: str) -> None:
    if path != "-":
        check_writable(path)


SPAN = Parsed(_span, "LOW:HIGH in degrees with LOW below HIGH, such as -27:147")
SPANS = by_joint(
    _span, "LOW:HIGH or JOINT=LOW:HIGH in degrees with LOW below HIGH, such as knee=-27:147"
)
ANGLES = by_joint(finite, "degrees, as DEG or JOINT=DEG, such as knee=30")
POSE = by_joint(finite, "JOINT=DEG, such as wrist=-90", all_joints=False)
PARAMETER = by_joint(finite, "NAME=VALUE, such as length=0.04", all_joints=False)
POSITIONS = by_joint(_position, "JOINT=DEG, such as wrist=-90", all_joints=False)
LIST = Parsed(lambda text: [each.strip() for each in text.split(",")], "A,B,C")
NAMES = by_joint(str, "JOINT=NAME, such as Rotation=shoulder_pan", all_joints=False)
TICKS = by_joint(_tick, "N or JOINT=N, such as knee=2048")

UNITS_OF_OPTIONS = {
    "hz": "hertz",
    "s": "seconds",
    "ms": "milliseconds",
    "deg": "degrees",
    "cm": "centimetres",
}
"""Units that end the name of an option, such as --rate-hz."""

INPUT = Place("file", use="read")
OUTPUT = Place("file", _check_file, use="written")
FOLDER = Place("dir", check_folder, use="written")
OUTPUT_OR_FOLDER = Place("file", use="written")  # checked once the format is known
REWRITTEN = Place("file", use=None)
