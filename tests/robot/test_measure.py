"""What calibration reads of servos before anything moves."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from planner import BusError, Log
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus
from planner.robot.measure import angles_of, check, move, ranges_by_hand, servo_ranges, with_ranges
from planner.robot.protocols import FEETECH
from planner.virtual.servo_bus import KINDS, VirtualPort, VirtualServos

TICK = 2.0 * math.pi / 4096


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("kind", ["sts3215", "xl430"])
def test_a_range_is_that_of_the_servos_limits_and_of_the_reach(kind, direction):
    bus = Bus(VirtualPort(VirtualServos(2, KINDS[kind])), KINDS[kind].protocol)
    servos = {f"joint_{k}": Servo(id=k, zero_tick=1900, direction=direction) for k in (1, 2)}
    bus.write(1, "least_position", 1800)
    bus.write(1, "largest_position", 3900)
    angles = check(Arm(bus, servos)).angles
    assert bus.read(2, "least_position") == 0
    bus.write(2, "largest_position", 0)  # no limits are set
    ranges = servo_ranges(Arm(bus, servos), angles, 0.5)
    here = direction * 148 * TICK
    limited = np.array([-248 * TICK, 0.5])[::direction] * direction  # around where it is
    assert ranges["joint_1"] - here == pytest.approx(limited, abs=2.0 * TICK)
    assert ranges["joint_2"] - here == pytest.approx([-0.5, 0.5], abs=2.0 * TICK)


def test_a_range_by_hand_is_from_the_least_to_the_largest_angle_that_was_shown():
    shown = iter([[0.2, 0.0], [-0.4, np.nan], [0.1, 0.2]])
    arm = SimpleNamespace(
        names=("hip", "knee"),
        angles=lambda: np.array([0.25, 0.1]),
        measure=lambda: SimpleNamespace(angles=np.array(next(shown))),
        bus=SimpleNamespace(port=SimpleNamespace(sleep=lambda _: None)),
    )
    ends = iter([False, False, False, True])
    found = ranges_by_hand(arm, lambda: next(ends), 0.02)
    assert {name: each.tolist() for name, each in found.items()} == {
        "hip": [-0.4, 0.25],  # where it was at first
        "knee": [0.0, 0.2],
    }


def test_the_limits_of_a_joint_are_its_range_less_a_margin():
    arm = Arm(Bus(VirtualPort(VirtualServos(1)), FEETECH), {"joint": Servo(id=1)})
    ends = np.radians([-20.0, -9.0])
    limits = with_ranges(arm, {"joint": ends}).servos["joint"].limits
    assert np.degrees(limits) == pytest.approx([-20.0 + 0.55, -9.0 - 0.55], abs=1e-4)


def test_a_servo_that_reports_a_fault_is_named_before_anything_moves():
    servos = VirtualServos(2)
    servos.motors.temperatures[1] = 90.0
    arm = Arm(Bus(VirtualPort(servos), FEETECH), {f"joint_{k}": Servo(id=k) for k in (1, 2)})
    with pytest.raises(BusError, match=r"joint_2: the servo reports .*; switch it off"):
        check(arm)


def test_a_row_that_was_not_measured_is_no_angle_nor_is_one_that_came_too_late():
    rows = np.array([0, 1, 3, 4, 6])
    log = Log(
        times=5.0 + 0.02 * rows + 0.004,
        requests=np.zeros(5),
        angles=0.1 * rows,
        measured=np.array([True, True, False, True, True]),
    )
    np.testing.assert_allclose(angles_of(log, 6, 0.02), [0.0, 0.1, np.nan, np.nan, 0.4, np.nan])


@pytest.mark.parametrize("limits", [(0.05, 1.0), (-1.0, -0.05)])
def test_joints_that_rest_beyond_their_range_stay_at_its_end(limits, tmp_path):
    bus = Bus(VirtualPort(VirtualServos(2)), FEETECH)
    other = Servo(id=2, zero_tick=2048, limits=limits)
    arm = Arm(bus, {"moved": Servo(id=1, zero_tick=2048), "other": other})
    with arm.powered():
        move(arm, "moved", np.full(50, 0.1), period=0.02, log=tmp_path / "log.csv")
        _, angle = arm.angles()
    assert angle == pytest.approx(min(limits, key=abs), abs=0.02)
