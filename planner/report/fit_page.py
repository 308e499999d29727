"""The page of a fit: its lines, those at the top speed, and errors of other numbers of lines."""

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
    LOWER_BOUND,
    MUTED,
    Axis,
    Curve,
    Figure,
    Panel,
    Timeline,
    joined,
    line,
)
from planner.report.page import Page
from planner.report.wording import UNITS, Table, Unit, labelled, renamed, table_of, words_of

if TYPE_CHECKING:
    from planner.approximation.fit_pwl import Choices, PiecewiseLinearFit


def fit_page(
    fits: Mapping[str, PiecewiseLinearFit],
    choices: Mapping[str, Choices],
    units: Mapping[str, Unit],
) -> Page:
    """The page: every joint's samples and lines, with error against number of lines beside them."""
    worst = dict[str, str]()  # the joint that is farthest off, by the name of its unit
    for name in sorted(fits, key=lambda name: fits[name].max_error):
        worst[units[name].name] = name
    joints = {
        name: [fit_figure(name, fit, k, unit), choices_figure(choices[name], fit, k, unit)]
        for k, (name, fit) in enumerate(fits.items(), 1)
        for unit in [units[name].sign]
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
        "knots_s": (curve.tick * curve.knots).tolist(),
        "values_deg": np.degrees(curve.values).tolist(),
        "slopes_deg_per_s": np.degrees(curve.slopes).tolist(),
        "angles_deg": np.degrees(curve.angles).tolist(),
    }
    return renamed(numbers, unit)


def fits_table(fits: Mapping[str, PiecewiseLinearFit], units: Mapping[str, Unit]) -> Table:
    """The number of lines of every joint, and its errors."""
    unit, labels = labelled({name: units[name] for name in fits})
    bounded = any(fit.fewest_segments is not None for fit in fits.values())
    proved = any(fit.proved for fit in fits.values())
    fewest = "fewest with knots on samples" if proved else "fewest possible"
    columns = {
        "lines": "segments",
        **({fewest: "fewest_segments"} if bounded else {}),
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


def choices_figure(
    choices: Choices, fit: PiecewiseLinearFit, number: int, unit: str = "deg"
) -> Figure:
    """Error against number of lines, its lower bound, and the automatic choice."""
    numbers, errors = np.array(choices.segments, float), np.degrees(choices.rms)
    bound = float(np.degrees(choices.floor))
    top = float(np.max(errors, initial=bound))
    room = max(top - bound, 0.05 * bound, 1e-9)  # less is no difference
    low, high = max(0.0, bound - 0.25 * room), bound + 1.1 * room
    ends = np.array([numbers.min(), numbers.max()])
    curves = [
        line((fit.segments, fit.segments), (low, high), MUTED),
        Curve(LOWER_BOUND, ends, np.full(2, bound)),
        Curve(INK._replace(width=1.2), numbers, errors, "rms error"),
        Curve(INK, numbers, errors, "numbers of lines", legend=False, marks="dots"),
    ]
    if choices.automatic in choices.segments:
        at = choices.segments.index(choices.automatic)
        curves.append(Curve(APPROXIMATION, numbers[[at]], errors[[at]], "automatic", marks="rings"))
    across = Axis("number of lines", names={each: f"{each:.0f}" for each in numbers})
    panel = Panel(Axis("rms error", unit, (low, high)), curves, height=1.3)
    return Figure(f"choices_{number}", *words_of("choices"), across, [panel])
