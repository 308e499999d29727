"""Questions and answers on a bus: retries, answers of others, counts of lost ones, and ports."""

import errno
import os
import select
import sys
from types import ModuleType, SimpleNamespace

import pytest
import serial

from planner.cli.servos import ids_by_joint
from planner.exceptions import BusError, InvalidInput
from planner.robot.bus import ATTEMPTS, Bus, SerialPort, lerobot_bus, robot_of
from planner.robot.protocols import DYNAMIXEL, FEETECH
from planner.virtual.servo_bus import KINDS, VirtualServos, terminal

POSITION = FEETECH.answer(1, 0, b"\x10\x08")


class ScriptedPort:
    """A port that hands over one content after each write, on a clock that waiting advances."""

    baud_rate = 1_000_000

    def __init__(self, *contents):
        self.contents, self.waiting, self.time, self.written = list(contents), b"", 0.0, []

    def write(self, content):
        self.written.append(content)
        self.waiting = self.contents.pop(0) if self.contents else b""

    def read(self, count, timeout):
        received, self.waiting = self.waiting[:count], self.waiting[count:]
        self.time += timeout if len(received) < count else 0.0
        return received

    def now(self):
        return self.time


def bus_of(*contents, protocol=FEETECH):
    return Bus(ScriptedPort(*contents), protocol)


def test_a_question_is_asked_four_times_and_every_loss_is_counted():
    bus = bus_of(*[b""] * (ATTEMPTS - 1), POSITION)
    assert bus.read(1, "position") == 0x0810
    assert (bus.asked, bus.lost, len(bus.port.written)) == (4, 3, 4)
    bus = bus_of(*[b""] * ATTEMPTS, POSITION)
    with pytest.raises(BusError, match="servo 1 does not answer; check its identifier, the baud"):
        bus.read(1, "position")
    assert (bus.asked, bus.lost, len(bus.port.written)) == (4, 4, 4)
    # Each time its patience, and the time of the packets on the wire.
    wire = 10.0 * (len(bus.port.written[0]) + len(POSITION)) / bus.port.baud_rate
    assert bus.port.time == pytest.approx(4 * (0.05 + wire))


@pytest.mark.parametrize(
    "wrong",
    [
        FEETECH.answer(2, 0, b"\x11\x09"),  # of another servo
        FEETECH.answer(1, 0, b"\x11"),  # too short
        FEETECH.answer(1, 0, b"\x11\x09\x00"),  # too long
    ],
)
def test_an_answer_of_another_servo_or_length_is_a_lost_one(wrong):
    bus = bus_of(wrong, POSITION)
    assert bus.read(1, "position") == 0x0810
    assert (bus.asked, bus.lost) == (2, 1)
    bus = bus_of(POSITION + wrong)
    assert bus.sync_read([1, 3], ["position"]) == {1: {"position": 0x0810, "error": 0}}
    assert (bus.asked, bus.lost) == (2, 1)


def test_answers_to_all_are_told_apart_by_servo_and_register():
    first, size = FEETECH.block(FEETECH.feedback)
    places = {name: FEETECH.registers[name] for name in FEETECH.feedback}
    wanted = {
        3: {"error": 0x24, "position": -7, "speed": 300, "load": -900, "temperature": 41},
        1: {"error": 0, "position": 2100, "speed": -300, "load": 12, "temperature": 25},
    }
    content = b""
    for servo, values in wanted.items():
        memory = bytearray(size)
        for name, place in places.items():
            at = place.address - first
            memory[at : at + place.size] = place.encode(values[name])
        content += FEETECH.answer(servo, values["error"], bytes(memory))
    bus = bus_of(content)
    assert bus.sync_read([1, 2, 3]) == wanted
    assert (bus.asked, bus.lost) == (3, 1)
    asked = FEETECH.instruction(0xFE, 0x82, bytes([56, 8, 1, 2, 3]))
    assert bus.port.written == [asked]


def test_a_refusal_is_named_though_the_servo_answers_and_a_later_answer_counts():
    refused, done = DYNAMIXEL.answer(1, 0x04), DYNAMIXEL.answer(1, 0)
    bus_of(refused, done, protocol=DYNAMIXEL).write(1, "torque", 1)
    with pytest.raises(BusError, match="servo 1 reports a value beyond its range; check its model"):
        bus_of(*[refused] * ATTEMPTS, protocol=DYNAMIXEL).write(1, "torque", 1)


def test_a_write_forgets_what_was_received_before_it():
    with terminal() as (end, path):
        port = SerialPort(path)
        os.write(end, b"old")
        assert port.read(1, 1.0) == b"o"
        port.write(b"\x11\x13\x03\n")  # as it is: no flow control, no signals
        received = b""
        while len(received) < 4 and select.select([end], [], [], 10.0)[0]:  # in parts
            received += os.read(end, 9)
        assert received == b"\x11\x13\x03\n"
        os.write(end, b"new")
        assert port.read(3, 60.0) == b"new"
        assert port.read(1, 0.0) == b""
        port.close()
        with pytest.raises(BusError, match="the bus is gone"):
            port.read(1, 0.0)


def test_a_port_whose_other_end_is_gone_or_full_is_named(monkeypatch):
    with terminal() as (end, path):
        port = SerialPort(path)
        os.close(end)
        for use in (lambda: port.read(1, 1.0), lambda: port.write(b"a")):
            with pytest.raises(BusError, match=f"^{path}: the bus is gone; check the cable"):
                use()
        port.close()
    monkeypatch.setattr("planner.robot.bus.FULL", 0.01)
    with terminal() as (_, path), pytest.raises(BusError, match="takes no more bytes"):
        SerialPort(path).write(bytes(2**20))


class Serial:
    """A port of pyserial before virtual servos."""

    port, baudrate, timeout = "/dev/ttyA", 57_600, None

    def __init__(self, servos):
        self.servos, self.waiting, self.broken = servos, b"", False

    def reset_input_buffer(self):
        if self.broken:
            raise OSError("unplugged")
        self.waiting = b""

    def write(self, content):
        self.waiting += self.servos.feed(content)

    def read(self, count):
        if self.broken:
            raise OSError("unplugged")
        received, self.waiting = self.waiting[:count], self.waiting[count:]
        return received


@pytest.fixture
def robots(monkeypatch):
    """LeRobot's registry with one robot, so101_follower, and the robots that were made of it."""
    made = []

    class Robot:
        def __init__(self, config):
            made.append(self)
            self.config, self.calls = config, []
            serial = Serial(VirtualServos(2, KINDS["sts3215"], step=0.02))
            bus = type(config.bus, (), {})()
            bus.port_handler = SimpleNamespace(ser=serial)
            bus.motors = {"pan": SimpleNamespace(id=1), "gripper": SimpleNamespace(id=6)}
            self.bus = bus

        def connect(self, **options):
            self.calls.append(("connect", options))
            if self.config.port == "none":
                raise ConnectionError("no such port\nmore")

        def disconnect(self):
            self.calls.append("disconnect")
            raise RuntimeError("it was not connected")

    def config(bus):
        return lambda port: SimpleNamespace(port=port, bus=bus)

    known = {
        "so101_follower": config("FeetechMotorsBus"),
        "so101": config("OtherBus"),
        "koch": config("DynamixelMotorsBus"),
        "reachy": config("OtherBus"),
    }
    modules = {
        "lerobot": {},
        "lerobot.robots": {},
        "lerobot.robots.config": {"RobotConfig": SimpleNamespace(get_known_choices=lambda: known)},
        "lerobot.robots.utils": {"make_robot_from_config": Robot},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return made


def test_a_port_of_another_group_is_refused_with_the_group_to_join(monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open port")

    monkeypatch.setattr("serial.Serial.open", refuse)
    with pytest.raises(InvalidInput, match=r"^/dev/ttyA: .* \(permission denied\); join its group"):
        SerialPort("/dev/ttyA", 57_600)


def test_the_bus_of_a_lerobot_robot_is_connected_in_the_block(robots):
    with lerobot_bus("so101", "/dev/ttyA") as bus:
        (robot,) = robots
        assert robot.config.port == "/dev/ttyA"
        assert robot.calls == [("connect", {"calibrate": False})]
        assert (bus.protocol, bus.port.baud_rate) == (FEETECH, 57_600)
        serial = robot.bus.port_handler.ser
        serial.waiting = b"old"
        assert bus.read(2, "p_gain") == 16
        assert 0.0 < serial.timeout <= bus.patience + 0.01
        serial.broken = True
        for use in (lambda: bus.port.read(1, 1.0), lambda: bus.port.write(b"a")):
            with pytest.raises(BusError, match=r"^/dev/ttyA: the bus is gone; check the cable"):
                use()
    assert robot.calls[1:] == ["disconnect"]
    ids = {"joint_1": 1, "mine": 6, "joint_7": 7}
    named = ids_by_joint({"bus": "lerobot:so101"}, ids)
    assert named == {"pan": 1, "mine": 6, "joint_7": 7}
    with lerobot_bus("koch", "/dev/ttyA") as bus:
        assert bus.protocol is DYNAMIXEL


def test_a_lerobot_robot_that_cannot_be_used_is_named(robots, monkeypatch):
    with pytest.raises(InvalidInput, match=r"got lerobot:so9, .* koch, reachy, so101, so101$"):
        robot_of("so9", "")
    words = "lerobot:reachy: got another bus of servos, expected Feetech"
    with pytest.raises(InvalidInput, match=words):
        robot_of("reachy", "")
    with (
        pytest.raises(BusError, match=r"^none: LeRobot cannot connect: no such port$"),
        lerobot_bus("so101", "none"),
    ):
        pass
    assert robots[-1].calls == [("connect", {"calibrate": False})]
    monkeypatch.setitem(sys.modules, "lerobot.robots.config", None)
    with pytest.raises(InvalidInput, match=r"--bus lerobot:so101 needs LeRobot, .*\[feetech\]"):
        robot_of("so101", "")
