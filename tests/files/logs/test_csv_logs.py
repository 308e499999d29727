"""CSV logs: what the columns are is guessed and said; their units are said or asked for."""

import math
import re
from functools import partial

import numpy as np
import pytest

import planner
from planner import LogOptions, read_logs
from tests.files.logs.told import told
from tests.instances import joint_of

EXACT = 1e-12  # angles and times come through unchanged but for one product of float64 [rad, s]
REQUESTED = np.array([0.0, 10.0, 20.0, 20.0])
ACTUAL = np.array([0.0, 2.0, 9.0, 17.0])

FOUR = "0,0,0\n0.01,10,2\n0.02,20,9\n0.04,20,17\n"

ALL = {"joint": "all"}

PER_RADIAN, MIDDLE = -163.0, 512.0
"""Counts of a potentiometer that is wired the wrong way round [1/rad], and at angle 0."""

COUNTED = "requested=us,actual=counts"  # units of pulses and of a potentiometer
HOBBY_SERVO = joint_of(4.0, 0.3, 0.02, 0.02, tick=0.02, dead_band=0.01)
GOOD = "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n2,0,0\n"
TWO = "t_s,req_knee,act_knee,req_hip,act_hip\n" + "".join(f"{k},0,0,0,0\n" for k in range(3))


def _read(file, **options):
    (log,) = read_logs(file, options=LogOptions(**options))
    return log


def _rows(*cells, count=3):
    """Rows ``0.0, 0.1, …`` in whose cells ``K`` is the number of the row."""
    return "".join(f"{k / 10}," + ",".join(cells).replace("K", f"{k}") + "\n" for k in range(count))


def _of_joints(form, words, cells=("K0", "2")):
    """A log of the joints a, b, … for these words, whose columns are named by a form."""
    titles = [title for k, word in enumerate(words.split()) for title in form(chr(97 + k), word)]
    return ",".join(["t_s", *titles]) + "\n" + _rows(*cells * (len(titles) // 2))


REQUESTED = (
    "requested request req goal command commanded cmd target desired des reference ref setpoint "
    "action"
)
ACTUAL = (
    "actual act present measured meas measurement feedback state observed observation position pos "
    "angle"
)
NO_ANGLES = (
    "velocity vel speed effort load torque current voltage volts temp temperature acceleration acc "
    "accel pwm error err gain limit min max"
)
UNITS = (
    "rad radian radians deg degree degrees ° tick ticks us µs usec turn turns range percent % "
    "range_0_100 range_m100_100"
)

READ = {
    "canonical": "t_s,requested_deg,actual_deg,torque_on\n0,0,0,1\n1,10,2,0\n2,20,9, true \n"
    "3,30,19,False\n",
    "words run together": f"stamp_s,goalPosition_deg,presentPosition_deg\n{FOUR}",
    "units in brackets": f"time [ms],Set point [deg],current position [rad]\n{FOUR}",
    "words for requests": (
        _of_joints(lambda joint, word: (f"{joint}_{word}_deg", f"act_{joint}_deg"), REQUESTED),
        ALL,
    ),
    "words for angles": (
        _of_joints(lambda joint, word: (f"{joint}.goal_deg", f"{word}_{joint}_deg"), ACTUAL),
        ALL,
    ),
    "joints that are only named": (
        "t_s,goal_Wrist_Pitch_deg,wrist_pitch_deg,elbow_deg,elbow_target_deg\n"
        + _rows("1", "2", "3", "4"),
        ALL,
    ),
    "what is no angle": _of_joints(
        lambda _, word: (f"goal_{word}_deg", f"present_{word}_deg"), f"position {NO_ANGLES}"
    ),
    "units by columns": (
        _of_joints(lambda joint, unit: (f"{joint}_req [{unit}]", f"{joint} [{unit}]"), UNITS, "K2"),
        {"joint": "all", "ticks_per_turn": 4000.0},
    ),
    "units by joints": (
        "t_s,req_hip,act_hip,req_jaw,act_jaw\n" + _rows("K0", "1", "50", "K"),
        {"joint": "all", "unit": "DEG, jaw = percent"},
    ),
    "units by columns and joints": (
        "t_s,req_hip,act_hip,requested,actual\n" + _rows("1500", "1", "1600", "2"),
        {"joint": "all", "unit": "us,actual=deg,hip=turns"},
    ),
    "one joint of two": (
        "t_s,hip_req_deg,hip_act_deg,knee_req_deg,knee_act_deg,hip_load_Nm,knee_load_Nm\n"
        + _rows("1", "2", "K0", "4", "5", "-K"),
        {"joint": "knee"},
    ),
    "a joint called all": (
        "t_s,req_all_deg,act_all_deg,req_hip_deg,act_hip_deg\n" + _rows("K0", "1", "50", "K"),
        {"joint": "all"},
    ),
    "columns by options": (
        f"a,b,c\n{FOUR}",
        {"time": "a:s", "requested": "c", "actual": "b", "unit": "deg"},
    ),
    "one column of two joints by option": (
        "t_s,hip_req_deg,hip_act_deg,knee_req_deg,knee_act_deg\n" + _rows("1", "2", "K0", "4"),
        {"requested": "knee_req_deg", "joint": "all"},
    ),
    "torque by option": (
        f"t_s,req_deg,act_deg,power\n{_rows('K0', '1', '0.0')}",
        {"torque": "power"},
    ),
    "time by option": (f"clock,req_deg,act_deg\n{FOUR}", {"time": "clock:ms"}),
    "half an hour in ms": "t_millis,req_deg,act_deg\n2000000,1,2\n2000010,9,8\n2000020,3,4\n",
    "since the epoch": "time_ns,req_deg,act_deg\n1732104192123456789,1,2\n,2,3\n"
    "1732104192143456789,2,3\n1732104192183456789,3,4\n",
    "dates": "time,req_deg,act_deg\nNaT,0,0\n2026-11-23 23:59:59.960+01:00,1,2\n"
    "2026-11-23 23:59:59.980+01:00,2,3\n2026-11-24 23:59:59.960+01:00,3,4\n",
    "a spreadsheet's": "\n\nt_s;req_deg;act_deg\n0;1,5;-,5e1\n0,01;2,5;3\n0,02;3;4\n",
    "comments": "# robot 3\n# t_s,req_deg,act_deg\n0,0,\n # paused, 2 s\n1,10,5\n2,20,15\n3,1,2\n",
    "a column called #": "# robot 3\n#,t_s,req_deg,act_deg\n1,0,0,0\n2,1,10,5\n3,2,20,15\n",
    "gaps": "t_s,req_deg,act_deg,load_Nm\n0,,1,1\n1,1,,0.1\n2,2,1,0.2\n,3,3,0.3\n4,4,,0.4\n"
    "5,5,4,0.5\n5,5,4,0.5\n6,6,nan,0.6\n7,7,6,\n8,8,7,0.8\n",
    "one gap in the load": "t_s,req_deg,act_deg,load_Nm\n0,1,2,\n1,2,3,4\n2,3,9,5\n3,9,5,6\n",
    "probably other units": "t_s,req_rad,act_deg\n0,5,0\n10,1,1.5\n20,3,0\n",
    "a joint at rest": f"t_s,req_deg,act_deg\n{_rows('5', '5')}",
}


def test_a_log_says_what_its_columns_and_the_options_say(tmp_path, snapshot):
    file, said = tmp_path / "FILE", []
    for name, case in READ.items():
        content, options = (case, {}) if isinstance(case, str) else case
        file.write_text(content)
        said.append(f"{name}\n")
        said.append(told(read_logs(file, options=LogOptions(**options))))
    snapshot.check("csv_read", "".join(said))


def test_joints_are_named_where_the_unit_of_the_times_is_still_to_be_said(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("stamp,knee_goal_deg,knee_actual_deg\n0,1,1\n20,2,1\n")
    assert planner.joints_in(log) == ("knee",)


def _csv(units, times, requests, angles, digits=9):
    """A log of a knee, as text."""
    titles = ("t_s", *map("knee_{}{}".format, ("requested", "actual"), units))
    rows = zip(times, requests, angles, strict=True)
    return ",".join(titles) + "".join(f"\n{t:.2f},{r:.9f},{a:.{digits}f}" for t, r, a in rows)


def _slow_then_fast(slow):
    """Times and requests [rad]; the slow ones have this share of the range of all, 0 for none."""
    times = 0.02 * np.arange(1000)
    triangle = slow * 0.6 * np.interp(times % 12.0, [0.0, 3.0, 9.0, 12.0], [0.0, 1.0, -1.0, 0.0])
    steps = 0.6 * np.sign(np.sin(2.0 * np.pi * 0.9 * times))
    return times, np.where((times < 12.0) & (slow > 0.0), triangle, steps)


def _potentiometer(slow):
    """A log of a hobby servo: pulses, and counts of a converter of ten bits."""
    times, requests = _slow_then_fast(slow)
    angles = planner.simulate(HOBBY_SERVO, requests, cyclic=False)
    counts = np.round(MIDDLE + PER_RADIAN * angles)
    return _csv(("", ""), times, 1500.0 + 2000.0 / np.pi * requests, counts)


def _sines(units, of_requests, of_angles):
    """A log of a joint that lags, with factors of requests and angles."""
    times = 0.02 * np.arange(200)
    requests, angles = 0.12 * np.sin(5.0 * times), 0.1 * np.sin(5.0 * (times - 0.1))
    titles = [f"_{unit}" for unit in units.split()]
    return _csv(titles, times, of_requests * requests, of_angles * angles)


BAD = {
    "empty": "",
    "too short": "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n",
    "cut short": "t_s,req_rad,act_rad\n0,0,0\n1,0,0\n2,0",
    "not a number": "t_s,req_rad,act_rad\n0,0,0\n1,inf,0\n2,0,0\n",
    "angles in rows of their own": "t_s,req_rad,act_rad\n0,0,\n1,,0\n2,0,\n3,,0\n",
    "unsorted": "t_s,req_rad,act_rad\n0,0,0\n2,0,0\n1,0,0\n",
    "a date in one row": "time_s,req_rad,act_rad\n2026-11-23T00:00:00,0,0\n1,0,0\n2,0,0\n",
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
    "no actual angle": "t_s,goal_rad,a_rad\n0,0,0\n1,0,0\n2,0,0\n",
    "nothing beside a named column": ("t_s,a_rad,b_rad\n0,0,0\n1,1,1\n", {"requested": "a_rad"}),
    "a unit of a joint that is not there": (TWO, {"joint": "all", "unit": "rad,nee=deg,fin=deg"}),
    "too few whole rows": "t_s,req_rad,act_rad\n0,0,0\n1,,0\n2,0,\n3,0,0\n",
    "the same column twice": "t_s,req_deg,act_deg\n0,1,1\n1,2,2\n2,3,\n3,4,4\n",
    "a share beyond the range": "t_s,req_range,act_range\n0,0,0\n1,0.5,0\n2,2,2.01\n",
    "requests in degrees": "t_s,req_rad,act_rad\n0,0,0\n1,20,2\n2,10,1\n",
    "an unlikely angle": "t_s,req_deg,act_deg\n0,0,0\n1,0.5,-1e9\n2,2,2.01\n",
    "two requests": "t_s,req_rad,goal_rad,act_rad\n0,0,0,0\n1,0,0,0\n2,0,0,0\n",
    "several joints": (TWO, {"unit": "rad"}),
    "misspelt joint": (TWO, {"unit": "rad", "joint": "knie"}),
    "a joint where columns name none": (GOOD, {"joint": "knee"}),
    "misspelt column": (GOOD, {"requested": "rek_rad"}),
    "misspelt torque": (GOOD, {"torque": "torque"}),
    "misspelt time": (GOOD, {"time": "ts"}),
    "unknown unit of time": (GOOD, {"time": "t_s:min"}),
    "torque that is no switch": "t_s,req_rad,act_rad,torque_on\n0,0,0,1\n1,0,0,0.4\n2,0,0,1\n",
    "one column for both": (GOOD, {"requested": "act_rad"}),
    "an option of another format": (GOOD, {"command_topic": "/x"}),
    "counts of no slow requests": (partial(_potentiometer, 0.0), {"unit": COUNTED}),
    "counts of too few slow requests": (partial(_potentiometer, 0.49), {"unit": COUNTED}),
    "requests in counts": (partial(_potentiometer, 1.0), {"unit": "counts"}),
    "requests alone in counts": (
        partial(_potentiometer, 1.0),
        {"unit": "requested=counts,actual=us"},
    ),
    "angles in degrees": _sines("rad rad", 1.0, 57.3),
    "requests alone in degrees": _sines("rad rad", 57.3, 1.0),
    "angles in radians": _sines("deg deg", 57.3, 1.0),
    "both in degrees": _sines("deg rad", 57.3, 57.3),
}


def test_what_cannot_be_read_is_reported_with_its_place_and_its_remedy(tmp_path, snapshot):
    file = tmp_path / "FILE"

    def read(case):
        content, options = (case, {}) if isinstance(case, str) else case
        file.write_text(content if isinstance(content, str) else content())
        read_logs(file, options=LogOptions(**options))

    snapshot.refusals("csv_logs", read, BAD, FILE=file)


@pytest.mark.parametrize("slow", [1.0, 0.51])
def test_the_scale_of_a_potentiometer_is_that_of_slow_requests_and_reported(tmp_path, slow):
    file, requests = tmp_path / "servo.csv", _slow_then_fast(slow)[1]
    file.write_text(_potentiometer(slow))
    log = _read(file, unit=COUNTED)
    np.testing.assert_allclose(log.requests, requests, atol=EXACT)
    # Half a count of rounding; a scale within 1 % of the range of slow requests.
    angles = planner.simulate(HOBBY_SERVO, requests, cyclic=False)
    np.testing.assert_allclose(log.angles, angles, atol=0.5 / 163.0 + 0.01 / slow * 0.6)
    (note,) = [each for each in log.notes if "a count of the actual angle" in each]
    per_count, zero = map(float, re.findall(r"(-?[\d.]+) (?:degrees|counts)", note))
    assert per_count == pytest.approx(math.degrees(1.0 / PER_RADIAN), rel=0.01 / slow)
    assert zero == pytest.approx(MIDDLE, abs=1.0)
