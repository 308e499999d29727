"""From logs to a joint model, with intervals, warnings and a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.arrays import Array, Mask, as_flag, rms
from planner.exceptions import InvalidInput
from planner.identification import joint_fit, residual_patterns, terms
from planner.identification.grid import (
    Timing,
    fine_hold,
    measured_speed,
    resampled,
    resampled_like,
    sound_rows,
    thinned,
    timing_of,
)
from planner.identification.intervals import (
    all_intervals,
    correlations_of,
    intervals_of,
    over_top_speeds,
    speed_bounded,
)
from planner.identification.judgement import notes_on, verdict_on, wrong_columns
from planner.identification.least_squares import FULL, Fit, better, sound_rms
from planner.identification.log import Log, as_logs, check_alike, check_periods, unwrapped
from planner.identification.parameters import only
from planner.identification.residual_patterns import Held
from planner.identification.result import (
    Alternative,
    Finding,
    HeldOut,
    Identification,
    Interval,
    LogFit,
    told,
)
from planner.identification.terms import INTEGRALS, MOTOR, ORDER
from planner.model.joint import JointModel

_Pair = tuple[Fit, Fit]  # the joint without and with the terms of a motor; one fit if none pay

LEFT_OUT = "these rows are left out"
"""What becomes of rows in which something holds the joint, unless these are too many."""


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
    hold_out, choose_tick = as_flag("hold_out", hold_out), tick is None and hold is None
    logs = as_logs(logs)
    check_alike(logs)
    check_periods(logs)
    logs, jumps = zip(*map(unwrapped, logs), strict=True)
    sound = [*map(sound_rows, logs)]
    failed = [int(np.sum(log.measured & ~rows)) for log, rows in zip(logs, sound, strict=True)]
    logs = [replace(log, measured=rows) for log, rows in zip(logs, sound, strict=True)]
    free, stuck_rows = _without(logs, [*map(residual_patterns.stuck, logs)])
    timing = timing_of(free, tick=tick, hold=hold)
    fits = joint_fit.fit_joint(free, timing, choose_tick=choose_tick)
    even = joint_fit.with_even_rows(free, timing, fits[-1])
    if even is not None:
        free, timing = even, timing_of(even, tick=tick, hold=hold)
        fits = joint_fit.fit_joint(free, timing, choose_tick=choose_tick)
    plain = [*map(_with_terms, fits)]
    free, touched = _without_contact(joint_fit.refitted(free, plain[0]))
    if touched:
        plain = [*map(_with_terms, joint_fit.fit_joint(free, timing, choose_tick=choose_tick))]
    pair = _with_motor(free, plain)
    timing = timing.ticking(pair[1].grid.tick)
    pair, stopped = _without_stops(pair, timing)
    pair = _weighed(pair)
    coarse, others = over_top_speeds(terms.with_integral(pair[1]))
    tick = timing.period / fine_hold(timing.period, coarse.parameters.acceleration_time)
    others += terms.without_top_speed(coarse, tick)
    # The loss is as rough in the top speed at short ticks. (Else one log of 160 simulated motors is
    # fitted with 1.5 times the noise.)
    fine = over_top_speeds(_with_shorter_ticks(coarse, timing, tick))[0] if choose_tick else coarse
    coarse = joint_fit.with_observed_speed(coarse)
    every = [
        replace(used, torque_on=log.torque_on)
        for log, used in zip(logs, coarse.grid.logs, strict=True)
    ]
    fit, bounds, refuted, seen = _bounded(every, fine, coarse, others)
    held = _held_out(pair, coarse, fit, timing, faster=refuted) if hold_out else None
    notes = [*notes_on(every, timing, jumps, failed), *stuck_rows, *touched, *stopped, *seen]
    if even is not None:
        notes.append(told("log", "jitter", period=1e3 * timing.period))
    if hold_out and held is None:
        notes.append(told("log", "nothing_held_out"))
    timing = timing.ticking(fine.grid.tick)
    intervals = all_intervals(coarse, bounds, fit)
    model = fit.parameters.model(tick=timing.tick, hold=timing.hold)
    tested = held is not None or not hold_out
    return _answer(
        model, fit, coarse, _log_fits(fit, every, held), intervals, held, notes, tested=tested
    )


def _without(
    logs: Sequence[Log], held: Sequence[Sequence[Held]], whole: Sequence[Log] = ()
) -> tuple[Sequence[Log], list[Finding]]:
    """The logs, rows in which something holds the joint as if without torque; and notes on these.

    Where most rows of a log, as it was at first, would go they stay: then something else holds the
    joint, or the angles are those of another one.
    """
    kept, notes = [], []
    for log, parts, of in zip(logs, held, whole or logs, strict=True):
        free = log.torque_on.copy()
        for part in parts:
            free[part.rows] = False
        few = np.sum(free) < 0.5 * np.sum(of.torque_on)
        kept.append(log if few or not parts else replace(log, torque_on=free))
        notes += [
            part.finding(log, "too many rows to leave out" if few else LEFT_OUT) for part in parts
        ]
    return tuple(kept), notes


def _with_terms(fit: Fit) -> Fit:
    """The fit with its terms, or that of a joint which never saturates, where that is better.

    On slow ramps a top speed a little below theirs may stand for a sag or friction that is not
    fitted yet. (There the loss without further terms is 2 or 3 times as large as with them, with
    steps 60 times and more.)
    """
    found = terms.with_terms(fit)
    if found.parameters.v_max <= fit.grid.fastest:
        at = found.parameters._replace(v_max=4.0 * fit.grid.fastest)
        unlimited = found.again(at, free=found.free & ~only("v_max"))
        if unlimited.cost < 10.0 * found.cost:
            other = terms.with_terms(unlimited)
            if better(found, other):
                return replace(other, free=other.free | only("v_max"))
    return found


def _without_contact(fit: Fit) -> tuple[Sequence[Log], list[Finding]]:
    """The logs, rows in which something touches the joint as if without torque; and notes.

    With these rows the fit is between what touches the joint and what does not, so that without
    them more may be found.
    """
    logs: Sequence[Log] = fit.grid.logs
    free = logs
    touched = [list[Held]() for _ in logs]
    for _ in range(3):
        found = residual_patterns.contacts(_log_fits(fit), fit.noise)
        if not any(found):
            break
        rest, _ = _without(free, found, logs)
        for known, parts, old, new in zip(touched, found, free, rest, strict=True):
            known += parts if new is not old else []
        free = rest
        fit = fit.again(grid=resampled_like(fit.grid, free, fit.grid.tick))
    named = zip(logs, touched, strict=True)
    return free, [
        residual_patterns.joined(parts).finding(log, LEFT_OUT) for log, parts in named if parts
    ]


def _both(logs: Sequence[Log], pair: _Pair) -> _Pair:
    """The same joints, fitted to other rows."""
    plain, joint = pair
    found = joint_fit.refitted(logs, plain)
    return found, found if joint is plain else joint_fit.refitted(logs, joint)


def _with_motor(logs: Sequence[Log], fits: Sequence[Fit]) -> _Pair:
    """The joint fitted to all rows with the better ticks, with the terms of a motor if they pay."""
    pairs = [(plain, terms.with_motor(plain)) for plain in fits]
    better_one = len(pairs) > 1 and better(pairs[0][1], pairs[1][1])
    return _both(logs, pairs[better_one])


def _without_stops(pair: _Pair, timing: Timing) -> tuple[_Pair, list[Finding]]:
    """The joint without the rows at a mechanical stop; and notes on these.

    A large sag may imitate a stop: there the joint that misses less is kept.
    """
    (plain, joint), logs = pair, pair[1].grid.logs
    imitated = joint is not plain and terms.has_large_sag(joint)
    for fit in (joint, plain) if imitated else (joint,):
        held = [residual_patterns.stops(of, fit.noise) for of in _log_fits(fit)]
        free, stopped = _without(logs, held)
        if stopped:
            rival = _with_motor(free, [*map(_with_terms, joint_fit.fit_joint(free, timing))])
            shares = [each.rms / each.grid.signal for each in (rival[1], joint)]
            if fit is joint or shares[0] < shares[1]:
                return rival, stopped
    return pair, []


def _weighed(pair: _Pair) -> _Pair:
    """The joint fitted to rows weighed by the error to expect of them, where it matters.

    A motor, which may show only there, is sought anew.
    """
    logs = residual_patterns.with_weights(_log_fits(pair[1]), pair[1].noise)
    if logs is None:
        return pair
    again = _both(logs, pair)
    anew = _with_motor(logs, again[:1])
    return again if better(anew[1], again[1]) else anew


def _with_shorter_ticks(fit: Fit, timing: Timing, tick: float) -> Fit:
    """The joint with ticks of about 1 ms, ``tick``; the same one where it moves by ticks of a row.

    A joint without inertia whose rows are as far apart as the ticks of the paper's robot moves by
    these unless the log tells otherwise; of any other the log has to tell.
    """
    fine = joint_fit.refitted(fit.grid.logs, fit, tick=tick)
    paper = abs(fit.grid.tick - 0.008) <= 1e-3 * 0.008
    likely = paper and fit.parameters.time_constant <= 0.0
    if timing.hold == 1 and (not better(fit, fine) if likely else terms.pays(fine, fit)):
        return fit
    return fine


def _bounded(
    logs: Sequence[Log], fit: Fit, coarse: Fit, others: Sequence[Fit]
) -> tuple[Fit, dict[str, Interval], bool, list[Finding]]:
    """The joint, and its intervals at ``coarse`` ticks, with the parameters of the ``others``.

    Also whether rows that are not fitted are faster than the fit allows, and findings on them.
    """
    fit = joint_fit.with_observed_speed(terms.with_calm_friction(fit))
    bounds, notes = intervals_of(coarse, others), []
    if _friction_shown(fit) == math.inf:  # or it is a sag
        bounds["offset"] = Interval(-math.inf, math.inf)
    lower, upper = bounds["v_max"]
    pairs = zip(fit.grid.logs, fit.grid.places, strict=True)  # what held the joint says nothing
    outside = [measured_speed(log, ~used) for log, used in pairs]
    model = fit.parameters.model(tick=fit.grid.tick, hold=1)
    limits = model.speed_limits(fit.grid.heaviest * np.array([-1.0, 0.0, 1.0]))
    most = float(np.max(np.abs(limits))) + model.gain * model.most_pose_sag
    seen = max(outside)
    most *= upper / coarse.parameters.v_max  # of a joint with that v_max
    noise = 4.0 * math.sqrt(2.0) * fit.noise / 0.1  # of angles at both ends of 0.1 s
    refuted, unit = seen - noise > most, logs[0].unit
    if refuted:
        name = logs[outside.index(seen)].name
        notes.append(told("log", "faster_than_bounded", unit, log=name, seen=seen, most=most))
    if refuted or (upper == math.inf and seen > lower):
        bounds["v_max"] = Interval(max(seen, lower), math.inf)
        if seen > fit.parameters.v_max:
            fit = joint_fit.with_speed_of(fit, seen)
    return fit, bounds, refuted, notes


def _held_out(
    pair: _Pair, coarse: Fit, whole: Fit, timing: Timing, *, faster: bool
) -> HeldOut | None:
    """Fit the first half of each log, predict the second; None where these hold nothing to fit.

    It begins at ``coarse``, so that what the first halves do not determine at all stays. Where that
    leads far astray, as in logs of a few seconds, a joint is sought among these alone, and taken
    unless it fits them much worse. It is refined on the ticks of ``whole``.

    A top speed that the first halves do not bound, and the others may exceed, cannot be predicted
    from them: it is that of the fit to all rows, or, where these do not bound it either, what the
    first halves call for if that is more. So it is where it is ``faster`` than any that is fitted.
    """
    (plain, joint), grid = pair, whole.grid
    logs = joint.grid.logs
    out: list[Mask] = []
    for log in logs:
        before: Array = np.cumsum(log.torque_on) - log.torque_on
        out.append(before >= 0.5 * np.sum(log.torque_on))
    pairs = zip(logs, out, strict=True)
    known = thinned([replace(log, torque_on=log.torque_on & ~held) for log, held in pairs])
    rows = np.concatenate([o[used] for o, used in zip(out, grid.places, strict=True)])
    if not rows.any():
        return None
    try:
        joint_fit.moving(resampled_like(coarse.grid, known, coarse.grid.tick))
        fit = terms.with_needed(
            joint_fit.refitted(known, coarse), (*MOTOR, *ORDER, *INTEGRALS), effort=FULL
        )
        missed = fit.along(coarse.grid).predicted - grid.angles
        # Of 38 logs of 1 to 3.5 s four were refused without what follows, with it two are.
        if rms(missed[rows]) > 1.5 * rms(coarse.residuals[rows]):
            alone = _with_terms(joint_fit.fit_joint(known, timing)[0])
            if joint is not plain:
                alone = terms.with_motor(alone, joint.parameters)
            alone = joint_fit.refitted(known, alone)
            fit = alone if alone.cost <= 1.2 * fit.cost else fit
        fit = (
            joint_fit.refitted(known, fit, tick=grid.tick)
            if grid.tick < coarse.grid.tick
            else fit.again()
        )
    except InvalidInput:
        return None
    shown = fit.peak_command
    fit = joint_fit.with_observed_speed(fit)
    response = fit.along(grid)
    beyond = response.highest_command(fit.parameters) > 1.1 * shown and not speed_bounded(fit)
    if beyond or faster:
        speed = whole.parameters.v_max
        if not (faster or speed_bounded(whole)):  # what all rows call for is its least one
            speed = max(speed, shown)
        fit = joint_fit.with_speed_of(fit, speed)
        response = fit.along(grid)
    predicted = response.predicted[rows]
    fitted = resampled(known, tick=timing.tick, reach=timing.reach, burn_in=0.0)
    simple = joint_fit.simple_fits(joint_fit.moving(fitted))
    every = resampled_like(grid, logs, timing.tick)
    first = every.measured_starts
    others = {other.name: rms(joint_fit.errors_of(other, every, first)[rows]) for other in simple}
    errors = predicted - grid.angles[rows]
    return HeldOut(
        rows=rows,
        predicted=predicted,
        rms=rms(errors),
        sound_rms=sound_rms(errors),
        alternatives=others,
        beyond=beyond,
    )


def _friction_shown(fit: Fit) -> float:
    """Largest dead band that the rows allow, where one was sought [rad]."""
    return fit.terms["dead_band"].interval.upper if "dead_band" in fit.terms else 0.0


def _answer(
    model: JointModel,
    fit: Fit,
    coarse: Fit,
    fits: tuple[LogFit, ...],
    intervals: dict[str, Interval],
    held: HeldOut | None,
    notes: list[Finding],
    *,
    tested: bool,
) -> Identification:
    """The identified joint with its verdict and findings, those on its logs among them.

    The simpler descriptions are fitted on the ticks of ``coarse``, as the terms were.
    """
    some, rows = thinned(coarse.grid.logs), coarse.grid
    simple = joint_fit.simple_fits(resampled_like(rows, some, rows.tick))
    errors = {other.name: rms(joint_fit.errors_of(other, rows, fit.starts)) for other in simple}
    verdict, reason, findings = verdict_on(
        fit,
        intervals,
        held,
        errors,
        columns=wrong_columns(resampled_like(fit.grid, some, fit.grid.tick)),
        signal=fit.grid.signal,
        tested=tested,
        friction=_friction_shown(fit) - fit.parameters.dead_band,
        shaken=residual_patterns.shaken(model, fits),
    )
    gain = intervals.pop("gain")
    if reason.topic == "fit":  # else what a fit to this log shows is not of the joint
        asymmetry = intervals.get("v_offset")
        findings += [
            *notes,
            *residual_patterns.patterns(model, fits, fit.noise, asymmetry, terms.backlash_of(fit)),
        ]
    return Identification(
        model=model,
        fits=fits,
        rms=fit.rms,
        held_out_rms=None if held is None else held.rms,
        noise=fit.noise,
        unexplained=math.sqrt(max(fit.scale**2 - fit.noise**2, 0.0)),
        fastest=fit.grid.fastest,
        heaviest=float(np.max(np.abs(fit.grid.loads), initial=0.0)),
        signal=fit.grid.signal,
        intervals=intervals,
        gain_interval=gain,
        correlations=correlations_of(fit),
        alternatives=tuple(
            Alternative(
                name=name,
                rms=errors[name],
                held_out_rms=None if held is None else held.alternatives[name],
                parameters=known,
            )
            for name, known, _ in simple
        ),
        findings=tuple(findings),
        verdict=verdict,
        reason=reason.words,
        terms=tuple(
            replace(term, interval=intervals[term.name]) if term.kept else term
            for term in fit.terms.values()
        ),
    )


def _log_fits(
    fit: Fit, logs: Sequence[Log] | None = None, held: HeldOut | None = None
) -> tuple[LogFit, ...]:
    grid, by_held = fit.grid, np.full(len(fit.grid.angles), np.nan)
    if held is not None:
        by_held[held.rows] = held.predicted
    columns = (grid.per_log(fit.predicted), grid.per_log(by_held), grid.per_log(fit.weights, 0.0))
    return tuple(
        LogFit(log=log, predicted=predicted, held_out_predicted=out, weights=weights)
        for log, predicted, out, weights in zip(logs or grid.logs, *columns, strict=True)
    )
