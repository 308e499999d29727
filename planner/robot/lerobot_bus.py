"""The servo bus of a LeRobot robot, which LeRobot's own class opens and sets up.

LeRobot writes gains and accelerations whenever it connects: the servos are measured here as
they are under LeRobot. At the end it switches torque off, unless the robot's configuration says
otherwise.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from planner.exceptions import BusError, InvalidInput
from planner.robot.bus import Bus, Port
from planner.robot.protocols import DYNAMIXEL, FEETECH

PROTOCOLS = {"FeetechMotorsBus": FEETECH, "DynamixelMotorsBus": DYNAMIXEL}
"""By the class of LeRobot's bus."""


class LeRobotPort(Port):
    """The serial port that LeRobot has opened."""

    def __init__(self, serial: Any) -> None:
        """Take the port, of pyserial."""
        self._serial, self.baud_rate = serial, int(serial.baudrate)

    def write(self, content: bytes) -> None:
        """Send bytes, and discard the bytes received before."""
        try:
            self._serial.reset_input_buffer()
            self._serial.write(content)
        except OSError as error:
            raise self._gone() from error

    def read(self, count: int, timeout: float) -> bytes:
        """So many bytes, or fewer if a time [s] is over before."""
        try:
            self._serial.timeout = timeout
            return bytes(self._serial.read(count))
        except OSError as error:
            raise self._gone() from error

    def _gone(self) -> BusError:
        return BusError(f"{self._serial.port}: the bus is gone; check the cable and the supply")


def robot_of(name: str, port: str) -> Any:
    """A LeRobot robot that is not connected yet.

    Args:
        name: As LeRobot calls it, with or without ``_follower``: so101.
        port: Its serial port.

    Raises:
        InvalidInput: LeRobot is not installed, has no such robot, or none with such a bus.
    """
    try:
        from lerobot.robots.config import RobotConfig  # type: ignore[import-not-found]
        from lerobot.robots.utils import make_robot_from_config  # type: ignore[import-not-found]
    except ImportError as error:
        raise InvalidInput(
            f"--bus lerobot:{name} needs LeRobot, which cannot be imported ({error}): python -m "
            "pip install 'lerobot[feetech]', or name the bus: --bus feetech"
        ) from error
    for module in ("so_follower", f"{name}_follower", name):
        with suppress(ImportError):
            importlib.import_module(f"lerobot.robots.{module}")
    choices = RobotConfig.get_known_choices()
    kind = next((each for each in (f"{name}_follower", name) if each in choices), None)
    if kind is None:
        raise InvalidInput(
            f"--bus: got lerobot:{name}, expected a robot of LeRobot, such as "
            f"{', '.join(sorted(each.removesuffix('_follower') for each in choices))}"
        )
    robot = make_robot_from_config(choices[kind](port=port))
    if type(getattr(robot, "bus", None)).__name__ not in PROTOCOLS:
        protocols = ", ".join(PROTOCOLS)
        raise InvalidInput(f"--bus lerobot:{name}: got another bus of servos, expected {protocols}")
    return robot


def joints(name: str) -> dict[int, str]:
    """LeRobot's names of the joints of a robot, by the identifiers of their servos."""
    return {motor.id: joint for joint, motor in robot_of(name, "").bus.motors.items()}


@contextmanager
def lerobot_bus(name: str, port: str) -> Iterator[Bus]:
    """The bus of a LeRobot robot, connected in the block as LeRobot does it.

    Raises:
        BusError: LeRobot cannot connect.
    """
    robot = robot_of(name, port)
    try:
        robot.connect(calibrate=False)
    except (OSError, RuntimeError) as error:
        raise BusError(f"{port}: LeRobot cannot connect: {str(error).splitlines()[0]}") from error
    try:
        protocol = PROTOCOLS[type(robot.bus).__name__]
        yield Bus(LeRobotPort(robot.bus.port_handler.ser), protocol)
    finally:
        with suppress(OSError, RuntimeError):
            robot.disconnect()
