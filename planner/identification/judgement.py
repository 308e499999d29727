"""Whether a model may be used, and what its user has to know first, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.exceptions import ANGLE_UNIT
from planner.identification.fit import delayed_errors, peak_command
from planner.identification.grid import Grid, Timing, unequal
from planner.identification.intervals import Uncertainty, at_edge, middle_known_within
from planner.identification.least_squares import Fit, sound_rms
from planner.identification.log import Log
from planner.identification.parameters import Parameters
from planner.identification.result import Finding, HeldOut, Interval, Topic
from planner.model.evidence import Verdict
from planner.trajectory import Array

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

WORDS = {
    "raw": "the request itself",
    "delay": "a mere delay",
    "first_order": "a delay with a first-order lag",
}

REASONS = (
    "is the joint overloaded, held up by friction or by a limit, or is this another joint's column?"
)


class Judgement(NamedTuple):
    """The verdict on a model, why, and what its user has to know first, in words."""

    verdict: Verdict
    reason: str
    findings: tuple[Finding, ...]


def verdict_on(
    fit: Fit,
    bounds: Mapping[str, Interval],
    uncertainty: Uncertainty,
    held: HeldOut | None,
    simple: dict[str, float],
    *,
    against: OppositeSign | None,
    exchanged: str,
    signal: float,
    unit: str,
    tested: bool,
    friction: float,
    shaken: Sequence[str],
) -> Judgement:
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
        held: What held-out rows say, if any were.
        simple: Error of the simpler descriptions on the same rows [rad].
        against: What speaks for a joint that moves against its requests, if anything does.
        exchanged: What speaks for columns that are exchanged, in words; empty where nothing does.
        signal: Standard deviation of the motion [rad].
        unit: Unit of the angles in words; empty for shares of a range.
        tested: Whether rows were held out, or were not asked for.
        friction: By how much the dead band may be larger than that of the model [rad].
        shaken: What speaks for a joint that is shaken at rest, in words.
    """
    found = [Finding("shaken", words) for words in shaken]

    def note(topic: Topic, words: str) -> None:
        found.append(Finding(topic, words))

    if held is not None and held.beyond:
        note(
            "held out",
            "the part that was held out calls for faster motion than the part that was fitted, "
            "which does not say how fast the joint can be: it is predicted with the top speed of "
            "the fit to all rows",
        )
    errors = [(sound_rms(fit.residuals), "")]
    if held is not None:
        errors.append((held.sound_rms, " in the part that was held out"))
    error, where = max(errors)
    missed = error / signal
    mere = min(simple["raw"], simple["delay"])
    useless = missed > OPTIONS.poor and fit.rms > OPTIONS.no_better * mere
    fits = missed <= OPTIONS.refused and not useless
    scale = _other_scale(fit.grid, unit)
    reasons = scale or REASONS
    share = f"{missed:.0%} of the motion's standard deviation{where} (rms {said(error, unit)})"
    if useless:
        note(
            "columns" if scale else "fit",
            f"the model does not fit: it misses {share}, and a mere delay hardly more "
            f"({said(mere, unit)} in place of {said(fit.rms, unit)}); {reasons}",
        )
    elif not fits:
        note(
            "columns" if scale else "fit",
            f"the model does not fit: it misses {share}; more than {OPTIONS.refused:.0%} is not "
            f"accepted; {reasons}",
        )
    elif missed > OPTIONS.suspect:
        note("columns" if scale else "error", f"the model misses {share}; {reasons}")
    if not fits and (span := float(np.ptp(fit.grid.angles))) < 0.2:
        note(
            "motion",
            f"the joint hardly moves in this log, by {said(span, unit)} in all: record requests "
            f"that span {said(30.0 * error, unit, digits=1)} or more, of which friction, "
            "play and the sensor's steps are a smaller part",
        )
    if against is not None:
        note("sign", against.words)
    elif exchanged and missed > OPTIONS.suspect:
        note("columns", exchanged)
    ours, others = (fit.rms, simple) if held is None else (held.rms, held.alternatives)
    name = min(others, key=lambda other: others[other])
    beaten = ours > OPTIONS.simpler_wins * others[name]
    if beaten:
        note(
            "simpler",
            f"{WORDS[name]} predicts better than the model (rms {said(others[name], unit)} "
            f"against {said(ours, unit)}): the log is too short or too gentle for more",
        )
    hidden = friction > OPTIONS.suspect * signal
    if fits and hidden:
        note(
            "friction",
            "the log leaves dry friction open: the dead band may be larger by "
            f"{said(friction, unit) if math.isfinite(friction) else 'any amount'}, and slow motion "
            "further off; record motion that is slow and reverses, such as excite --kind "
            "slow-triangle",
        )
    misses = f"it misses {missed:.0%} of the motion{where}"
    doubts = {
        misses: missed > OPTIONS.suspect,
        f"{WORDS[name]} predicts better": beaten,
        "the log leaves dry friction open": hidden,
        "the joint is shaken": bool(shaken),
        "it was not tested on rows held out": not tested,
    }
    reason = "; ".join(words for words, doubted in doubts.items() if doubted)
    verdict: Verdict
    if against is not None:
        verdict, reason = "refused", "the joint seems to move against its requests"
    elif not fits:
        verdict, reason = "refused", misses + ", and a mere delay hardly more" * useless
    elif ours > OPTIONS.delay_wins * others["delay"]:
        verdict = "worse than a delay"
        on = "" if held is None else " on rows held out"
        reason = f"the error of a pure delay is {others['delay'] / ours:.0%} of its own{on}"
    else:
        verdict, reason = ("usable", reason) if reason else ("holds", misses)
    return Judgement(verdict, reason, (*found, *_undetermined(fit, bounds, uncertainty, unit)))


def _undetermined(
    fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty, unit: str
) -> list[Finding]:
    """A sentence for each parameter that the log leaves open."""
    found: list[Finding] = []

    def note(topic: Topic, words: str) -> None:
        found.append(Finding(topic, words))

    at, called = fit.parameters, peak_command(fit)
    gain, v_max = bounds["gain"], bounds["v_max"]
    if math.isinf(v_max.upper):
        hardly = "never" if at.v_max > called else "hardly"
        known = (
            f"only v_max/theta_0 = {at.gain:.3g} per second is known"
            if gain.bounded
            else "neither v_max nor theta_0 is known"
        )
        note(
            "top speed",
            f"the joint {hardly} saturates in this log: {known}; v_max is at least "
            f"{said(v_max.lower, unit, '/s')}, and the model has {said(at.v_max, unit, '/s')}, no "
            "more than this log shows or calls for; record steps larger than about "
            f"{said(max(2.0 * called / at.gain, fit.grid.span), unit, digits=1)}",
        )
    elif math.isinf(gain.upper) and gain.lower > 0.0:
        note(
            "threshold",
            "theta_0 is only known to be less than "
            f"{said(v_max.upper / gain.lower, unit)}: record small steps, or slow "
            "motion, in which the joint does not saturate",
        )
    for name in fit.free_names:
        if at_edge(fit, Parameters._fields.index(name)):
            note(
                "search",
                f"{name} ended at the edge of the search, at {getattr(at, name):.3g}: the logs do "
                "not say how much further it would go, and the model probably does not fit this "
                "joint",
            )
    delays = open_delays(fit, bounds, uncertainty)
    return [*found, *(Finding("delays", words) for words in delays)]


def open_delays(fit: Fit, bounds: Mapping[str, Interval], uncertainty: Uncertainty) -> list[str]:
    """What the log leaves open of lag and acceleration time.

    In rows far apart even sudden steps show little more than the middle of the window.
    """

    def loose(width: float, value: float) -> bool:
        return width > max(2.0 * fit.grid.tick, OPTIONS.loose * value)

    at = fit.parameters
    ends = {
        name: f"between {1e3 * bounds[name].lower:.0f} and {1e3 * bounds[name].upper:.0f} ms"
        for name in ("lag", "acceleration_time")
    }
    wide = [
        name for name in ends if loose(bounds[name].upper - bounds[name].lower, getattr(at, name))
    ]
    if wide and _sudden(fit.grid) and all(bounds[name].bounded for name in ends):
        middle = at.lag + at.acceleration_time / 2.0
        half = middle_known_within(fit, uncertainty, bounds["acceleration_time"])
        known = f", but lag + acceleration_time / 2 is, {1e3 * middle:.3g} ± {1e3 * half:.2g} ms"
        return [
            f"lag, {ends['lag']}, and acceleration_time, {ends['acceleration_time']}, are not "
            f"known{'' if loose(2.0 * half, middle) else known}: record more rows a second to tell "
            "them apart"
        ]
    return [
        f"{name} is not known at all: record sudden steps"
        if math.isinf(bounds[name].upper)
        else f"{name} lies anywhere {ends[name]}: record sudden steps to tell it from other delays"
        for name in wide
    ]


def _sudden(grid: Grid) -> bool:
    """Whether most of the way that requests go is in sudden steps."""
    steps = np.abs(np.diff(grid.requests))
    sudden = steps >= 0.1 * grid.span
    return float(np.sum(steps[sudden])) > 0.5 * float(np.sum(steps))


def notes_on(logs: Sequence[Log], timing: Timing, jumps: Sequence[int]) -> list[str]:
    """What is odd about the logs themselves.

    Args:
        logs: The logs.
        timing: Their ticks.
        jumps: For each log, how often its angles started again after a turn.
    """
    found = []
    periods = [log.period for log in logs]
    if unequal(logs):
        found.append(
            f"the logs have periods from {1e3 * min(periods):.3g} to {1e3 * max(periods):.3g} ms; "
            f"the model's is {1e3 * timing.period:.3g} ms"
        )
    for log, often in zip(logs, jumps, strict=True):
        if often:
            times = "once" if often == 1 else f"{often} times"
            found.append(
                f"{log.name}: the actual angle jumps by a whole turn {times}, as encoders do that "
                "start again; it is taken to go on"
            )
        if not log.torque_on.all():
            off = 1.0 - float(np.mean(log.torque_on))
            found.append(f"{log.name}: torque is off in {off:.0%} of the rows, which are left out")
    return found


def said(value: float, unit: str, per: str = "", *, digits: int = 3) -> str:
    """A number with its unit, angles in the unit in which the user writes."""
    if unit == "rad":
        unit = ANGLE_UNIT.get()
        value = math.degrees(value) if unit == "deg" else value
    return f"{_rounded(value, digits):.3g} {unit}{per}".rstrip()


def _rounded(value: float, digits: int) -> float:
    """The number, to so many significant digits."""
    return float(f"{value:.{digits - 1}e}")


class OppositeSign(NamedTuple):
    """What speaks for the opposite sign: the angles are as much like requests of that sign, sooner.

    Attributes:
        delay: How long after requests of the opposite sign the angles come [s].
        likeness: Their correlation then, 0 to 1.
        same_delay: The same by the requests as they are [s].
        same_likeness: And the correlation with these.
    """

    delay: float
    likeness: float
    same_delay: float
    same_likeness: float

    @property
    def repeats(self) -> bool:
        """Whether the motion repeats itself, so that only the delay tells the signs apart."""
        return _unlike(self.same_likeness) <= SIGN_LIKENESS * _unlike(self.likeness)

    @property
    def words(self) -> str:
        """Why the sign of a column may be wrong."""
        otherwise = ", or record motion that does not repeat itself" if self.repeats else ""
        return (
            f"the joint seems to move against its requests: its angles correlate by "
            f"{self.likeness:.2f} with requests of the opposite sign {1e3 * self.delay:.0f} ms "
            f"before, and by {self.same_likeness:.2f} with the requests themselves "
            f"{1e3 * self.same_delay:.0f} ms before; invert the sign of one column{otherwise}"
        )


def opposite_sign(grid: Grid) -> OppositeSign | None:
    """What speaks for a joint that moves against its requests; None where nothing does.

    Half a cycle of motion that repeats itself looks like the other sign. There the shorter delay
    is taken for the true one: what a joint is late by is less than half a cycle.
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
    return OppositeSign(delay, other, same_delay, same)


def _other_scale(grid: Grid, unit: str) -> str:
    """What speaks for columns in two scales, in words: angles like requests of another span.

    Empty where nothing does.
    """
    requested, actual = float(np.ptp(grid.requests)), float(np.ptp(grid.angles))
    if min(requested, actual) <= 0.0 or 0.5 <= actual / requested <= 2.0:
        return ""
    if np.max(_likeness(grid, np.linspace(0.0, grid.reach, 200))) < OPTIONS.scaled:
        return ""
    return (
        f"the angles are like the requests but span {said(actual, unit)} beside "
        f"{said(requested, unit)}: is the scale of a column wrong? expected actual angles times "
        f"{requested / actual:.3g}, or requested ones times {actual / requested:.3g}; "
        f"if not, {REASONS}"
    )


def exchanged_columns(grid: Grid) -> str:
    """What speaks for angles that come before their requests, in words; empty where nothing does.

    Motion that repeats itself is as like the requests before as those after.
    """
    delays = np.linspace(0.0, grid.reach, 200)
    before, after = _likeness(grid, delays), _likeness(grid, -delays)
    k = _first_best(after)
    past, future = float(np.max(before)), float(after[k])
    if future < 0.7:
        return ""
    if SIGN_LIKENESS * _unlike(future) >= _unlike(past):
        return ""
    return (
        f"the joint seems to move before it is requested to: its angles correlate by {future:.2f} "
        f"with the requests {1e3 * delays[k]:.0f} ms later, and by at most {past:.2f} with "
        "earlier ones; are the columns of requested and actual angles exchanged, or the times of "
        "one of them late?"
    )


def _first_best(likeness: Array) -> int:
    """The first of the delays that are the best up to rounding: each cycle of a motion has one."""
    return int(np.argmax(likeness >= np.max(likeness) - SAME_LIKENESS))


def _unlike(likeness: float) -> float:
    """Share of the motion that a correlation leaves unexplained, as a standard deviation."""
    return float(np.sqrt(max(1.0 - likeness * abs(likeness), 0.0)))


def _likeness(grid: Grid, delays: Array) -> Array:
    """Correlation of the angles with the requests of some time before, by that time [s]."""
    angles = grid.angles - np.mean(grid.angles)
    found = np.zeros(len(delays))
    for k, delay in enumerate(delays):
        requests = delayed_errors(grid, float(delay)) + grid.angles
        requests -= np.mean(requests)
        size = float(np.linalg.norm(requests) * np.linalg.norm(angles))
        found[k] = float(requests @ angles) / size if size > 0.0 else 0.0
    return found
