"""Packets and registers of servo buses: Feetech STS/SMS, and Dynamixel protocol 2.0.

Both protocols know the same instructions, and write numbers with the low byte first; they differ in
their frames, in the width of addresses and in the sign of numbers. The servos that speak them, with
their control tables, are in ``protocols.toml``. Nothing here opens a port or keeps a state.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import NamedTuple

PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
"""Instructions, the same in both protocols."""

LOAD_UNIT = 1e-3  # share of the largest load of a load of 1
BROADCAST = 0xFE  # the identifier that all servos listen to, and none answers
TWO_COMPLEMENT = -1  # sign of a register whose negative numbers are two's complements


class Register(NamedTuple):
    """A number in the memory of a servo, the low byte first."""

    address: int
    size: int  # bytes
    sign: int = 0  # 0 where it has none, TWO_COMPLEMENT, or the bit that holds the sign

    def encode(self, value: int) -> bytes:
        """The bytes of a value; one that does not fit is cut to the nearest that does."""
        width, signed = 8 * self.size, self.sign == TWO_COMPLEMENT
        if self.sign > 0:
            value = min(abs(value), (1 << self.sign) - 1) | ((value < 0) << self.sign)
        least, span = -(1 << (width - 1)) if signed else 0, 1 << width
        kept = max(least, min(least + span - 1, value))
        return kept.to_bytes(self.size, "little", signed=signed)

    def decode(self, content: bytes | bytearray) -> int:
        """The value of bytes."""
        signed = self.sign == TWO_COMPLEMENT
        value = int.from_bytes(content[: self.size], "little", signed=signed)
        if self.sign > 0 and value >> self.sign & 1:
            return -(value & ((1 << self.sign) - 1))
        return value


class Packet(NamedTuple):
    """The content of a frame."""

    servo: int  # that it is for, or from
    code: int  # the instruction; in an answer the error, 0 for none
    content: bytes  # parameters, or the answer's data


@dataclass(frozen=True, kw_only=True)
class ServoProtocol:
    """A protocol and the control table of servos; the subclasses have the frames."""

    name: str  # its name for users
    registers: Mapping[str, Register]  # by name; the same names in all protocols
    address_size: int  # bytes of an address
    errors: Mapping[int, str]  # meaning of each bit of an answer's error
    # by an answer's error without these bits, why the instruction was not carried out
    refusals: Mapping[int, str]
    feedback: Sequence[str]  # registers of one sync read, beside one another
    speed_unit: float  # speed of a profile speed of 1 [rad/s]
    acceleration_unit: float  # acceleration of a profile acceleration of 1 [rad/s²]
    ticks_per_turn: float = 4096  # counts of the angle in a turn
    # count in the middle of the range, which is angle 0 unless one says otherwise
    middle: int = 2048
    fastest_acceleration: int = 0  # profile acceleration that limits nothing, beside 0

    def instruction(self, servo: int, code: int, content: bytes = b"") -> bytes:
        """The frame of an instruction."""
        raise NotImplementedError

    def answer(self, servo: int, error: int, content: bytes = b"") -> bytes:
        """The frame of an answer."""
        return self.instruction(servo, error, content)

    def take(self, buffer: bytearray, *, answers: bool) -> Packet | None:
        """Take the first whole packet, and any bytes before it, off a buffer; more may come.

        Where answers are expected, instructions are dropped, and the reverse.
        """
        raise NotImplementedError

    def place(self, address: int, size: int) -> bytes:
        """An address and a number of bytes, as instructions begin."""
        width = self.address_size
        return address.to_bytes(width, "little") + size.to_bytes(width, "little")

    def block(self, names: Sequence[str]) -> tuple[int, int]:
        """First address and bytes of neighbouring registers."""
        places = [self.registers[name] for name in names]
        first = min(place.address for place in places)
        return first, max(place.address + place.size for place in places) - first

    def error_words(self, error: int) -> str:
        """The error of an answer in words; empty for none."""
        bits = [words for bit, words in self.errors.items() if error & bit]
        return " and ".join(bits + ([self.refusal(error)] if self.refusal(error) else []))

    def refusal(self, error: int) -> str:
        """Why an instruction was not carried out, in words; empty where it was."""
        number = error & ~sum(self.errors)
        return self.refusals.get(number, f"error {number}") if self.refusals and number else ""


class _Feetech(ServoProtocol):
    """FF FF, servo, length, instruction or error, content, inverted sum."""

    def instruction(self, servo: int, code: int, content: bytes = b"") -> bytes:
        body = bytes([servo, len(content) + 2, code]) + content
        return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])

    def take(self, buffer: bytearray, *, answers: bool) -> Packet | None:  # noqa: ARG002
        while (start := buffer.find(b"\xff\xff")) >= 0:
            del buffer[:start]
            if len(buffer) < 4:
                return None
            if buffer[2] == 0xFF or buffer[3] < 2:  # 255 is no identifier
                del buffer[0]
                continue
            end = buffer[3] + 4
            if len(buffer) < end:
                return None
            if ~sum(buffer[2 : end - 1]) & 0xFF != buffer[end - 1]:
                del buffer[:2]
                continue
            packet = Packet(buffer[2], buffer[4], bytes(buffer[5 : end - 1]))
            del buffer[:end]
            return packet
        del buffer[: -1 if buffer.endswith(b"\xff") else None]
        return None


class _Dynamixel(ServoProtocol):
    """FF FF FD 00, servo, length, instruction, content, CRC-16; an answer has the instruction 55.

    FF FF FD inside is followed by a stuffed FD.
    """

    def instruction(self, servo: int, code: int, content: bytes = b"") -> bytes:
        body = (bytes([code]) + content).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        frame = b"\xff\xff\xfd\x00" + bytes([servo]) + (len(body) + 2).to_bytes(2, "little") + body
        return frame + _crc(frame).to_bytes(2, "little")

    def answer(self, servo: int, error: int, content: bytes = b"") -> bytes:
        return self.instruction(servo, 0x55, bytes([error]) + content)

    def take(self, buffer: bytearray, *, answers: bool) -> Packet | None:
        while (start := buffer.find(b"\xff\xff\xfd\x00")) >= 0:
            del buffer[:start]
            if len(buffer) < 7:
                return None
            end = int.from_bytes(buffer[5:7], "little") + 7
            if end < 10:
                del buffer[:4]
                continue
            if len(buffer) < end:
                return None
            frame = bytes(buffer[:end])
            if _crc(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
                del buffer[:4]
                continue
            del buffer[:end]
            body = frame[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            if (body[0] == 0x55) != answers or (answers and len(body) < 2):
                continue
            return Packet(frame[4], *((body[1], body[2:]) if answers else (body[0], body[1:])))
        del buffer[: max(0, len(buffer) - 3)]
        return None


_CRC = [
    reduce(
        lambda value, _: (value << 1 ^ (0x8005 if value & 0x8000 else 0)) & 0xFFFF, range(8), top
    )
    for top in range(0, 1 << 16, 1 << 8)
]


def _crc(content: bytes) -> int:
    """CRC-16 with the polynomial 8005, from 0."""
    value = 0
    for byte in content:
        value = (value << 8 ^ _CRC[value >> 8 ^ byte]) & 0xFFFF
    return value


def _read_protocols() -> dict[str, ServoProtocol]:
    tables = tomllib.loads(Path(__file__).with_name("protocols.toml").read_text("utf-8"))
    protocols: dict[str, ServoProtocol] = {}
    for name, own in tables.items():
        like = own.pop("like", "")
        table = tables.get(like, {}) | own
        for key in ("errors", "refusals"):
            table[key] = {int(number, 0): words for number, words in table.get(key, {}).items()}
        table["registers"] = {key: Register(*each) for key, each in table["registers"].items()}
        table["speed_unit"] = table.pop("speed_rpm") * 2.0 * math.pi / 60.0
        table["acceleration_unit"] = table.pop("acceleration_rpm2") * 2.0 * math.pi / 3600.0
        frames = _Feetech if "feetech" in (name, like) else _Dynamixel
        protocols[name] = frames(name=name, **table)
    return protocols


PROTOCOLS: Mapping[str, ServoProtocol] = _read_protocols()  # by the name that users give
FEETECH, DYNAMIXEL = PROTOCOLS["feetech"], PROTOCOLS["dynamixel"]
