"""``request-planner gait``: parameters of a walk in, the path of a foot out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from planner.cli import legs, options
from planner.cli.say import deliver

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.stride import Stride

SHAPE = ("length", "height", "forward", "sideways", "hip_height")
"""Options that have other defaults for a leg."""

SHORTEST, LONGEST = 1e-6, 1e3
"""Range of the time between samples [s]: beyond it the unit is surely mistaken."""


@click.command(short_help="Make the foot path of a walk.")
@click.option(
    "--samples",
    type=click.IntRange(max=1_000_000),
    default=88,
    show_default=True,
    help="Samples in a cycle.",
)
@click.option("--period", default=0.008, show_default=True, help="Time between samples [s].")
@click.option("--length", type=float, help="Half of the stroke [m].  [default: 0.04893]")
@click.option("--height", type=float, help="How high the foot swings [m].  [default: 0.042]")
@click.option("--forward", type=float, help="Middle before the hip [m].  [default: 0.049]")
@click.option("--sideways", type=float, help="Outward of the hip [m].  [default: 0.028]")
@click.option("--hip-height", type=float, help="Hip above ground [m].  [default: 0.077]")
@click.option("--ground-fraction", default=0.5, show_default=True, help="Part on the ground.")
@click.option(
    "--heading-deg",
    default=0.0,
    show_default=True,
    help="Where the walk goes, from x towards y: 90 is sideways along y, 180 backward.",
)
@legs.options
@options.output
@options.as_json
def gait(*, samples: int, period: float, output: str, as_json: bool, **choices: Any) -> None:
    """Make the half-ellipse foot path of a walk, in the hip's frame; by default the paper's.

    With a leg the path is in the base's frame, around the foot of the leg's standing pose (--near),
    and as large as the leg can trace it well; options overrule that.

    \b
    Example, a longer and flatter step, and one as large as a leg can trace:
        request-planner gait --length 0.055 --height 0.03 -o foot.csv
        request-planner gait --leg front-left -o foot.csv
    """  # noqa: D301
    from planner.files.foot_path import write_foot_path
    from planner.gait import half_ellipse
    from planner.stride import stride

    if not SHORTEST <= period <= LONGEST:
        raise click.UsageError(
            f"--period: got {period:g}, expected {SHORTEST:g} to {LONGEST:g} seconds."
        )
    given = {name: choices[name] for name in SHAPE if choices[name] is not None}
    given |= {"samples": samples, "ground_fraction": choices["ground_fraction"]}
    given |= {"heading": math.radians(choices["heading_deg"])}
    leg = legs.load_leg(choices)
    document: dict[str, Any] = {"period_s": period}
    said = f"a cycle of {samples} samples, {samples * period:g} s"
    if leg is None:
        path = half_ellipse(**given)
    else:
        made = stride(leg, **given)
        path = made.foot
        document["stride"] = about(leg, made, period)
        said += f"\n{told(document['stride'])}"
    document |= {f"{axis}_m": path[:, k].tolist() for k, axis in enumerate("xyz")}
    deliver(
        document,
        said,
        lambda file: write_foot_path(file, path, period=period),
        output=output,
        as_json=as_json,
    )


def about(leg: Leg, made: Stride, period: float) -> dict[str, Any]:
    """The walk of a leg for machines."""
    import numpy as np

    closed = np.vstack([made.angles, made.angles[:1]])
    speeds = np.abs(np.diff(closed, axis=0)).max(axis=0) / period
    return {
        "length_m": made.length,
        "height_m": made.height,
        "centre_m": made.centre.tolist(),
        "pose_deg": dict(zip(leg.joint_names, np.degrees(made.pose).tolist(), strict=True)),
        "speeds_deg_s": dict(zip(leg.joint_names, np.degrees(speeds).tolist(), strict=True)),
    }


def told(about: Mapping[str, Any]) -> str:
    """The walk of a leg for people."""
    x, y, z = about["centre_m"]
    pose = " ".join(f"--near {name}={angle:g}" for name, angle in about["pose_deg"].items())
    speeds = ", ".join(f"{name} {speed:.0f}" for name, speed in about["speeds_deg_s"].items())
    return (
        f"half stroke {about['length_m']:.4g} m, height {about['height_m']:.4g} m, "
        f"around ({x:.4g}, {y:.4g}, {z:.4g}) m, the foot of {pose}\n"
        f"fastest on the way [deg/s]: {speeds}"
    )
