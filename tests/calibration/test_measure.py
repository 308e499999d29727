"""What calibration reads of servos before anything moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.calibration.measure import check, servo_ranges
from planner.robot.arm import Arm, Servo
from planner.robot.bus import Bus
from planner.robot.protocols import PROTOCOLS
from planner.virtual.servo_bus import VirtualPort, VirtualServos

TICK = 2.0 * math.pi / 4096


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)
def test_a_range_is_that_of_the_servos_limits_and_of_the_reach(protocol, direction):
    bus = Bus(VirtualPort(VirtualServos(2, protocol)), protocol)
    servos = {f"joint_{k}": Servo(id=k, zero_tick=1900, direction=direction) for k in (1, 2)}
    bus.write(1, "least_position", 1800)
    bus.write(1, "largest_position", 3900)
    angles = check(Arm(bus, servos)).angles
    ranges = servo_ranges(Arm(bus, servos), angles, 0.5)
    here = direction * 148 * TICK
    limited = np.array([-248 * TICK, 0.5])[::direction] * direction  # around where it is
    assert ranges["joint_1"] - here == pytest.approx(limited, abs=2.0 * TICK)
    assert ranges["joint_2"] - here == pytest.approx([-0.5, 0.5], abs=2.0 * TICK)
