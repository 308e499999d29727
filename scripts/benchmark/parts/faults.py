"""Commands that move servos, with something that goes wrong at a random moment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
from click.testing import CliRunner, Result

from benchmark.parts import Options
from benchmark.table import Table
from planner.cli import cli
from planner.virtual import servo_bus
from planner.virtual.servo_bus import Faults, VirtualServos

MOMENTS = 5  # of each fault, for every random instance that the options ask for: 100 by default
NOTICED = 2.0
"""Time in which a fault is noticed [s]: a joint that stalls where it should nearly rest is not."""

BEGIN = -0.02  # faults that come so shortly after the end may have come before it [s]
CALIBRATE = ("calibrate", "--bus", "virtual", "--ids", "1", "--yes", "-o", "arm.toml")
BRIEF = ("--duration-s", "16", "--reach-deg", "30")

VIRTUAL = ("--bus", "virtual", "--model", "arm.toml")

COMMANDS: Mapping[str, tuple[tuple[str, ...], float]] = {
    "play": (("play", "requests.csv", *VIRTUAL, "-o", "log.csv"), 3.0),
    "record": (("record", *VIRTUAL, "--duration-s", "2", "-o", "log.csv"), 2.5),
    "check": (("check", *VIRTUAL), 20.0),
    "calibrate": ((*CALIBRATE, *BRIEF), 60.0),
}
"""Each with the time that it takes without a fault [s], about."""

FAULTS: Mapping[str, Callable[[float], dict[str, Any]]] = {
    "5 % of the packets lost": lambda _: {"drop": 0.05},
    "cable pulled": lambda time: {"disconnect": time},
    "supply off": lambda time: {"power_off": time},
    "servo stalls": lambda time: {"stall": {1: time}},
    "Ctrl-C": lambda _: {},
}


def measure(options: Options) -> list[Table]:
    """How many ended as documented, of each command and fault."""
    count = MOMENTS * options.instances
    table = Table(
        "Commands on servos, with a fault at a random moment",
        "command, fault | cases | not in one line | wrong status | log not whole"
        " | torque not as it was",
        note="Virtual servos in lock step. Lost packets: the command goes on. Any other fault ends "
        "it with status 1 or, Ctrl-C, 130 and one line of message, where it comes before the end; "
        "record ends well by Ctrl-C, and moves no servo that could stall. Every row that was "
        "measured is in the log; torque is off, as it was before, where the servo still answers.",
    )
    with TemporaryDirectory() as folder, chdir(folder):
        time = 0.01 * np.arange(150)
        angles = 20.0 * np.sin(2.0 * np.pi * time / 1.5)
        CliRunner().invoke(cli, CALIBRATE)
        kept = {"fmt": "%.6f", "delimiter": ",", "header": "t_s,joint_1_deg", "comments": ""}
        np.savetxt("requests.csv", np.column_stack([time, angles]), **kept)
        for command in COMMANDS:  # calibrate, which writes the model anew, is the last one
            for fault in FAULTS:
                wrong = np.sum([case(command, fault, seed) for seed in range(count)], axis=0)
                table.add(f"{command}, {fault}", count, *wrong)
    return [table]


def case(command: str, fault: str, seed: int) -> tuple[bool, bool, bool, bool]:
    """Whether message, status, log and torque of one case are wrong."""
    for file in (*Path().glob("*.part"), *Path().glob("*_logs/*.part"), *Path().glob("log.csv")):
        file.unlink()
    random = np.random.default_rng(seed)
    arguments, duration = COMMANDS[command]
    moment = duration * float(random.random())
    servos, interrupted = list[Interrupted](), fault == "Ctrl-C"

    def create(*args: Any, **options: Any) -> Interrupted:
        faults = Faults(**FAULTS[fault](moment))
        servos.append(Interrupted(*args, faults=faults, seed=seed, **options))
        servos[-1].interruption = moment if interrupted else float("inf")
        return servos[-1]

    with patch.object(servo_bus, "VirtualServos", create):
        result = CliRunner().invoke(cli, ["-q", *arguments])
    (bus,) = servos
    since = bus.time - moment if bus.interrupted or not interrupted else -1.0
    return (
        not in_one_line(result),
        not right_status(result, command, fault, since),
        not whole_logs(),
        fault not in ("cable pulled", "supply off") and bool(bus.motors.powered.any()),
    )


class Interrupted(VirtualServos):
    """Servos during whose answer somebody presses Ctrl-C."""

    interruption = float("inf")
    interrupted = False

    def feed(self, content: bytes) -> bytes:
        """Answer, or raise KeyboardInterrupt once."""
        if self.time >= self.interruption and not self.interrupted:
            self.interrupted = True
            raise KeyboardInterrupt
        return super().feed(content)


def in_one_line(result: Result) -> bool:
    """Whether a failure was reported in one line; success may come with warnings."""
    lines = result.stderr.splitlines()
    clear = all(line.startswith("request-planner: ") for line in lines)
    return clear if result.exit_code == 0 else clear and len(lines) == 1


def right_status(result: Result, command: str, fault: str, since: float) -> bool:
    """Whether a fault ended the command in good time, and nothing else did.

    The command went on ``since`` afterwards [s], negative where it had ended before.
    """
    harmless = fault.startswith("5 %") or (command == "record" and fault == "servo stalls")
    if fault == "Ctrl-C" and since >= 0.0:
        return result.exit_code == (0 if command == "record" else 130)
    if since < BEGIN or harmless:
        return result.exit_code == 0
    return result.exit_code == 1 or (result.exit_code == 0 and since < NOTICED)


def whole_logs() -> bool:
    """Whether every line of every log has the columns of its header."""
    for log in (*Path().glob("*.csv*"), *Path().glob("*_logs/*")):
        first, *rows = log.read_text(encoding="utf-8").splitlines()
        if any(row.count(",") != first.count(",") for row in rows):
            return False
    return True
