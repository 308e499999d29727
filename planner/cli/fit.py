"""``request-planner fit``: a joint path in, its piecewise linear approximation out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import click

from planner.cli import options
from planner.cli.console import Answer, Progress
from planner.cli.declared import Positive, argument, option
from planner.cli.settings import Run
from planner.exceptions import PlannerError, about


def _knot(text: str) -> tuple[float, float | None]:
    """Time [s] and angle [rad] of a required knot, from '0.4' or '0.4=12.5'."""
    time, equals, angle = text.partition("=")
    return float(time), math.radians(float(angle)) if equals else None


KNOT = options.Parsed(_knot, "S[=DEG]", "seconds (0.4) or seconds=degrees (0.4=12.5)")


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
    knot_s: tuple[float, ...] = option(
        "Time of a knot. Repeat the option for each knot. Only their angles are then sought."
    ),
    required_s: Annotated[tuple[tuple[float, float | None], ...], KNOT] = option(
        "Time at which there must be a knot, and perhaps its angle. Repeat it for more."
    ),
    exact: bool = option("Prove that no other knots on samples are better."),
    knots: options.Output | None = option(
        "Also write the knots of a single joint: knot_s and value_deg, or JSON for FILE.json."
    ),
    output: str = options.output,
) -> Answer:
    """Approximate DESIRED, a CSV of <joint>_deg or <joint>_rad columns, by lines within ±v_max.

    \b
    Example, six lines per joint, and their knots:
        request-planner fit desired.csv --segments 6 --json
    As few lines as stay within 2 degrees, with a page:
        request-planner fit desired.csv --max-error 2 --report fit.html
    """  # noqa: D301
    import numpy as np

    from planner.approximation.fit_pwl import choices, fit_pwl
    from planner.cli.desired import check_angles, load_joints, model_words
    from planner.cli.planning import inputs_of, origins_of
    from planner.files.paths import write_curve
    from planner.report.fit_page import fit_page, fit_results, fits_table, proof_words

    path = load_joints(run)
    options.warn_of(path.remarks)
    check_angles(path.names, path.units)
    if knots is not None and len(path.names) > 1:
        raise click.UsageError(
            f"--knots writes one joint, got {', '.join(path.names)}; choose one with --joint."
        )
    arguments: dict[str, Any] = {
        "cyclic": path.cyclic,
        "segments": run.plan.segments,
        "max_error": None if max_error is None else math.radians(max_error),
        "max_rms": None if max_rms is None else math.radians(max_rms),
        "knots": [_samples(time, path.period) for time in knot_s] or None,
        "required": {
            _samples(time, path.period): angle
            for time, angle in options.by_name("--required-s", required_s).items()
        },
        "exact": exact,
    }
    fits = {}
    with Progress(len(path.names)) as progress:
        for j, (name, joint) in enumerate(zip(path.names, path.models, strict=True)):
            progress(name)
            with about(name), _in_seconds(path.period):
                fits[name] = fit_pwl(
                    path.angles[:, j], v_max=joint.v_max, tick=joint.period, **arguments
                )
    document = {
        "cyclic": path.cyclic,
        "period_s": path.period,
        "joints": {name: fit_results(curve) for name, curve in fits.items()},
    }
    words = f"lines within the top speed; {model_words(run.model)}\n{fits_table(fits).text()}"
    words += f"\nproved: {proof}" if (proof := proof_words(fits)) else ""
    angles = np.column_stack([curve.angles for curve in fits.values()])
    if knots is not None:
        write_curve(knots, next(iter(fits.values())))
    return Answer(
        document,
        words,
        lambda file: path.write(file, angles),
        lambda: fit_page(fits, {name: choices(curve) for name, curve in fits.items()}),
        origins_of(run),
        [*inputs_of(path), ("lines", output), ("knots", knots)],
    )


@contextmanager
def _in_seconds(period: float) -> Iterator[None]:
    """Let errors inside the block name the times [s] of samples, as their user has."""
    try:
        yield
    except PlannerError as error:
        message, number = str(error), r"\bsample (\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
        error.args = (re.sub(number, lambda each: f"{period * float(each[1]):.6g} s", message),)
        raise


def _samples(time: float, period: float) -> float:
    """Time in samples; whole where the seconds were a multiple of the period but for rounding."""
    count = time / period
    if not math.isfinite(count):
        return count  # which the fit refuses
    return float(round(count)) if abs(count - round(count)) < 1e-6 else count
