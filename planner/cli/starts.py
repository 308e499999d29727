"""The option ``--start-deg``: where the joints rest before a path that does not repeat."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import click

from planner.cli.limits import finite

option = click.option(
    "--start-deg",
    "--start",
    multiple=True,
    metavar="[JOINT=]DEG",
    help="With --no-cyclic: where all joints, or one, rest before the path begins.",
)


def parse_starts(
    given: Sequence[str], joints: Sequence[str], *, cyclic: bool
) -> Mapping[str, float]:
    """Start of each joint that the option names [rad].

    Raises:
        click.UsageError: The path repeats, an entry cannot be understood, or it names no joint.
    """
    if given and cyclic:
        raise click.UsageError("--start-deg: a cycle has no start; add --no-cyclic.")
    starts: dict[str, float] = {}
    for entry in sorted(given, key=lambda entry: "=" in entry):  # single joints have the last word
        joint, equals, text = entry.rpartition("=")
        angle = finite(text)
        if math.isnan(angle) or (equals and not joint):
            raise click.UsageError(
                f"--start-deg: got '{entry}', expected DEG or JOINT=DEG, such as knee=30."
            )
        if joint and joint not in joints:
            raise click.UsageError(
                f"--start-deg: no joint '{joint}' in the path; joints: {', '.join(joints)}."
            )
        for name in [joint] if joint else joints:
            starts[name] = math.radians(angle)
    return starts
