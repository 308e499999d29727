"""CSV for a controller: held requests at its rate, in its unit."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from planner.exceptions import InvalidInput, MissingExtra
from planner.files.exports import Ticks, check_format, to_ticks, write_controller_csv
from planner.files.paths import read_joint_path
from planner.robot.schedule import ON_TIME, Schedule, never_sent, resampled

ROUNDING = 1e-10
"""Twelve decimals of a degree are written [rad]."""


def _numbered(rows, period):
    """A joint whose request is the number of the request."""
    return Schedule(("knee",), np.arange(float(rows))[:, None], period)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_what_is_written_is_read_back_as_a_joint_path(schedule, tmp_path, unit):
    file = tmp_path / "requests.csv"
    write_controller_csv(file, schedule, unit=unit)
    assert file.read_text().splitlines()[0] == f"t_s,hip_{unit},on_{unit},knee_{unit}"
    given = read_joint_path(file)
    assert np.max(np.abs(given.values - schedule.requests)) <= ROUNDING
    assert np.max(np.abs(given.times - schedule.times)) <= ROUNDING


def test_ticks_are_whole_numbers_nearest_to_the_requests(tmp_path):
    file = tmp_path / "ticks.csv"
    turns = Schedule(("hip", "knee"), np.array([[0.0, 0.0], [0.25, -0.125]]) * 2.0 * np.pi, 0.02)
    write_controller_csv(file, turns, unit="ticks", ticks=Ticks(zeros={"knee": 1000}))
    rows = list(csv.reader(file.read_text().splitlines()))
    assert rows == [
        ["t_s", "hip_ticks", "knee_ticks"],
        ["0.0", "2048", "1000"],
        ["0.02", "3072", "488"],
    ]


@pytest.mark.parametrize(
    ("angle", "ticks", "message"),
    [
        (
            np.pi,
            Ticks(),
            "knee: request 0, 180.00 deg, is tick 4096, expected 0 to 4095; check the zero tick, "
            "the ticks per turn and the direction",
        ),
    ],
)
def test_a_servo_cannot_go_beyond_its_turn(angle, ticks, message):
    with pytest.raises(InvalidInput) as caught:
        to_ticks(Schedule(("knee",), np.array([[angle]]), 0.02), ticks)
    assert str(caught.value) == message


def test_a_slower_controller_that_would_leave_requests_out_is_refused():
    with pytest.raises(InvalidInput, match="rate: at 50 Hz 4 of 8 requests would never be sent"):
        resampled(_numbered(8, 0.008), 50.0)
    slow = resampled(_numbered(8, 0.008), 50.0, between="linear")
    assert np.allclose(slow.requests[:, 0], [0.0, 2.5, 5.0, 7.0], atol=ROUNDING)


def test_a_faster_controller_repeats_what_is_held():
    fast = resampled(_numbered(3, 0.02), 100.0)
    assert fast.requests[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]
    assert fast.period == 0.01
    assert never_sent(_numbered(3, 0.02), 100.0) == 0


def test_a_straight_line_leads_to_the_next_request_and_the_last_is_held():
    fast = resampled(_numbered(3, 0.02), 100.0, between="linear")
    assert np.allclose(fast.requests[:, 0], [0.0, 0.5, 1.0, 1.5, 2.0, 2.0], atol=ROUNDING)


@given(st.integers(1, 60), st.floats(1e-3, 1.0), st.floats(10.0, 2000.0))
def test_a_held_row_is_the_request_of_its_time(rows, period, rate):
    given_rows = _numbered(rows, period)
    assume(not never_sent(given_rows, rate))
    held = resampled(given_rows, rate)
    numbers = held.requests[:, 0]
    slack = 2.0 * ON_TIME * max(period, 1.0 / rate)
    assert (held.times >= numbers * period - slack).all()
    assert (held.times <= (numbers + 1.0) * period + slack).all()
    assert held.duration - given_rows.duration + slack >= 0.0
    assert held.duration - given_rows.duration <= 1.0 / rate + slack


def test_a_period_that_is_written_rounded_loses_no_request():
    for period in (0.033333333334, 0.033333333333):
        same = resampled(_numbered(90, period), 30.0)
        assert same.requests[:, 0].tolist() == list(range(90))


def test_hobby_servos_get_pulses_in_microseconds_of_their_own_centre_and_direction(tmp_path):
    file = tmp_path / "pulses.csv"
    quarter = Schedule(("hip", "knee"), np.array([[0.0, 0.0], [0.25, 0.125]]) * 2.0 * np.pi, 0.02)
    servos = Ticks(per_turn=4000, zero=1500, zeros={"knee": 1460}, reversed=["knee"], unit="us")
    write_controller_csv(file, quarter, unit="us", ticks=servos)
    assert file.read_text() == "t_s,hip_us,knee_us\n0.0,1500,1460\n0.02,2500,960\n"
    beyond = r"knee: request 1, 45\.00 deg, is a pulse of 2540 us, expected 500 to 2500; check"
    with pytest.raises(InvalidInput, match=beyond):
        to_ticks(quarter, Ticks(4000, 1500, {"knee": 2040}, unit="us"))
    with pytest.raises(InvalidInput, match="reverse: no joint 'ankle'; joints: hip, knee"):
        check_format("csv", quarter, ticks=Ticks(reversed=["ankle"]))


SHORT = Schedule(("knee",), np.zeros((3, 1)), 0.02)


@pytest.mark.parametrize(
    ("form", "schedule", "given", "message"),
    [
        ("xml", SHORT, {}, "format: got 'xml', expected csv, yaml, bag, mcap, lerobot"),
        ("csv", SHORT, {"ticks": Ticks(zeros={"hip": 3})}, "zero tick: no joint 'hip'"),
        ("csv", SHORT, {"ticks": Ticks(reversed=["hip"], unit="us")}, "reverse: no joint 'hip'"),
        ("lerobot", Schedule(("knee",), np.zeros((3, 1)), 2.5), {}, "is 0.4 per second, expected"),
        *((form, SHORT, {"lead": 1e12}, "whole nanoseconds") for form in ("yaml", "bag", "mcap")),
        *((form, SHORT, {"topic": "/"}, "topic: got '/'") for form in ("bag", "mcap")),
        ("csv", SHORT, {"lead": -1.0, "topic": "/"}, None),
        ("yaml", SHORT, {"topic": "/"}, None),
        ("lerobot", SHORT, {"lead": -1.0, "topic": "/"}, None),
    ],
)
def test_what_a_format_cannot_hold_is_refused_before_there_are_angles(
    form, schedule, given, message
):
    if message is None:
        check_format(form, schedule, **given)
        return
    with pytest.raises(InvalidInput, match=message):
        check_format(form, schedule, **given)


@pytest.mark.parametrize(
    ("form", "extra"), [("yaml", "yaml"), ("bag", "bags"), ("mcap", "bags"), ("lerobot", "parquet")]
)
def test_a_format_whose_package_is_not_installed_is_refused_at_once(form, extra, monkeypatch):
    monkeypatch.setattr("planner.files.exports.find_spec", lambda _: None)
    check_format("csv", SHORT)
    with pytest.raises(MissingExtra, match=rf"request-planner\[{extra}\]"):
        check_format(form, SHORT)
