"""``request-planner fit``: a joint path in, its piecewise linear approximation out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.say import deliver, naming
from planner.cli.wanted import load_wanted

if TYPE_CHECKING:
    from planner.approximation.fit import PiecewiseLinearFit


@click.command(short_help="Approximate joint angles by lines that a joint can follow.")
@click.argument("desired")
@options.model
@options.joints
@options.cyclic
@options.segments
@click.option(
    "--max-error",
    type=float,
    metavar="DEG",
    help="Use as few lines as stay this close to the path everywhere.",
)
@options.output
@options.as_json
def fit(
    *,
    desired: str,
    model: str,
    joints: tuple[str, ...],
    cyclic: bool,
    segments: int | None,
    max_error: float | None,
    output: str,
    as_json: bool,
) -> None:
    """Approximate DESIRED, a CSV of <joint>_deg or <joint>_rad columns, by lines within ±v_max.

    \b
    Example, six lines per joint, and their knots:
        request-planner fit desired.csv --segments 6 --json
    """  # noqa: D301
    import numpy as np

    from planner.approximation.fit import fit_pwl
    from planner.files.joint_path import write_joint_path
    from planner.report.text_table import text_table

    if max_error is not None and not 0.0 < max_error < math.inf:
        raise click.UsageError(f"--max-error: got {max_error:g}, expected more than 0 degrees.")
    wanted = load_wanted(desired, model=model, joints=joints, takes_leg=False)
    tolerance = None if max_error is None else float(np.radians(max_error))
    fits = {}
    for j, (name, joint) in enumerate(zip(wanted.names, wanted.models, strict=True)):
        with naming(name):
            fits[name] = fit_pwl(
                wanted.angles[:, j],
                v_max=joint.v_max,
                tick=joint.period,
                cyclic=cyclic,
                segments=segments,
                max_error=tolerance,
            )
    document = {
        "cyclic": cyclic,
        "period_s": wanted.period,
        "joints": {name: _document(curve) for name, curve in fits.items()},
    }
    rows = [
        [
            name,
            str(len(curve.slopes)),
            f"{np.degrees(curve.rms):.3f}",
            f"{np.degrees(curve.max_error):.3f}",
        ]
        for name, curve in fits.items()
    ]
    angles = np.column_stack([curve.angles for curve in fits.values()])
    deliver(
        document,
        text_table(["joint", "lines", "rms [deg]", "max [deg]"], rows),
        lambda file: write_joint_path(file, wanted.names, angles, period=wanted.period),
        output=output,
        as_json=as_json,
    )


def _document(curve: PiecewiseLinearFit) -> dict[str, Any]:
    import numpy as np

    return {
        "segments": len(curve.slopes),
        "rms_deg": float(np.degrees(curve.rms)),
        "max_deg": float(np.degrees(curve.max_error)),
        "knots": curve.knots.tolist(),
        "values_deg": np.degrees(curve.values).tolist(),
        "slopes_deg_per_s": np.degrees(curve.slopes).tolist(),
        "angles_deg": np.degrees(curve.angles).tolist(),
    }
