"""BAM's JSON: one entry a sample, in radians, with the torque's switch."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from planner import joints_in, read_logs

SAMPLES = [(0.01, 0.0, 0.1), (0.03, 0.5, 0.2), (0.06, 1.0, 0.3), (0.08, 1.5, 0.4)]
"""Time [s], goal and position [rad] of every entry."""


def _entries(**changes):
    return [
        {
            "position": position,
            "speed": math.nan,
            "load": 0,
            "timestamp": time,
            "goal_position": goal,
            "torque_enable": k != 2,
            **changes.get(f"entry_{k}", {}),
        }
        for k, (time, goal, position) in enumerate(SAMPLES)
    ]


def _file(tmp_path, content):
    file = tmp_path / "run.json"
    text = content if isinstance(content, str) else json.dumps(content)
    file.write_text(text)
    return file


def test_entries_are_rows(tmp_path):
    (log,) = read_logs(_file(tmp_path, {"motor": "sts3250", "entries": _entries()}))
    times, goals, positions = zip(*SAMPLES, strict=True)
    np.testing.assert_array_equal(log.times, times)
    np.testing.assert_array_equal(log.requests, goals)
    np.testing.assert_array_equal(log.angles, positions)
    np.testing.assert_array_equal(log.torque_on, [True, True, False, True])
    assert log.notes == (
        "time from column 'timestamp' [s], requested from 'goal_position', actual from "
        "'position', torque from 'torque_enable'",
        "angles in rad, as BAM defines them",
    )
    assert joints_in(log.name) == ("",)


BAD = {
    "empty": "",
    "cut short": '{"entries": [\n{"position": 0.0,',
    "another format": {"times": [0, 1], "angles": []},
    "a list": [1, 2],
    "no entry": {"entries": []},
    "an entry that is a number": {"entries": [{"position": 0}, 3]},
    "another key": {"entries": [{"timestamp": 0, "goal_pos": 0, "position": 0}]},
    "a switch for a number": {"entries": _entries(entry_3={"position": True})},
    "text for a number": {"entries": _entries(entry_1={"position": "0.1"})},
    "an infinite angle": {"entries": _entries(entry_2={"position": math.inf})},
    "a number of 400 digits": {"entries": _entries(entry_2={"position": 10**400})},
    "a number of 5000 digits": '{"entries": [' + "9" * 5000 + "]}",
    "nested without end": "[" * 100_000,
    "torque in words": {"entries": _entries(entry_0={"torque_enable": "on"})},
    "unsorted": {"entries": _entries(entry_2={"timestamp": 0.02})},
    **{
        f"a mass of {mass}": {"mass": mass, "length": 0.1, "entries": _entries()}
        for mass in ("a pendulum", True, -1.0, math.nan, 1e300)
    },
}


def test_what_cannot_be_read_is_reported_with_its_place(tmp_path, snapshot):
    file = tmp_path / "run.json"
    snapshot.refusals("bam", lambda each: read_logs(_file(tmp_path, each)), BAD, FILE=file)


@pytest.mark.parametrize("goal", [None, math.nan])
@pytest.mark.parametrize("off", [False, 0, 0.0])
def test_a_servo_that_is_off_needs_no_goal(tmp_path, off, goal):
    entries = _entries(entry_2={"goal_position": goal, "torque_enable": off})
    (log,) = read_logs(_file(tmp_path, {"entries": entries}))
    np.testing.assert_array_equal(log.requests, [0.0, 0.5, 0.3, 1.5])


def test_the_weight_of_the_pendulum_is_the_load(tmp_path):
    positions = np.array([position for _, _, position in SAMPLES])
    pendulum = {"mass": 1.2, "length": 0.15, "entries": _entries()}
    (log,) = read_logs(_file(tmp_path, pendulum))
    expected = -1.2 * 9.80665 * 0.15 * np.sin(positions)
    np.testing.assert_allclose(log.load, expected, rtol=1e-12)
    assert "load of a pendulum, 1.77 N m where it is level" in log.notes
    (log,) = read_logs(_file(tmp_path, {**pendulum, "arm_mass": 0.2}))
    np.testing.assert_allclose(log.load, expected * 1.3 / 1.2, rtol=1e-12)
    (log,) = read_logs(_file(tmp_path, {"mass": 1.2, "entries": _entries()}))
    assert log.load is None
