"""Whether a model may be used, and what its user has to know first, in codes and numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.identification.fit import delayed_errors, peak_command
from planner.identification.grid import Grid, Timing, sound_rows, unequal
from planner.identification.intervals import Uncertainty, at_edge, middle_known_within
from planner.identification.least_squares import Fit, sound_rms
from planner.identification.log import Log
from planner.identification.parameters import Parameters
from planner.identification.result import HeldOut, Interval, Note, Topic, note
from planner.model.evidence import PROVEN, Verdict
from planner.trajectory import Array, rms

SAME_LIKENESS = 1e-9
"""Correlations closer than this differ by rounding."""


SIGN_LIKENESS = 1.05
"""Both signs, or requests before and after, explain the angles if what they leave unexplained is
within this factor."""


@dataclass(frozen=True, kw_only=True)
class VerdictOptions:
    """From which errors on a model is refused or doubted.

    Errors are shares of the standard deviation of the motion. In brackets what half and twice the
    value change in the verdicts on 29 reference logs (20 made, 9 recorded; ``scripts/reference``),
    27 of which are accepted, with 21 warnings in all.

    Attributes:
        refused: A model that misses more is refused. Recordings of joints that the model is
            meant for leave 0.02 to 0.23, those of an overloaded one 0.23 to 1. (One verdict; one.)
        suspect: From this error on a possible reason is reported (three warnings more; one less).
        poor: Error from which a model has to prove its worth beside a mere delay (none; one
            verdict).
        no_better: It then has to come below this share of the error of the delay (one verdict;
            one).
        delay_wins: A model whose error on held-out rows exceeds that of the best pure delay by this
            factor is worse than a delay.
        simpler_wins: A simpler description that predicts held-out rows better by this factor is
            pointed out (six warnings more; none).
        scaled: Correlation from which on angles of another span are requests in another scale: what
            holds a joint up bends its motion, too.
        loose: A time whose interval is wider than this share of it, and than two ticks, is
            pointed out (two warnings more; none).
    """

    refused: float = 0.25
    suspect: float = 0.1
    poor: float = 0.2
    no_better: float = 0.9
    delay_wins: float = 1.05
    simpler_wins: float = 1.02
    scaled: float = 0.9
    loose: float = 0.5


OPTIONS = VerdictOptions()


def verdict_on(
    fit: Fit,
    bounds: Mapping[str, Interval],
    uncertainty: Uncertainty,
    held: HeldOut | None,
    simple: dict[str, float],
    *,
    against: Note | None,
    exchanged: Note | None,
    signal: float,
    tested: bool,
    friction: float,
    shaken: Sequence[Note],
) -> tuple[Verdict, Note, list[Note]]:
    """Judge a fit by its error, without gross outliers, on all rows and on those held out.

    A model is refused beyond 25 %, where it is hardly better than a delay, or where the joint seems
    to move against its requests. It is worse than a delay where the best pure delay is 5 % closer
    to held-out rows. It holds where it misses at most 10 %, nothing simpler predicts held-out rows
    better, and the log shows the dry friction: the joint is not shaken, and the dead band is known
    to 10 % of the motion. Else it is usable.

    Args:
        fit: The model fitted to all rows.
        bounds: Its intervals.
        uncertainty: The covariance that they come from.
        held: The prediction of held-out rows, if there are any.
        simple: Error of the simpler descriptions on the same rows [rad].
        against: What speaks for a joint that moves against its requests, if anything does.
        exchanged: What speaks for columns that are exchanged, if anything does.
        signal: Standard deviation of the motion [rad].
        tested: Whether rows were held out, or were not asked for.
        friction: By how much the dead band may be larger than that of the model [rad].
        shaken: What speaks for a joint that is shaken at rest.

    Returns:
        The verdict, its reason and what else to know.
    """
    notes = list(shaken)
    if held is not None and held.beyond:
        notes.append(note("held out", "held out is faster"))
    error, of_held_out = sound_rms(fit.residuals), False
    if held is not None and held.sound_rms >= error:
        error, of_held_out = held.sound_rms, True
    missed = error / signal
    mere = min(simple["raw"], simple["delay"])
    useless = missed > OPTIONS.poor and fit.rms > OPTIONS.no_better * mere
    fits = missed <= OPTIONS.refused and not useless
    if not fits and _at_random(fit.grid, signal):
        return "refused", note("motion", "no motion"), [note("motion", "random", signal=signal)]
    numbers: dict[str, float] = {"missed": missed, "of_held_out": of_held_out, "error": error}
    if missed > OPTIONS.suspect:
        scale = _other_scale(fit.grid)
        why = "another scale" if scale else "why"
        numbers |= {"mere": mere, "rms": fit.rms, "most": OPTIONS.refused, **scale}
        misfit = "no better than a delay" if useless else "inexact" if fits else "does not fit"
        topic: Topic = "columns" if scale else "error" if fits else "fit"
        notes.append(note(topic, misfit, why, **numbers))
    if not fits and (span := float(np.ptp(fit.grid.angles))) < 0.2:
        notes.append(note("motion", "hardly moves", span=span, enough=30.0 * error))
    if against is not None:
        notes.append(against)
    elif exchanged is not None and missed > OPTIONS.suspect:
        notes.append(exchanged)
    ours, others = (fit.rms, simple) if held is None else (held.rms, held.alternatives)
    name = min(others, key=lambda other: others[other])
    beaten = ours > OPTIONS.simpler_wins * others[name]
    if beaten:
        notes.append(note("simpler", "simpler", simpler=name, theirs=others[name], ours=ours))
    hidden = friction > OPTIONS.suspect * signal
    if fits and hidden:
        notes.append(note("friction", "dry friction", friction=friction))
    notes += _undetermined(fit, bounds, uncertainty)
    doubts = {
        "misses": missed > OPTIONS.suspect,
        "simpler predicts better": beaten,
        "hardly better than a delay": PROVEN * others["delay"] < ours <= others["delay"],
        "friction open": hidden,
        "shaken": bool(shaken),
        "not tested": not tested,
    }
    verdict: Verdict = "holds"
    codes = ["misses"]
    if against is not None:
        verdict, codes = "refused", ["moves against"]
    elif not fits:
        verdict, codes = "refused", ["misses, as a delay does" if useless else "misses"]
    elif ours > OPTIONS.delay_wins * others["delay"]:
        verdict, codes = "worse than a delay", ["a delay wins"]
        numbers |= {"ratio": others["delay"] / ours, "tested": held is not None}
    elif any(doubts.values()):
        verdict, codes = "usable", [code for code, doubted in doubts.items() if doubted]
    if verdict == "holds":
        codes += _not_found(fit)
    return verdict, note("fit", *codes, simpler=name, **numbers), notes


def _not_found(fit: Fit) -> list[str]:
    """What many joints have and this one does not show: motion that calls for it is untested."""
    at = fit.parameters
    gravity = fit.grid.unloaded and at.sag_sin == at.sag_cos == 0.0
    if at.dead_band == 0.0:
        return ["nothing found"] if gravity else ["no friction"]
    return ["no gravity"] if gravity else []


def _at_random(grid: Grid, signal: float) -> bool:
    """Whether the angles change from row to row at random, as the noise at a resting joint does."""
    steps = np.diff(grid.angles)[grid.run[1:] == grid.run[:-1]]
    chance = 2.0 / math.sqrt(len(grid.angles))
    return bool(rms(steps) ** 2 / 2.0 >= (1.0 - chance) * signal**2)


def _undetermined(fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty) -> list[Note]:
    """A note for each parameter that the log does not determine."""
    found = []
    at, called = fit.parameters, peak_command(fit)
    gain, v_max = bounds["gain"], bounds["v_max"]
    if math.isinf(v_max.upper):
        found.append(
            note(
                "top speed",
                "top speed",
                reached=at.v_max <= called,
                known=gain.bounded,
                gain=at.gain,
                least=v_max.lower,
                v_max=at.v_max,
                steps=max(2.0 * called / at.gain, fit.grid.span),
            )
        )
    elif math.isinf(gain.upper) and gain.lower > 0.0:
        found.append(note("threshold", "threshold", most=v_max.upper / gain.lower))
    found += [
        note("search", "edge", name=name, value=getattr(at, name))
        for name in fit.free_names
        if at_edge(fit, Parameters._fields.index(name))
    ]
    return found + undetermined_delays(fit, bounds, uncertainty)


def undetermined_delays(
    fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty
) -> list[Note]:
    """Notes on lag and acceleration time where the log does not determine them.

    In rows far apart even sudden steps show little more than the middle of the window.
    """

    def loose(width: float, value: float) -> bool:
        return width > max(2.0 * fit.grid.tick, OPTIONS.loose * value)

    at = fit.parameters
    ends = {name: bounds[name] for name in ("lag", "acceleration_time")}
    wide = [name for name, of in ends.items() if loose(of.upper - of.lower, getattr(at, name))]
    if wide and _sudden(fit.grid) and all(of.bounded for of in ends.values()):
        middle = at.lag + at.acceleration_time / 2.0
        half = middle_known_within(fit, uncertainty, bounds["acceleration_time"])
        return [
            note(
                "delays",
                "delays",
                lag=ends["lag"],
                window=ends["acceleration_time"],
                loose=loose(2.0 * half, middle),
                middle=1e3 * middle,
                half=1e3 * half,
            )
        ]
    return [
        note("delays", "delay unknown", name=name)
        if math.isinf(ends[name].upper)
        else note("delays", "delay loose", name=name, between=ends[name])
        for name in wide
    ]


def _sudden(grid: Grid) -> bool:
    """Whether most of the way that requests go is in sudden steps."""
    steps = np.abs(np.diff(grid.requests))
    sudden = steps >= 0.1 * grid.span
    return float(np.sum(steps[sudden])) > 0.5 * float(np.sum(steps))


def notes_on(logs: Sequence[Log], timing: Timing, jumps: Sequence[int]) -> list[Note]:
    """What is odd about the logs themselves.

    Args:
        logs: The logs.
        timing: Their ticks.
        jumps: For each log, how often its angles started again after a turn.
    """
    found = []
    periods = [1e3 * log.period for log in logs]
    if unequal(logs):
        least, most, period = min(periods), max(periods), 1e3 * timing.period
        found.append(note("log", "periods", least=least, most=most, period=period))
    for log, often in zip(logs, jumps, strict=True):
        if often:
            found.append(note("log", "turns", log=log.name, once=often == 1, often=often))
        if not log.torque_on.all():
            off = 1.0 - float(np.mean(log.torque_on))
            found.append(note("log", "torque off", log=log.name, off=off))
        if count := int(np.sum(log.measured & ~sound_rows(log))):
            found.append(note("log", "glitches", log=log.name, count=count))
    return found


def opposite_sign(grid: Grid) -> Note | None:
    """What speaks for a joint that moves against its requests; None where nothing does.

    The angles then are as much like requests of the opposite sign, after a shorter delay. Half a
    cycle of motion that repeats itself looks like the other sign, too. There the shorter delay is
    taken for the true one: what a joint is late by is less than half a cycle.
    """
    delays = np.linspace(0.0, grid.reach, 200)
    coarse = _likeness(grid, delays)
    best = []
    for sign in (1.0, -1.0):
        near = delays[_first_best(sign * coarse)] + delays[1] * np.linspace(-1.0, 1.0, 17)
        near = np.maximum(near, 0.0)
        fine = sign * _likeness(grid, near)
        best.append((float(near[_first_best(fine)]), float(np.max(fine))))
    (same_delay, same), (delay, other) = best
    as_good = _unlike(other) <= SIGN_LIKENESS * _unlike(same)
    if other < 0.7 or not as_good or delay >= same_delay:
        return None
    return note(
        "sign",
        "opposite sign",
        likeness=other,
        late=1e3 * delay,
        same_likeness=same,
        same_late=1e3 * same_delay,
        repeats=_unlike(same) <= SIGN_LIKENESS * _unlike(other),
    )


def _other_scale(grid: Grid) -> dict[str, float]:
    """The spans and factors of columns in two scales; empty where they are in one.

    The angles then are like the requests, but of another span.
    """
    requested, actual = float(np.ptp(grid.requests)), float(np.ptp(grid.angles))
    if min(requested, actual) <= 0.0 or 0.5 <= actual / requested <= 2.0:
        return {}
    if np.max(_likeness(grid, np.linspace(0.0, grid.reach, 200))) < OPTIONS.scaled:
        return {}
    ratio = requested / actual
    return {"actual": actual, "requested": requested, "up": ratio, "down": actual / requested}


def exchanged_columns(grid: Grid) -> Note | None:
    """What speaks for angles that come before their requests; None where nothing does.

    Motion that repeats itself is as like the requests before as those after.
    """
    delays = np.linspace(0.0, grid.reach, 200)
    before, after = _likeness(grid, delays), _likeness(grid, -delays)
    k = _first_best(after)
    past, future = float(np.max(before)), float(after[k])
    if future < 0.7 or SIGN_LIKENESS * _unlike(future) >= _unlike(past):
        return None
    return note("columns", "exchanged", future=future, early=1e3 * delays[k], past=past)


def _first_best(likeness: Array) -> int:
    """The first of the delays that are the best up to rounding: each cycle of a motion has one."""
    return int(np.argmax(likeness >= np.max(likeness) - SAME_LIKENESS))


def _unlike(likeness: float) -> float:
    """Share of the motion that a correlation leaves unexplained, as a standard deviation."""
    return float(np.sqrt(max(1.0 - likeness * abs(likeness), 0.0)))


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
