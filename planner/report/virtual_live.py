"""What is live on the page of the virtual robot's experiment beside what both experiments share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve, Panel
from planner.report.live_plane import Axis, plane_plot
from planner.report.live_plot import time_plot
from planner.report.style import CLOSED_FORM, GRID, INK, MUTED

if TYPE_CHECKING:
    from planner.evaluation.virtual_outcome import VirtualOutcome
    from planner.trajectory import Array

THIN = 0.9
"""Width of a residual [pt]."""


def steps_plot(outcome: VirtualOutcome) -> dict[str, Any]:
    """Figures 3 and 4: the sensors' records of each step test's last cycle, and the model's."""
    samples = len(outcome.planned.walk.desired)
    times, last = np.arange(float(samples)), slice(-samples, None)
    panels = []
    for found, joint in zip(outcome.identifications, outcome.planned.joints, strict=True):
        middles = [float(np.mean(fit.log.requests[last])) for fit in found.fits]
        predicted, measured = (
            _one_after_another(
                [np.degrees(each[last] - at) for each, at in zip(values, middles, strict=True)]
            )
            for values in (
                [fit.predicted for fit in found.fits],
                [fit.log.angles for fit in found.fits],
            )
        )
        along = _one_after_another([times] * len(found.fits))
        curves = (
            Curve(CLOSED_FORM._replace(width=1.4), along, predicted, "identified model"),
            Curve(INK, along, measured, "measured by the sensor", dots=True, filled=0.55),
        )
        left = Curve(MUTED._replace(width=THIN), along, measured - predicted, "residual")
        panels.append(Panel(joint.name, "angle", "deg", curves))
        title = f"{joint.name}, residual, {np.degrees(found.rms):.2f} deg rms"
        panels.append(Panel(title, "residual", "deg", (left,), height=0.6))
    return time_plot(panels, unit="ms", scale=1000.0 * outcome.constants.request_period)


def promises_plot(outcome: VirtualOutcome) -> dict[str, Any]:
    """The foot's accuracy by method: as planned, as executed, and on the paper's robot."""
    from planner.evaluation.paper import published_foot
    from planner.report.paper_tables import METHODS

    executed, planned = outcome.foot_table, outcome.planned.foot_table
    rows = np.arange(float(len(METHODS)))
    names = [label.split(":")[0] for label in METHODS.values()]
    promised = np.array([planned[method].rms for method in METHODS])
    done = np.array([executed[method].mean.rms for method in METHODS])
    theirs = [published_foot(method) for method in METHODS]
    known = np.array([each is not None for each in theirs])
    figures = np.array([each.L2.mean for each in theirs if each is not None])
    gaps = np.full(len(rows), np.nan)
    joined, along = (
        np.column_stack([*pair, gaps]).ravel() for pair in ((promised, done), (rows, rows))
    )
    notes = tuple(names)
    told = tuple(name for name, there in zip(names, known, strict=True) if there)
    return plane_plot(
        [
            Curve(GRID._replace(label="loss", width=2.6), joined, along),
            Curve(CLOSED_FORM, promised, rows, "planned", dots=True, notes=notes),
            Curve(CLOSED_FORM, done, rows, "executed", dots=True, filled=1.0, notes=notes),
            Curve(INK, figures, rows[known], "the paper's robot", dots=True, notes=told),
        ],
        Axis("foot error, L₂ [cm]", "cm", (0.0, 1.06 * max(*promised, *done, *figures))),
        Axis("", range=(len(rows) - 0.4, -0.6), names=dict(zip(rows.tolist(), names, strict=True))),
        height=300,
    )


def _one_after_another(parts: list[Array]) -> Array:
    """Several curves as one, with gaps between them."""
    return np.concatenate([np.append(part, np.nan) for part in parts])[:-1]
