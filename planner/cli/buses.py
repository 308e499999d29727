"""Options of commands that move servos: which bus, which port, which joints."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from planner.cli import types
from planner.cli.console import complain

if TYPE_CHECKING:
    from planner.robot.arm import Arm, Servo
    from planner.robot.bus import Bus

BUSES = ("virtual", "feetech", "dynamixel")

INTERRUPTED = 130

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--bus",
        type=click.Choice(BUSES),
        required=True,
        help="What the servos speak; 'virtual' are simulated ones, here and at once.",
    ),
    click.option("--port", metavar="P", help="The serial port, such as /dev/ttyACM0."),
    click.option(
        "--baud-rate",
        type=click.IntRange(9600),
        default=1_000_000,
        show_default=True,
        metavar="N",
        help="Bits per second.",
    ),
)


def bus_options(command: Command) -> Command:
    """Give a command the options that :func:`open_bus` takes."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def model_option(help_text: str) -> Callable[[Command], Command]:
    """Give a command the option of the file that names the servos of the joints."""
    return click.option("--model", type=types.INPUT, required=True, metavar="FILE", help=help_text)


def _ids(text: str) -> dict[str, int]:
    """Identifiers by joint: 1-6, or pan=1,lift=2."""
    found: dict[str, int] = {}
    for part in text.split(","):
        if equals := re.fullmatch(r"\s*([^=]+)=\s*(\d{1,3})\s*", part):
            named = {equals[1].strip(): int(equals[2])}
        elif ends := re.fullmatch(r"\s*(\d{1,3})(?:-(\d{1,3}))?\s*", part):
            first, last = int(ends[1]), int(ends[2] or ends[1])
            named = {f"joint_{each}": each for each in range(first, last + 1)}
        else:
            raise ValueError
        if not named or found.keys() & named.keys():
            raise ValueError
        found |= named
    if max(found.values()) > 252 or len(set(found.values())) < len(found):
        raise ValueError
    return found


def ids_type() -> click.ParamType:  # type: ignore[type-arg]  # generic from click 8.5 on
    """The type of an option that names servos."""
    return types.Parsed(_ids, "identifiers of servos, such as 1-6 or pan=1,lift=2, each once")


@contextmanager
def open_bus(choices: Mapping[str, Any], ids: Mapping[str, int]) -> Iterator[Bus]:
    """The bus that the options name, in the block; a virtual one has servos 1 to the largest.

    Raises:
        click.UsageError: A port is missing, or has no effect.
        BusError: It cannot be opened.
    """
    from planner.robot.bus import Bus, SerialPort
    from planner.robot.protocols import FEETECH, PROTOCOLS

    kind, path = choices["bus"], choices["port"]
    if kind == "virtual":
        if path is not None:
            raise click.UsageError("--port has no effect with --bus virtual; leave it out.")
        from planner.virtual.servo_bus import VirtualPort, VirtualServos

        yield Bus(VirtualPort(VirtualServos(max(1, *ids.values()))), FEETECH)
        return
    if path is None:
        raise click.UsageError(f"--bus {kind} needs --port, such as --port /dev/ttyACM0.")
    port = SerialPort(path, choices["baud_rate"])
    try:
        yield Bus(port, PROTOCOLS[kind])
    finally:
        port.close()


@contextmanager
def open_arm(choices: Mapping[str, Any], servos: Mapping[str, Servo]) -> Iterator[Arm]:
    """The joints on the bus that the options name, in the block."""
    from planner.robot.arm import Arm

    with open_bus(choices, {name: servo.id for name, servo in servos.items()}) as bus:
        yield Arm(bus, servos)


@contextmanager
def stopping(advice: str) -> Iterator[None]:
    """Say in one line what Ctrl-C or a fault in the block leaves; the bus has been seen to."""
    from planner.exceptions import BusError

    try:
        yield
    except KeyboardInterrupt as stop:
        complain(f"stopped by Ctrl-C: the joints stay where they are, torque as before; {advice}")
        raise click.exceptions.Exit(INTERRUPTED) from stop
    except BusError as error:
        raise BusError(f"{error}; {advice}") from error


def logs_folder(output: str) -> Path:
    """Where the raw logs of a calibration are: beside its models."""
    return Path(output).with_name(f"{Path(output).stem}_logs")
