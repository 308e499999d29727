"""CSV logs: what the columns are is guessed and said; their units are said or asked for."""

from __future__ import annotations

import io
import math
import re
import sys

import numpy as np
import pytest

import planner
from planner import InvalidFile, LogOptions, joints_in, read_logs

EXACT = 1e-12
"""Angles and times come through unchanged but for one product of float64 [rad, s]."""

REQUESTED = np.array([0.0, 10.0, 20.0, 20.0])
ACTUAL = np.array([0.0, 2.0, 9.0, 17.0])
TIMES = np.array([0.0, 0.01, 0.02, 0.04])


def _csv(tmp_path, header, *, times=TIMES, requested=REQUESTED, actual=ACTUAL, more="", cut=","):
    rows = [cut.join(map(str, row)) + more for row in zip(times, requested, actual, strict=True)]
    file = tmp_path / "run.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def _read(file, **options):
    (log,) = read_logs(file, options=LogOptions(**options))
    return log


NAMES = {
    "canonical": "t_s,requested_deg,actual_deg",
    "short": "t_s,req_deg,act_deg",
    "goal and present": "time_s,goal_position_deg,present_position_deg",
    "command and position": "time_s,command_deg,position_deg",
    "target and measured": "timestamp_s,target_deg,measured_deg",
    "desired and actual": "stamp_s,desired_angle_deg,actual_angle_deg",
    "setpoint and feedback": "t_s,set_point_deg,feedback_deg",
    "words run together": "t_s,goalPosition_deg,presentPosition_deg",
    "capitals": "Time_S,Requested_Deg,Actual_Deg",
    "units in brackets": "time [s],goal position [deg],current position [deg]",
    "units in round brackets": "time (s),cmd (deg),pos (deg)",
    "units spelt out": "time_sec,requested_degrees,actual_degrees",
}


@pytest.mark.parametrize("names", NAMES)
def test_columns_are_guessed_from_what_people_call_them(tmp_path, names):
    log = _read(_csv(tmp_path, NAMES[names]))
    np.testing.assert_allclose(log.times, TIMES, atol=EXACT)
    np.testing.assert_allclose(log.requests, np.radians(REQUESTED), atol=EXACT)
    np.testing.assert_allclose(log.angles, np.radians(ACTUAL), atol=EXACT)
    assert log.torque_on.all()
    assert log.joint == ""


def test_what_was_guessed_is_said_in_words(tmp_path):
    header = "t_s,req_deg,act_deg,torque_on"
    log = _read(_csv(tmp_path, header, more=",1"))
    assert log.notes == (
        "time from column 't_s', requested from 'req_deg', actual from 'act_deg', torque from "
        "'torque_on'",
        "angles in deg, as the columns said",
    )
    assert log.name == str(tmp_path / "run.csv")


UNITS = {
    "rad": (1.0, "rad"),
    "deg": (math.pi / 180.0, "rad"),
    "ticks": (2.0 * math.pi / 4096, "rad"),
    "turns": (2.0 * math.pi, "rad"),
    "range": (1.0, "1"),
    "percent": (0.01, "1"),
}


@pytest.mark.parametrize("said", ["column", "option"])
@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_comes_from_the_column_or_from_the_option(tmp_path, unit, said):
    factor, kind = UNITS[unit]
    ending = f"_{unit}" if said == "column" else ""
    requested, actual = 0.01 * REQUESTED, 0.01 * ACTUAL
    file = _csv(tmp_path, f"t_s,req{ending},act{ending}", requested=requested, actual=actual)
    log = _read(file, unit=unit if said == "option" else None, ticks_per_turn=4096)
    np.testing.assert_allclose(log.requests, factor * requested, atol=EXACT)
    np.testing.assert_allclose(log.angles, factor * actual, atol=EXACT)
    assert log.unit == kind


def test_minus_100_to_100_is_a_share_of_the_range(tmp_path):
    log = _read(_csv(tmp_path, "t_s,req,act", requested=[-100, 0, 100, 50]), unit="range_m100_100")
    np.testing.assert_allclose(log.requests, [0.0, 0.5, 1.0, 0.75], atol=EXACT)


def test_the_two_columns_may_have_two_units(tmp_path):
    log = _read(_csv(tmp_path, "t_s,req_deg,act_rad", actual=np.radians(ACTUAL)))
    np.testing.assert_allclose(log.requests, np.radians(REQUESTED), atol=EXACT)
    np.testing.assert_allclose(log.angles, np.radians(ACTUAL), atol=EXACT)
    assert "angles in deg and rad, as the columns said" in log.notes


def test_joints_whose_columns_are_alike_have_the_same_note(tmp_path):
    file = tmp_path / "run.csv"
    rows = "".join(f"{k},0,{k},0,{k}\n" for k in range(3))
    file.write_text(f"t_s,req_knee_deg,act_knee_deg,req_hip_deg,act_hip_deg\n{rows}")
    notes = {log.notes[0] for log in read_logs(file, options=LogOptions(joint="all"))}
    columns = "requested from 'req_<joint>_deg', actual from 'act_<joint>_deg'"
    assert notes == {f"time from column 't_s', {columns}"}
    (hip,) = read_logs(file, options=LogOptions(joint="hip"))
    assert "requested from 'req_hip_deg', actual from 'act_hip_deg'" in hip.notes[0]


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("said", ["column", "option"])
def test_times_may_be_in_any_unit(tmp_path, unit, said):
    steps = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
    times = [f"{time * steps[unit]:.12g}" for time in TIMES]
    header = f"clock_{unit},req_deg,act_deg" if said == "column" else "clock,req_deg,act_deg"
    log = _read(
        _csv(tmp_path, header, times=times), time=f"clock:{unit}" if said == "option" else None
    )
    np.testing.assert_allclose(log.times, TIMES, atol=EXACT)


@pytest.mark.parametrize(
    ("header", "times"),
    [
        ("t_s", [f"1732104192.{k:09d}" for k in (123456789, 123456790, 123456792)]),
        ("time_ns", [1732104192123456789 + k for k in (0, 1, 3)]),
    ],
)
def test_times_since_the_epoch_keep_their_last_nanosecond(tmp_path, header, times):
    log = _read(
        _csv(
            tmp_path,
            f"{header},req_deg,act_deg",
            times=times,
            requested=REQUESTED[:3],
            actual=ACTUAL[:3],
        )
    )
    np.testing.assert_allclose(log.times, [0.0, 1e-9, 3e-9], atol=1e-20)
    assert "shifted to start at 0" in log.notes[0]


@pytest.mark.parametrize("words", [("1", "0"), ("true", "false"), ("True", "False")])
def test_rows_without_torque_are_marked(tmp_path, words):
    on, off = words
    file = tmp_path / "run.csv"
    file.write_text(
        f"t_s,req_rad,act_rad,torque_enable\n0,0,0,{on}\n1,0,0,{off}\n2,0,0,{on}\n3,0,0,{off}\n"
    )
    np.testing.assert_array_equal(_read(file).torque_on, [True, False, True, False])


def test_the_torque_may_have_any_name_by_option(tmp_path):
    file = _csv(tmp_path, "t_s,req_deg,act_deg,power", more=",0")
    assert _read(file).torque_on.all()
    assert not _read(file, torque="power").torque_on.any()


@pytest.mark.parametrize("cut", [";", "\t"])
def test_tables_of_spreadsheets_are_read(tmp_path, cut):
    times, requested, actual = (
        [str(value).replace(".", ",") for value in values] for values in (TIMES, REQUESTED, ACTUAL)
    )
    header = cut.join(["t_s", "req_deg", "act_deg"])
    file = _csv(tmp_path, header, times=times, requested=requested, actual=actual, cut=cut)
    log = _read(file)
    np.testing.assert_allclose(log.times, TIMES, atol=EXACT)
    np.testing.assert_allclose(log.angles, np.radians(ACTUAL), atol=EXACT)


def test_columns_may_be_named_by_option(tmp_path):
    file = _csv(tmp_path, "a,b,c")
    log = _read(file, time="a:s", requested="b", actual="c", unit="deg")
    np.testing.assert_allclose(log.requests, np.radians(REQUESTED), atol=EXACT)
    swapped = _read(file, time="a:s", requested="c", actual="b", unit="deg")
    np.testing.assert_allclose(swapped.requests, np.radians(ACTUAL), atol=EXACT)


def test_naming_one_column_leaves_the_other_to_be_guessed(tmp_path):
    file = _csv(tmp_path, "t_s,knee_goal_deg,b_deg")
    np.testing.assert_allclose(_read(file, actual="b_deg").angles, np.radians(ACTUAL), atol=EXACT)


def test_what_is_no_angle_is_left_alone(tmp_path):
    header = (
        "time_s,goal_position_deg,present_position_deg,goal_current,present_current,goal_velocity,"
        "present_velocity_deg,present_load,position_error_deg,target_torque"
    )
    log = _read(_csv(tmp_path, header, more=",1,2,3,4,5,6,7"))
    np.testing.assert_allclose(log.requests, np.radians(REQUESTED), atol=EXACT)
    np.testing.assert_allclose(log.angles, np.radians(ACTUAL), atol=EXACT)


JOINTS = "t_s,req_Wrist_Pitch,act_Wrist_Pitch,req_Jaw,act_Jaw,speed_Jaw"


def _joints_file(tmp_path, header=JOINTS):
    file = tmp_path / "run.csv"
    file.write_text(header + "\n" + "".join(f"{k},{k},{k}.5,0.{k},0.{k}5,9\n" for k in range(4)))
    return file


def test_all_joints_are_read_each_in_its_unit(tmp_path):
    file = _joints_file(tmp_path)
    assert joints_in(file) == ("Wrist_Pitch", "Jaw")
    wrist, jaw = read_logs(file, options=LogOptions(joint="all", unit="deg,Jaw=range"))
    assert (wrist.joint, wrist.unit) == ("Wrist_Pitch", "rad")
    assert (jaw.joint, jaw.unit) == ("Jaw", "1")
    np.testing.assert_allclose(wrist.requests, np.radians(range(4)), atol=EXACT)
    np.testing.assert_allclose(jaw.angles, [0.05, 0.15, 0.25, 0.35], atol=EXACT)


@pytest.mark.parametrize(
    "header",
    [
        "t_s,req_Wrist_Pitch_deg,act_Wrist_Pitch_deg,req_Jaw_deg,act_Jaw_deg,speed_Jaw",
        "t_s,Wrist_Pitch_req_deg,Wrist_Pitch_act_deg,Jaw_req_deg,Jaw_act_deg,Jaw_vel_deg",
        "t_s,Wrist_Pitch.goal_deg,Wrist_Pitch.pos_deg,Jaw.goal_deg,Jaw.pos_deg,x",
        "t_s,goal_Wrist_Pitch_deg,Wrist_Pitch_position_deg,goal_Jaw_deg,Jaw_position_deg,Jaw_load",
        "t_s,goal_Wrist_Pitch_deg,Wrist_Pitch_deg,Jaw_request_deg,jaw_deg,Jaw_load",
    ],
)
def test_joints_may_be_named_before_or_after_what_is_measured(tmp_path, header):
    file = _joints_file(tmp_path, header)
    assert joints_in(file) == ("Wrist_Pitch", "Jaw")
    np.testing.assert_allclose(
        _read(file, joint="Wrist_Pitch").requests, np.radians(range(4)), atol=EXACT
    )


def test_named_columns_are_of_the_joint_that_they_name(tmp_path):
    (log,) = read_logs(
        _joints_file(tmp_path),
        options=LogOptions(joint="all", requested="req_Jaw", actual="act_Jaw", unit="range"),
    )
    assert log.joint == "Jaw"


def test_standard_input_is_read(tmp_path, monkeypatch):
    file = _csv(tmp_path, "t_s,req_deg,act_deg")
    stream = io.TextIOWrapper(io.BytesIO(file.read_bytes()))
    monkeypatch.setattr(sys, "stdin", stream)
    assert len(_read("-").times) == len(TIMES)


def test_several_files_are_several_logs_in_their_order(tmp_path):
    file = _csv(tmp_path, "t_s,req_deg,act_deg")
    other = tmp_path / "other.csv"
    other.write_bytes(file.read_bytes())
    assert [log.name for log in read_logs([file, str(other)])] == [str(file), str(other)]


DOUBTS = {
    "degrees called radians": (
        "t_s,req_deg,act_rad",
        {"actual": [0, 20, 10, 0]},
        "actual angles reach 20 rad: are they degrees?",
    ),
    "radians called degrees": (
        "t_s,req_deg,act_deg",
        {"actual": [0, 1.5, 0.5, 0]},
        "actual angles span only 1.5 degrees: are they radians?",
    ),
    "milliseconds called seconds": (
        "t_s,req_deg,act_deg",
        {"times": [0, 10, 20, 30]},
        "one row every 10 s: is the unit of time right?",
    ),
}


@pytest.mark.parametrize("case", DOUBTS)
def test_a_unit_that_is_probably_wrong_is_doubted_in_words(tmp_path, case):
    header, values, doubt = DOUBTS[case]
    assert doubt in _read(_csv(tmp_path, header, **values)).notes


def test_requests_in_radians_that_are_those_of_degrees_are_refused(tmp_path):
    file = _csv(tmp_path, "t_s,req_rad,act_rad", requested=[0, 20, 10, 0])
    with pytest.raises(InvalidFile, match=r"line 3: column 'req_rad': got 20 rad, 3.2 turns"):
        _read(file)


@pytest.mark.parametrize("form", ["2026-11-23T23:59:59.{}", "2026-11-23 23:59:59.{}+01:00"])
@pytest.mark.parametrize("options", [{}, {"time": "time:s"}])
def test_dates_are_times_since_the_first(tmp_path, form, options):
    cells = [form.format(f"{960 + 20 * k:03}") for k in range(2)]
    cells += ["NaT", cells[0].replace("23T", "24T").replace("23 ", "24 ")]
    log = _read(_csv(tmp_path, "time,req_deg,act_deg", times=cells), **options)
    assert np.allclose(log.times, [0.0, 0.02, 86400.0], rtol=0.0, atol=1e-9)
    assert "time from the dates in column 'time', shifted to start at 0" in log.notes[0]


@pytest.mark.parametrize("cell", ["", " ", "nan", "NaN"])
@pytest.mark.parametrize("column", [0, 1])
def test_a_row_without_time_or_request_is_left_out_with_a_note(tmp_path, cell, column):
    cells = [[f"{k}", f"{10 * k}", f"{10 * k - 5}"] for k in range(6)]
    cells[0][column] = cells[3][column] = cell
    file = tmp_path / "run.csv"
    file.write_text("t_s,req_deg,act_deg\n" + "".join(",".join(row) + "\n" for row in cells))
    (log,) = read_logs(file)
    assert log.times.tolist() == [1.0, 2.0, 4.0, 5.0]
    assert np.allclose(np.degrees(log.requests), [10.0, 20.0, 40.0, 50.0])
    note = "2 rows, first line 2: left out, as the time or the request is missing"
    assert note in log.notes
    assert log.measured.all()


@pytest.mark.parametrize("missing", [[3], [0, 3]])
@pytest.mark.parametrize("column", ["angle", "load"])
def test_a_failed_read_leaves_time_and_request(tmp_path, column, missing):
    cells = [[f"{k}", f"{10 * k}", f"{10 * k - 5}", f"{k / 10}"] for k in range(6)]
    for k in missing:
        cells[k][2 if column == "angle" else 3] = ""
    file = tmp_path / "run.csv"
    header = "t_s,req_deg,act_deg,load_Nm\n"
    file.write_text(header + "".join(",".join(row) + "\n" for row in cells))
    (log,) = read_logs(file)
    assert log.times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert np.allclose(np.degrees(log.requests), 10.0 * np.arange(6))
    assert np.flatnonzero(~log.measured).tolist() == missing
    rows = "line 5" if len(missing) == 1 else "2 rows, first line 2"
    assert f"{rows}: the {column} is missing, only the request counts" in log.notes


def test_a_row_that_is_there_twice_counts_once_with_a_note(tmp_path):
    rows = ["0,0,0", "1,10,", "1,10,", "2,20,15", "2,20,15", "2,20,15", "3,30,25", "4,40,35"]
    file = tmp_path / "run.csv"
    file.write_text("t_s,req_deg,act_deg\n" + "".join(f"{row}\n" for row in rows))
    (log,) = read_logs(file)
    assert log.times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert log.measured.tolist() == [True, False, True, True, True]
    assert "3 rows, first line 4: left out, the same as the row before" in log.notes


@pytest.mark.parametrize(
    "above", ["# robot 3\n", "# robot 3, at 50 Hz\n\n  #\n", "sep=,\n# rate, 50\n", "#\r\n"]
)
def test_lines_above_the_header_that_begin_with_a_hash_are_comments(tmp_path, above):
    file = tmp_path / "run.csv"
    file.write_bytes(f"{above}t_s,req_deg,act_deg\n0,0,0\n1,10,5\n2,20,15\n3,x,0\n".encode())
    line = above.count("\n") + 5
    with pytest.raises(InvalidFile, match=f"line {line}: column 'req_deg': got 'x'"):
        read_logs(file)
    file.write_bytes(file.read_bytes().replace(b"x", b"30"))
    assert np.allclose(np.degrees(_read(file).requests), [0.0, 10.0, 20.0, 30.0])


@pytest.mark.parametrize("note", ["# paused", "  # paused, 2 s", "#"])
def test_a_hash_line_between_rows_is_a_comment_and_counts_as_a_line(tmp_path, note):
    file = tmp_path / "run.csv"
    file.write_text(f"t_s,req_deg,act_deg\n{note}\n0,0,0\n1,10,5\n{note}\n2,20,15\n3,x,0\n")
    with pytest.raises(InvalidFile, match="line 7: column 'req_deg': got 'x'"):
        read_logs(file)
    file.write_text(file.read_text().replace("x", "30"))
    assert np.allclose(np.degrees(_read(file).requests), [0.0, 10.0, 20.0, 30.0])


@pytest.mark.parametrize("names", ["# t_s,req_deg,act_deg", "#t_s, req_deg, act_deg"])
def test_the_last_hash_line_right_above_the_numbers_is_their_header(tmp_path, names):
    file = tmp_path / "run.csv"  # as numpy.savetxt writes one
    file.write_text(f"# robot 3\n{names}\n0,0,0\n1,10,5\n2,20,15\n")
    assert np.allclose(np.degrees(_read(file).requests), [0.0, 10.0, 20.0])


def test_a_fault_after_an_empty_cell_is_reported_on_its_own_line(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("t_s,req_rad,act_rad\n0,0,0\n1,,0\n2,0,0\n3,0,0\n3,0,1\n")
    with pytest.raises(InvalidFile, match="line 6: time is 3 s after 3 s"):
        read_logs(file)


GOOD = "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n2,0,0\n"

TWO = "t_s,req_knee,act_knee,req_hip,act_hip\n" + "".join(f"{k},0,0,0,0\n" for k in range(3))

BAD = {
    "empty": "",
    "too short": "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n",
    "cut short": "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n2,0",
    "not a number": "t_s,req_rad,act_rad\n0,0,0\n1,inf,0\n2,0,0\n",
    "angles in rows of their own": "t_s,req_rad,act_rad\n0,0,\n1,,0\n2,0,\n3,,0\n",
    "unsorted": "t_s,req_rad,act_rad\n0,0,0\n2,0,0\n1,0,0\n",
    "a date in one row": "time_s,req_rad,act_rad\n2026-11-23T00:00:00,0,0\n1,0,0\n2,0,0\n",
    "dates with and without a zone": "time_s,req_rad,act_rad\n"
    "2026-11-23T00:00:00,0,0\n2026-11-23T00:00:01Z,0,0\n2026-11-23T00:00:02,0,0\n",
    "repeated": "t_s,req_rad,act_rad\n0,0,0\n\n1,0,0\n1,0,1\n",
    "no unit": "t_s,req,act\n0,0,0\n1,0,0\n2,0,0\n",
    "no unit of one column": "t_s,req_rad,act\n0,0,0\n1,0,0\n2,0,0\n",
    "no unit of time": "time,req_rad,act_rad\n0,0,0\n1,0,0\n2,0,0\n",
    "two units": (GOOD, {"unit": "deg"}),
    "ticks of no turn": "t_s,req_ticks,act_ticks\n0,0,0\n1,0,0\n2,0,0\n",
    "angle against share": "t_s,req_range,act_rad\n0,0,0\n1,0,0\n2,0,0\n",
    "percent called range": "t_s,req_range,act_range\n0,0,0\n1,0.5,0\n2,87,0\n",
    "no time": "req_rad,act_rad\n0,0\n1,0\n2,0\n",
    "two times": "time_s,time_ms,req_rad,act_rad\n0,0,0,0\n1,0,0,0\n2,0,0,0\n",
    "no request": "t_s,a_rad,actual_rad\n0,0,0\n1,0,0\n2,0,0\n",
    "no angles": "t_s,x,y\n0,0,0\n1,0,0\n2,0,0\n",
    "two requests": "t_s,req_rad,goal_rad,act_rad\n0,0,0,0\n1,0,0,0\n2,0,0,0\n",
    "several joints": (
        "t_s,req_a,act_a,req_b,act_b\n0,0,0,0,0\n1,0,0,0,0\n2,0,0,0,0\n",
        {"unit": "rad"},
    ),
    "misspelt joint": (
        "t_s,req_knee,act_knee,req_hip,act_hip\n0,0,0,0,0\n1,0,0,0,0\n2,0,0,0,0\n",
        {"unit": "rad", "joint": "knie"},
    ),
    "a joint where columns name none": (GOOD, {"joint": "knee"}),
    "misspelt column": (GOOD, {"requested": "rek_rad"}),
    "misspelt time": (GOOD, {"time": "ts"}),
    "unknown unit of time": (GOOD, {"time": "t_s:min"}),
    "torque that is no switch": "t_s,req_rad,act_rad,torque_on\n0,0,0,1\n1,0,0,0.4\n2,0,0,1\n",
    "two torques": "t_s,req_rad,act_rad,torque_on,torque_enable\n0,0,0,1,1\n1,0,0,1,1\n2,0,0,1,1\n",
    "one column for both": (GOOD, {"requested": "act_rad"}),
    "an option of another format": (GOOD, {"command_topic": "/x"}),
}


def test_what_cannot_be_read_is_reported_with_its_place_and_its_remedy(tmp_path, snapshot):
    file, said = tmp_path / "FILE", []
    for name, case in BAD.items():
        content, options = (case, {}) if isinstance(case, str) else case
        file.write_text(content)
        with pytest.raises(InvalidFile) as caught:
            read_logs(file, options=LogOptions(**options))
        said.append(f"{name}: {caught.value}\n".replace(str(file), "FILE"))
    snapshot.check("csv_logs", "".join(said))


def test_text_that_is_not_utf_8_is_refused_with_its_line(tmp_path):
    file = tmp_path / "run.csv"
    file.write_bytes(b"t_s,req_rad,act_rad\n0,0,0\xb0\n")
    with pytest.raises(InvalidFile) as caught:
        read_logs(file)
    assert str(caught.value) == (
        f"{file}, line 2: byte 0xb0 is not UTF-8; save the file as UTF-8 text"
    )


def test_a_column_of_torques_is_the_load_of_its_joint(tmp_path):
    file = tmp_path / "log.csv"
    rows = "".join(f"{0.02 * k},{k},{k - 1},{0.1 * k}\n" for k in range(4))
    file.write_text(f"t_s,hip_requested_deg,hip_actual_deg,hip_load_Nm\n{rows}")
    (log,) = read_logs(file)
    np.testing.assert_allclose(log.load, [0.0, 0.1, 0.2, 0.3], atol=1e-12)
    file.write_text(f"t_s,requested_deg,actual_deg,load_Nm\n{rows}")
    (log,) = read_logs(file)
    np.testing.assert_allclose(log.load, [0.0, 0.1, 0.2, 0.3], atol=1e-12)
    file.write_text(f"t_s,requested_deg,actual_deg,speed\n{rows}")
    (log,) = read_logs(file)
    assert log.load is None


def test_a_note_names_the_line_of_the_file_after_rows_that_were_left_out(tmp_path):
    rows = [f"{0.02 * k:.2f},{k},{k - 1}" for k in range(40)]
    rows[30] = "0.60,30,"
    rows.insert(11, rows[10])
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["t_s,req_deg,act_deg", *rows]) + "\n")
    (log,) = read_logs([str(file)])
    assert "line 13: left out, the same as the row before" in log.notes
    assert "line 33: the angle is missing, only the request counts" in log.notes
    assert len(log.times) == 40


PER_RADIAN, MIDDLE = -163.0, 512.0
"""Counts of a potentiometer that is wired the wrong way round [1/rad], and at angle 0."""


def _potentiometer(tmp_path, *, slow=True):
    """A log of a hobby servo: pulses, and counts of a converter of ten bits."""
    times = 0.02 * np.arange(1000)
    triangle = 0.6 * np.interp(times % 12.0, [0.0, 3.0, 9.0, 12.0], [0.0, 1.0, -1.0, 0.0])
    steps = 0.6 * np.sign(np.sin(2.0 * np.pi * 0.9 * times))
    requests = np.where((times < 12.0) & slow, triangle, steps)
    joint = planner.JointModel(
        v_max=4.0, theta_0=0.3, lag=0.02, acceleration_time=0.02, tick=0.02, dead_band=0.01
    )
    angles = planner.simulate(joint, requests, cyclic=False)
    pulses = 1500.0 + 2000.0 / np.pi * requests
    counts = np.round(MIDDLE + PER_RADIAN * angles)
    file = tmp_path / "servo.csv"
    columns = np.column_stack([times, pulses, counts])
    np.savetxt(file, columns, delimiter=",", header="t_s,requested,actual", comments="")
    return file, requests, angles


def test_the_scale_of_a_potentiometer_is_that_of_slow_requests_and_reported(tmp_path):
    file, requests, angles = _potentiometer(tmp_path)
    log = _read(file, unit="requested=us,actual=counts")
    np.testing.assert_allclose(log.requests, requests, atol=EXACT)
    # Half a count of rounding; a scale within 1 %.
    np.testing.assert_allclose(log.angles, angles, atol=0.5 / 163.0 + 0.01 * 0.6)
    (note,) = [each for each in log.notes if "a count of the actual angle" in each]
    per_count, zero = map(float, re.findall(r"(-?[\d.]+) (?:degrees|counts)", note))
    assert per_count == pytest.approx(math.degrees(1.0 / PER_RADIAN), rel=0.01)
    assert zero == pytest.approx(MIDDLE, abs=1.0)


def test_the_scale_of_a_potentiometer_is_that_of_rows_with_torque(tmp_path):
    file, _, angles = _potentiometer(tmp_path)
    head, *rows = file.read_text().splitlines()
    without = [row.rsplit(",", 1)[0] + ",100,0" for row in rows[100:160]]  # it hangs down
    rows = [*(f"{row},1" for row in rows[:100]), *without, *(f"{row},1" for row in rows[160:])]
    file.write_text("\n".join([f"{head},torque_on", *rows]))
    log = _read(file, unit="requested=us,actual=counts")
    np.testing.assert_allclose(log.angles[200:], angles[200:], atol=0.5 / 163.0 + 0.01 * 0.6)


def test_pulses_of_another_servo_are_read_by_the_microseconds_of_a_turn(tmp_path):
    file, requests, _ = _potentiometer(tmp_path)
    log = _read(file, unit="requested=us,actual=counts", ticks_per_turn=8000)
    np.testing.assert_allclose(log.requests, requests / 2.0, atol=EXACT)


def test_names_of_columns_say_pulses_and_counts(tmp_path):
    file, requests, _ = _potentiometer(tmp_path)
    text = file.read_text().replace("t_s,requested,actual", "t_s,requested_us,actual_counts")
    file.write_text(text)
    log = _read(file)
    np.testing.assert_allclose(log.requests, requests, atol=EXACT)
    assert "angles in us and counts, as the columns said" in " ".join(log.notes)


@pytest.mark.parametrize(
    ("unit", "slow", "message"),
    [
        ("requested=us,actual=counts", False, "the scale of actual angles in counts does not show"),
        ("counts", True, "requests in counts, whose scale is unknown"),
        ("requested=counts,actual=us", True, "requests in counts"),
    ],
)
def test_counts_without_a_scale_are_refused(tmp_path, unit, slow, message):
    file, *_ = _potentiometer(tmp_path, slow=slow)
    with pytest.raises(InvalidFile, match=message):
        _read(file, unit=unit)


def test_slow_requests_in_one_direction_tell_no_scale(tmp_path):
    """The joint trails them by an amount that nobody knows."""
    file, *_ = _potentiometer(tmp_path)
    rows = file.read_text().splitlines()
    file.write_text("\n".join([rows[0], *rows[160:440]]) + "\n")  # from the top to the bottom
    with pytest.raises(InvalidFile, match="up and down"):
        _read(file, unit="requested=us,actual=counts")


def test_counts_of_another_sensor_are_refused(tmp_path):
    file, *_ = _potentiometer(tmp_path)
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    table[:, 2] = np.random.default_rng(0).uniform(0.0, 1023.0, len(table))
    np.savetxt(file, table, delimiter=",", header="t_s,requested_us,actual_adc", comments="")
    with pytest.raises(InvalidFile, match="beside a straight line of slow requests"):
        _read(file)
