"""What is said of an identification: in words, in a table, in the comments of a model file."""

import dataclasses
import math
import tomllib

import pytest

from planner.files.joint_model import models_text
from planner.identification.result import Alternative, Finding, Interval
from planner.report.identification_text import (
    REMARKS,
    identification_text,
    model_comments,
    parameters,
    verdict,
)
from tests.report.made_up import made_up, made_up_log, never_saturated


def row(identification, name):
    return next(row for row in parameters(identification) if row.name == name)


@pytest.mark.parametrize(
    ("name", "interval", "words"),
    [
        ("v_max", Interval(5.3996, 5.5087), "± 1 %"),
        ("v_max", Interval(4.418, 6.490), "± 19 %"),
        ("v_max", Interval(4.309, 6.599), "only ± 21 %"),
        ("v_offset", Interval(-0.5, 0.5), "± 29 deg/s"),
        ("offset", Interval(-0.024, 0.024), "± 1.4 deg"),
        ("offset", Interval(-0.025, 0.025), "only ± 1.4 deg"),
        ("v_max", Interval(0.0, 10.9), "only ± 100 %"),
        ("v_max", Interval(0.0, 11.0), "hardly at all"),
        ("lag", Interval(0.031, 0.033), "± 1 ms"),
        ("lag", Interval(0.025, 0.039), "± 7 ms"),
        ("lag", Interval(0.0, 0.328), "only ± 164 ms"),
        ("v_max", Interval(0.5, math.inf), "only bounded from below"),
        ("v_max", Interval(-math.inf, 2.0), "only bounded from above"),
        ("v_max", Interval(-math.inf, math.inf), "not determined"),
    ],
)
def test_how_well_a_parameter_is_known_is_said_in_words(name, interval, words):
    found = row(made_up(intervals={**made_up().intervals, name: interval}), name)
    assert found.judgement == words
    assert found.rough == (not words.startswith("±"))


def test_a_model_that_a_pure_delay_beats_is_not_to_be_planned_with():
    late = Alternative(name="delay", rms=0.003, held_out_rms=0.003, parameters={"delay": 0.1})
    found = made_up(alternatives=(late,), verdict="worse than a delay")
    assert verdict(found).startswith("a pure delay serves better, plan with --method shift: ")
    assert "1.3 times farther off than the best pure delay" in verdict(found)
    text = identification_text({"hip": made_up(), "knee": found})
    assert text.startswith("the model holds for 1 of 2 joints\n")
    assert "worse than a delay" in text


def test_warnings_of_many_joints_come_once_ordered_and_one_line_says_what_to_do_next():
    finding = never_saturated().findings[0]
    friction = Finding("friction", "the log does not determine dry friction")
    log, drift = Finding("log", "a.csv: torque is off in 20 %"), Finding("pattern", "backlash")
    turned = Finding("pattern", "wraps around")
    every = {
        f"joint{k}": made_up(findings=(log, friction, finding) if k else (drift, turned, log))
        for k in range(6)
    }
    for joint, found in every.items():
        (fit,) = found.fits
        faster = dataclasses.replace(fit, log=dataclasses.replace(fit.log, times=fit.log.times / 2))
        every[joint] = dataclasses.replace(found, fits=(faster,))
    text = identification_text(every)
    told = [line for line in text.splitlines() if "warning: " in line]
    assert [line.partition(": warning: ")[::2] for line in told] == [
        ("joint1, joint2, joint3 and 2 more", friction.words),
        ("joint1, joint2, joint3 and 2 more", finding.words),
        ("joint0, joint1, joint2 and 3 more", log.words),
        ("joint0", drift.words),
        ("joint0", turned.words),
    ]
    assert text.splitlines()[-1] == (
        "next: record joint1 (likewise joint2, joint3, joint4 and joint5), which shows top speed, "
        "dry friction: request-planner excite --kind combined --limits-deg -39:51 --rate-hz 100 "
        "--joint joint1 -o more.csv; then identify from all logs"
    )


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "next: request-planner plan PATH --model arm.toml -o requests.csv"),
        ({"verdict": "refused"}, "next: find out what holds or loads hip, and record again"),
        (
            {"findings": (Finding("friction", ""), Finding("sign", ""))},
            "next: check the columns of hip, as the first warning says",
        ),
        (
            {"findings": (Finding("columns", ""),)},
            "next: check the columns of hip, as the first warning says",
        ),
    ],
)
def test_what_to_do_next_is_to_plan_unless_the_model_is_refused_or_a_column_wrong(changes, line):
    text = identification_text({"hip": made_up(**changes)}, "arm.toml")
    assert text.splitlines()[-1] == line


def test_no_name_of_a_log_can_break_the_model_file():
    found = {"": made_up(made_up_log(name="a\nv_max = 1\r\x00\udcff.csv", unit="1"))}
    text = models_text({"": found[""].model}, remarks=REMARKS, about=model_comments(found))
    assert tomllib.loads(text)["v_max"] == found[""].model.v_max
    assert "shares of the joint's range" in text
    assert "# [1/s], " in text
    text.encode()
