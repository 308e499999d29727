"""Whether a model may be used, and what its user has to know first.

Errors are judged as shares of the standard deviation of the motion. In brackets stands what half
and twice a bound change in the verdicts on 29 reference logs (20 made, 9 recorded;
``scripts/reference``), 27 of which are accepted, with 21 warnings in all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from planner.arrays import Array, rms
from planner.identification.grid import Grid, Timing, unequal
from planner.identification.intervals import at_edge
from planner.identification.joint_fit import delayed_errors
from planner.identification.least_squares import Fit, sound_rms
from planner.identification.log import GAP, Log
from planner.identification.parameters import TERMS
from planner.identification.result import Finding, HeldOut, Interval, Topic, told
from planner.model.evidence import PROVEN, Verdict

SIMPLER = {
    "raw": "the request itself",
    "delay": "a mere delay",
    "first_order": "a delay with a first-order lag",
}

SIGN_LIKENESS = 1.05
"""Both signs, or requests before and after, explain the angles if what they leave unexplained is
within this factor."""

REFUSED = 0.25
"""A model that misses more is refused. Recordings of joints that the model is meant for leave 0.02
to 0.23, those of an overloaded one 0.23 to 1. (One verdict; one.)"""

SUSPECT = 0.1  # from this error on a possible reason is reported (three warnings more; one less)

POOR, NO_BETTER = 0.2, 0.9
"""From the first error on a model has to come below the second share of the error of a mere delay
(none and one verdict; one verdict)."""

DELAY_WINS, SIMPLER_WINS = 1.05, 1.02
"""A model whose error on held-out rows exceeds that of the best pure delay by the first factor is
worse than a delay; a simpler description that predicts them better by the second one is pointed out
(six warnings more; none)."""


Columns = tuple[Finding | None, Finding | None, tuple[float, float] | None]
"""What speaks against the columns of a log: see :func:`wrong_columns`."""

ANOTHER_SCALE = "one column may be in another scale"  # a reason to refuse a model, or to doubt it


def verdict_on(
    fit: Fit,
    bounds: Mapping[str, Interval],
    held: HeldOut | None,
    simple: dict[str, float],
    *,
    columns: Columns,
    signal: float,
    tested: bool,
    friction: float,
    shaken: Sequence[Finding],
) -> tuple[Verdict, Finding, list[Finding]]:
    """Judge a fit by its error, without gross outliers, on all rows and on those held out.

    The rules are in ``docs/math.md``, section 8, "The verdict". ``simple`` is the error of the
    simpler descriptions on the same rows [rad], ``signal`` the standard deviation of the motion
    [rad], and ``friction`` by how much the dead band may be larger than that of the model [rad].

    Returns the verdict, its reason and what else to know; the topic of the reason is "fit", or what
    makes a fit to the log meaningless.
    """
    error, where, unit = sound_rms(fit.residuals), "", fit.grid.logs[0].unit
    if held is not None and held.sound_rms >= error:
        error, where = held.sound_rms, " in the part that was held out"
    missed, mere = error / signal, min(simple["raw"], simple["delay"])
    suspect, hidden = missed > SUSPECT, friction > SUSPECT * signal
    useless = missed > POOR and fit.rms > NO_BETTER * mere
    fits = missed <= REFUSED and not useless
    # Findings from which all others follow
    angles, run, at = fit.grid.angles, fit.grid.run, fit.parameters
    steps = np.diff(angles)[run[1:] == run[:-1]]  # of noise as large as the motion
    chance = 1.0 - 2.0 / math.sqrt(len(angles))
    if not fits and rms(steps) ** 2 / 2.0 >= chance * signal**2:
        note = told("motion", "no_motion", unit, signal=signal)
        return _refused("the log holds no motion of the joint", note)
    against, exchanged, spans = columns
    if against is not None:
        return _refused("the joint seems to move against its requests", against)
    if exchanged is not None and not fits:
        return _refused("the joint seems to move before it is requested to", exchanged)
    ours, others = (fit.rms, simple) if held is None else (held.rms, held.alternatives)
    name = min(others, key=lambda other: others[other])
    beaten, span = ours > SIMPLER_WINS * others[name], float(np.ptp(angles))
    notes = [*shaken]
    if held is not None and held.beyond:
        notes.append(told("held out", "held_out_is_faster"))
    if suspect:
        topic: Topic = "columns" if spans else "error" if fits else "fit"
        known = {"useless": useless, "fits": fits, "where": where, "spans": spans}
        sizes = {"missed": missed, "error": error, "rms": fit.rms, "mere": mere, "most": REFUSED}
        notes.append(told(topic, "misses", unit, **known, **sizes))
        if spans and not fits:
            return _refused(ANOTHER_SCALE, notes[-1])
    elif spans and span > np.ptp(fit.grid.requests):  # taken for gravity
        notes.append(told("columns", "scale_or_load", unit, spans=spans))
    if not fits and span < 0.2:
        notes.append(told("motion", "hardly_moves", unit, span=span, record=max(0.3, 30.0 * error)))
    if exchanged is not None and suspect:
        notes.append(exchanged)
    if beaten:
        sizes = {"error": others[name], "ours": ours}
        notes.append(told("simpler", "simpler", unit, name=SIMPLER[name], **sizes))
    if fits and hidden:
        notes.append(told("friction", "friction", unit, friction=friction))
    notes += _undetermined(fit, bounds, unit)
    share = f"{100.0 * missed:{'.0f' if missed >= 0.01 else '.1f'}}"
    why, delay = f"it misses {share} % of the motion{where}", others["delay"]
    doubts = {
        why: suspect,
        ANOTHER_SCALE: any(note.topic == "columns" for note in notes),
        f"{SIMPLER[name]} predicts better": beaten,
        "a pure delay predicts nearly as well": PROVEN * delay < ours <= delay,
        "the log does not determine dry friction": hidden,
        "the joint is shaken": bool(shaken),
        "it was not tested on rows held out": not tested,
    }
    verdict: Verdict = "holds"
    if not fits:
        verdict, why = "refused", f"{why}, and a mere delay hardly more" if useless else why
    elif ours > DELAY_WINS * delay:
        verdict, of_test = "worse than a delay", "" if held is None else "on held-out rows "
        why = f"{of_test}a pure delay has {100.0 * delay / ours:.0f} % of the model's error"
    elif any(doubts.values()):
        verdict, why = "usable", "; ".join(words for words, doubted in doubts.items() if doubted)
    else:  # many joints have these: motion that calls for them is untested
        gravity = fit.grid.unloaded and at.sag_sin == at.sag_cos == 0.0
        if at.dead_band == 0.0:
            none = "neither dry friction nor gravity" if gravity else "no dry friction"
            why += f"; the log shows {none}"
        elif gravity:
            why += "; the log shows no gravity"
    return verdict, Finding("fit", why), notes


def _refused(why: str, note: Finding) -> tuple[Verdict, Finding, list[Finding]]:
    """The answer of :func:`verdict_on` where a finding makes the fit meaningless."""
    return "refused", Finding(note.topic, why), [note]


def _undetermined(fit: Fit, bounds: Mapping[str, Interval], unit: str) -> list[Finding]:
    """A finding for each parameter that the log does not determine."""
    found = []
    at, called, gain, v_max = fit.parameters, fit.peak_command, bounds["gain"], bounds["v_max"]
    if math.isinf(v_max.upper):
        found.append(
            told(
                "top speed",
                "top_speed",
                unit,
                reached=at.v_max <= called,
                gain=at.gain if gain.upper - gain.lower <= 2.0 * at.gain else None,
                least=v_max.lower,
                v_max=at.v_max,
                record=max(2.0 * called / at.gain, fit.grid.span),
            )
        )
    elif math.isinf(gain.upper) and gain.lower > 0.0:
        found.append(told("threshold", "threshold", unit, most=bounds["theta_0"].upper))
    ended = (name for name in fit.free_names if at_edge(fit, name))
    found += [told("search", "search", name=TERMS.get(name, name)) for name in ended]
    return found + _undetermined_delays(fit, bounds)


def is_loose(tick: float, width: float, value: float) -> bool:
    """Whether an interval of a delay is so wide that the log does not determine it [s].

    It is wider than two ticks and half of the delay (two warnings more; none).
    """
    return width > max(2.0 * tick, 0.5 * value)


def _undetermined_delays(fit: Fit, bounds: Mapping[str, Interval]) -> list[Finding]:
    """Findings on lag and acceleration time where the log does not determine them.

    Sudden steps tell them as well as any motion, and more rows a second than the joint needs to
    respond hardly more: three simulated servos have the same wide intervals at 50, 100 and 200 Hz.
    """
    at, ends, found = fit.parameters, {}, []
    for name in ("lag", "acceleration_time"):
        low, high = bounds[name]
        ends[name] = f"{1e3 * low:.0f} and {1e3 * high:.0f} ms"
        if is_loose(fit.grid.tick, high - low, getattr(at, name)):
            bounded = math.isfinite(high)
            found.append(told("delays", "delay", name=name, ends=ends[name], bounded=bounded))
    # Sudden are requests most of whose way is in steps, or that have six steps between rests: more
    # would show no more. The signal that ``excite`` proposes has 12.
    steps = np.abs(np.diff(fit.grid.requests))
    jumps, rests = steps >= 0.1 * fit.grid.span, np.diff(fit.grid.edges) >= 0.2  # [s]
    sudden = np.sum(steps[jumps]) > 0.5 * np.sum(steps)
    sudden |= np.sum(jumps[:-1] & rests[:-1] & rests[1:]) >= 6
    if found and sudden and all(bounds[name].bounded for name in ends):
        late = at.lag + at.acceleration_time / 2.0 + at.time_constant
        close = float(np.median(np.diff(fit.grid.times))) <= late
        return [] if close else [told("log", "slow_rows", **ends)]
    return found  # of sudden steps another recording at this rate would show no more


def notes_on(
    logs: Sequence[Log], timing: Timing, jumps: Sequence[int], failed: Sequence[int]
) -> list[Finding]:
    """What is odd about the logs themselves.

    ``jumps`` is for each log how often its angles, or else its requests, started after a turn anew,
    ``failed`` how many of its measured angles no joint takes.
    """
    found = []
    periods = [1e3 * log.period for log in logs]
    if unequal(logs):
        known = {"most": max(periods), "period": 1e3 * timing.period}
        found.append(told("log", "unequal", least=min(periods), **known))
    for log, often, count in zip(logs, jumps, failed, strict=True):
        say = partial(told, "log", log=log.name)
        if often:
            found.append(say("turns", often=often))
        pauses = np.diff(log.times)
        if (holes := np.flatnonzero(pauses > GAP * log.period)).size:
            found.append(say("gaps", gaps=[(pauses[k], k, log.times[k]) for k in holes]))
        if not log.torque_on.all():
            found.append(say("torque", share=1.0 - float(np.mean(log.torque_on))))
        if count:
            found.append(say("glitches", count=count))
    return found


def wrong_columns(grid: Grid) -> Columns:
    """Evidence for a wrong sign and for exchanged columns, and the spans of columns in two scales.

    Half a cycle of motion that repeats itself looks like the other sign: the shorter delay is taken
    for the true one. Such motion is as like the requests before as those after.
    """
    delays, against, exchanged = np.linspace(0.0, grid.reach, 200), None, None
    before, after = _likeness(grid, delays), _likeness(grid, -delays)
    best = []
    for sign in (1.0, -1.0):
        near = _first_best(delays, sign * before)[0] + delays[1] * np.linspace(-1.0, 1.0, 17)
        near = np.maximum(near, 0.0)
        best.append(_first_best(near, sign * _likeness(grid, near)))
    (same_delay, same), (delay, other) = best
    as_good = _unlike(other) <= SIGN_LIKENESS * _unlike(same)
    if other >= 0.7 and as_good and delay < same_delay:
        likes = {"other": other, "delay": 1e3 * delay, "same": same, "same_delay": 1e3 * same_delay}
        repeats = _unlike(same) <= SIGN_LIKENESS * _unlike(other)
        against = told("sign", "sign", repeats=repeats, **likes)
    (late, future), past = _first_best(delays, after), float(np.max(before))
    if future >= 0.7 and SIGN_LIKENESS * _unlike(future) < _unlike(past):
        exchanged = told("columns", "exchanged", future=future, delay=1e3 * late, past=past)
    spans = _two_scales(grid, float(delays[np.argmax(before)]), past)
    return against, exchanged, spans


def _two_scales(grid: Grid, delay: float, likeness: float) -> tuple[float, float] | None:
    """The spans of columns whose angles are like the requests a delay before, but of another span.

    A slow or overloaded joint spans less than its requests, and one that rings little more; what
    holds a joint up bends its motion, too, so that the correlation is smaller.
    """
    requested, actual = float(np.ptp(grid.requests)), float(np.ptp(grid.angles))
    if min(requested, actual) <= 0.0 or 0.5 <= actual / requested <= 1.4 or likeness < 0.9:
        return None
    if actual > requested:  # unless it is for a moment only: the joint may overshoot
        requests = delayed_errors(grid, delay) + grid.angles
        usual = [np.diff(np.quantile(each, (0.1, 0.9)))[0] for each in (requests, grid.angles)]
        if usual[1] <= 1.4 * usual[0]:
            return None
    return requested, actual


def _first_best(delays: Array, likeness: Array) -> tuple[float, float]:
    """The first of the delays that are the best up to rounding, and its likeness.

    Each cycle of a motion has one.
    """
    k = np.argmax(likeness >= np.max(likeness) - 1e-9)
    return float(delays[k]), float(likeness[k])


def _unlike(likeness: float) -> float:
    """Share of the motion that a correlation leaves unexplained, as a standard deviation."""
    return math.sqrt(max(1.0 - likeness * abs(likeness), 0.0))


def _likeness(grid: Grid, delays: Array) -> Array:
    """Correlation of the angles with the requests of some time before, by that time [s]."""
    angles = grid.angles - np.mean(grid.angles)
    found, own = np.zeros(len(delays)), np.sum(angles**2)
    for k, delay in enumerate(delays):
        requests = delayed_errors(grid, float(delay)) + grid.angles
        requests -= np.mean(requests)
        size = math.sqrt(own * np.sum(requests**2))
        found[k] = float(np.sum(requests * angles)) / size if size > 0.0 else 0.0
    return found
