"""Joints on a virtual bus: what is requested, what is read, and what stops a motion."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.exceptions import BusError, InvalidInput
from planner.robot.arm import Arm, Measured, Servo, _Guard
from planner.robot.bus import Bus, SerialPort
from planner.robot.protocols import SYNC_READ, SYNC_WRITE
from planner.virtual.servo_bus import KINDS, Faults, VirtualPort, VirtualServos

TICK = 2.0 * math.pi / 4096  # a count [rad]
PERIOD = 0.01
EVERY = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
DEGREE = math.radians(1.0)


def arm_of(kind=KINDS["sts3215"], count=6, *, faults=None, seed=0, **servo):
    protocol = kind.protocol
    bus = Bus(VirtualPort(VirtualServos(count, kind, faults=faults, seed=seed)), protocol)
    known = {"zero_tick": protocol.middle, "ticks_per_turn": protocol.ticks_per_turn}
    known |= {"limits": (-1.0, 1.0), **servo}
    return Arm(bus, {f"joint_{k}": Servo(id=k, **known) for k in range(1, count + 1)})


def waves(count=6, duration=4.0):
    time = np.arange(0.0, duration, PERIOD)
    return 0.6 * np.sin(2.0 * np.pi * 0.5 * time)[:, None] * np.ones(count)


def torques(arm):
    return [arm.bus.read(servo.id, "torque") for servo in arm.servos.values()]


@EVERY
def test_a_tick_is_one_sync_write_and_one_sync_read_whatever_the_number_of_joints(
    kind, monkeypatch
):
    arm, sent = arm_of(kind), []
    port = arm.bus.port
    write = port.write
    monkeypatch.setattr(port, "write", lambda content: (sent.append(content), write(content)))
    begin = port.now()
    arm.send(np.zeros(6))
    measured = arm.measure()
    packets = [kind.protocol.take(bytearray(each), answers=False) for each in sent]
    assert [packet.code for packet in packets] == [SYNC_WRITE, SYNC_READ]
    assert np.isfinite(measured.angles).all()
    assert port.now() - begin < 3e-3  # of a tick of 10 ms at 100 Hz


@EVERY
@pytest.mark.parametrize("direction", [1, -1])
def test_requests_arrive_as_angles_of_the_same_sign_about_the_zero(kind, direction):
    zero = kind.protocol.middle - 48
    arm = arm_of(kind, 1, zero_tick=zero, direction=direction)
    with arm.powered():
        arm.perform(np.full((100, 1), 0.3), period=PERIOD)
        (angle,) = arm.angles()
    assert angle == pytest.approx(0.3, abs=0.06)  # its dead band and sag
    count = arm.bus.read(1, "position")
    tick = 2.0 * math.pi / kind.protocol.ticks_per_turn
    assert count == pytest.approx(zero + direction * 0.3 / tick, abs=0.06 / tick)


@EVERY
def test_the_torque_is_afterwards_as_it_was_before(kind):
    arm = arm_of(kind, 3)
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


def test_a_step_after_a_rest_is_not_taken_for_a_stuck_joint():
    arm = arm_of(count=1)
    path = np.repeat([0.4, -0.4, 0.4], 150)[:, None]
    with arm.powered():
        assert not arm.perform(path, period=PERIOD).interrupted


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


def test_two_joints_cannot_share_a_servo():
    bus = arm_of(count=1).bus
    with pytest.raises(InvalidInput, match=r"identifiers \[1, 1\], expected each once"):
        Arm(bus, {"a": Servo(id=1), "b": Servo(id=1)})


def test_what_is_no_port_is_one_clear_error_and_not_left_open(tmp_path):
    (tmp_path / "file").write_text("")
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(InvalidInput, match="is no serial port; expected such as /dev/ttyACM0"):
        SerialPort(str(tmp_path / "file"))
    assert len(list(Path("/proc/self/fd").iterdir())) == before


@pytest.mark.parametrize("kind", ["sts3215", "xl430"])
@pytest.mark.parametrize("whole", [True, False])
def test_what_an_adapter_hands_back_is_not_taken_for_an_answer(kind, whole, monkeypatch):
    arm = arm_of(KINDS[kind], 2)
    servos, port = arm.bus.port.servos, arm.bus.port
    feed, read = servos.feed, port.read
    monkeypatch.setattr(servos, "feed", lambda content: content + feed(content))
    if not whole:  # a driver that hands over three bytes at a time
        monkeypatch.setattr(port, "read", lambda count, _: read(min(3, count), 0.0))
    arm.bus.write(1, "goal", 2100)
    assert arm.bus.read(1, "goal") == 2100
    arm.bus.sync_write("goal", {1: 2000, 2: 2001})
    assert [each["goal"] for each in arm.bus.sync_read([1, 2], ["goal"]).values()] == [
        2000,
        2001,
    ]
    assert arm.bus.lost == 0


def guarded(limits=(-1.0, 1.0), start=(0.0, 0.0)):
    """Whether a tick of two joints passes: given a time [s], requests, angles [rad] and errors."""
    arm = arm_of(count=2, limits=limits)
    guard = _Guard(arm, np.array(start))

    def tick(time, requests, angles, errors=(0, 0)):
        measured = Measured(time, np.array(angles, dtype=float), errors)
        guard.check(np.array(requests, dtype=float), measured)

    return tick


def stops(tick, *arguments):
    """The message with which a tick ends the motion; nothing where it goes on."""
    try:
        tick(*arguments)
    except BusError as error:
        return str(error)
    return ""


def test_a_joint_is_stopped_15_degrees_beyond_its_range_or_where_it_began():
    for start, low, high in ((0.0, -1.0, 1.0), (1.2, -1.0, 1.2), (-1.3, -1.3, 1.0)):
        for end, sign in ((low, -1.0), (high, 1.0)):
            for degrees, far in ((14.9, False), (15.1, True)):
                angle = end + sign * degrees * DEGREE
                told = stops(guarded(start=(0.0, start)), 0.01, (0.0, start), (0.0, angle))
                words = (
                    f"joint_2: at {angle:g} rad, far beyond its range; stopped: is its direction"
                )
                assert told.startswith(words) if far else told == ""


def test_a_joint_is_gone_after_half_a_second_of_silence_and_only_that_one():
    tick = guarded()
    tick(0.1, (0.0, 0.0), (0.0, 0.0))
    tick(0.6, (0.0, 0.0), (0.0, math.nan))
    told = stops(tick, 0.601, (0.0, 0.0), (0.0, math.nan))
    assert told == "joint_2: the servo has stopped answering; check cable and supply"


def test_a_joint_follows_that_is_near_its_request_or_moves_by_a_degree_in_the_time():
    def stuck(error, step, time=0.71):
        """By their errors and how far they come [deg]."""
        tick = guarded(limits=(-3.0, 3.0))
        requests = np.array([0.0, error * DEGREE])
        tick(0.0, np.zeros(2), np.zeros(2))
        tick(0.001, 3.0 * requests, (0.0, 0.0))  # from here on they are to move
        tick(0.3, requests, (0.0, step * DEGREE))
        moved = np.array([0.0, step * DEGREE])
        return stops(tick, time, requests + moved, moved)

    told = stuck(12.1, 0.0)
    assert told == (
        f"joint_2: does not follow: at 0 rad, requested {12.1 * DEGREE:.6g} rad; stopped: what "
        "holds it?"
    )
    assert stuck(12.1, 0.0, time=0.69) == ""
    assert stuck(12.1, 0.9) != ""
    assert stuck(12.1, 1.1) == ""
    assert stuck(-12.1, 1.1) == ""
    for error, held in ((11.9, False), (12.1, True)):  # requests that stay
        tick = guarded(limits=(-3.0, 3.0))
        told = [stops(tick, time, (0.0, error * DEGREE), (0.0, 0.0)) for time in (0.0, 0.3, 0.71)]
        assert bool(told[-1]) == held


def test_a_fault_is_that_of_its_servo_though_another_is_silent(monkeypatch):
    told = stops(guarded(), 0.01, (0.0, 0.0), (0.0, 0.0), (0, 0x24))
    assert told == "joint_2: the servo reports overheating and overload; stopped"
    arm = arm_of(count=3)
    servos = arm.bus.port.servos
    servos.motors.temperatures[2] = 90.0
    monkeypatch.setattr(servos, "ids", [1, 3])
    measured = arm.measure()
    assert measured.errors == (0, 0, 0x04)
    assert np.isnan(measured.angles).tolist() == [False, True, False]
    assert np.isnan(arm.goals()).tolist() == [False, True, False]


def test_each_joint_that_is_stopped_keeps_its_request_or_takes_its_own_angle():
    arm = arm_of(count=2)
    arm.bus.write(1, "torque", 1)
    arm.send([0.1, 0.8])
    arm.bus.port.sleep(1.0)  # the second has no torque
    arm.hold()
    assert arm.goals() == pytest.approx([0.1, 0.0], abs=TICK)


def test_joints_are_led_at_half_a_radian_per_second_and_time_begins_after_that():
    arm, rows = arm_of(count=2), []
    with arm.powered():
        begin = arm.bus.port.now()
        arm.perform(
            np.tile([0.5, -0.2], (3, 1)),
            period=PERIOD,
            cycles=2,
            keep=lambda *row: rows.append((arm.bus.port.now(), *row)),
        )
    assert rows[0][0] - begin == pytest.approx(0.5 / 0.5 + 0.5, abs=3.0 * PERIOD)
    assert [row[1] for row in rows] == pytest.approx(PERIOD * np.arange(6), abs=1e-3)
    assert all(row[2].tolist() == [0.5, -0.2] for row in rows)
