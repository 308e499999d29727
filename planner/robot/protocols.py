"""Packets and registers of servo buses: Feetech STS/SMS, and Dynamixel protocol 2.0.

Both protocols know the same instructions, and write numbers with the low byte first; what differs
in their frames and in the control tables of servos is in ``protocols.toml``. Nothing here opens a
port or keeps a state.
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
    """A protocol and the control table of servos.

    A frame is header, servo, length of the rest, content, checksum; ``stuffed`` in the content is
    followed by its last byte once more. An answer's content begins with its mark and the error.
    """

    name: str  # its name for users
    header: bytes
    mark: bytes  # of answers
    stuffed: bytes
    registers: Mapping[str, Register]  # by name; the same names in all protocols
    address_size: int  # bytes of an address, of a length and of the checksum
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
        return self._frame(servo, bytes([code]) + content)

    def answer(self, servo: int, error: int, content: bytes = b"") -> bytes:
        """The frame of an answer."""
        return self._frame(servo, self.mark + bytes([error]) + content)

    def _frame(self, servo: int, content: bytes) -> bytes:
        content = content.replace(self.stuffed, self.stuffed + self.stuffed[-1:])
        length = (len(content) + self.address_size).to_bytes(self.address_size, "little")
        frame = self.header + bytes([servo]) + length + content
        return frame + self._checksum(frame)

    def _checksum(self, frame: bytes) -> bytes:
        """Of a short frame the inverted sum, of another one CRC-16 with polynomial 8005, from 0."""
        if self.address_size == 1:
            return bytes([~sum(frame[len(self.header) :]) & 0xFF])
        value = 0
        for byte in frame:
            value = (value << 8 ^ _CRC[value >> 8 ^ byte]) & 0xFFFF
        return value.to_bytes(2, "little")

    def take(self, buffer: bytearray, *, answers: bool) -> Packet | None:
        """Take the first whole packet, and any bytes before it, off a buffer; more may come.

        Where answers are expected, instructions that differ from them are dropped, and the reverse.
        """
        head, width = len(self.header), self.address_size
        begin = head + 1 + width
        while (start := buffer.find(self.header)) >= 0:
            del buffer[:start]
            if len(buffer) < begin:
                return None
            end = begin + int.from_bytes(buffer[head + 1 : begin], "little")
            possible = buffer[head] != 0xFF and end > begin + width  # 255 is no identifier
            if possible and len(buffer) < end:
                return None
            frame = bytes(buffer[:end])
            if not possible or self._checksum(frame[:-width]) != frame[-width:]:
                del buffer[0]
                continue
            del buffer[:end]
            content = frame[begin:-width].replace(self.stuffed + self.stuffed[-1:], self.stuffed)
            if self.mark and content.startswith(self.mark) != answers:
                continue
            if content := content[len(self.mark) if answers else 0 :]:
                return Packet(frame[head], content[0], content[1:])
        del buffer[: max(0, len(buffer) - head + 1)]
        return None

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


_CRC = [
    reduce(
        lambda value, _: (value << 1 ^ (0x8005 if value & 0x8000 else 0)) & 0xFFFF, range(8), top
    )
    for top in range(0, 1 << 16, 1 << 8)
]


def _read_protocols() -> dict[str, ServoProtocol]:
    tables = tomllib.loads(Path(__file__).with_name("protocols.toml").read_text("utf-8"))
    protocols: dict[str, ServoProtocol] = {}
    for name, own in tables.items():
        table = tables.get(own.pop("like", ""), {}) | own
        for key in ("errors", "refusals"):
            table[key] = {int(number, 0): words for number, words in table.get(key, {}).items()}
        table["registers"] = {key: Register(*each) for key, each in table["registers"].items()}
        table["speed_unit"] = table.pop("speed_rpm") * 2.0 * math.pi / 60.0
        table["acceleration_unit"] = table.pop("acceleration_rpm2") * 2.0 * math.pi / 3600.0
        for key in ("header", "mark", "stuffed"):
            table[key] = bytes(table[key])
        protocols[name] = ServoProtocol(name=name, **table)
    return protocols


PROTOCOLS: Mapping[str, ServoProtocol] = _read_protocols()  # by the name that users give
FEETECH, DYNAMIXEL = PROTOCOLS["feetech"], PROTOCOLS["dynamixel"]
