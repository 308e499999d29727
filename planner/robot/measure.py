"""Calibration on the bus: inspect the servos, and move one joint at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.exceptions import BusError, InvalidFile, InvalidInput, angle_text
from planner.files.logs import read_logs
from planner.files.logs.rows import LogOptions
from planner.files.paths import growing_log
from planner.identification.excitation import excite
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import Identification
from planner.model.evidence import TRACKING, WINDOW, Evidence
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.robot.arm import Arm
from planner.trajectory import Array, rms

LOOKS = 50
"""Sync reads at rest, for the noise of the sensors and the time of a tick."""

MARGIN = 0.05
"""Share of a range that is left free at either end."""

WORSE = 2.0
"""A model still holds while it misses the motion by at most this factor over the error that its
own test predicts, by :data:`SMALL`, or by at most this factor over a new model of this motion."""

SMALL = math.radians(0.3)
"""Error that is never worth a new calibration [rad]: three counts of a sensor of 12 bits."""

UNKNOWN = 0.1
"""Share by which a parameter without an interval may be off."""

SAME = 1e-3
"""Difference of requests below which a log holds the requested motion [rad]."""


class Check(NamedTuple):
    """State of the servos before anything moves; dictionaries are by joint."""

    angles: dict[str, float]  # where every joint is [rad]
    noise: dict[str, float]  # standard deviation of the measured angles at rest [rad]
    settings: dict[str, dict[str, int]]  # the registers that shape the motion
    tick_time: float  # of a sync write and a sync read [s]
    lost: float  # share of the answers


def check(arm: Arm) -> Check:
    """Ask every servo for itself; nothing moves, and no torque is switched.

    Raises:
        BusError: A servo does not answer, or reports a fault.
    """
    bus, port = arm.bus, arm.bus.port
    for servo in arm.servos.values():
        bus.ping(servo.id)
    settings = arm.settings()
    rows, times = [], []
    attempts, losses = bus.asked, bus.lost
    for _ in range(LOOKS):
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
    """The range of every joint by its servo's own limits, at most ``reach`` from where it is [rad].

    The ``angles`` say where they are [rad].
    """
    ranges = {}
    for name, servo in arm.servos.items():
        ends = [arm.bus.read(servo.id, f"{end}_position") for end in ("least", "largest")]
        if ends[0] >= ends[1]:  # no limits are set
            ends = [0, 2 * arm.bus.protocol.middle - 1]
        own = np.sort([servo.angle(count) for count in ends])
        here = angles[name]
        ranges[name] = np.array([max(own[0], here - reach), min(own[1], here + reach)])
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
    """The arm with these ranges, less a margin, as its limits.

    Raises:
        InvalidInput: A range is too small to show how the joint moves.
    """
    servos, least = dict(arm.servos), math.radians(10.0)
    for name, ends in ranges.items():
        low, high = (float(each) for each in ends)
        if high - low < least:
            raise InvalidInput(
                f"{name}: its range is {angle_text(low, high)}, expected at least "
                f"{angle_text(least)} wide; turn the joint by hand through all of its range, "
                "or away from a limit of its servo"
            )
        margin = MARGIN * (high - low)
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

    With ``resume`` a finished log of an earlier run is taken as it is, and nothing moves.

    Raises:
        KeyboardInterrupt: Ctrl-C; the rows until then are kept.
        BusError: Something went wrong; the rows until then are kept.
        InvalidFile: The finished log is of other requests.
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
        if np.mean(np.abs(expected - record.requests) < SAME) < 0.5:  # rows may be late by one
            raise InvalidFile(
                log,
                "holds another motion than would be played now: the rate, the duration or the "
                "range differs; choose those of the interrupted run, or leave --resume out",
            )
    return record


def angles_of(log: Log, count: int, period: float) -> Array:
    """The angle that was measured with each of so many requests [rad]; NaN where none was."""
    angles = np.full(count, np.nan)
    rows = np.rint((log.times - log.times[0]) / period).astype(int)
    kept = log.measured & (rows < count)
    angles[rows[kept]] = log.angles[kept]
    return angles


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

    holds: bool | None  # None where all of the motion is beyond the logs of the model
    error: float  # of the model, rms [rad]
    expected: float  # error to expect of it by its own test, rms [rad]
    beyond: float  # share of the motion that is beyond the logs of the model, and left out
    changes: list[str]  # parameters of a model that no longer holds which have changed, in words


def recheck(model: JointModel, log: Log) -> Recheck:
    """Compare a model with a new log; where it misses the motion, with a new model of this log."""
    error, expected, beyond = errors(model, log)
    if error <= max(WORSE * expected, SMALL):
        return Recheck(True, error, expected, beyond, [])
    identification = identify(log)
    if error <= WORSE * identification.rms:  # the motion is hard for any model
        return Recheck(True, error, expected, beyond, [])
    if beyond == 1.0:
        return Recheck(None, error, expected, beyond, [])
    return Recheck(False, error, expected, beyond, changes(model, identification))


def errors(model: JointModel, log: Log) -> tuple[float, float, float]:
    """Error of the model in a log, error to expect of it, both rms [rad], and share left out [-].

    Parts whose motion is outside the tested range are left out, unless all are: the share is then
    1. A servo holds its last request over rows that were lost.
    """
    evidence, period = model.evidence or Evidence(), model.period
    due = np.rint((log.times - log.times[0]) / period).astype(int)
    requests = log.requests[np.searchsorted(due, np.arange(due[-1] + 1), side="right") - 1]
    predicted = simulate(model, requests, cyclic=False, start=float(log.angles[0]))
    length = min(round(WINDOW / period), len(predicted))
    within = np.zeros(len(predicted), dtype=bool)
    expected: dict[bool, list[float]] = {False: [], True: []}
    for begin in {*range(0, len(predicted) - length, length // 2), len(predicted) - length}:
        part = slice(begin, begin + length)
        outside = evidence.exceeded(predicted[part], period=period, cyclic=False)
        inside = not {*outside} - {TRACKING}
        within[part] |= inside
        expected[inside].append(evidence.error_of(predicted[part], period=period, cyclic=False))
    compared = log.measured & (within[due] if within.any() else True)
    return (
        rms((predicted[due] - log.angles)[compared]),
        rms(np.array(expected[bool(within.any())])),
        float(np.mean(~within)),
    )


def changes(model: JointModel, identification: Identification) -> list[str]:
    """Parameters of a new model that differ by more than both intervals allow."""
    intervals = {} if model.evidence is None else model.evidence.intervals
    changed = []
    for name in ("v_max", "theta_0", "lag", "dead_band", "offset"):
        if name not in identification.intervals:
            continue
        old, new = getattr(model, name), getattr(identification.model, name)
        low, high = intervals.get(name, (old - UNKNOWN * abs(old), old + UNKNOWN * abs(old)))
        interval = identification.intervals[name]
        if interval.lower > high or interval.upper < low:
            changed.append(f"{name} is {new:.3g}, and was {old:.3g}")
    return changed
