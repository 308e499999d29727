"""What may be asked of `request-planner fit`, in degrees and seconds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--max-error",
        type=float,
        metavar="DEG",
        help="Use as few lines as stay this close to the path everywhere.",
    ),
    click.option(
        "--max-rms",
        type=float,
        metavar="DEG",
        help="Use as few lines as stay this close to the path in root mean square.",
    ),
    click.option(
        "--knot-s",
        "knot_s",
        type=float,
        multiple=True,
        metavar="S",
        help="Time of a knot; several times for all knots. Only their angles are then sought.",
    ),
    click.option(
        "--required-s",
        "required_s",
        multiple=True,
        metavar="S[=DEG]",
        help="Time at which there must be a knot, and perhaps its angle; several times for more.",
    ),
    click.option(
        "--shortest-s",
        "shortest_s",
        type=float,
        metavar="S",
        help="Duration of the shortest line.  [default: one sample]",
    ),
    click.option("--start-deg", type=float, metavar="DEG", help="Angle at the start of a path."),
    click.option("--end-deg", type=float, metavar="DEG", help="Angle at the end of a path."),
    click.option("--on-samples", is_flag=True, help="Put knots on samples only."),
    click.option("--exact", is_flag=True, help="Prove that no other knots on samples are better."),
)


def add_fit_options(command: Command) -> Command:
    """Give a command every option of :func:`asked`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def asked(options: dict[str, Any], period: float) -> dict[str, Any]:
    """The options as keywords of :func:`planner.fit_pwl`.

    Args:
        options: What click read.
        period: Time between samples [s].

    Raises:
        click.UsageError: An error or a duration is not above 0, a required knot is unreadable, or a
            cycle is to have ends.
    """
    for name in ("max_error", "max_rms", "shortest_s"):
        value = options[name]
        if value is not None and not 0.0 < value < math.inf:
            unit = "seconds" if name == "shortest_s" else "degrees"
            raise click.UsageError(
                f"--{name.replace('_', '-')}: got {value:g}, expected more than 0 {unit}."
            )
    ends = options["start_deg"], options["end_deg"]
    for name, angle in zip(("--start-deg", "--end-deg"), ends, strict=True):
        if options["cyclic"] and angle is not None:
            raise click.UsageError(f"{name}: a cycle has no ends; add --no-cyclic.")
    given: dict[str, Any] = {
        "cyclic": options["cyclic"],
        "segments": options["segments"],
        "required": dict(_knot(text, period) for text in options["required_s"]),
        "ends": tuple(None if angle is None else math.radians(angle) for angle in ends),
        "on_samples": options["on_samples"],
        "exact": options["exact"],
    }
    for name in ("max_error", "max_rms"):
        if options[name] is not None:
            given[name] = math.radians(options[name])
    if options["shortest_s"] is not None:
        given["shortest"] = _samples(options["shortest_s"], period)
    if options["knot_s"]:
        given["knots"] = [_samples(time, period) for time in options["knot_s"]]
    return given


def _samples(time: float, period: float) -> float:
    """Time in samples; whole where the seconds were a multiple of the period but for rounding."""
    count = time / period
    return float(round(count)) if abs(count - round(count)) < 1e-6 else count


def _knot(text: str, period: float) -> tuple[float, float | None]:
    """Place and angle of a required knot, from '0.4' or '0.4=12.5'."""
    time, equals, angle = text.partition("=")
    try:
        place = _samples(float(time), period)
        return place, math.radians(float(angle)) if equals else None
    except (ValueError, OverflowError):
        raise click.UsageError(
            f"--required-s: got '{text}', expected seconds (0.4) or seconds=degrees (0.4=12.5)."
        ) from None
