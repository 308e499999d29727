"""The page of a fit: its lines, and those at the top speed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.figure import (
    APPROXIMATION,
    DESIRED,
    DIRECT,
    INK,
    Axis,
    Curve,
    Figure,
    Panel,
    Timeline,
    joined,
)
from planner.report.page import Page
from planner.report.wording import UNITS, Table, Unit, labelled, renamed, table_of, words_of

if TYPE_CHECKING:
    from planner.approximation.fit_pwl import PiecewiseLinearFit


def fit_page(fits: Mapping[str, PiecewiseLinearFit], units: Mapping[str, Unit]) -> Page:
    """The page: every joint's samples and lines."""
    worst = dict[str, str]()  # the joint that is farthest off, by the name of its unit
    for name in sorted(fits, key=lambda name: fits[name].max_error):
        worst[units[name].name] = name
    joints = {
        name: [fit_figure(name, fit, k, units[name].sign)]
        for k, (name, fit) in enumerate(fits.items(), 1)
    }
    return Page(
        "fit",
        joints=joints,
        errors=fits_table(fits, units),
        worst=" and ".join(worst.values()),
        rms={unit: math.degrees(fits[name].rms) for unit, name in worst.items()},
        most={unit: math.degrees(fits[name].max_error) for unit, name in worst.items()},
        proof=proof_words(fits),
    )


def proof_words(fits: Mapping[str, PiecewiseLinearFit]) -> str:
    """What ``exact`` has proved, in a sentence; nothing without it."""
    if not all(fit.proved for fit in fits.values()):
        return ""
    return "no curve of as many lines, with knots on samples, has a smaller rms error"


def fit_results(curve: PiecewiseLinearFit, unit: Unit = UNITS["rad"]) -> dict[str, Any]:
    """An approximation for machines."""
    numbers = {
        "segments": len(curve.slopes),
        "fewest_segments": curve.fewest_segments,
        "proved": curve.proved,
        "rms_deg": float(np.degrees(curve.rms)),
        "max_deg": float(np.degrees(curve.max_error)),
        "knots": curve.knots.tolist(),
        "values_deg": np.degrees(curve.values).tolist(),
        "slopes_deg_per_s": np.degrees(curve.slopes).tolist(),
        "angles_deg": np.degrees(curve.angles).tolist(),
    }
    return renamed(numbers, unit)


def fits_table(fits: Mapping[str, PiecewiseLinearFit], units: Mapping[str, Unit]) -> Table:
    """The number of lines of every joint, and its errors."""
    unit, labels = labelled({name: units[name] for name in fits})
    bounded = any(fit.fewest_segments is not None for fit in fits.values())
    columns = {
        "lines": "segments",
        **({"fewest possible": "fewest_segments"} if bounded else {}),
        f"rms [{unit}]": "rms_deg .3f",
        f"max [{unit}]": "max_deg .3f",
    }
    rows = ((labels[name], fit_results(fit)) for name, fit in fits.items())
    return table_of("joint", rows, columns, "Lines")


def fit_figure(name: str, fit: PiecewiseLinearFit, number: int, unit: str = "deg") -> Figure:
    """A joint's samples, and the lines through them."""
    timeline = Timeline(fit.tick, fit.samples, fit.cyclic)
    step, last = timeline.step, timeline.last
    # The curve from the first sample to the last, cut at every knot inside.
    inside = fit.knots[(fit.knots > 0) & (fit.knots < last)]
    cuts = np.unique(np.concatenate([[0.0], inside, [last]]))
    heights = np.degrees(fit(cuts))
    shares = np.abs(fit.slope_at(0.5 * (cuts[:-1] + cuts[1:]))) / fit.v_max
    fast = np.flatnonzero(shares >= 0.999)  # rounding
    lines = APPROXIMATION._replace(label="lines", dashes="-", width=2.0)
    curves = [timeline.curve(np.degrees(fit.desired), DESIRED), Curve(lines, step * cuts, heights)]
    if len(fast):
        pairs = np.stack([fast, fast + 1], axis=1)
        role = lines._replace(label="at the top speed", light=DIRECT.light, dark=DIRECT.dark)
        curves.append(Curve(role, step * joined(cuts[pairs]), joined(heights[pairs])))
    knots = np.mod(fit.knots, fit.samples)
    curves.append(Curve(INK, step * knots, np.degrees(fit.values), "knots", marks="rings"))
    panel = Panel(Axis("angle", unit), curves, height=1.3)
    return timeline.figure(f"fit_{number}", [panel], words_of("fit", name=name, fit=fit, unit=unit))
