"""BAM's JSON: one entry a sample, in radians, with the torque's switch."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from planner import InvalidFile, LogOptions, joints_in, read_logs

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
        "time from 'timestamp', requested from 'goal_position', actual from 'position', torque "
        "from 'torque_enable'",
        "angles in rad, as BAM defines them",
    )
    assert joints_in(log.name) == ("",)


@pytest.mark.parametrize("nothing", [math.nan, None])
def test_a_servo_that_is_off_needs_no_goal(tmp_path, nothing):
    entries = _entries(entry_2={"goal_position": nothing})
    (log,) = read_logs(_file(tmp_path, {"entries": entries}))
    assert np.isfinite(log.requests).all()
    assert not log.torque_on[2]


def test_a_file_without_the_torque_has_it_on(tmp_path):
    entries = [
        {key: entry[key] for key in ("timestamp", "goal_position", "position")}
        for entry in _entries()
    ]
    (log,) = read_logs(_file(tmp_path, {"entries": entries}))
    assert log.torque_on.all()


BAD = {
    "empty": ("", ", line 1: not JSON (Expecting value); is the file cut short?"),
    "cut short": (
        '{"entries": [\n{"position": 0.0,',
        ", line 2: not JSON (Expecting property name enclosed in double quotes); is the file cut "
        "short?",
    ),
    "another format": (
        {"times": [0, 1], "angles": []},
        ": got the keys 'times', 'angles', expected BAM's object with a list 'entries'; give "
        "another format as CSV",
    ),
    "a list": (
        [1, 2],
        ": got no entries, expected BAM's object with a list 'entries'; give another format as CSV",
    ),
    "no entry": ({"entries": []}, ": rows of samples: got 0, expected at least 3"),
    "an entry that is a number": (
        {"entries": [{"position": 0}, 3]},
        ": entry 2: got int, expected an object with keys",
    ),
    "another key": (
        {"entries": [{"timestamp": 0, "goal_pos": 0, "position": 0}]},
        ": entry 1: no 'goal_position' (did you mean 'position'?); keys: timestamp, goal_pos, "
        "position",
    ),
    "text for a number": (
        {"entries": _entries(entry_1={"position": "0.1"})},
        ": entry 2: 'position': got str, expected a number",
    ),
    "NaN while the torque is on": (
        {"entries": _entries(entry_1={"goal_position": math.nan})},
        ": entry 2: requested angle: got nan, expected a finite number; remove or interpolate the "
        "sample",
    ),
    "an infinite angle": (
        {"entries": _entries(entry_2={"position": math.inf})},
        ": entry 3: actual angle: got inf, expected a finite number; remove or interpolate the "
        "sample",
    ),
    "a number of 400 digits": (
        {"entries": _entries(entry_2={"position": 10**400})},
        ": entry 3: actual angle: got inf, expected a finite number; remove or interpolate the "
        "sample",
    ),
    "a number of 5000 digits": (
        '{"entries": [' + "9" * 5000 + "]}",
        ": not JSON of a log: a number is too long",
    ),
    "nested without end": ("[" * 100_000, ": not JSON of a log: nested too deeply"),
    "torque in words": (
        {"entries": _entries(entry_0={"torque_enable": "on"})},
        ": entry 1: 'torque_enable': got 'on', expected true or false",
    ),
    "unsorted": (
        {"entries": _entries(entry_2={"timestamp": 0.02})},
        ": entry 3: time is 0.02 s after 0.03 s, expected times that increase; sort the rows and "
        "remove doubles",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_read_is_told_with_its_place(tmp_path, case):
    content, message = BAD[case]
    file = _file(tmp_path, content)
    with pytest.raises(InvalidFile) as caught:
        read_logs(file)
    assert str(caught.value) == f"{file}{message}"


def test_bam_is_in_radians_whatever_the_option_says(tmp_path):
    file = _file(tmp_path, {"entries": _entries()})
    assert len(read_logs(file, options=LogOptions(unit="rad"))) == 1
    with pytest.raises(InvalidFile) as caught:
        read_logs(file, options=LogOptions(unit="deg"))
    assert str(caught.value) == (
        f"{file}: angles of BAM are in rad by definition, but --unit says deg; leave the option out"
    )
