"""Joints on a virtual bus: what is requested, what is read, and what stops a motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.exceptions import BusError, InvalidInput
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus, SerialPort
from planner.robot.protocols import DYNAMIXEL, FEETECH, PROTOCOLS, SYNC_READ, SYNC_WRITE
from planner.virtual.servo_bus import Faults, VirtualPort, VirtualServos

PERIOD = 0.01
TICK = 2.0 * math.pi / 4096
BOTH = pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)


def arm_of(protocol=FEETECH, count=6, *, faults=None, seed=0, **servo):
    servos = VirtualServos(count, protocol, faults=faults, seed=seed)
    bus = Bus(VirtualPort(servos), protocol)
    limits = (-1.0, 1.0)
    return Arm(
        bus, {f"joint_{k}": Servo(id=k, limits=limits, **servo) for k in range(1, count + 1)}
    )


def waves(count=6, duration=4.0):
    time = np.arange(0.0, duration, PERIOD)
    return 0.6 * np.sin(2.0 * np.pi * 0.5 * time)[:, None] * np.ones(count)


def torques(arm):
    return [arm.bus.read(servo.id, "torque") for servo in arm.servos.values()]


@BOTH
def test_a_tick_is_one_sync_write_and_one_sync_read_whatever_the_number_of_joints(
    protocol, monkeypatch
):
    arm, sent = arm_of(protocol), []
    port = arm.bus.port
    write = port.write
    monkeypatch.setattr(port, "write", lambda content: (sent.append(content), write(content)))
    begin = port.now()
    arm.send(np.zeros(6))
    measured = arm.measure()
    packets = [protocol.take(bytearray(each), answers=False) for each in sent]
    assert [packet.code for packet in packets] == [SYNC_WRITE, SYNC_READ]
    assert np.isfinite(measured.angles).all()
    assert port.now() - begin < 3e-3  # of a tick of 10 ms at 100 Hz


@BOTH
@pytest.mark.parametrize("direction", [1, -1])
def test_requests_arrive_as_angles_of_the_same_sign_about_the_zero(protocol, direction):
    arm = arm_of(protocol, 1, zero_tick=1900, direction=direction)
    with arm.powered():
        arm.perform(np.full((100, 1), 0.3), period=PERIOD)
        (angle,) = arm.angles()
    assert angle == pytest.approx(0.3, abs=0.06)  # its dead band and sag
    count = arm.bus.read(1, "position")
    assert count == pytest.approx(1900 + direction * 0.3 / TICK, abs=0.06 / TICK)


def test_no_joint_jumps_to_its_goal():
    arm = arm_of(count=1)
    with arm.powered():
        arm.send([0.8])
        begun = arm.angles()[0]
        arm.bus.port.sleep(0.1)
        assert begun < 0.01
        assert 0.05 < arm.angles()[0] < 0.7


@BOTH
def test_the_torque_is_afterwards_as_it_was_before(protocol):
    arm = arm_of(protocol, 3)
    arm.bus.write(2, "torque", 1)
    with arm.powered():
        assert torques(arm) == [1, 1, 1]
    assert torques(arm) == [0, 1, 0]


def test_five_percent_of_lost_packets_lose_rows_but_no_motion():
    arm, rows = arm_of(faults=Faults(drop=0.05)), []
    arm.bus.patience = 2e-3
    with arm.powered():
        arm.perform(
            waves(), period=PERIOD, keep=lambda time, _, angles: rows.append((time, *angles))
        )
    times, angles = np.array(rows)[:, 0], np.array(rows)[:, 1:]
    assert len(rows) > 0.97 * len(waves())
    assert (np.diff(times) > 0.0).all()
    assert 0.02 < np.mean(np.isnan(angles)) < 0.2
    assert arm.bus.lost > 100
    assert np.nanmax(np.abs(angles)) == pytest.approx(0.6, abs=0.1)


FAULTS = {
    "stall": (Faults(stall={3: 3.0}), "joint_3: does not follow"),
    "overheat": (Faults(overheat={2: 3.0}), "joint_2: the servo reports overheating"),
    "disconnect": (Faults(disconnect=3.0), "the bus is gone"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("moment", [0.0, 0.31])
def test_a_fault_stops_the_motion_and_keeps_what_was_measured(fault, moment):
    faults, message = FAULTS[fault]
    if fault == "disconnect":
        faults = replace(faults, disconnect=faults.disconnect + moment)
    arm, rows = arm_of(faults=faults), []
    with pytest.raises(BusError, match=message), arm.powered():
        arm.perform(waves(duration=60.0), period=PERIOD, keep=lambda *row: rows.append(row))
    assert 100 < len(rows) < 600
    if fault != "disconnect":
        arm.bus.port.sleep(0.5)
        assert torques(arm) == [0] * 6


def test_a_servo_that_falls_silent_is_named():
    arm = arm_of(count=2)
    arm.servos["joint_2"] = replace(arm.servos["joint_2"], id=9)
    silent = Arm(arm.bus, arm.servos)
    with pytest.raises(BusError, match="servo 9 does not answer; check its identifier"):
        silent.angles()


def test_joints_that_answer_are_stopped_and_released_where_another_fell_silent(monkeypatch):
    arm = arm_of(count=3)
    servos = arm.bus.port.servos

    def fall_silent(time, *_):
        if time > 1.0:
            monkeypatch.setattr(servos, "ids", [1, 3])

    with pytest.raises(BusError, match="joint_2: the servo has stopped answering"), arm.powered():
        arm.perform(waves(3), period=PERIOD, keep=fall_silent)
    assert [arm.bus.read(each, "torque") for each in (1, 3)] == [0, 0]


@pytest.mark.parametrize(("request_", "words"), [(1.1, r"1\.1 rad"), (math.nan, "nan rad")])
def test_a_request_beyond_the_range_is_refused_before_anything_moves(request_, words):
    arm = arm_of(count=1)
    with pytest.raises(InvalidInput, match=f"joint_1: request 1 is {words}, expected -1 to 1 rad"):
        arm.perform(np.array([[0.0], [request_]]), period=PERIOD)
    assert arm.bus.port.now() == 0.0


def test_ctrl_c_stops_the_joints_where_they_are_and_answers_what_was_played():
    arm, rows = arm_of(count=1), []

    def keep(*row):
        rows.append(row)
        if len(rows) == 40:
            raise KeyboardInterrupt

    with arm.powered():
        played = arm.perform(np.full((400, 1), 0.9), period=PERIOD, keep=keep)
    assert played.interrupted
    assert len(rows) == 40


def test_a_joint_far_beyond_its_range_is_led_into_it():
    arm = arm_of(count=1)
    low = Arm(arm.bus, {"joint_1": replace(arm.servos["joint_1"], limits=(0.5, 1.0))})
    with low.powered():
        low.perform(np.full((50, 1), 0.7), period=PERIOD)
        assert low.angles()[0] > 0.5


def test_a_joint_that_rests_beside_its_request_keeps_it_when_it_is_stopped():
    arm = arm_of(count=1)
    with arm.powered():
        arm.perform(np.full((50, 1), 0.3), period=PERIOD)
        assert abs(arm.angles()[0] - 0.3) > TICK  # its friction
    assert arm.goals()[0] == pytest.approx(0.3, abs=0.5 * TICK)


def test_an_angle_whose_answer_was_lost_is_asked_for_again(monkeypatch):
    arm = arm_of(count=2)
    arm.bus.write(1, "goal", 3000)  # without torque it stays
    angles = arm.angles()
    lost = arm.measure()._replace(angles=np.array([math.nan, angles[1]]))
    monkeypatch.setattr(arm, "measure", lambda: lost)
    assert arm.angles() == pytest.approx(angles, abs=2.0 * TICK)


def test_two_joints_cannot_share_a_servo():
    bus = arm_of(count=1).bus
    with pytest.raises(InvalidInput, match=r"identifiers \[1, 1\], expected each once"):
        Arm(bus, {"a": Servo(id=1), "b": Servo(id=1)})


def test_a_port_that_cannot_be_opened_is_one_clear_error(tmp_path):
    with pytest.raises(BusError, match=r"cannot be opened \(no such file or directory\); check"):
        SerialPort("/dev/ttyNONE")
    (tmp_path / "file").write_text("")
    with pytest.raises(BusError, match="is no serial port; expected such as /dev/ttyACM0"):
        SerialPort(str(tmp_path / "file"))
    with pytest.raises(InvalidInput, match="baud rate: got 123, expected one of 9600"):
        SerialPort("/dev/ttyNONE", 123)


def test_alerts_of_dynamixels_name_what_it_may_be():
    assert "overload" in DYNAMIXEL.error_words(0x80)
    assert DYNAMIXEL.error_words(0x04) == ""
    assert FEETECH.error_words(0x24) == "overheating and overload"
