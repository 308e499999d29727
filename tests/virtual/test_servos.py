"""Every kind of virtual servo and every constant of the virtual robot, held by snapshots.

Where a number is meant to change, the diff of its snapshot shows which, and what moves otherwise.
"""

import math
from dataclasses import asdict

import numpy as np
import pytest
from benchmark.pendulum import STS3215, Pendulum

from planner.robot.bus import Bus
from planner.robot.protocols import LOAD_UNIT, PROTOCOLS
from planner.virtual.robot import CONSTANTS
from planner.virtual.servo_bus import KINDS, Faults, VirtualPort, VirtualServos

MOTION = {
    "step": {},
    "profile": {"profile_speed": 200, "profile_acceleration": 10},
    "speed_only": {"profile_speed": 300},
    "soft": {"p_gain": 6, "i_gain": 100, "d_gain": 0},
}

FAULTS = {
    "stall": Faults(stall={2: 0.2}),
    "sag": Faults(saturate={1: 0.2}),
    "hot": Faults(overheat={3: 0.2}),
    "off": Faults(power_off=0.5),
}


def test_control_tables_and_what_errors_are_called(snapshot):
    lines = []
    for protocol in PROTOCOLS.values():
        content = asdict(protocol)
        lines += [f"{key} {content.pop(key)}" for key in ("name", "feedback")]
        for name in ("registers", "errors", "refusals"):
            lines += [f"{name} {key}: {value}" for key, value in content.pop(name).items()]
        lines += [f"{key} {value}" for key, value in content.items()]
    snapshot.check("protocols", "\n".join(lines) + "\n")


def test_constants_with_their_units_and_sources(snapshot):
    lines = [
        f"{name} {entry['value']} {entry['unit']}: {entry['source']}"
        for name, entry in CONSTANTS.to_dict().items()
    ]
    lines += [
        f"{name} {getattr(each, name):.9g}"
        for each in (CONSTANTS, STS3215)
        for name in ("sensor_error", "armature", "stall_torque", "top_speed")
    ]
    snapshot.check("constants", "\n".join([*lines, repr(Pendulum())]) + "\n")


def moved(kind, registers, faults):
    """A line for each of three servos with each quantity at ten moments of a motion.

    They step by 50 degrees and, after 0.4 s, back and off; at 0.9 s the torque of one goes off.
    """
    servos = VirtualServos(3, kind, faults=faults)
    bus, protocol = Bus(VirtualPort(servos), kind.protocol), kind.protocol
    degree = protocol.ticks_per_turn / 360.0
    found = {}
    for servo in (1, 2, 3):
        for name, value in {**registers, "torque": 1}.items():
            if name in protocol.registers:
                bus.write(servo, name, value)
    for time in (0.0, 0.03, 0.1, 0.2, 0.4, 0.55, 0.7, 0.9, 1.0, 1.1):
        bus.port.sleep(time - bus.port.now())
        if time in (0.0, 0.4):
            goal = protocol.middle + round((50.0 if time == 0.0 else -10.0) * degree)
            bus.sync_write("goal", dict.fromkeys((1, 2, 3), goal))
        if time == 0.9:
            bus.sync_write("torque", {2: 0})
        for servo, values in bus.sync_read([1, 2, 3]).items():
            speed = math.degrees(values["speed"] * protocol.speed_unit)
            for name, text in {
                "deg": f"{(values['position'] - protocol.middle) / degree:.1f}",
                "deg/s": f"{speed:.1f}",
                "load": f"{values['load'] * LOAD_UNIT:.2f}",
                "C": f"{servos.motors.temperatures[servo - 1]:.1f}",
                "error": f"{values['error']}",
            }.items():
                found.setdefault(servo, {}).setdefault(name, []).append(text)
    return [
        f"{servo}: "
        + "; ".join(f"{key} {' '.join(each)}" for key, each in told.items() if {*each} != {"0"})
        for servo, told in found.items()
    ]


def test_every_kind_moves_as_it_did(snapshot):
    lines = []
    for name, kind in KINDS.items():
        lines.append(f"{name} {dict(kind.registers)}")
        for motion, registers in MOTION.items():
            lines += [f"{name} {motion} {row}" for row in moved(kind, registers, Faults())]
    snapshot.check("kinds", "\n".join(lines) + "\n")


def test_faults_spoil_the_motion_of_their_servo_and_no_other(snapshot):
    kind = KINDS["sts3215"]
    lines = [f"{name} {row}" for name, each in FAULTS.items() for row in moved(kind, {}, each)]
    snapshot.check("faults", "\n".join(lines) + "\n")


@pytest.mark.parametrize("joint", ["leg", "pendulum"])
def test_the_robot_moves_as_it_did(joint, snapshot):
    pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
    from planner.virtual.robot import VirtualRobot

    if joint == "leg":
        robot, goal = VirtualRobot(seed=2), np.array([0.6, 0.5, 1.0])
    else:
        servo = STS3215
        model = Pendulum().model(servo)
        robot = VirtualRobot((0.2,), constants=servo, model=model, seed=2)
        goal = np.array([1.2])
    rows = np.vstack([np.tile(goal, (40, 1)), np.tile(-0.2 * goal, (40, 1))])
    found = robot.play(rows)
    assert not any(each.flags.writeable for each in found)
    period = robot.constants.request_period
    lines = [
        f"{k * period:.3f} s: {np.round(np.degrees(found.sensed[k]), 1).tolist()} of "
        f"{np.round(np.degrees(found.angles[k]), 1).tolist()}"
        for k in range(0, 80, 6)
    ]
    low, high = (np.round(np.degrees(each), 3).tolist() for each in robot.limits)
    snapshot.check(f"robot-{joint}", "\n".join([*lines, f"limits {low} {high}"]) + "\n")
