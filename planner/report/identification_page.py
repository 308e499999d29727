"""The page about identified joints: verdict first, then what is known, every log, the sources."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from planner.arrays import Array, stretches
from planner.identification.result import (
    Identification,
    Interval,
    LogFit,
    SpeedPoints,
    telling_error,
)
from planner.report import figure
from planner.report.figure import Axis, Curve, Figure, Panel, Role, Span, Words, line
from planner.report.identification_text import (
    explained,
    joints_table,
    numbers_of,
    of_several,
    parameters,
    profile,
    rounded_by,
    verdict,
)
from planner.report.page import Page, parameters_of
from planner.report.wording import UNITS, words_of

CLOSE_UP = 3.0  # length of the part that is drawn by itself [s]: some ten answers of a hobby servo
BAR = 9.0  # width of the bar of an interval [pt]


def identification_page(identifications: Mapping[str, Identification]) -> Page:
    """The whole page: of a joint, or of several one after the other, below a table of all."""
    several = len(identifications) > 1
    joints = [
        _joint_values(name, each, f"joint{k}_" if several else "")
        for k, (name, each) in enumerate(identifications.items(), 1)
    ]
    return Page(
        "identification",
        joints=joints,
        good=all(each.accepted for each in identifications.values()),
        summary=of_several(identifications),
        summaries=joints_table(identifications, page=True),
        rare=explained(identifications),
    )


def _joint_values(name: str, found: Identification, prefix: str) -> dict[str, Any]:
    """What the page shows of a joint: figures, tables, and numbers in the units of the page."""
    units, (error, where), (points, *_) = UNITS[found.unit], telling_error(found), cloud_of(found)
    numbers = numbers_of(found)
    shown = {row.name: row.bounds if row.rough else row.short for row in numbers["estimates"]}

    def angle(radians: float) -> str:
        return " ".join(units.sized(radians))

    return {
        "name": name,
        **numbers,
        "anchor": re.sub(r"\W+", "-", f"{prefix}{name or 'joint'}"),
        "verdict": verdict(found),
        "profile": profile(found),
        "error": units.sized(error),
        "where": where,
        "noise": angle(found.noise),
        "signal": angle(found.signal),
        "short": {name: " ".join(words) for name, words in shown.items()},
        # whether the joint may be faster than anything in the logs
        "open": math.isinf(found.intervals["v_max"].upper),
        "saturated": float(np.sum(points.saturated)) / max(1, len(points.errors)),
        "speeds": cloud_figure(found, prefix),
        "intervals": intervals_figure(found, prefix),
        "logs": [
            (fit.log.name, angle(fit.rms), log_figure(found, fit, f"{prefix}log{k}_"))
            for k, fit in enumerate(found.fits, 1)
        ],
        "names": parameters_of([found.model.parameters()]),
    }


# The figures.


def cloud_of(identification: Identification) -> tuple[SpeedPoints, float, float]:
    """All points of an identification, the largest error to show [rad], and the speed [rad/s]."""
    model = identification.model
    clouds = [fit.speed_points(model) for fit in identification.fits]
    points = SpeedPoints(*(np.concatenate(parts) for parts in zip(*clouds, strict=True)))
    corner = float(model.corners()[-1])
    reach = 2.0 * corner
    if len(points.errors):
        most = 1.1 * float(np.quantile(np.abs(points.errors), 0.99))
        beyond = max(1.3 * corner, min(most, 5.0 * corner))
        reach = max(most, 1e-9) if most < corner else beyond
    speeds = np.abs(points.speeds[np.abs(points.errors) <= reach])
    most = float(np.quantile(speeds, 0.995)) if len(speeds) else 0.0
    top = float(model.speed(reach))
    if most > 0.0 and not identification.saturates:  # its top speed is a guess: the dots count
        top = min(top, 1.5 * most)
    return points, reach, 1.15 * max(top, most)


def cloud_figure(identification: Identification, prefix: str = "") -> Figure:
    """The paper's Figure 5, from data: speed against error, with the identified f over it."""
    model, units = identification.model, UNITS[identification.unit]
    points, reach, highest = cloud_of(identification)
    factor, corners = units.factor, model.corners()
    right, high = factor * reach, factor * highest
    curves = [line((-right, right), (0, 0)), line((0, 0), (-high, high))]
    measured = points.errors, points.speeds
    off = [(points.off, figure.MUTED, 0.3, "window across a corner of f", *measured)]
    if model.has_inertia:
        predicted = points.predicted_errors, points.predicted_speeds
        off = [
            (points.off, figure.OPTIMAL, 0.35, "model, as its speed changes", *predicted),
            (points.off, figure.MUTED, 0.55, "measured, as its speed changes", *measured),
        ]
    for mask, role, opacity, name, errors, speeds in (
        *off,
        (~points.off, figure.INK, 0.6, "measured", *measured),
    ):
        places = np.flatnonzero(mask)
        places = places[:: max(1, math.ceil(len(places) / 1500))]  # enough to see a shape
        if len(places):
            x, y = factor * errors[places], factor * speeds[places]
            curves.append(Curve(role, x, y, name, marks="dots", opacity=opacity))
    far = max(reach, float(np.max(np.abs(points.errors), initial=0.0)))
    ends = np.array([-far, *np.clip(corners, -far, far), far])
    words: list[Words] = []
    corner, level = factor * float(corners[-1]), factor * float(model.speed(corners[-1]))
    seen = corners[-1] <= reach
    if identification.saturates and seen:
        dotted = figure.MUTED._replace(dashes=(0, (1.0, 1.5)))
        curves.append(line((corner, corner), (-high, level), dotted))
        threshold = "θ₀ + dead band" if model.steady.dead_band else "θ₀"
        side: Literal["left", "right"] = "left" if corner < right / 3 else "right"  # within it
        # at the lower edge, where a joint has no dots: they lie about f
        words.append(Words(threshold, corner, -high, side, "bottom"))
        words.append(Words("v_max", -right, factor * model.v_max, across="left"))
    wide, speeds = figure.CLOSED_FORM._replace(width=2.4), factor * model.speed(ends)
    curves.append(Curve(wide, factor * ends, speeds, "f, identified"))
    about = words_of(
        "speed",
        youngest=1e3 * model.lag,
        oldest=1e3 * (model.lag + model.acceleration_time),
        gravity=model.most_pose_sag > 0.0,
        inertia=model.has_inertia,
        off=points.off.any(),
        guessed=not identification.saturates and seen,
    )
    across = Axis("request minus angle", units.words, (-right, right), decimals=3)
    panel = Panel(Axis("speed", f"{units.sign}/s", (-high, high)), curves, words=words, height=2.2)
    return Figure(f"{prefix}speed", *about, across, [panel])


def intervals_figure(identification: Identification, prefix: str = "") -> Figure:
    """Every estimate and its 95 % interval, on a scale from or about nothing to twice as much."""
    model, names = identification.model, dict[float, str]()
    curves, words = list[Curve](), list[Words]()
    sag = 1.5 * model.most_pose_sag or 1.0
    static = max(0.25 * model.theta_0, 1.5 * abs(model.offset))
    about_zero = {"offset": static, "sag_sin": sag, "sag_cos": sag, "v_offset": model.v_max}
    for k, row in enumerate(parameters(identification)):
        shortest = model.period if row.name == "lag" else 0.0
        most = about_zero.get(row.name) or max(2.0 * row.estimate, shortest) or 1.0
        marks = np.linspace(-most if row.name in about_zero else 0.0, most, 3)
        places = np.clip([*row.ends, row.estimate], marks[0], most)
        low, high, estimated = np.interp(places, (marks[0], most), (0.0, 100.0)).tolist()
        role, label = figure.DIRECT, "interval without an end"
        if row.ends.bounded:
            role, label = figure.CLOSED_FORM, "95 % interval"
        for looks, x, name, height in (
            (figure.GRID._replace(width=BAR, dashes="-"), (0.0, 100.0), "", 0.0),
            (role._replace(width=BAR, dashes="-"), (low, high), label, 0.0),
            (figure.INK._replace(width=2.0), (estimated, estimated), "estimate", 0.22),
        ):
            y = np.array([k - height, k + height])
            curves.append(Curve(looks, np.array(x), y, name, legend=bool(name)))
        shown = Interval(*(row.factor * end for end in row.ends))
        numbers = [rounded_by(row.factor * mark, shown) if mark else "0" for mark in marks.tolist()]
        words += [
            Words(numbers[0], 0.0, k + 0.18, "left", "top"),
            Words(numbers[1], 50.0, k + 0.18, "center", "top"),
            Words(numbers[2], 100.0, k + 0.18, "right", "top"),
        ]
        names[float(k)] = f"{row.brief} [{row.unit}]"
    axis = Axis("", range=(len(names) - 0.3, -0.5), names=names)
    panel = Panel(axis, curves, words=words, height=0.4 * len(names))
    across = Axis("", range=(-1.0, 101.0), names={})
    return Figure(f"{prefix}intervals", *words_of("intervals"), across, [panel])


def log_figure(identification: Identification, fit: LogFit, prefix: str) -> Figure:
    """A log: requests, angles and prediction, its residuals, and a button for a part of it."""
    units, log, held_out = UNITS[identification.unit], fit.log, fit.held_out
    factor, times = units.factor, log.times - log.times[0]
    angles = factor * log.angles
    predicted = factor * np.where(held_out, fit.held_out_predicted, fit.predicted)
    outliers = np.flatnonzero(fit.used & (fit.weights < 0.5))  # which count by less than half
    residuals = angles - predicted
    fitted, unseen = (each._replace(width=1.4) for each in (figure.CLOSED_FORM, figure.OPTIMAL))
    requested, ink = figure.REQUESTED._replace(width=1.1), figure.INK._replace(width=0.9)
    above = [
        _log_curve(figure.DESIRED, "measured", times, angles),
        _log_curve(requested, "", times, factor * log.requests, held=True),
        _log_curve(fitted, "model, fitted", times, np.where(held_out, np.nan, predicted)),
        _log_curve(unseen, "model, rows held out", times, np.where(held_out, predicted, np.nan)),
    ]
    below = [
        _log_curve(ink, "residual", times, residuals),
        Curve(figure.DIRECT, times[outliers], residuals[outliers], "outliers", marks="rings"),
    ]
    shades = [
        Span(float(times[rows.start]), float(times[rows.stop - 1]), figure.GRID, 0.45)
        for rows in stretches(held_out)
        if not held_out.all()
    ]
    noise, known = factor * identification.noise, math.isfinite(identification.noise)
    noises = [Span(-2.0 * noise, 2.0 * noise, figure.CLOSED_FORM, 0.16, "y")] if known else []
    top, low = ([curve for curve in curves if len(curve.y)] for curves in (above, below))
    quantity, whole = "angle" if units.words == "deg" else "position", (0.0, float(times[-1]))
    about = words_of(
        "log",
        held_out=held_out.any(),
        noise=f"{noise:.2g} {units.words}" if known else "unknown",
        outliers=len(outliers),
        least=float(np.min(log.weights[fit.used], initial=1.0)),
        seconds=CLOSE_UP,
    )
    residual = Axis("residual", units.words)
    panels = [
        Panel(Axis(quantity, units.words), top, spans=shades, height=1.9),
        Panel(residual, low, "measured − predicted", spans=[*shades, *noises]),
    ]
    rows = fit.held_out & fit.used if (fit.held_out & fit.used).any() else fit.used
    off = np.where(rows, np.abs(log.requests - log.angles), -1.0)
    first = min(float(times[np.argmax(off)]), max(whole[1] - CLOSE_UP, 0.0))
    views = {"whole log": whole, "close-up": (first, min(first + CLOSE_UP, whole[1]))}
    across = Axis("time", "s", whole, decimals=3)
    return Figure(f"{prefix}whole", *about, across, panels, over_time=True, views=views)


def _log_curve(role: Role, label: str, times: Array, values: Array, *, held: bool = False) -> Curve:
    """A curve without the rows before its first and after its last value."""
    finite = np.flatnonzero(np.isfinite(values))
    span = slice(finite[0], finite[-1] + 1) if len(finite) else slice(0)
    times, values = times[span], values[span]
    if len(values) > 20_000:  # the least and the largest value of every part
        starts = np.linspace(0, len(values), 10_000, endpoint=False).astype(int)
        ends = [extreme.reduceat(values, starts) for extreme in (np.fmin, np.fmax)]
        times, values = np.repeat(times[starts], 2), np.column_stack(ends).ravel()
    return Curve(role, times, values, label, held=held)
