"""From logs to a joint model, with intervals, warnings and a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification.fit import (
    at_ticks,
    commanded_speed,
    errors_of,
    fit_joint,
    moving,
    never_saturating,
    peak_command,
    simple_fits,
    starts_of,
    with_even_rows,
    with_observed_speed,
    with_speed_of,
)
from planner.identification.grid import (
    Grid,
    Timing,
    fine_hold,
    measured_speed,
    resampled,
    resampled_like,
    thinned,
    timing_of,
)
from planner.identification.intervals import (
    all_intervals,
    correlations_of,
    covariance_of,
    intervals_of,
    noise_of,
    over_ticks,
    speed_bounded,
    uncertainty_of,
)
from planner.identification.judgement import (
    exchanged_columns,
    notes_on,
    opposite_sign,
    verdict_on,
)
from planner.identification.least_squares import Fit, better, least_squares, respond, sound_rms
from planner.identification.log import Log, as_logs, check_periods, unwrapped
from planner.identification.parameters import only
from planner.identification.residual_patterns import (
    Contact,
    contacts,
    joined,
    patterns,
    shaken,
    stops,
    stuck,
    with_weights,
)
from planner.identification.result import (
    Alternative,
    Finding,
    HeldOut,
    Identification,
    Interval,
    LogFit,
    Term,
    angle_in,
)
from planner.identification.terms import (
    backlash_of,
    has_large_sag,
    pays,
    with_calm_friction,
    with_motor,
    with_terms,
)
from planner.trajectory import Array, Indices, Mask, rms
from planner.validation import as_flag

SPEED_NOISE = 4.0 * math.sqrt(2.0) / 0.1
"""Standard deviations of the noise that the angles at both ends of 0.1 s may be off [1/s]."""

PAPER_TICK = 0.008
"""Ticks of the paper's robot, by which its joints move [s]."""

MOSTLY_FREE = 0.5
"""Share of the rows of a log that have to remain where something holds the joint in others."""

ALIKE_PARTS = 15
"""Into how many parts each log is divided, every second of which tests whether a joint is a motor;
odd and large, since test signals are made of a few parts, some of them twice.

The halves of a log that begins with slow motion are too unlike: the first may hold nothing that
tells an acceleration limit, which in the second matters most."""

LOST = 0.2
"""Share of the loss by which a joint is worse where it is sought again: one that requests nearly
shake out of step goes another way after a small change."""

MAYBE_UNLIMITED = 10.0
"""Up to how many times its loss without further terms a joint that never saturates is tried with
them. (With slow ramps it is 2 or 3 times, with steps 60 and more.)"""

LEFT_OUT = "these rows are left out"
"""What becomes of rows in which something holds the joint."""

CONTACT_ROUNDS = 3
"""How often contact is sought, each time without the rows that are known to have it."""


@np.errstate(under="ignore")  # too small to matter, whatever the caller has set
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
        returned as well: see ``accepted``, ``reason`` and ``warnings``.

    Raises:
        InvalidTrajectory: A log is malformed.
        InvalidInput: The logs hold no motion to learn from, are of different units, have rows too
            far apart or too close to be of a joint, or tick and hold contradict their period.

    Example:
        >>> import numpy as np
        >>> from planner import JointModel, Log, simulate
        >>> requests = np.repeat(np.radians([0.0, 60.0, -20.0, 10.0, 40.0, 0.0]), 60)
        >>> angles = simulate(JointModel.ers210a(), requests, cyclic=False)
        >>> times = 0.008 * np.arange(len(requests))
        >>> found = identify(Log(times=times, requests=requests, angles=angles))
        >>> found.accepted, round(found.model.lag, 3)
        (True, 0.032)
    """
    hold_out = as_flag("hold_out", hold_out)
    logs = as_logs(logs)
    _check_alike(logs)
    check_periods(logs)
    logs, jumps = zip(*map(unwrapped, logs), strict=True)
    free, stuck_rows = _without_stuck(logs)
    free, timing, candidates, evenly_timed = _fitted(free, tick=tick, hold=hold)
    every = [replace(log, torque_on=whole.torque_on) for log, whole in zip(free, logs, strict=True)]
    joints, logs = _with_terms(candidates), free
    logs, held_rows = _without_contact(logs, _on_all(logs, joints[0].fit))
    if held_rows:
        choose_tick = tick is None and hold is None
        joints = _with_terms(fit_joint(logs, timing, choose_tick=choose_tick))
    plain, full = _with_motor(logs, joints)
    timing = timing.ticking(full.fit.grid.tick)
    logs, stopped = _without_stops(logs, full.fit)
    if stopped:
        held_rows += stopped
        plain, full = _with_motor(logs, _with_terms(fit_joint(logs, timing)))
    elif has_large_sag(full.fit):  # it may imitate a stop: the joint that misses less is kept
        free_logs, stopped = _without_stops(logs, plain.fit)
        rivals = plain, full
        if stopped:
            rivals = _with_motor(free_logs, _with_terms(fit_joint(free_logs, timing)))
        if _missed(rivals[1].fit) < _missed(full.fit):
            logs, held_rows, (plain, full) = free_logs, held_rows + stopped, rivals
    weighed = with_weights(_log_fits(logs, full.fit, None), noise_of(full.fit))
    if weighed is not None:
        logs = weighed
        every = [replace(log, weights=each.weights) for log, each in zip(every, logs, strict=True)]
        anew = _with_motor(logs, _with_terms(fit_joint(logs, timing)))
        again = _refitted(logs, plain, full)
        plain, full = again if better(anew[1].fit, again[1].fit) else anew
    motor = full.fit is not plain.fit
    if motor and hold_out:
        rivals = plain, full
        parts = [
            held_out(logs, timing, each.fit, motor=each is full, parts=ALIKE_PARTS)
            for each in rivals
        ]
        if parts[0] and parts[1]:  # what is fitted and what is not count alike, as in the error
            bare, more = (
                rms(each.fit.weighted) * rms(_weighted(held, each.fit.grid))
                for held, each in zip(parts, rivals, strict=True)
                if held
            )
            motor = more <= bare
    fit, terms = full if motor else plain
    coarse, rows = timing, fit.grid  # with the ticks on which the terms are sought
    longer: tuple[Fit, Fit] | None = None  # fits with longer and shorter ticks
    if tick is None and hold is None:
        finer = fine_hold(timing.period, fit.parameters.acceleration_time)
        fine, found = at_ticks(logs, fit, timing.period / finer), terms
        if motor and fine.cost > (1.0 + LOST) * fit.cost:
            fine, found = with_motor(fine, terms)
        if timing.hold > 1 or not _by_rows(fit, fine):
            timing, fit, terms = timing.ticking(fine.grid.tick), fine, found
            longer = at_ticks(logs, fine, 2.0 * timing.tick), fine
    fit = with_observed_speed(with_calm_friction(logs, fit))
    uncertainty = uncertainty_of(fit)
    bounds = intervals_of(fit, uncertainty)
    outside = [measured_speed(log, ~used) for log, used in zip(every, fit.grid.places, strict=True)]
    seen = max(outside)
    faster = bounds["v_max"].upper == math.inf and seen > bounds["v_max"].lower
    refuted = _refuted(every, outside, fit, bounds["v_max"].upper)
    if refuted:
        faster, (seen, _) = True, refuted
    if faster:  # in rows that are not fitted
        if seen > fit.parameters.v_max:
            fit = with_speed_of(fit, seen)
        bounds["v_max"] = Interval(max(seen, bounds["v_max"].lower), math.inf)
    # By how much the dead band may be larger than that of the model [rad].
    frictions = [term.interval.upper for term in terms if term.name == "dead_band"]
    friction = max(frictions, default=0.0) - fit.parameters.dead_band
    if friction == math.inf:  # or it is a sag
        bounds["offset"] = Interval(-math.inf, math.inf)
    held = (
        held_out(logs, coarse, fit, faster=refuted is not None, motor=motor) if hold_out else None
    )
    some = thinned(logs)
    simple = simple_fits(resampled_like(rows, some, rows.tick))
    errors = {other.name: rms(errors_of(other, rows, fit.starts)) for other in simple}
    signal, noise = _signal(fit), noise_of(fit)
    alike = resampled_like(fit.grid, some, fit.grid.tick)
    model = fit.parameters.model(tick=timing.tick, hold=timing.hold)
    fits = _log_fits(every, fit, held)
    intervals = all_intervals(fit, bounds, uncertainty)
    if longer:
        intervals = over_ticks(intervals, *longer)
    unit = logs[0].unit
    verdict, reason, notes = verdict_on(
        fit,
        intervals,
        uncertainty,
        held,
        errors,
        against=opposite_sign(alike),
        exchanged=exchanged_columns(alike),
        signal=signal,
        tested=held is not None or not hold_out,
        friction=friction,
        shaken=shaken(model, fits),
        unit=unit,
    )
    gain = intervals.pop("gain")
    if reason.topic != "motion":  # else nothing in the log is of the joint
        notes += [*notes_on(every, timing, jumps), *stuck_rows, *held_rows]
        if refuted:
            notes.append(refuted[1])
        elif faster:  # in logs whose rows are not all fitted
            for each, speed in zip(fits, outside, strict=True):
                left_out = ", ".join(f"{count} {why}" for why, count in each.left_out.items())
                if speed == seen:
                    words = (
                        f"{each.log.name}: the joint moves at up to {angle_in(unit, seen, '/s')}, "
                        f"its least top speed, also in rows that are not fitted: {left_out}"
                    )
                    notes.append(Finding("log", words))
        if evenly_timed:
            words = "the times of the rows jitter: rows every "
            words += f"{1e3 * timing.period:.3g} ms fit better, and are taken"
            notes.append(Finding("log", words))
        if hold_out and held is None:
            words = "nothing was held out: the first half of the log holds no motion to fit"
            notes.append(Finding("log", words))
        notes += patterns(model, fits, noise, backlash_of(fit))
    return Identification(
        model=model,
        fits=fits,
        rms=fit.rms,
        held_out_rms=None if held is None else held.rms,
        noise=noise,
        unexplained=math.sqrt(max(fit.scale**2 - noise**2, 0.0)),
        fastest=fit.grid.fastest,
        heaviest=float(np.max(np.abs(fit.grid.loads), initial=0.0)),
        signal=signal,
        intervals=intervals,
        gain_interval=gain,
        covariance=covariance_of(fit, bounds, uncertainty),
        correlations=correlations_of(fit, uncertainty),
        alternatives=tuple(
            Alternative(
                name=name,
                rms=errors[name],
                held_out_rms=None if held is None else held.alternatives[name],
                parameters=known,
            )
            for name, known, _ in simple
        ),
        findings=tuple(notes),
        verdict=verdict,
        reason=reason.words,
        terms=tuple(
            replace(term, interval=intervals[term.name]) if term.kept else term for term in terms
        ),
    )


def _by_rows(whole: Fit, fine: Fit) -> bool:
    """Whether a joint is taken to move by ticks of a row, and not by shorter ones.

    Without inertia, and with rows as far apart as the ticks of the paper's robot, it is so unless
    the log tells otherwise; else the log has to tell.
    """
    inertia = whole.parameters.time_constant > 0.0
    if not inertia and abs(whole.grid.tick - PAPER_TICK) <= 1e-3 * PAPER_TICK:
        return not better(whole, fine)
    return pays(fine, whole)


def _refuted(
    logs: Sequence[Log], speeds: Sequence[float], fit: Fit, upper: float
) -> tuple[float, Finding] | None:
    """The speed of rows that are not fitted [rad/s], where those that are fitted exclude it.

    Args:
        logs: The logs.
        speeds: The highest speed of each in rows that are not fitted [rad/s].
        fit: The fit.
        upper: Upper end of the interval of the top speed by the rows that are fitted [rad/s].
    """
    if upper == math.inf:
        return None
    model = fit.parameters.model(tick=fit.grid.tick, hold=1)
    limits = model.speed_limits(fit.grid.heaviest * np.array([-1.0, 0.0, 1.0]))
    most = float(np.max(np.abs(limits))) + model.v_max / model.theta_0 * model.most_pose_sag
    most *= upper / fit.parameters.v_max
    log, speed = max(zip(logs, speeds, strict=True), key=lambda each: each[1])
    if speed - SPEED_NOISE * noise_of(fit) <= most:
        return None
    fast, bound = (angle_in(log.unit, each, "/s") for each in (speed, most))
    words = (
        f"{log.name}: the joint moves at up to {fast} in rows that are not fitted, and "
        f"those that are bound its top speed at {bound}: a limit in the servo was changed, "
        "or something pushed the joint; v_max is the measured speed; record anew with one limit, "
        "or leave out the rows in which it was pushed"
    )
    return speed, Finding("log", words)


def _fitted(
    logs: Sequence[Log], *, tick: float | None, hold: int | None
) -> tuple[Sequence[Log], Timing, tuple[Fit, ...], bool]:
    """The logs, on even times where these fit better, their ticks, and the fits to them."""
    choose_tick = tick is None and hold is None
    timing = timing_of(logs, tick=tick, hold=hold)
    fits = fit_joint(logs, timing, choose_tick=choose_tick)
    even = with_even_rows(logs, timing, fits[-1])
    if even is not None:
        logs, timing = even, timing_of(even, tick=tick, hold=hold)
        fits = fit_joint(logs, timing, choose_tick=choose_tick)
    return logs, timing, fits, even is not None


class _Fitted(NamedTuple):
    """A fit, and the terms that were tried for it."""

    fit: Fit
    terms: tuple[Term, ...]


def _with_terms(fits: Sequence[Fit]) -> list[_Fitted]:
    return [_with_terms_of_either(fit) for fit in fits]


def _with_terms_of_either(fit: Fit) -> _Fitted:
    """The fit with its terms, or that of a joint which never saturates, where that is better."""
    found = _Fitted(*with_terms(fit))
    unlimited = never_saturating(found.fit)
    if unlimited is not None and unlimited.cost < MAYBE_UNLIMITED * found.fit.cost:
        other, terms = with_terms(unlimited, found.terms)
        if better(found.fit, other):
            return _Fitted(replace(other, free=other.free | only("v_max")), terms)
    return found


def _with_motor(logs: Sequence[Log], plain: Sequence[_Fitted]) -> tuple[_Fitted, _Fitted]:
    """The fit to all rows with the better ticks, without and with the terms of a motor."""
    full = [_Fitted(*with_motor(*each)) for each in plain]
    k = 1 if len(full) > 1 and better(full[0].fit, full[1].fit) else 0
    bare = plain[k]._replace(fit=_on_all(logs, plain[k].fit))
    motor = full[k].fit is not plain[k].fit
    return bare, full[k]._replace(fit=_on_all(logs, full[k].fit) if motor else bare.fit)


def _on_all(logs: Sequence[Log], fit: Fit) -> Fit:
    """The fit to all rows of the logs, begun at one to some of them."""
    return at_ticks(logs, fit, fit.grid.tick)


def _refitted(logs: Sequence[Log], plain: _Fitted, full: _Fitted) -> tuple[_Fitted, _Fitted]:
    """The same joints, fitted to logs with other weights."""
    bare = plain._replace(fit=_again(logs, plain.fit))
    motor = full.fit is not plain.fit
    return bare, full._replace(fit=_again(logs, full.fit) if motor else bare.fit)


def _again(logs: Sequence[Log], fit: Fit) -> Fit:
    grid = resampled_like(fit.grid, logs, fit.grid.tick)
    return least_squares(grid, fit.parameters, free=fit.free, starts=fit.starts)


def _left_without(log: Log, parts: Sequence[Indices], *, of: Log) -> Log | None:
    """The log with these rows as if without torque; None where few rows of a log would be left."""
    free = log.torque_on.copy()
    for rows in parts:
        free[rows] = False
    few = np.sum(free) < MOSTLY_FREE * np.sum(of.torque_on)
    return None if few else replace(log, torque_on=free)


def _without_contact(logs: Sequence[Log], fit: Fit) -> tuple[Sequence[Log], list[Finding]]:
    """The logs, rows in which something touches the joint as if without torque; and notes.

    With these rows the fit is between what touches the joint and what does not, so that without
    them more may be found.
    """
    grid, free = fit.grid, list(logs)
    touched: dict[int, list[Contact]] = {}
    for _ in range(CONTACT_ROUNDS):
        found = contacts(_log_fits(free, fit, None), noise_of(fit))
        for k, contact in found.items():
            rest = _left_without(free[k], [contact.rows], of=logs[k])
            if rest is not None:
                free[k] = rest
                touched.setdefault(k, []).append(contact)
        if not found:
            break
        fit = least_squares(resampled_like(grid, free, grid.tick), fit.parameters, free=fit.free)
    notes = [joined(touched[k]).finding(logs[k], LEFT_OUT) for k in sorted(touched)]
    return tuple(free), notes


def _without_stuck(logs: Sequence[Log]) -> tuple[Sequence[Log], list[Finding]]:
    """The logs, rows in which the joint is stuck as if without torque; and notes on these.

    Where most rows of a log would go they stay: then the angles are those of another joint.
    """
    free_logs, notes = [], []
    for log in logs:
        found = stuck(log)
        rest = _left_without(log, found, of=log)
        free_logs.append(log if rest is None else rest)
        notes += [
            Finding(
                "log",
                f"{log.name}: the joint does not move in {len(rows)} rows between {rows[0]} and "
                f"{rows[-1]}, whichever way it is requested: something holds it, or its sensor "
                f"stands still; {LEFT_OUT}",
            )
            for rows in (() if rest is None else found)
        ]
    return tuple(free_logs), notes


def _without_stops(logs: Sequence[Log], fit: Fit) -> tuple[Sequence[Log], list[Finding]]:
    """The logs, rows at a mechanical stop as if without torque; and notes on these.

    Where most rows of a log would go they stay: then something else holds the joint.
    """
    free_logs, notes = [], []
    for each in _log_fits(logs, fit, None):
        log, found = each.log, stops(each, noise_of(fit))
        rest = _left_without(log, [stop.rows for stop in found], of=log)
        free_logs.append(log if rest is None else rest)
        fate = "too many rows to leave out" if rest is None else LEFT_OUT
        notes += [stop.finding(log, fate) for stop in found]
    return tuple(free_logs), notes


def _check_alike(logs: Sequence[Log]) -> None:
    for name in ("unit", "joint"):
        found = sorted({getattr(log, name) for log in logs})
        if len(found) > 1:
            raise InvalidInput(
                f"logs: got {name}s {', '.join(map(repr, found))}, expected logs of one joint in "
                "one unit: identify each joint by itself"
            )


def _missed(fit: Fit) -> float:
    """Share of the motion that a fit misses [-]."""
    return fit.rms / _signal(fit)


def _signal(fit: Fit) -> float:
    """Standard deviation of the actual angles about their mean in each run [rad]."""
    grid = fit.grid
    runs = len(grid.starts)
    means = np.bincount(grid.run, grid.angles, runs) / np.bincount(grid.run, minlength=runs)
    return rms(grid.angles - means[grid.run])


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
            rms=rms(residuals[used]),
        )
        for log, used, predicted, out, out_predicted, weights, residuals in columns
    )


def held_out(
    logs: Sequence[Log],
    timing: Timing,
    whole: Fit,
    *,
    faster: bool = False,
    motor: bool = True,
    parts: int = 2,
) -> HeldOut | None:
    """Fit every second part of each log, predict the others; None where they hold nothing to fit.

    Of long parts some stretches are fitted; all rows of the others are predicted.

    A top speed that the parts do not bound, and the others may exceed, cannot be predicted from
    them: there that of the fit to all rows is taken, the other parameters are fitted beside it, and
    tested.

    Args:
        logs: The logs.
        timing: Ticks on which the terms of the joint are sought.
        whole: The fit to all rows that are used in the end.
        faster: Whether its top speed is that of rows that are not fitted; then it is taken, too.
        motor: Whether the terms of a motor are sought together, too.
        parts: Into how many parts each log is divided; the first is fitted.
    """
    grid = whole.grid
    out = [_every_second(log, parts) for log in logs]
    known = thinned(
        [replace(log, torque_on=log.torque_on & ~o) for log, o in zip(logs, out, strict=True)]
    )
    try:
        (one,) = _with_terms(fit_joint(known, timing))
        fit, terms = one
        fit, _ = with_motor(fit, terms) if motor else (fit, terms)
        fit = at_ticks(known, fit, grid.tick)
        likewise = at_ticks(known, whole, grid.tick)
        if fit.cost > (1.0 + LOST) * likewise.cost:
            fit = likewise
    except InvalidInput:
        return None
    rows = np.concatenate([o[used] for o, used in zip(out, grid.places, strict=True)])
    if not rows.any():
        return None
    shown = peak_command(fit)
    fit = with_observed_speed(fit)
    at, starts = fit.parameters, starts_of(grid, fit)
    response = respond(grid, at, starts)
    called = commanded_speed(at, response)
    beyond = called > 1.1 * shown and not speed_bounded(fit)
    if beyond or faster:
        speed = whole.parameters.v_max
        if not (faster or speed_bounded(whole)):  # what all rows call for is its least one
            speed = max(speed, shown)
        fit = with_speed_of(fit, speed)
        at, starts = fit.parameters, starts_of(grid, fit)
        response = respond(grid, at, starts)
    predicted = response.predicted
    simple = simple_fits(
        moving(resampled(known, tick=timing.tick, reach=timing.reach, burn_in=0.0))
    )
    every = resampled_like(grid, logs, timing.tick)
    first = every.measured_starts
    others = {other.name: rms(errors_of(other, every, first)[rows]) for other in simple}
    errors = (predicted - grid.angles)[rows]
    return HeldOut(
        rows=rows,
        predicted=predicted[rows],
        rms=rms(errors),
        sound_rms=sound_rms(errors),
        alternatives=others,
        beyond=beyond,
    )


def _weighted(held: HeldOut, grid: Grid) -> Array:
    """Weighted errors of the rows of a grid that were held out [rad]."""
    errors = held.predicted - grid.angles[held.rows]
    return np.asarray(grid.weights[held.rows] * errors)


def _every_second(log: Log, parts: int) -> Mask:
    """Rows in the second of so many parts, the fourth ..., each with as many rows with torque."""
    before: Array = np.cumsum(log.torque_on) - log.torque_on
    part = before * parts // max(1, int(np.sum(log.torque_on)))
    return np.asarray(part % 2 == 1)
