"""Calibration on the bus: inspect the servos, move a joint, and compare the ways to plan for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from planner.arrays import Array, rms
from planner.exceptions import BusError, InvalidFile, InvalidInput, angle_text
from planner.files.logs import read_logs
from planner.files.logs.rows import LogOptions
from planner.files.paths import growing_log
from planner.identification.excitation import excite
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import Identification
from planner.model.evidence import WORSE, Evidence
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from planner.planning.plan import Inversion
from planner.planning.time_shift import invert_shift
from planner.robot.arm import Arm

UNKNOWN = 0.1  # share by which a parameter without an interval may be off


class Check(NamedTuple):
    """State of the servos before anything moves; dictionaries are by joint."""

    angles: dict[str, float]  # where every joint is [rad]
    noise: dict[str, float]  # standard deviation of the measured angles at rest [rad]
    settings: dict[str, dict[str, int]]  # the registers that shape the motion
    tick_time: float  # of a sync write and a sync read [s]
    lost: float  # share of the answers


def check(arm: Arm) -> Check:
    """Ask every servo for itself, or raise BusError; nothing moves, and no torque is switched."""
    bus, port = arm.bus, arm.bus.port
    for servo in arm.servos.values():
        bus.ping(servo.id)
    settings = arm.settings()
    rows, times = [], []
    attempts, losses = bus.asked, bus.lost
    for _ in range(50):  # at rest, for the noise of the sensors and the time of a tick
        begin = port.now()
        measured = arm.measure()
        times.append(port.now() - begin)
        rows.append(measured.angles)
        for name, error in zip(arm.names, measured.errors, strict=True):
            if words := bus.protocol.error_words(error):
                raise BusError(f"{name}: the servo reports {words}; switch it off and on again")
    angles = np.array(rows)
    whole = np.array(times)[np.isfinite(angles).all(axis=1)]
    if not whole.size or np.isnan(angles).all(axis=0).any():
        raise BusError("most answers are lost; check the baud rate, the cable and the supply")
    write_time = 10.0 * (10 + 5 * len(arm.names)) / port.baud_rate
    tick_time = float(np.median(whole)) + write_time
    bus.patience = max(2e-3, 2.0 * float(np.max(whole)))
    return Check(
        dict(zip(arm.names, np.nanmedian(angles, axis=0).tolist(), strict=True)),
        dict(zip(arm.names, np.nanstd(angles, axis=0).tolist(), strict=True)),
        settings,
        tick_time,
        (bus.lost - losses) / (bus.asked - attempts),
    )


def servo_ranges(arm: Arm, angles: Mapping[str, float], reach: float) -> dict[str, Array]:
    """The range of every joint by its servo's limits, at most ``reach`` from its angle [rad]."""
    ranges = {}
    for name, servo in arm.servos.items():
        ends = [arm.bus.read(servo.id, f"{end}_position") for end in ("least", "largest")]
        if ends[0] >= ends[1]:  # no limits are set
            ends = [0, 2 * arm.bus.protocol.middle - 1]
        least, largest = sorted(map(servo.angle, ends))
        here = angles[name]
        ranges[name] = np.array([max(least, here - reach), min(largest, here + reach)])
    return ranges


def ranges_by_hand(arm: Arm, ended: Callable[[], bool], period: float) -> dict[str, Array]:
    """The range through which every joint is turned by hand until ``ended``; torque must be off."""
    least = largest = arm.angles()
    while not ended():
        arm.bus.port.sleep(period)
        angles = arm.measure().angles
        least, largest = np.fmin(least, angles), np.fmax(largest, angles)
    return {name: np.array(ends) for name, *ends in zip(arm.names, least, largest, strict=True)}


def with_ranges(arm: Arm, ranges: Mapping[str, Array]) -> Arm:
    """The arm with these ranges, less a margin, as its limits; InvalidInput for a small one."""
    servos, least = dict(arm.servos), math.radians(10.0)
    for name, ends in ranges.items():
        low, high = (float(each) for each in ends)
        if high - low < least:
            raise InvalidInput(
                f"{name}: its range is {angle_text(low, high)}, expected at least "
                f"{angle_text(least)} wide; turn the joint by hand through all of its range, "
                "or away from a limit of its servo"
            )
        margin = 0.05 * (high - low)  # left free at either end
        limits = (round(low + margin, 6), round(high - margin, 6))
        servos[name] = replace(servos[name], limits=limits)
    return Arm(arm.bus, servos)


def excitation(arm: Arm, joint: str, *, period: float, duration: float) -> Array:
    """A slow triangle, a sum of sines, then steps, within the joint's range [rad], shape (n,)."""
    limits = arm.servos[joint].limits
    return excite("combined", limits=limits, period=period, duration=duration).requests


def move(
    arm: Arm, joint: str, requests: Array, *, period: float, log: Path, resume: bool = False
) -> Log:
    """Play requests [rad], (n,), on one joint while the others stay, with a log as it is measured.

    With ``resume`` a finished log of these requests is taken as it is, and nothing moves. Rows
    until Ctrl-C, which raises KeyboardInterrupt, or a BusError are kept.
    """
    if not (resume and log.exists()):
        place = arm.names.index(joint)
        rows = np.tile(arm.angles(), (len(requests), 1))
        limits = np.array([servo.limits for servo in arm.servos.values()])
        rows = np.clip(rows, limits[:, 0], limits[:, 1])
        rows[:, place] = requests
        with growing_log(log, [joint]) as keep:
            played = arm.perform(
                rows,
                period=period,
                keep=lambda time, row, angles: keep(
                    time, row[place : place + 1], angles[place : place + 1]
                ),
            )
            if played.interrupted:
                raise KeyboardInterrupt
    (record,) = read_logs([str(log)], options=LogOptions(joint=joint))
    if resume:
        rows = np.rint((record.times - record.times[0]) / period).astype(int)
        expected = requests[np.minimum(rows, len(requests) - 1)]
        if np.mean(np.abs(expected - record.requests) < 1e-3) < 0.5:  # rows may be late by one
            raise InvalidFile(
                log,
                "holds another motion than would be played now: the rate, the duration or the "
                "range differs; choose those of the interrupted run, or leave --resume out",
            )
    return record


def by_request(times: Array, angles: Array, count: int, period: float) -> Array:
    """Angles (rows, k) at the time of every request, (count, k); missing ones are interpolated."""
    due = period * np.arange(count)
    columns = []
    for column in angles.T:
        read = np.isfinite(column)
        if not read.any():
            raise BusError("a joint was never read; check its cable")
        # A row was measured with its request, however late: it belongs to the nearest due time.
        columns.append(np.interp(due, period * np.rint(times[read] / period), column[read]))
    return np.column_stack(columns)


class Recheck(NamedTuple):
    """Whether a model still holds, by a new motion of its joint."""

    # None where no new model is better, or all of the motion is beyond the logs of the model
    holds: bool | None
    error: float  # of the model, rms [rad]
    expected: float  # error to expect of it by its own test, rms [rad]
    most: float  # largest error with which it holds, rms [rad]
    beyond: float  # share of the motion that is beyond the logs of the model, and left out
    anew: Identification | None = None  # of this motion, where the model misses it by more
    changes: Mapping[str, float] = {}  # parameters that have changed, as they were


def recheck(model: JointModel, log: Log) -> Recheck:
    """Compare a model with a new log; where it misses the motion, with a new model of this log.

    It holds up to the error that 19 of 20 such motions stay below by its test, or a small one.
    """
    error, expected, most, beyond = errors(model, log)
    if error <= most:
        return Recheck(True, error, expected, most, beyond)
    anew = identify(log)
    if beyond == 1.0 or error <= WORSE * anew.rms:  # the motion is hard for any model
        return Recheck(None, error, expected, most, beyond, anew)
    return Recheck(False, error, expected, most, beyond, anew, changes(model, anew))


def errors(model: JointModel, log: Log) -> tuple[float, float, float, float]:
    """Error of the model in a log, error to expect and at most, rms [rad], and share left out [-].

    Parts outside the tested range are left out, unless all are, share 1. A servo holds its last
    request over rows that were lost.
    """
    evidence, period = model.evidence or Evidence(), model.period
    due = np.rint((log.times - log.times[0]) / period).astype(int)
    requests = log.requests[np.searchsorted(due, np.arange(due[-1] + 1), side="right") - 1]
    predicted = simulate(model, requests, cyclic=False, start=float(log.angles[0]))
    within, expected, most = evidence.compared(predicted, period=period)
    compared = log.measured & (within[due] if within.any() else True)
    error = rms((predicted[due] - log.angles)[compared])
    return error, expected, most, float(np.mean(~within))


def changes(model: JointModel, anew: Identification) -> dict[str, float]:
    """Parameters of a model from which a new one differs by more than both intervals allow."""
    intervals = {} if model.evidence is None else model.evidence.intervals
    changed: dict[str, float] = {}
    for name in ("v_max", "theta_0", "lag", "dead_band", "offset"):
        if name not in anew.intervals:
            continue
        old, new = getattr(model, name), anew.intervals[name]
        low, high = intervals.get(name, (old - UNKNOWN * abs(old), old + UNKNOWN * abs(old)))
        if new.lower > high or new.upper < low:
            changed[name] = old
    return changed


Way = Literal["direct", "shift", "closed_form", "optimal", "optimal_friction"]

WORDS: dict[Way, str] = {
    "direct": "direct",
    "shift": "best shift",
    "closed_form": "closed form",
    "optimal": "optimised",
    "optimal_friction": "optimised with friction and load",
}
"""Labels of the ways."""

FRICTION_AND_LOAD: dict[str, Any] = dict.fromkeys(
    ("dead_band", "v_offset", "compliance", "speed_per_torque", "sag_sin", "sag_cos"), 0.0
)
"""Parameters that the plain optimised plan does without."""

RUN_IN = 0.5
"""Beginning of the test motion whose errors do not count [s]: until the first motion frees it,
friction leaves a joint up to its dead band off the first request, by chance."""


class Candidate(NamedTuple):
    """A way to make the joint follow the test motion."""

    way: Way
    error: float  # root mean square of the measured errors after the run-in [rad]
    max_error: float  # the largest of them [rad]
    largest_step: float  # largest change between requests [rad]
    expected: float  # the error that the model led one to expect [rad]; NaN without one
    angles: Array  # the measured angles [rad], NaN where none was read, shape (n,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """A calibrated joint."""

    identification: Identification
    candidates: tuple[Candidate, ...]  # every way, the simplest first
    recommended: Candidate
    model: JointModel  # of the recommended way, with its verdict
    desired: Array  # the test motion [rad], shape (n,)

    def named(self, way: Way) -> Candidate:
        """The candidate of this way."""
        return next(each for each in self.candidates if each.way == way)


def calibrate(
    arm: Arm,
    joint: str,
    *,
    period: float,
    duration: float,
    folder: Path,
    resume: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Compared:
    """Excite a joint for so long [s], identify it, and compare the ways to plan for it.

    Of each motion, requests every period [s], there is a log in the folder: :func:`move`.
    """

    def moved(requests: Array, name: str) -> Log:
        log = folder / f"{name}.csv"
        return move(arm, joint, requests, period=period, log=log, resume=resume)

    def measured(way: Way, requests: Array) -> Array:
        progress(f"{joint}: test motion, {WORDS[way]}")
        log = moved(requests, f"{joint}_{way}")
        angles, since = np.full(len(requests), np.nan), log.times - log.times[0]
        rows = np.rint(since / period).astype(int)
        read = log.measured & (rows < len(requests))
        angles[rows[read]] = log.angles[read]
        return angles

    progress(f"{joint}: excitation, {duration:g} s")
    log = moved(excitation(arm, joint, period=period, duration=duration), joint)
    progress(f"{joint}: identifying")
    identification = identify(log)
    progress(f"{joint}: planning")
    return compare(identification, arm.servos[joint].limits, measured)


def compare(
    identification: Identification,
    limits: tuple[float, float],
    measure: Callable[[Way, Array], Array],
) -> Compared:
    """Play the test motion in every way, and recommend the one with the least measured error.

    ``limits`` are those of requests [rad]; ``measure`` plays them, and returns the measured angles,
    NaN where none was read.
    """
    model = identification.model
    desired = test_motion(model, limits)
    plain = replace(model, **FRICTION_AND_LOAD)
    plans: dict[Way, Inversion] = {
        "shift": invert_shift(model, desired, cyclic=False),
        "closed_form": invert_closed_form(model, desired, cyclic=False),
        "optimal": invert_optimal(plain, desired, cyclic=False, limits=limits),
    }
    if plain != model:
        plans["optimal_friction"] = invert_optimal(model, desired, cyclic=False, limits=limits)
    ways: tuple[Way, ...] = ("direct", *plans)
    candidates = []
    for name in ways:
        allowed = np.clip(desired if name == "direct" else plans[name].requests, *limits)
        expected = np.nan if name in ("direct", "shift") else plans[name].expected.error
        angles = measure(name, allowed)
        errors = (angles - desired)[round(RUN_IN / model.period) :]
        errors = errors[np.isfinite(errors)]
        step = float(np.max(np.abs(np.diff(allowed))))
        largest = float(np.max(np.abs(errors)))
        candidates.append(Candidate(name, rms(errors), largest, step, expected, angles))
    least = min(each.error for each in candidates)
    recommended = next(each for each in candidates if each.error <= 1.02 * least)  # the simplest
    used, evidence = model, model.evidence or Evidence()
    if recommended.way == "optimal":  # without friction and load: its error on the test motion
        used = plain
        evidence = evidence._replace(
            error=recommended.error,
            by_acceleration=(),
            spread=Evidence().spread,
            intervals={k: v for k, v in evidence.intervals.items() if k not in FRICTION_AND_LOAD},
            correlations=(),
        )
    if recommended.way in ("direct", "shift"):
        words = f"on the test motion of its calibration '{WORDS[recommended.way]}' was closer"
        evidence = evidence._replace(verdict="worse than a delay", reason=words)
    return Compared(
        identification=identification,
        candidates=tuple(candidates),
        recommended=recommended,
        model=used.with_evidence(evidence),
        desired=desired,
    )


def test_motion(model: JointModel, limits: tuple[float, float]) -> Array:
    """Sines, then moves to and fro with rests between them, for 5 s in all [rad], shape (n,).

    As fast as the joint can follow, beginning and ending at rest in the middle of the limits.
    """
    period = model.period
    half = 2.5
    middle = 0.5 * (limits[0] + limits[1])
    reach = 0.8 * 0.5 * (limits[1] - limits[0])
    sines = excite(
        "multisine",
        limits=(middle - reach, middle + reach),
        period=period,
        duration=half,
        highest=min(1.5, 0.4 / period),
        seed=7,
    ).requests
    levels = middle + reach * np.array([0.0, 0.9, 0.3, -0.8, -0.5, 0.0])
    # from level to level along minimum-jerk curves in two thirds of the time, then at rest
    samples = round(half / period)
    each = samples // (len(levels) - 1)
    shares = np.clip(1.5 * np.arange(1, each + 1) / each, 0.0, 1.0)
    rise = shares**3 * (10.0 - 15.0 * shares + 6.0 * shares**2)
    moves = [low + (high - low) * rise for low, high in pairwise(levels)]
    rest = np.full(samples - each * len(moves), levels[-1])
    angles = np.concatenate([sines, *moves, rest])
    share = min(1.0, 0.6 * model.v_max * period / float(np.max(np.abs(np.diff(angles)))))
    scaled: Array = middle + share * (angles - middle)
    return scaled
