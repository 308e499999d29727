"""The recipe for Feetech servos runs on Feetech's own SDK, with one packet for all servos."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.docs.blocks import ROOT

READ, WRITE, POSITION = 0x82, 0x83, 56


def _packet(servo, *content):
    body = [servo, len(content) + 1, *content]
    return [0xFF, 0xFF, *body, ~sum(body) & 0xFF]


class Bus:
    """A serial port with servos that are where they were last asked to be."""

    def __init__(self, _name):
        self.is_using, self.ticks, self.silent = False, {}, set()
        self.sent, self.waiting = [], []

    def openPort(self):  # noqa: N802
        return True

    def setBaudRate(self, _rate):  # noqa: N802
        return True

    def clearPort(self):  # noqa: N802
        self.waiting.clear()

    def setPacketTimeout(self, _bytes):  # noqa: N802
        pass

    def isPacketTimeout(self):  # noqa: N802
        return not self.waiting

    def writePort(self, packet):  # noqa: N802
        packet = list(packet)
        assert packet == _packet(packet[2], *packet[4:-1])
        self.sent.append(packet)
        kind, address, size, content = packet[4], packet[5], packet[6], packet[7:-1]
        if kind == WRITE:
            for k in range(0, len(content), size + 1):
                servo, acceleration, low, high, *_, speed_low, speed_high = content[k:][: size + 1]
                assert (acceleration, speed_low, speed_high) == (0, 0, 0)
                self.ticks[servo] = low + 256 * high
        if kind == READ:
            assert (address, size) == (POSITION, 2)
            for servo in content:
                if servo not in self.silent:
                    low, high = self.ticks[servo] % 256, self.ticks[servo] // 256
                    self.waiting += _packet(servo, 0, low, high)
        return len(packet)

    def readPort(self, count):  # noqa: N802
        read, self.waiting = self.waiting[:count], self.waiting[count:]
        return read


def test_the_class_for_feetech_servos_sends_and_reads_all_joints_in_one_packet_each(monkeypatch):
    sdk = pytest.importorskip("scservo_sdk", reason="ftservo-python-sdk is not installed")
    page = (ROOT / "docs/recipes/feetech.md").read_text("utf-8")
    (code,) = re.findall(r"^```py\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    monkeypatch.setattr(sdk, "PortHandler", Bus)
    names = {}
    exec(compile(code, "feetech.md", "exec"), names)
    ids = range(1, 7)
    robot = names["Feetech"](ids)
    asked = np.radians([0.0, 30.0, -170.0, 179.0, -1.0, 90.0])
    robot.send(asked)
    assert np.allclose(robot.angles(), asked, rtol=0.0, atol=np.pi / names["TURN"])
    robot.send(-asked)
    assert np.allclose(robot.angles(), -asked, rtol=0.0, atol=np.pi / names["TURN"])
    assert [packet[4] for packet in robot.port.sent] == [WRITE, READ] * 2
    robot.port.silent = {4}
    with pytest.raises(OSError, match="servo 4 did not answer"):
        robot.angles()
    robot.port.silent = set(ids)
    with pytest.raises(OSError, match="servo 1 did not answer"):
        robot.angles()
