"""From logs to a joint model, with intervals, warnings and a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.alternatives import Simple, errors_of, simple_fits
from planner.identification.fit import fit_joint, with_even_rows, with_observed_speed
from planner.identification.intervals import Uncertainty, intervals_of, uncertainty_of
from planner.identification.least_squares import Fit
from planner.identification.log import Log, as_logs, unwrapped
from planner.identification.parameters import COUNT, PARAMETERS, model_derivatives
from planner.identification.result import Alternative, Identification, Interval, LogFit
from planner.identification.robust_loss import rms
from planner.identification.timestamps import Timing, timing_of
from planner.identification.validation import HeldOut, held_out
from planner.identification.verdict import notes_on, opposite_sign, verdict_on
from planner.trajectory import Array
from planner.validation import as_flag


def identify(
    logs: Any, *, tick: float | None = None, hold: int | None = None, hold_out: bool = True
) -> Identification:
    """The joint model that explains the logs best (``docs/math.md``, section 8).

    Args:
        logs: One or several logs of the same joint: :class:`planner.Log`, triples of arrays
            (times, requests, angles), mappings with these keys, or several of such.
        tick: Time step of the model [s]; by default chosen from the log's period, or the period
            itself where that fits clearly better.
        hold: Ticks for which a request is held; by default as many as make a period.
        hold_out: Whether to fit the first half of each log alone too, and test it on the rest.

    Returns:
        The model, fitted to all rows, with what is needed to judge it. A model that does not fit is
        returned as well: see ``accepted`` and ``warnings``.

    Raises:
        InvalidTrajectory: A log is malformed.
        InvalidInput: The logs hold no motion to learn from, are of different units, or tick and
            hold contradict their period.
    """
    hold_out = as_flag("hold_out", hold_out)
    logs = as_logs(logs)
    _check_alike(logs)
    logs, jumps = zip(*map(unwrapped, logs), strict=True)
    logs, timing, fit, evenly_timed = _fitted(logs, tick=tick, hold=hold)
    timing = timing.ticking(fit.grid.tick)
    uncertainty = uncertainty_of(fit)
    bounds = intervals_of(fit, uncertainty)
    held = held_out(logs, timing, fit.grid) if hold_out else None
    simple = simple_fits(fit.grid)
    errors = {other.name: rms(errors_of(other, fit.grid, fit.starts)) for other in simple}
    signal = _signal(fit)
    verdict = verdict_on(
        fit,
        bounds,
        held,
        errors,
        against=opposite_sign(fit.grid),
        signal=signal,
        unit="" if logs[0].unit == "1" else logs[0].unit,
    )
    notes = notes_on(logs, timing, jumps)
    if evenly_timed:
        notes.append(
            f"the times of the rows jitter: rows every {1e3 * timing.period:.3g} ms fit better, "
            "and are taken"
        )
    if hold_out and held is None:
        notes.append("nothing was held out: the first half of the log holds no motion to fit")
    return Identification(
        model=fit.parameters.model(tick=timing.tick, hold=timing.hold),
        fits=_log_fits(logs, fit, held),
        rms=fit.rms,
        held_out_rms=None if held is None else held.rms,
        noise=fit.scale,
        signal=signal,
        intervals=_intervals(fit, bounds, uncertainty),
        gain_interval=bounds["gain"],
        covariance=_covariance(fit, bounds, uncertainty),
        alternatives=_alternatives(simple, errors, held),
        warnings=(*verdict.warnings, *notes),
        accepted=verdict.accepted,
    )


def _alternatives(
    simple: Sequence[Simple], errors: Mapping[str, float], held: HeldOut | None
) -> tuple[Alternative, ...]:
    """The simpler models, with their errors on all rows and on those held out."""
    return tuple(
        Alternative(
            name=other.name,
            rms=errors[other.name],
            held_out_rms=None if held is None else held.alternatives[other.name],
            parameters=other.parameters,
        )
        for other in simple
    )


def _fitted(
    logs: Sequence[Log], *, tick: float | None, hold: int | None
) -> tuple[Sequence[Log], Timing, Fit, bool]:
    """The logs, on even times where these fit better, their ticks and the joint that fits best."""
    choose_tick = tick is None and hold is None
    timing = timing_of(logs, tick=tick, hold=hold)
    fit = fit_joint(logs, timing, choose_tick=choose_tick)
    even = with_even_rows(logs, timing, fit)
    if even is not None:
        logs, timing = even, timing_of(even, tick=tick, hold=hold)
        fit = fit_joint(logs, timing, choose_tick=choose_tick)
    return logs, timing, with_observed_speed(fit), even is not None


def _check_alike(logs: Sequence[Log]) -> None:
    for name in ("unit", "joint"):
        found = sorted({getattr(log, name) for log in logs})
        if len(found) > 1:
            raise InvalidInput(
                f"logs: got {name}s {', '.join(map(repr, found))}, expected logs of one joint in "
                "one unit: identify each joint by itself"
            )


def _signal(fit: Fit) -> float:
    """Standard deviation of the actual angles about their mean in each run [rad]."""
    grid = fit.grid
    runs = len(grid.starts)
    means = np.bincount(grid.run, grid.angles, runs) / np.bincount(grid.run, minlength=runs)
    return rms(grid.angles - means[grid.run])


def _intervals(
    fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty
) -> dict[str, Interval]:
    known = {**bounds, "theta_0": _theta_0(fit, bounds, uncertainty)}
    return {name: known[name] for name in PARAMETERS}


def _theta_0(fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty) -> Interval:
    """theta_0 = v_max / gain: by their covariance where it holds, else from their ends."""
    gain, v_max = bounds["gain"], bounds["v_max"]
    if v_max.bounded and gain.bounded:
        way = np.zeros(COUNT)
        way[:2] = -1.0, 1.0
        half = uncertainty.quantile * float(np.sqrt(way @ uncertainty.covariance @ way))
        value = fit.parameters.v_max / fit.parameters.gain
        if half < 1.0:
            return Interval(value * float(np.exp(-half)), value * float(np.exp(half)))
    upper = v_max.upper / gain.lower if gain.lower > 0.0 else np.inf
    return Interval(v_max.lower / gain.upper, upper)


def _covariance(fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty) -> Array | None:
    """Covariance of :data:`PARAMETERS` in SI units, shape (p, p)."""
    if not all(interval.bounded for interval in bounds.values()):
        return None
    change = model_derivatives(fit.grid, fit.parameters)
    covariance = change @ uncertainty.covariance @ change.T
    covariance.setflags(write=False)
    return np.asarray(covariance)


def _log_fits(logs: Sequence[Log], fit: Fit, held: HeldOut | None) -> tuple[LogFit, ...]:
    grid = fit.grid
    rows = np.zeros(len(grid.angles), dtype=bool) if held is None else held.rows
    by_held = np.full(len(grid.angles), np.nan)
    if held is not None:
        by_held[rows] = held.predicted
    columns = zip(
        logs,
        grid.places,
        grid.per_log(fit.predicted),
        grid.per_log(rows.astype(float), fill=0.0),
        grid.per_log(by_held),
        grid.per_log(fit.weights, fill=0.0),
        grid.per_log(fit.residuals),
        strict=True,
    )
    return tuple(
        LogFit(
            log=log,
            used=used,
            predicted=predicted,
            held_out=out > 0.0,
            held_out_predicted=out_predicted,
            weights=weights,
            rms=rms(residuals[used]) if used.any() else 0.0,
        )
        for log, used, predicted, out, out_predicted, weights, residuals in columns
    )
