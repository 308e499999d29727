"""Kinds of servos, calibrated on a bus as users do, and the gain of the recommendation."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from benchmark.parts import Options
from benchmark.parts.servos import Array, early, motions
from benchmark.table import Table
from planner.arrays import rms
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from planner.planning.time_shift import invert_shift
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus, SerialPort
from planner.robot.calibration import Compared, calibrate, check, with_ranges
from planner.robot.protocols import FEETECH, PROTOCOLS
from planner.virtual.motors import Motor
from planner.virtual.servo_bus import KINDS, Kind, VirtualPort, VirtualServos

HOBBY_MOTOR = Motor(
    voltage=6.0, resistance=2.4, torque_constant=0.82, inertia=0.012, dry_friction=0.06,
    rest_friction=0.03, rest_speed=0.5, viscous_friction=0.01, gravity=0.2, current_limit=2.5,
    duty_steps=255.0, duty_dead_band=0.07, proportional=14.0, integral=0.0, derivative=0.0,
    delay=0.02, counts=1024.0,
)  # fmt: skip
HOBBY_REGISTERS = {"model": 0, "largest_position": 4095, "p_gain": 1, "torque_limit": 1000}
HOBBY = Kind(FEETECH, HOBBY_MOTOR, HOBBY_REGISTERS)
"""A hobby servo of 20 kg cm and 0.16 s for 60 degrees at 6 V, as data sheets of such give them: an
8-bit PWM with a dead band, a pulse every 20 ms, a potentiometer at a converter of ten bits."""

SERVOS = {
    **{name: KINDS[name] for name in ("mx-64", "mx-106", "xl330", "xl-320", "sts3215", "xl430")},
    "hobby": HOBBY,
}

RATE, DURATION = 100.0, 60.0
"""Of the requests [Hz], and of the excitation [s]: the defaults of calibrate."""

REACH = math.radians(60.0)
"""Range either way [rad]: the motions reach 40 degrees, and sag asks for more."""

CYCLES = 3  # cycles that are played; the first does not count
LEADS = np.arange(0.0, 0.3, 0.02)
FINER = np.arange(-0.016, 0.017, 0.004)
"""Leads among which the best time shift is sought on the servo itself [s], then about the best."""

FAIR = 0.3  # relative difference allowed between the expected and the measured error


class Joint(NamedTuple):
    """A calibrated joint."""

    calibration: Compared
    limits: tuple[float, float]  # least and largest request [rad]
    play: Callable[[Array, int], Array]  # cycles of requests to measured angles, (cycles n,) [rad]


def measure(_: Options) -> list[Table]:
    """One row for each kind and motion."""
    table = Table(
        "Kinds of servos, calibrated, and three motions that calibration had not seen",
        "kind, way: motion | direct, deg | shift, deg | recommended | told/met",
        note="Virtual servos behind their real protocol, in lock step, each with a load; "
        "parameters from Rhoban/bam and data sheets (planner/virtual/servos.toml). Each is "
        f"calibrated as request-planner calibrate does, at {RATE:g} Hz; a cycle is then planned "
        "in the way that was recommended, and played. Errors are root mean square, of measured "
        "angles; shift: the desired angles early by the best time, sought on the servo itself. "
        "Recommended: its error over that. Told: error to expect of the plan over that met.",
    )
    shares, ratios = [], []
    for name, kind in SERVOS.items():
        with TemporaryDirectory() as folder:
            joint = calibrated(kind, Path(folder))
            for motion, row in rows_of(joint):
                way = joint.calibration.recommended.way
                table.add(f"{name}, {way}: {motion}", *row)
                shares.append(row[2])
                ratios.append(row[3])
    fair = np.mean([abs(each - 1.0) <= FAIR for each in ratios if math.isfinite(each)])
    table.note += (
        f" The median is {np.median(shares):.2f}, the largest {max(shares):.2f}; in "
        f"{100.0 * fair:.0f} % of the rows the error is told within {100.0 * FAIR:.0f} %."
    )
    return [table, loops()]


SERVED = "from planner.cli.program import main; main()"  # the command line, in another process
LOOP_SERVOS, LOOP_SECONDS = 6, 5.0  # servos of the loop in real time, and how long it runs [s]


def loops() -> Table:
    """One row for each protocol: six servos at 100 Hz behind a pseudo-terminal, in real time."""
    table = Table(
        f"A loop of {LOOP_SERVOS} servos at {RATE:g} Hz in real time",
        "protocol | driver, ms | late, ms | latest, ms | skipped | lost, %",
        note="Virtual servos in another process, behind a pseudo-terminal; a tick is one sync "
        "write and one sync read. Driver: processor time of this process for each tick. Late: of "
        "requests behind their times, mean and most. Skipped: requests that were not sent in time.",
    )
    for name, kind in (("feetech", "sts3215"), ("dynamixel", "xl430")):
        command = [sys.executable, "-P", "-c", SERVED, "virtual-bus", "--kind", kind]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
            try:
                assert served.stdout is not None, "it is a pipe"
                port = SerialPort(served.stdout.readline().strip(), 1_000_000)
                table.add(name, *_loop(port, name))
                port.close()
            finally:
                served.terminate()
    return table


def _loop(port: SerialPort, protocol: str) -> tuple[float, ...]:
    """Time of a tick in the driver, lateness [ms], requests skipped, answers lost [%]."""
    count = round(RATE * LOOP_SECONDS)
    phase = 2.0 * np.pi * np.arange(count) / count
    rows = np.radians(20.0) * np.sin(phase)[:, None] * np.ones(LOOP_SERVOS)
    servos = {f"joint {k}": Servo(id=k) for k in range(1, LOOP_SERVOS + 1)}
    arm = Arm(Bus(port, PROTOCOLS[protocol]), servos)
    with arm.powered():
        arm.perform(rows[:1], period=1.0 / RATE)  # to where it begins
        begin = time.process_time()
        played = arm.perform(rows, period=1.0 / RATE)
        seconds = time.process_time() - begin
    lost = 100.0 * arm.bus.lost / arm.bus.asked
    late = 1e3 * played.mean_lateness, 1e3 * played.latest
    return 1e3 * seconds / count, *late, played.skipped, lost


def calibrated(kind: Kind, folder: Path) -> Joint:
    """One servo of a kind, calibrated as the command does it."""
    protocol, period = kind.protocol, 1.0 / RATE
    bus = Bus(VirtualPort(VirtualServos(1, kind, motors=[kind.motor])), protocol)
    servo = Servo(id=1, zero_tick=protocol.middle, ticks_per_turn=protocol.ticks_per_turn)
    arm = Arm(bus, {"joint": servo})
    check(arm)
    arm = with_ranges(arm, {"joint": np.array([-REACH, REACH])})
    limits = arm.servos["joint"].limits

    def play(requests: Array, cycles: int) -> Array:
        angles = list[float]()
        keep = {"keep": lambda _, __, row: angles.append(row[0])}
        with arm.powered():
            arm.perform(np.clip(requests, *limits)[:, None], period=period, cycles=cycles, **keep)
        return np.array(angles)

    with arm.powered():
        result = calibrate(arm, "joint", period=period, duration=DURATION, folder=folder)
    return Joint(result, limits, play)


def rows_of(joint: Joint) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Errors: direct and best shift [deg], recommended over shift, expected over met."""
    model = joint.calibration.model
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
    model, way = joint.calibration.model, joint.calibration.recommended.way
    if way == "direct":
        return path, math.nan
    if way == "shift":
        return invert_shift(model, path).requests, math.nan
    if way == "closed_form":
        answer = invert_closed_form(model, path)
    else:
        answer = invert_optimal(model, path, limits=joint.limits)
    return answer.requests, answer.expected.error
