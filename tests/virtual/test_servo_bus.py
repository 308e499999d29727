"""The virtual bus behind a pseudo-terminal: the vendors' SDKs work on it as they are."""

import re
import threading
from contextlib import contextmanager

import numpy as np
import pytest

from planner.robot.bus import Bus
from planner.robot.protocols import BROADCAST, FEETECH, WRITE
from planner.virtual.servo_bus import KINDS, Faults, VirtualPort, VirtualServos, serve, terminal
from tests.docs.blocks import ROOT

STEP = 0.01
IDS = range(1, 7)
PATIENCE = 5000  # how long the SDKs wait for an answer on a busy machine [ms]; they have 16 and 50


@contextmanager
def served(kind, **settings):
    """The port of virtual servos in lock step with sync writes."""
    VirtualServos(1, kind).run(0.01)  # compiles, for longer than drivers wait for an answer
    servos = VirtualServos(6, kind, step=STEP, **settings)
    ended = threading.Event()
    with terminal() as (end, path):
        thread = threading.Thread(
            target=serve, args=(servos, end), kwargs={"stopped": ended.is_set}
        )
        thread.start()
        try:
            yield path
        finally:
            ended.set()
            thread.join()


def wave(k):
    return 2048 + round(400 * np.sin(0.1 * k))


def test_the_recipe_for_feetechs_own_sdk_moves_and_reads_all_servos_in_one_packet_each(monkeypatch):
    """The bus goes on by a packet to all servos, and answers what asks them all."""
    sdk = pytest.importorskip("scservo_sdk", reason="ftservo-python-sdk is not installed")
    page = (ROOT / "docs/recipes/feetech.md").read_text("utf-8")
    (code,) = re.findall(r"^```py\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    names = {}
    exec(compile(code, "feetech.md", "exec"), names)
    monkeypatch.setattr(sdk.port_handler, "LATENCY_TIMER", PATIENCE)
    with served(KINDS["sts3215"]) as path:
        robot = names["Feetech"](IDS, port=path)
        for servo in IDS:
            assert robot.packet.ping(servo)[:2] == (777, sdk.COMM_SUCCESS)
            assert robot.packet.write1ByteTxRx(servo, 40, 1) == (sdk.COMM_SUCCESS, 0)
        angles = []
        for k in range(80):
            robot.send(np.full(6, (wave(k) - 2048) * 2.0 * np.pi / 4096))
            angles.append(robot.angles())
        monkeypatch.setattr(sdk.port_handler, "LATENCY_TIMER", 50)
        robot.ids = [*IDS, 7]
        with pytest.raises(OSError, match="servo 7 did not answer"):
            robot.angles()
        robot.port.closePort()
    assert_followed(np.array(angles) * 4096 / (2.0 * np.pi) + 2048)


@pytest.mark.parametrize(
    ("kind", "torque", "goal", "position", "size"),
    [("xl430", 64, 116, 132, 4), ("mx-64", 64, 116, 132, 4), ("xl-320", 24, 30, 37, 2)],
)
def test_robotis_own_sdk_pings_writes_and_reads_moving_servos(
    kind, torque, goal, position, size, monkeypatch
):
    sdk = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")
    monkeypatch.setattr(sdk.port_handler, "LATENCY_TIMER", PATIENCE)
    model = KINDS[kind].registers["model"]
    middle = KINDS[kind].protocol.middle
    with served(KINDS[kind]) as path:
        port, packet = sdk.PortHandler(path), sdk.PacketHandler(2.0)
        assert port.openPort()
        assert port.setBaudRate(1_000_000)
        found, result = packet.broadcastPing(port)
        assert result == sdk.COMM_SUCCESS
        assert {servo: model for servo, (model, _) in found.items()} == dict.fromkeys(IDS, model)
        writer = sdk.GroupSyncWrite(port, packet, goal, size)
        reader = sdk.GroupSyncRead(port, packet, position, size)
        for servo in IDS:
            assert packet.write1ByteTxRx(port, servo, torque, 1) == (sdk.COMM_SUCCESS, 0)
            reader.addParam(servo)
        positions = []
        for k in range(80):
            for servo in IDS:
                writer.addParam(servo, (wave(k) - 2048 + middle).to_bytes(size, "little"))
            assert writer.txPacket() == sdk.COMM_SUCCESS
            writer.clearParam()
            assert reader.txRxPacket() == sdk.COMM_SUCCESS
            positions.append([reader.getData(servo, position, size) for servo in IDS])
        port.closePort()
    assert_followed(np.array(positions) - middle + 2048)


def assert_followed(positions):
    """They move with their requests, late: no servo jumps to its goal."""
    requests = np.array([wave(k) for k in range(len(positions))])
    assert (np.ptp(positions, axis=0) > 0.35 * np.ptp(requests)).all()
    late = [np.mean((positions[k:, 0] - requests[: len(requests) - k]) ** 2) for k in range(30)]
    assert 3 <= int(np.argmin(late)) <= 25


def test_a_servo_that_is_held_gives_up_as_real_ones_do():
    bus = Bus(VirtualPort(VirtualServos(1, faults=Faults(stall={1: 0.1}))), FEETECH)
    bus.write(1, "torque", 1)
    bus.write(1, "goal", 3500)
    bus.port.sleep(4.0)
    reading = bus.sync_read([1])[1]
    assert FEETECH.error_words(reading["error"]) == "overload"
    assert abs(reading["load"]) <= 200
    assert reading["temperature"] > 25


@pytest.mark.parametrize("kind", ["sts3215", "xl430", "xl-320"])
def test_a_write_to_all_servos_is_answered_by_none_and_obeyed_by_all(kind):
    made = KINDS[kind]
    servos, protocol = VirtualServos(3, made), made.protocol
    register = protocol.registers["torque"]
    address = register.address.to_bytes(protocol.address_size, "little")
    content = address + register.encode(1)
    one = servos.feed(protocol.instruction(2, WRITE, content))
    assert one == protocol.answer(2, 0, b"")
    assert servos.feed(protocol.instruction(BROADCAST, WRITE, content)) == b""
    assert servos.motors.powered.all()
