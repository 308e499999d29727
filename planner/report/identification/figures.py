"""The figures of an identification: f from data, intervals, errors, and every log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.identification.log import Log
from planner.identification.result import Identification, Interval, LogFit
from planner.model.joint import JointModel
from planner.report import style
from planner.report.figure import Axis, Curve, Figure, Panel, Span, Words, line
from planner.report.identification.words import (
    estimate,
    figure,
    parameters,
    unit_of,
    units_of,
)
from planner.report.style import Role
from planner.trajectory import Array, index_of_largest

CLOSE_UP = 3.0
"""Length of the part that is drawn by itself [s]: some ten answers of a hobby servo."""

APART = "window across a corner of f"
"""Name of the pale dots of a cloud."""

MEASURED = style.DESIRED._replace(label="measured")
FITTED = style.CLOSED_FORM._replace(label="model, fitted", width=1.4)
UNSEEN = style.OPTIMAL._replace(label="model, rows held out", width=1.4)
BAR = 9.0
"""Width of a bar [pt]."""

SIDES: tuple[Literal["left", "center", "right"], ...] = ("left", "center", "right")
"""Where the numbers below a strip stand."""


class SpeedPoints(NamedTuple):
    """One point per interval between two rows."""

    errors: Array  # mean request over the window of the model, plus its sags, minus the angle [rad]
    speeds: Array  # change of the angle over the interval [rad/s]
    saturated: npt.NDArray[np.bool_]  # points whose whole window calls for the top speed
    # points whose window lies on both sides of a corner of f: there the mean of f is not f of the
    # mean, so that they need not lie on its curve
    apart: npt.NDArray[np.bool_]


def cloud_of(identification: Identification) -> tuple[SpeedPoints, float, float]:
    """All points of an identification, the largest error to show [rad], and the speed [rad/s]."""
    model = identification.model
    clouds = [speed_against_error(model, fit) for fit in identification.fits]
    points = SpeedPoints(*(np.concatenate(parts) for parts in zip(*clouds, strict=True)))
    corner = float(model.corners()[-1])
    reach = 2.0 * corner
    if len(points.errors):
        most = 1.1 * float(np.quantile(np.abs(points.errors), 0.99))
        beyond = max(1.3 * corner, min(most, 5.0 * corner))
        reach = max(most, 1e-9) if most < corner else beyond
    speeds = np.abs(points.speeds[np.abs(points.errors) <= reach])
    most = float(np.quantile(speeds, 0.995)) if len(speeds) else 0.0
    return points, reach, 1.15 * max(float(model.speed(reach)), most)


def speed_against_error(model: JointModel, fit: LogFit) -> SpeedPoints:
    """The points of one log, from intervals between neighbouring rows that were both used.

    Over an interval with its middle at t, Equation 3 averages f over the requests of
    ``[t - lag - acceleration_time, t - lag]``, moved by half a tick.
    """
    log = fit.log
    intervals = np.flatnonzero(fit.used[:-1] & fit.used[1:])
    after = intervals + 1
    steps = log.times[after] - log.times[intervals]
    middle = 0.5 * (log.times[after] + log.times[intervals]) + 0.5 * model.tick
    speeds = (log.angles[after] - log.angles[intervals]) / steps
    # Equation 3 compares with the angle one tick before, on average half a tick before the middle.
    here = 0.5 * (log.angles[after] + log.angles[intervals] - speeds * model.tick)
    mean, least, most = _windows(
        log, middle - model.lag - model.acceleration_time, middle - model.lag
    )
    balance = here - model.offset - model.pose_sag(here)
    errors, low, high = (values - balance for values in (mean, least, most))
    down, *band, up = model.corners(angle=here)
    saturated = (low >= up) | (high <= down)
    edges = [down, *(band if model.steady.dead_band else ()), up]
    one_piece = np.zeros(len(errors), dtype=bool)
    for least, most in pairwise(edges):
        one_piece |= (low >= least) & (high <= most)
    return SpeedPoints(errors, speeds, saturated, ~(one_piece | saturated))


def _windows(log: Log, starts: Array, ends: Array) -> tuple[Array, Array, Array]:
    """Mean, least and largest of the requests, each held until the next, in windows of time."""
    steps = np.diff(log.times)
    cumulative = np.concatenate([[0.0], np.cumsum(log.requests[:-1] * steps)])

    def integral(times: Array) -> Array:
        inner = np.interp(times, log.times, cumulative)
        before = np.minimum(times - log.times[0], 0.0) * log.requests[0]
        after = np.maximum(times - log.times[-1], 0.0) * log.requests[-1]  # by half a tick
        total: Array = inner + before + after
        return total

    mean = (integral(ends) - integral(starts)) / (ends - starts)
    last = len(log.times) - 1
    first_row = np.clip(np.searchsorted(log.times, starts, side="right") - 1, 0, last)
    last_row = np.clip(np.searchsorted(log.times, ends, side="left") - 1, first_row, last)
    padded = np.append(log.requests, log.requests[-1])  # reduceat's ends must lie inside
    edges = np.column_stack([first_row, last_row + 1]).ravel()
    least = np.minimum.reduceat(padded, edges)[::2]
    most = np.maximum.reduceat(padded, edges)[::2]
    return mean, least, most


def cloud_figure(identification: Identification, prefix: str = "") -> Figure:
    """The paper's Figure 5, from data: speed against error, with the identified f over it."""
    model, units = identification.model, units_of(identification)
    points, reach, highest = cloud_of(identification)
    factor = units.factor
    finite = np.isfinite(points.errors) & np.isfinite(points.speeds)
    curves = [line((-factor * reach, factor * reach), (0, 0)), line((0, 0), (-factor * highest,
              factor * highest))]  # fmt: skip
    for mask, role, opacity, name in (
        (finite & points.apart, style.MUTED, 0.3, APART),
        (finite & ~points.apart, style.INK, 0.6, "measured"),
    ):
        places = np.flatnonzero(mask)
        places = places[:: max(1, math.ceil(len(places) / 1500))]  # enough to see a shape
        if len(places):
            x, y = factor * points.errors[places], factor * points.speeds[places]
            curves.append(Curve(role, x, y, name, marks="dots", opacity=opacity))
    far = max(reach, float(np.max(np.abs(points.errors[finite]), initial=0.0)))
    corners = model.corners()
    ends = np.array([-far, *np.clip(corners, -far, far), far])
    speeds = factor * model.speed(ends)
    words: tuple[Words, ...] = ()
    if identification.saturates and corners[-1] <= reach:
        corner, top = factor * float(corners[-1]), factor * float(model.speed(corners[-1]))
        low = -factor * highest
        curves.append(
            line((corner, corner), (low, top), style.MUTED._replace(dashes=(0, (1.0, 1.5))))
        )
        words = (  # at the lower edge, where a joint has no dots: they lie about f
            Words(
                "θ₀ + dead band" if model.steady.dead_band else "θ₀",
                corner,
                low,
                "left" if corner < factor * reach / 3 else "right",  # within the figure
                "bottom",
            ),
            Words("v_max", -factor * reach, factor * model.v_max, across="left"),
        )
    curves.append(
        Curve(style.CLOSED_FORM._replace(width=2.4), factor * ends, speeds, "f, identified")
    )
    age, oldest = 1e3 * model.lag, 1e3 * (model.lag + model.acceleration_time)
    end_note = ""
    if not identification.saturates and corners[-1] <= reach:
        end_note = " Its level ends are a guess: no data is there."
    note = ""
    if model.most_pose_sag > 0.0:
        note = (
            " The level ends of f are those without gravity, which shifts both by v_max/θ₀ times "
            "the sag by the angle."
        )
    if (finite & points.apart).any():
        note += (
            " Dots of a window that lies on both sides of a corner of f are pale: they may lie off "
            "the line."
        )
    return Figure(
        f"{prefix}speed",
        "The function f: speed against error",
        "One dot per interval between two rows: upwards the change of the measured angle over the "
        f"interval by its duration, to the right the mean of the requests {age:.0f} to "
        f"{oldest:.0f} ms old, plus the static sag, minus the angle.{note} The line is f with "
        f"the identified v_max and θ₀; it was not fitted to these dots.{end_note}",
        Axis("request minus angle", units.angle, (-factor * reach, factor * reach), decimals=3),
        (
            Panel(
                Axis("speed", units.speed, (-factor * highest, factor * highest)),
                tuple(curves),
                words=words,
                height=2.2,
            ),
        ),
    )


def intervals_figure(identification: Identification, prefix: str = "") -> Figure:
    """Every estimate and its 95 % interval, on a scale from nothing to twice the estimate."""
    curves, words, names = list[Curve](), list[Words](), dict[float, str]()
    for k, row in enumerate(parameters(identification)):
        value, interval = estimate(identification, row.name)
        factor, unit = unit_of(identification, row.name)
        least, most = _strip(identification, row.name, value)
        scaled = Interval(*(factor * each for each in interval))
        marks = (least, 0.5 * (least + most), most)
        low, high, estimated, *ends = (
            100.0 * (each - least) / (most - least)
            for each in (*np.clip(interval, least, most), value, *marks)
        )
        role = style.CLOSED_FORM if row.bounded else style.DIRECT
        label = "95 % interval" if row.bounded else "interval without an end"
        y = float(k)
        curves += [
            _stroke(style.GRID, (0, 100), (y, y), BAR, "", legend=False),
            _stroke(role, (low, high), (y, y), BAR, label),
            _stroke(style.INK, (estimated, estimated), (y - 0.22, y + 0.22), 2.0, "estimate"),
        ]
        words += [
            Words(figure(factor * mark, scaled) if mark else "0", end, y + 0.18, across, "top")
            for mark, end, across in zip(marks, ends, SIDES, strict=True)
        ]
        names[y] = f"{row.brief} [{unit}]"
    return Figure(
        f"{prefix}intervals",
        "The parameters and their 95 % intervals",
        "Every strip runs from zero to twice the estimate, that of a short lag to the time between "
        "requests, and those of sags are as far to either side; the short upright line is the "
        "estimate, the bar its interval, which may go on beyond the strip.",
        Axis("", range=(-1.0, 101.0), names={}),
        (
            Panel(
                Axis("", range=(len(names) - 0.3, -0.5), names=names),
                tuple(curves),
                words=tuple(words),
                height=0.4 * len(names),
            ),
        ),
    )


def _strip(identification: Identification, name: str, value: float) -> tuple[float, float]:
    """The ends of a parameter's strip; the lag's covers at least a period."""
    model = identification.model
    if name == "offset":
        most = max(0.25 * model.theta_0, 1.5 * abs(value))
        return -most, most
    if name in ("sag_sin", "sag_cos"):
        most = 1.5 * model.most_pose_sag or 1.0
        return -most, most
    if name == "lag":
        return 0.0, max(2.0 * value, model.period)
    if name == "v_offset":
        return -model.v_max, model.v_max
    return 0.0, 2.0 * value if value else 1.0


def _stroke(
    role: Role,
    x: Sequence[float],
    y: Sequence[float],
    width: float,
    label: str,
    *,
    legend: bool = True,
) -> Curve:
    """A bar, or a mark across one."""
    looks = role._replace(width=width, dashes="-")
    return Curve(looks, np.asarray(x, float), np.asarray(y, float), label, legend=legend)


def log_figure(identification: Identification, fit: LogFit, prefix: str) -> Figure:
    """A log: the whole of it, with a button for the part to look at closely.

    Above are requests, angles and prediction, below them the residuals.
    """
    units, noise, log = units_of(identification), identification.noise, fit.log
    times, held_out, close = log.times - log.times[0], fit.held_out, close_up(fit)
    requests, angles = units.factor * log.requests, units.factor * log.angles
    predicted, outliers = units.factor * prediction(fit), outliers_of(fit)
    residuals = angles - predicted
    above = [
        _log_curve(MEASURED, times, angles),
        _log_curve(style.REQUESTED._replace(width=1.1), times, requests, held=True),
        _log_curve(FITTED, times, np.where(held_out, np.nan, predicted)),
        _log_curve(UNSEEN, times, np.where(held_out, predicted, np.nan)),
    ]
    below = [
        _log_curve(style.INK._replace(label="residual", width=0.9), times, residuals),
        Curve(style.DIRECT, times[outliers], residuals[outliers], "outliers", marks="rings"),
    ]
    drawn = [tuple(curve for curve in curves if len(curve.y)) for curves in (above, below)]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], held_out.astype(int), [0]])))
    shades = tuple(
        Span(float(times[start]), float(times[end - 1]), style.GRID, 0.45)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        if end - start < len(times)
    )
    band, level = 2.0 * units.factor * noise, "unknown"
    noises: tuple[Span, ...] = ()
    if math.isfinite(noise):
        noises = (Span(-band, band, style.CLOSED_FORM, 0.16, "y"),)
        level = f"{units.factor * noise:.2g} {units.angle}"
    colours, shaded, counted = "", "", ""
    if held_out.any():
        colours = "; where the model is dashed, it was fitted without these rows"
        shaded = " The shaded part was held out."
    if len(outliers):
        counted = "; outliers are rows that the robust fit counted by less than half"
    if (least := float(np.min(log.weights[fit.used], initial=1.0))) < 1.0:
        counted += f"; rows of the fastest motion counted by {100.0 * least:.0f} %"
    return Figure(
        f"{prefix}whole",
        "The whole log",
        f"Requests, measured angles and prediction{colours}. Below, measured minus predicted, and "
        f"twice the noise ({level}) either way{counted}. There is no prediction where the torque "
        f"was off or the requests before are not known.{shaded} The close-up shows the "
        f"{CLOSE_UP:g} seconds in which the joint is farthest from its requests.",
        Axis("time", "s", (0.0, float(times[-1])), decimals=3),
        (
            Panel(Axis("angle" if units.si else "position", units.angle), drawn[0], spans=shades,
                  height=1.9),
            Panel(Axis("residual", units.angle), drawn[1], "measured − predicted",
                  spans=(*shades, *noises)),
        ),
        over_time=True,
        views={
            "whole log": (0.0, float(times[-1])),
            "close-up": (float(times[close[0]]), float(times[close[-1]])),
        },
        wide=True,
    )  # fmt: skip


def outliers_of(fit: LogFit) -> npt.NDArray[np.intp]:
    """The rows that the robust fit counts by less than half."""
    return np.flatnonzero(fit.used & (fit.weights < 0.5))


def close_up(fit: LogFit) -> npt.NDArray[np.intp]:
    """The rows of the seconds to look at closely, within the rows held out if there are any."""
    log = fit.log
    rows = fit.held_out & fit.used if (fit.held_out & fit.used).any() else fit.used
    error = np.where(rows, (log.requests - log.angles) ** 2, 0.0)
    cumulative = np.concatenate([[0.0], np.cumsum(error)])
    ends = np.searchsorted(log.times, log.times + CLOSE_UP, side="right")
    whole = log.times + CLOSE_UP <= log.times[np.flatnonzero(rows)[-1]]
    sums = cumulative[ends] - cumulative[:-1]
    start = index_of_largest(np.where(whole, sums, -1.0)) if whole.any() else 0
    return np.arange(start, ends[start])


def prediction(fit: LogFit) -> Array:
    """The prediction of each row [rad], by a model that had not seen it where there is one."""
    return np.where(fit.held_out, fit.held_out_predicted, fit.predicted)


def thinned(times: Array, values: Array, *, bins: int = 10_000) -> tuple[Array, Array]:
    """A curve for drawing: of every part the least and the largest value, NaN where it has none.

    A log of twice as many rows as ``bins``, over three minutes at 100 Hz, is drawn row by row.
    """
    if len(values) <= 2 * bins:
        return times, values
    pieces = []
    for rows in np.array_split(np.arange(len(values)), bins):
        finite = rows[np.isfinite(values[rows])]
        if not len(finite):
            pieces.append(rows[:1])
            continue
        ends = (finite[np.argmin(values[finite])], finite[np.argmax(values[finite])])
        pieces.append(np.unique(ends))
    indices = np.concatenate(pieces)
    return times[indices], values[indices]


def _log_curve(role: Role, times: Array, values: Array, *, held: bool = False) -> Curve:
    """A curve without the rows before its first and after its last value."""
    finite = np.flatnonzero(np.isfinite(values))
    span = slice(finite[0], finite[-1] + 1) if len(finite) else slice(0)
    return Curve(role, *thinned(times[span], values[span]), held=held)
