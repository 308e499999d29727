"""``request-planner fit``: a joint path in, its piecewise linear approximation out."""

from __future__ import annotations

import math
from typing import Any

import click

from planner.cli import options
from planner.cli.console import Answer, Progress
from planner.cli.declared import Positive, argument, option
from planner.cli.settings import Run
from planner.exceptions import about


@options.command("Write a page (HTML) about the lines, and the error for other numbers of them.")
def fit(
    *,
    run: Run = options.settings(
        "model: file",
        "path: joints",
        "plan: cyclic segments",
        path=argument(form="DESIRED"),
    ),
    max_error: Positive | None = option(
        "Use as few lines as stay this close to the path everywhere.", form="DEG"
    ),
    max_rms: Positive | None = option(
        "Use as few lines as stay this close to the path in root mean square.", form="DEG"
    ),
    exact: bool = option("Prove that no other knots on samples are better."),
    knots: options.Output | None = option(
        "Also write the knots of a single joint: knot_s and value_deg."
    ),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
    """Approximate DESIRED, a CSV of <joint>_deg, _rad or _percent columns, by lines within ±v_max.

    \b
    Example, six lines per joint, and their knots:
        request-planner fit desired.csv --segments 6 --json
    As few lines as stay within 2 degrees, with a page:
        request-planner fit desired.csv --max-error 2 --report fit.html
    """  # noqa: D301
    import numpy as np

    from planner.approximation.fit_pwl import choices, fit_pwl
    from planner.cli.desired import load_joints, model_words, units_in_messages
    from planner.cli.planning import origins_of
    from planner.files.paths import write_curve
    from planner.report.fit_page import fit_page, fit_results, fits_table, proof_words
    from planner.report.wording import CARRIED

    path = load_joints(run)
    options.warn_of(path.remarks)
    units = {name: CARRIED[unit] for name, unit in path.shown_units.items()}
    if knots is not None and len(path.names) > 1:
        raise click.UsageError(
            f"--knots writes one joint, got {', '.join(path.names)}; choose one with --joint."
        )
    arguments: dict[str, Any] = {
        "cyclic": path.cyclic,
        "segments": run.plan.segments,
        "max_error": None if max_error is None else math.radians(max_error),
        "max_rms": None if max_rms is None else math.radians(max_rms),
        "exact": exact,
    }
    fits = {}
    with Progress(len(path.names)) as progress:
        for j, (name, joint) in enumerate(zip(path.names, path.models, strict=True)):
            progress(name)
            with units_in_messages(path.shown_units), about(name):
                fits[name] = fit_pwl(
                    path.angles[:, j], v_max=joint.v_max, tick=joint.period, **arguments
                )
    document = {
        "cyclic": path.cyclic,
        "period_s": path.period,
        "joints": {name: fit_results(curve, units[name]) for name, curve in fits.items()},
    }
    words = (
        f"lines within the top speed; {model_words(run.model)}\n{fits_table(fits, units).text()}"
    )
    words += f"\nproved: {proof}" if (proof := proof_words(fits)) else ""
    angles = np.column_stack([curve.angles for curve in fits.values()])
    if knots is not None:
        ((name, curve),) = fits.items()
        write_curve(knots, curve, unit=path.shown_units[name])
    return Answer(
        document,
        words,
        lambda file: path.write(file, angles),
        lambda: fit_page(fits, {name: choices(curve) for name, curve in fits.items()}, units),
        origins_of(run),
    )
