"""Kinds of servos, calibrated on a bus as users do, and what the recommendation is worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from benchmark.parts import Options
from benchmark.parts.servos import Array, early, motions
from benchmark.table import Table
from planner.calibration.candidates import Compared, compare
from planner.calibration.measure import angles_of, check, excitation, move, with_ranges
from planner.identification.identify import identify
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from planner.planning.time_shift import invert_shift
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus
from planner.trajectory import rms
from planner.virtual.servo_bus import KINDS, Kind, VirtualPort, VirtualServos

SHOWN = ("mx-64", "mx-106", "xl330", "xl-320", "sts3215", "xl430")

RATE, DURATION = 100.0, 60.0
"""Of the requests [Hz], and of the excitation [s]: what calibrate does by default."""

REACH = math.radians(60.0)
"""Range either way [rad]: the motions reach 40 degrees, and sag asks for more."""

CYCLES = 3
"""Cycles that are played; the first does not count."""

LEADS = np.arange(0.0, 0.3, 0.02)
FINER = np.arange(-0.016, 0.017, 0.004)
"""Leads among which the best time shift is sought on the servo itself [s], then about the best."""

FAIR = 0.3
"""Share by which the error that is told may be off the one that is met."""


class Joint(NamedTuple):
    """A calibrated joint.

    Attributes:
        found: What calibration found.
        limits: Least and largest request [rad].
        play: Plays cycles of requests [rad], (n,), and returns the measured angles, (cycles n,).
    """

    found: Compared
    limits: tuple[float, float]
    play: Callable[[Array, int], Array]


def measure(_: Options) -> list[Table]:
    """One row for each kind and motion."""
    table = Table(
        "Kinds of servos, calibrated, and three motions that calibration had not seen",
        ("direct, deg", "shift, deg", "recommended", "told/met"),
        note="Virtual servos behind their real protocol, in lock step, each with a load; "
        "parameters from Rhoban/bam and data sheets (planner/virtual/motors.py). Each is "
        f"calibrated as request-planner calibrate does, at {RATE:g} Hz; a cycle is then planned "
        "in the way that was recommended, and played. Errors are root mean square, of measured "
        "angles; shift: the desired angles early by the best time, sought on the servo itself. "
        "Recommended: its error over that. Told: error to expect of the plan over that met.",
        stub="kind, way: motion",
    )
    shares, told = [], []
    for name in SHOWN:
        with TemporaryDirectory() as folder:
            joint = calibrated(KINDS[name], Path(folder))
            for motion, row in rows_of(joint):
                way = joint.found.recommended.way
                table.add(f"{name}, {way}: {motion}", *row)
                shares.append(row[2])
                told.append(row[3])
    near = np.mean([abs(each - 1.0) <= FAIR for each in told if math.isfinite(each)])
    table.note += (
        f" The median is {np.median(shares):.2f}, the largest {max(shares):.2f}; in {near:.0%} of "
        f"the rows the error is told within {FAIR:.0%}."
    )
    return [table]


def calibrated(kind: Kind, folder: Path) -> Joint:
    """One servo of a kind, calibrated as the command does it."""
    protocol, period = kind.protocol, 1.0 / RATE
    bus = Bus(VirtualPort(VirtualServos(1, kind, motors=[kind.motor])), protocol)
    servo = Servo(id=1, zero_tick=protocol.middle, ticks_per_turn=protocol.ticks_per_turn)
    arm = Arm(bus, {"joint": servo})
    check(arm)
    arm = with_ranges(arm, {"joint": np.array([-REACH, REACH])})
    limits = arm.servos["joint"].limits

    def measured(name: str, requests: Array) -> Array:
        log = move(arm, "joint", requests, period=period, log=folder / f"{name}.csv")
        return angles_of(log, len(requests), period)

    def play(requests: Array, cycles: int) -> Array:
        angles = list[float]()
        rows = np.clip(requests, *limits)[:, None]
        with arm.powered():
            arm.perform(
                rows, period=period, cycles=cycles, keep=lambda _, __, row: angles.append(row[0])
            )
        return np.array(angles)

    with arm.powered():
        requests = excitation(arm, "joint", period=period, duration=DURATION)
        log = move(arm, "joint", requests, period=period, log=folder / "log.csv")
        found = compare(identify(log), limits, measured)
    return Joint(found, limits, play)


def rows_of(joint: Joint) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Errors on each motion: direct and best shift [deg], recommended over shift, told over met."""
    model = joint.found.model
    for name, path in motions(model.period).items():

        def error(requests: Array, path: Array = path) -> float:
            angles = joint.play(requests, CYCLES)[len(path) :]
            return rms(angles - np.tile(path, CYCLES - 1))

        def shifted(lead: float, path: Array = path) -> float:
            return error(early(path, lead / model.period))

        coarse = [shifted(lead) for lead in LEADS]
        around = LEADS[int(np.argmin(coarse))] + FINER
        shift = min(shifted(lead) for lead in around)
        requests, expected = planned(joint, path)
        met = error(requests)
        yield name, (math.degrees(coarse[0]), math.degrees(shift), met / shift, expected / met)


def planned(joint: Joint, path: Array) -> tuple[Array, float]:
    """Requests for a cycle in the recommended way, and the error to expect [rad]."""
    model, way = joint.found.model, joint.found.recommended.way
    if way == "direct":
        return path, math.nan
    if way == "shift":
        return invert_shift(model, path).requests, math.nan
    if way == "closed_form":
        answer = invert_closed_form(model, path)
    else:
        answer = invert_optimal(model, path, limits=joint.limits)
    return answer.requests, answer.expected.error
