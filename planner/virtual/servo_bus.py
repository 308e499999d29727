"""Servos behind their real protocol: packets in, packets out, and joints that move meanwhile.

:class:`VirtualServos` answers the bytes of a bus. :class:`VirtualPort` puts it in the place of a
serial port, on a clock of its own that only its packets and waiting advance: the same program finds
the same numbers. :func:`serve` puts it behind a pseudo-terminal, for other programs.
"""

from __future__ import annotations

import math
import os
import select
import time
import tomllib
import tty
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

import planner.robot.protocols as protocols
from planner.exceptions import BusError
from planner.robot.protocols import BROADCAST, SYNC_WRITE, WRITE, Packet, ServoProtocol
from planner.virtual.motors import Motor, Motors, arm_of

HOT = 70.0  # temperature at which a servo switches its torque off [°C]
WIRE = 1e-3  # time of a packet and its answers on the wire, in lock step [s]
PROTECTIVE, SAGGING = 0.2, 0.3  # largest duty of a servo that gave up, and at a supply that sags


class Kind(NamedTuple):
    """A kind of servo."""

    protocol: ServoProtocol
    motor: Motor
    registers: Mapping[str, int]  # when the supply is switched on; all others hold 0


def _read_kinds() -> dict[str, Kind]:
    text = Path(__file__).with_name("servos.toml").read_text("utf-8")
    tables, kinds = tomllib.loads(text), {}
    for name, table in tables.items():
        protocol = protocols.PROTOCOLS[table["protocol"]]
        base = tables[table["like"]]["motor"] if "like" in table else {}
        registers = table["registers"] | {"largest_position": 2 * protocol.middle - 1}
        kinds[name] = Kind(protocol, Motor(**base | table.get("motor", {})), registers)
    return kinds


KINDS: Mapping[str, Kind] = _read_kinds()
"""By name: the tables of ``servos.toml``. The first of a protocol represents it."""


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Faults, and their times [s since the beginning]."""

    drop: float = 0.0  # share of the packets, both ways, that are lost
    disconnect: float = math.inf  # when the cable is pulled
    power_off: float = math.inf  # when the supply is off: the port stays, and no servo answers
    stall: Mapping[int, float] = field(default_factory=dict)  # by servo, when something blocks it
    overheat: Mapping[int, float] = field(default_factory=dict)  # by servo, when it is too hot
    saturate: Mapping[int, float] = field(default_factory=dict)  # by servo, when its supply sags


class VirtualServos:
    """Servos on a bus, with their memories and their joints."""

    def __init__(
        self,
        count: int = 6,
        kind: Kind = KINDS["sts3215"],
        *,
        motors: Sequence[Motor] | None = None,
        faults: Faults | None = None,
        step: float | None = None,
        seed: int = 0,
    ) -> None:
        """Servos with the identifiers 1 to ``count``, at rest near their middle, torque off.

        Their motors are by default an arm of such servos. With a ``step`` [s] sync writes are the
        clock, and any other packet takes :data:`WIRE`. The seed is that of lost packets.
        """
        self.protocol, self.ids = kind.protocol, range(1, count + 1)
        self.motors = Motors(list(motors or arm_of(kind.motor, count)), np.zeros(count))
        self._tick_angle = 2.0 * np.pi / kind.protocol.ticks_per_turn
        self.faults, self.step = faults or Faults(), step
        self._tick = 0.0
        self._random = np.random.default_rng(seed)
        self._received = bytearray()
        self._memories = [bytearray(256) for _ in self.ids]
        for servo in self.ids:
            self._set(servo, {**kind.registers, "goal": kind.protocol.middle})

    @property
    def time(self) -> float:
        """How long they have been running [s]."""
        return self.motors.time

    def run(self, until: float) -> None:
        """Let the joints move until a time since the beginning [s]."""
        faults, motors = self.faults, self.motors
        while motors.time < until - 1e-9:
            before = motors.time
            motors.run(min(until, before + 0.02))
            if motors.time == before:  # less than a step
                return
            stalled, hot, sagging = (
                [servo - 1 for servo, at in each.items() if motors.time >= at]
                for each in (faults.stall, faults.overheat, faults.saturate)
            )
            motors.jammed[stalled] = 1.0
            motors.temperatures[hot] = np.maximum(motors.temperatures[hot], HOT + 10.0)
            motors.limits[sagging] = np.minimum(motors.limits[sagging], SAGGING)
            motors.limits[motors.overload_times > 2.0] = PROTECTIVE
            motors.powered[(motors.temperatures > HOT) | self._dead] = 0.0

    def feed(self, content: bytes) -> bytes:
        """The answers to bytes of the bus."""
        self._received += content
        answers = b""
        while (packet := self.protocol.take(self._received, answers=False)) is not None:
            if self.step is not None:
                due = self._tick + self.step if packet.code == SYNC_WRITE else 0.0
                self.run(max(due, self.motors.time + WIRE))
                self._tick = self.motors.time if packet.code == SYNC_WRITE else self._tick
            if not (self._dead or self._lost()):
                answers += b"".join(each for each in self._carry_out(packet) if not self._lost())
        return answers

    @property
    def _dead(self) -> bool:
        return self.motors.time >= self.faults.power_off

    def _lost(self) -> bool:
        return self.faults.drop > 0.0 and bool(self._random.random() < self.faults.drop)

    def _carry_out(self, packet: Packet) -> Iterator[bytes]:
        """Carry out an instruction, and answer."""
        width, content = self.protocol.address_size, packet.content
        first = int.from_bytes(content[:width], "little")
        size = int.from_bytes(content[width : 2 * width], "little")
        reads = packet.code in (protocols.READ, protocols.SYNC_READ)
        servos: Sequence[int] = self.ids if packet.servo == BROADCAST else [packet.servo]
        if packet.code == SYNC_WRITE:
            rows = content[2 * width :]
            for k in range(0, len(rows) - size, size + 1):
                self._write(rows[k], first, rows[k + 1 : k + 1 + size])
        elif packet.code == protocols.SYNC_READ:
            servos = content[2 * width :]
        for servo in servos:
            if servo not in self.ids:
                continue
            if packet.code == protocols.PING:
                model = self._memory(servo)[self.protocol.registers["model"].address :][:2]
                yield self._answer(servo, bytes(model) + b"\x01" if width == 2 else b"")
            elif reads:
                yield self._answer(servo, self._memory(servo)[first : first + size])
            elif packet.code == WRITE:
                self._write(servo, first, content[width:])
                if packet.servo != BROADCAST:
                    yield self._answer(servo, b"")

    def _answer(self, servo: int, content: bytes | bytearray) -> bytes:
        motors, k = self.motors, servo - 1
        hot, overloaded = motors.temperatures[k] > HOT, motors.limits[k] == PROTECTIVE
        feetech = self.protocol is protocols.FEETECH
        error = (0x04 * hot + 0x20 * overloaded) if feetech else 0x80 * (hot or overloaded)
        return self.protocol.answer(servo, int(error), bytes(content))

    def _set(self, servo: int, values: Mapping[str, float]) -> None:
        memory = self._memories[servo - 1]
        for name, value in values.items():
            register, content = self.protocol.registers[name], round(float(value))
            place = slice(register.address, register.address + register.size)
            memory[place] = register.encode(content)

    def _memory(self, servo: int) -> bytearray:
        """The memory of a servo, with its present measurements."""
        motors, k, protocol = self.motors, servo - 1, self.protocol
        self._set(
            servo,
            {
                "position": protocol.middle + motors.angles[k] / self._tick_angle,
                "speed": motors.speeds[k] / protocol.speed_unit,
                "load": motors.duties[k] / protocols.LOAD_UNIT,
                "temperature": motors.temperatures[k],
            },
        )
        return self._memories[k]

    def _write(self, servo: int, first: int, content: bytes) -> None:
        """Write bytes to a servo's memory, and let its registers take effect."""
        if servo not in self.ids:
            return
        k, protocol, motors = servo - 1, self.protocol, self.motors
        memory = self._memories[k]
        memory[first : first + len(content)] = content
        del memory[256:]
        value = {
            name: register.decode(memory[register.address :])
            for name, register in protocol.registers.items()
        }
        motors.goals[k] = (value["goal"] - protocol.middle) * self._tick_angle
        motors.powered[k] = value["torque"] > 0 and motors.temperatures[k] <= HOT
        motors.gains[k] = [value[name] for name in ("p_gain", "i_gain", "d_gain")]
        acceleration = value.get("profile_acceleration", 0)
        if acceleration == protocol.fastest_acceleration:
            acceleration = 0
        motors.profiles[k] = [
            value["profile_speed"] * protocol.speed_unit,
            acceleration * protocol.acceleration_unit,
        ]


class VirtualPort:
    """Virtual servos as a port of ``planner.robot.bus``, in lock step with its packets."""

    path = "the virtual bus"
    baud_rate = 1_000_000

    def __init__(self, servos: VirtualServos) -> None:
        """Take the servos, whose clock is the port's."""
        self.servos, self._time, self._waiting = servos, servos.time, b""

    def write(self, content: bytes) -> None:
        """Send bytes, and discard the bytes received before."""
        self.sleep(10.0 * len(content) / self.baud_rate)
        self._waiting = self.servos.feed(content)

    def read(self, count: int, timeout: float) -> bytes:
        """So many bytes, or fewer if a time [s] is over before."""
        received, self._waiting = self._waiting[:count], self._waiting[count:]
        self.sleep(10.0 * len(received) / self.baud_rate if len(received) == count else timeout)
        return received

    def now(self) -> float:
        """Time of the servos [s]."""
        return self._time

    def sleep(self, duration: float) -> None:
        """Let the servos run for a time [s]."""
        self._time += duration
        self.servos.run(self._time)
        if self._time >= self.servos.faults.disconnect:
            raise BusError(f"{self.path}: the bus is gone; check the cable and the supply")


@contextmanager
def terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the end of the servos, and the path of the other end."""
    ours, theirs = os.openpty()
    try:
        tty.setraw(theirs)
        yield ours, os.ttyname(theirs)
    finally:
        for end in (ours, theirs):
            with suppress(OSError):
                os.close(end)


def serve(servos: VirtualServos, end: int, *, stopped: Callable[[], bool] = lambda: False) -> None:
    """Answer on the servos' end of a :func:`terminal` until ``stopped``, or the cable is pulled."""
    begin = time.monotonic()
    while not stopped() and servos.time < servos.faults.disconnect:
        ready = select.select([end], [], [], 0.05)[0]
        if servos.step is None:
            servos.run(time.monotonic() - begin)
        if ready:
            answers = servos.feed(os.read(end, 4096))
            while answers:
                answers = answers[os.write(end, answers) :]
