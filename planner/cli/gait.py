"""``request-planner gait``: parameters of a walk in, the path of a foot out."""

from __future__ import annotations

import click

from planner.cli import options
from planner.cli.say import deliver

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
@click.option("--length", default=0.04893, show_default=True, help="Half of the stroke [m].")
@click.option("--height", default=0.042, show_default=True, help="How high the foot swings [m].")
@click.option("--forward", default=0.049, show_default=True, help="Middle before the hip [m].")
@click.option("--sideways", default=0.028, show_default=True, help="Outward of the hip [m].")
@click.option("--hip-height", default=0.077, show_default=True, help="Hip above ground [m].")
@click.option("--ground-fraction", default=0.5, show_default=True, help="Part on the ground.")
@options.output
@options.as_json
def gait(*, samples: int, period: float, output: str, as_json: bool, **parameters: float) -> None:
    """Make the half-ellipse foot path of a walk, in the hip's frame; by default the paper's.

    \b
    Example, a longer and flatter step:
        request-planner gait --length 0.055 --height 0.03 -o foot.csv
    """  # noqa: D301
    from planner.files.foot_path import write_foot_path
    from planner.gait import half_ellipse

    if not SHORTEST <= period <= LONGEST:
        raise click.UsageError(
            f"--period: got {period:g}, expected {SHORTEST:g} to {LONGEST:g} seconds."
        )
    path = half_ellipse(samples=samples, **parameters)
    deliver(
        {
            "period_s": period,
            "x_m": path[:, 0].tolist(),
            "y_m": path[:, 1].tolist(),
            "z_m": path[:, 2].tolist(),
        },
        f"a cycle of {samples} samples, {samples * period:g} s",
        lambda file: write_foot_path(file, path, period=period),
        output=output,
        as_json=as_json,
    )
