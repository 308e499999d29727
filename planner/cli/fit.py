"""``request-planner fit``: a joint path in, its piecewise linear approximation out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.fit_options import add_fit_options, asked, weighed
from planner.cli.say import Progress, deliver, naming
from planner.cli.wanted import load_wanted

if TYPE_CHECKING:
    from planner.approximation.fit import PiecewiseLinearFit
    from planner.cli.wanted import Wanted
    from planner.trajectory import Array


@click.command(short_help="Approximate joint angles by lines that a joint can follow.")
@click.argument("desired")
@options.model
@options.joints
@options.cyclic
@options.segments
@add_fit_options
@click.option(
    "--knots",
    "knots_file",
    metavar="FILE",
    help="Also write the knots of a single joint: knot_s and value_deg, or JSON for FILE.json.",
)
@click.option(
    "--figure",
    metavar="FILE",
    help="Also draw the lines, and the error for other numbers of them, as .svg or .png.",
)
@options.output
@options.as_json
def fit(
    *,
    desired: str,
    model: str,
    joints: tuple[str, ...],
    cyclic: bool,
    knots_file: str | None,
    figure: str | None,
    output: str,
    as_json: bool,
    **given: Any,
) -> None:
    """Approximate DESIRED, a CSV of <joint>_deg or <joint>_rad columns, by lines within ±v_max.

    \b
    Example, six lines per joint, and their knots:
        request-planner fit desired.csv --segments 6 --json
    As few lines as stay within 2 degrees, with a picture:
        request-planner fit desired.csv --max-error 2 --figure fit.svg
    """  # noqa: D301
    import numpy as np

    from planner.files.joint_path import write_joint_path
    from planner.files.table import read_table
    from planner.report.text_table import text_table

    if figure is not None and Path(figure).suffix.lower() not in (".svg", ".png"):
        raise click.UsageError(
            f"--figure: got '{figure}', expected a name that ends in .svg or .png."
        )
    weights, table = weighed(given["weights"], read_table(desired))
    wanted = load_wanted(desired, model=model, joints=joints, takes_leg=False, table=table)
    if knots_file is not None and len(wanted.names) > 1:
        raise click.UsageError(
            f"--knots writes one joint, got {', '.join(wanted.names)}; choose one with --joint."
        )
    question = asked({**given, "cyclic": cyclic}, wanted.period)
    fits = _fits(wanted, weights, question)
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
    _write_extras(fits, knots_file, figure)
    deliver(
        document,
        text_table(["joint", "lines", "rms [deg]", "max [deg]"], rows),
        lambda file: write_joint_path(file, wanted.names, angles, period=wanted.period),
        output=output,
        as_json=as_json,
    )


def _fits(
    wanted: Wanted, weights: Array | None, question: dict[str, Any]
) -> dict[str, PiecewiseLinearFit]:
    from planner.approximation.fit import fit_pwl

    fits = {}
    with Progress(wanted.names) as progress:
        for j, (name, joint) in enumerate(zip(wanted.names, wanted.models, strict=True)):
            progress(name)
            with naming(name):
                fits[name] = fit_pwl(
                    wanted.angles[:, j],
                    v_max=joint.v_max,
                    tick=joint.period,
                    weights=weights,
                    **question,
                )
    return fits


def _write_extras(
    fits: dict[str, PiecewiseLinearFit], knots_file: str | None, figure: str | None
) -> None:
    if knots_file is not None:
        from planner.files.curve import write_curve

        (only,) = fits.values()
        write_curve(knots_file, only)
    if figure is not None:
        from planner.approximation.choices import choices
        from planner.files.text import write_bytes
        from planner.report.draw_fit import draw_fits_and_choices
        from planner.report.render import to_png, to_svg
        from planner.report.style import applied

        with applied():
            picture = draw_fits_and_choices(
                fits, {name: choices(curve) for name, curve in fits.items()}
            )
        is_svg = Path(figure).suffix.lower() == ".svg"
        write_bytes(figure, to_svg(picture).encode() if is_svg else to_png(picture))


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
