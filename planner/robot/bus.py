"""A bus of servos: instructions and answers over a port, with lost packets counted.

All joints are sent to by one sync write and read by one sync read, each of one packet from here.
"""

from __future__ import annotations

import errno
import importlib
import os
import termios
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from planner.exceptions import BusError, InvalidInput
from planner.robot import protocols
from planner.robot.protocols import BROADCAST, Packet, ServoProtocol

ATTEMPTS = 4
"""How often a servo is asked before it counts as silent; at 5 % lost packets, 10 % of questions
fail, and one in 10,000 fails so often."""

FULL = 1.0  # time until a full port is given up [s]; at 9,600 bits a second packets take 0.2

PATIENCE = 0.05
"""Time for which an answer is awaited beside its own [s]: a USB adapter may keep it for 16 ms."""

LEROBOT_BUSES = {"FeetechMotorsBus": protocols.FEETECH, "DynamixelMotorsBus": protocols.DYNAMIXEL}
"""By the class of LeRobot's bus."""


class Port(Protocol):
    """A connection to the servos, whose clock times the motion: the system's by default."""

    baud_rate: int

    def write(self, content: bytes) -> None:
        """Send bytes, and discard the bytes received before."""

    def read(self, count: int, timeout: float) -> bytes:
        """So many bytes, or fewer if a time [s] is over before."""

    def now(self) -> float:
        """A time that never goes back [s]."""
        return time.monotonic()

    def sleep(self, duration: float) -> None:
        """Wait for a time [s]."""
        time.sleep(duration)


class SerialPort(Port):
    """A serial port, or a pseudo-terminal, by pyserial."""

    def __init__(self, path: str, baud_rate: int = 1_000_000, *, opened: Any = None) -> None:
        """Open a port such as /dev/ttyACM0, or take it as pyserial has ``opened`` it already."""
        import serial

        self.path = path
        if opened is None and baud_rate not in serial.Serial.BAUDRATES:
            rates = ", ".join(str(rate) for rate in serial.Serial.BAUDRATES if rate >= 9600)
            raise InvalidInput(f"baud rate: got {baud_rate}, expected one of {rates}")
        try:
            self._serial = opened or serial.Serial(path, baud_rate, write_timeout=FULL)
        except serial.SerialException as error:
            if error.errno is None:  # opened, and not configured
                words = "is no serial port; expected such as /dev/ttyACM0"
            else:
                reason, advice = os.strerror(error.errno).lower(), "check the cable and the name"
                if error.errno == errno.EACCES:
                    advice = "join its group (sudo usermod -aG dialout $USER) and log in again"
                words = f"cannot be opened ({reason}); {advice}"
            raise InvalidInput(f"{path}: {words}") from error
        self.baud_rate = int(self._serial.baudrate)

    def write(self, content: bytes) -> None:
        """Send bytes, and discard the bytes received before."""
        with self._gone():
            self._serial.reset_input_buffer()
            self._serial.write(content)

    def read(self, count: int, timeout: float) -> bytes:
        """So many bytes, or fewer if a time [s] is over before."""
        with self._gone():
            self._serial.timeout = timeout
            return bytes(self._serial.read(count))

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()

    @contextmanager
    def _gone(self) -> Iterator[None]:
        import serial

        try:
            yield
        except serial.SerialTimeoutException as error:  # of a write
            raise BusError(f"{self.path}: takes no more bytes; check the cable") from error
        except (OSError, termios.error) as error:
            raise BusError(
                f"{self.path}: the bus is gone; check the cable and the supply"
            ) from error


class Bus:
    """The servos on a port; BusError where it is gone, or a servo stays silent or refuses."""

    def __init__(self, port: Port, protocol: ServoProtocol) -> None:
        """Take a port, which carries the bytes, and the protocol that frames them."""
        self.port, self.protocol = port, protocol
        self.patience = PATIENCE  # time for which an answer is waited for beside its own [s]
        self.asked = self.lost = 0  # answers, and those that did not come, or not whole

    def ping(self, servo: int) -> None:
        """Make sure that a servo answers."""
        self._ask(servo, protocols.PING, b"", 3 if self.protocol.address_size == 2 else 0)

    def read(self, servo: int, name: str) -> int:
        """The value of a register."""
        register = self.protocol.registers[name]
        place = self.protocol.place(register.address, register.size)
        return register.decode(self._ask(servo, protocols.READ, place, register.size).content)

    def write(self, servo: int, name: str, value: int) -> None:
        """Write a register, and wait for the servo to say so."""
        register = self.protocol.registers[name]
        width = self.protocol.address_size
        place = self.protocol.place(register.address, register.size)[:width]
        self._ask(servo, protocols.WRITE, place + register.encode(value), 0)

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Write a register of several servos in one packet, which none answers."""
        register = self.protocol.registers[name]
        content = self.protocol.place(register.address, register.size) + b"".join(
            bytes([servo]) + register.encode(value) for servo, value in values.items()
        )
        self.port.write(self.protocol.instruction(BROADCAST, protocols.SYNC_WRITE, content))

    def sync_read(
        self, servos: Sequence[int], names: Sequence[str] | None = None
    ) -> dict[int, dict[str, int]]:
        """Registers of servos by name, and the "error" of the answer; silent ones are left out.

        One packet asks for the registers, which are beside one another: by default the feedback.
        """
        protocol, names = self.protocol, names or self.protocol.feedback
        first, size = protocol.block(names)
        content = protocol.place(first, size) + bytes(servos)
        answers = self._answers(
            protocol.instruction(BROADCAST, protocols.SYNC_READ, content), len(servos), size
        )
        readings: dict[int, dict[str, int]] = {}
        for packet in answers:
            if packet.servo in servos and len(packet.content) == size:
                readings[packet.servo] = {"error": packet.code}
                for name in names:
                    register = protocol.registers[name]
                    content = packet.content[register.address - first :]
                    readings[packet.servo][name] = register.decode(content)
        self.asked += len(servos)
        self.lost += len(servos) - len(readings)
        return readings

    def _ask(self, servo: int, code: int, content: bytes, size: int) -> Packet:
        """The answer of one servo, asked for several times where it is lost."""
        instruction, refusal = self.protocol.instruction(servo, code, content), ""
        for _ in range(ATTEMPTS):
            self.asked += 1
            for packet in self._answers(instruction, 1, size):
                if packet.servo == servo:
                    refusal = self.protocol.refusal(packet.code)
                    if len(packet.content) == size and not refusal:
                        return packet
            self.lost += 1
        if refusal:
            raise BusError(f"servo {servo} reports {refusal}; check its model and its settings")
        raise BusError(
            f"servo {servo} does not answer; check its identifier, the baud rate, the cable and "
            "the supply"
        )

    def _answers(self, instruction: bytes, count: int, size: int) -> list[Packet]:
        """At most so many packets, each with so many bytes; an adapter may echo the instruction."""
        port, protocol = self.port, self.protocol
        whole = count * len(protocol.answer(1, 0, bytes(size)))
        end = port.now() + self.patience + 10.0 * (whole + len(instruction)) / port.baud_rate
        port.write(instruction)
        buffer, packets, echo = bytearray(), list[Packet](), len(instruction)
        missing = whole
        while missing > 0 and (remaining := end - port.now()) > 0.0:
            received = port.read(missing, remaining)
            buffer += received
            if echo and received and instruction.startswith(buffer[:echo]):
                if len(buffer) < echo:
                    missing = echo - len(buffer)
                    continue
                del buffer[:echo]
            echo = 0
            while (packet := protocol.take(buffer, answers=True)) is not None:
                if packet.servo < BROADCAST:
                    packets.append(packet)
            if len(packets) == count:
                break
            missing = max(1, whole // count * (count - len(packets)) - len(buffer))
        return packets


def robot_of(name: str, port: str) -> Any:
    """A LeRobot robot that is not connected yet, by its name with or without ``_follower``."""
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
    if type(getattr(robot, "bus", None)).__name__ not in LEROBOT_BUSES:
        expected = ", ".join(LEROBOT_BUSES)
        raise InvalidInput(f"--bus lerobot:{name}: got another bus of servos, expected {expected}")
    return robot


@contextmanager
def lerobot_bus(name: str, port: str) -> Iterator[Bus]:
    """The bus of a LeRobot robot, connected in the block as LeRobot does it.

    LeRobot writes gains and accelerations whenever it connects: the servos are measured as they are
    under LeRobot. It switches torque off at the end, unless the robot's configuration differs.
    """
    robot = robot_of(name, port)
    try:
        robot.connect(calibrate=False)
    except (OSError, RuntimeError) as error:
        raise BusError(f"{port}: LeRobot cannot connect: {str(error).splitlines()[0]}") from error
    try:
        protocol = LEROBOT_BUSES[type(robot.bus).__name__]
        yield Bus(SerialPort(port, opened=robot.bus.port_handler.ser), protocol)
    finally:
        with suppress(OSError, RuntimeError):
            robot.disconnect()
