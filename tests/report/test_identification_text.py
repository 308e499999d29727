"""What is said of an identification: in words, in a table, in the comments of a model file."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest

from planner.files.joint_model import models_text
from planner.identification.result import Alternative, Finding, Interval, told
from planner.model.evidence import Evidence
from planner.report.identification_text import (
    REMARKS,
    identification_text,
    model_comments,
    parameters,
    verdict,
)
from tests.report.made_up import made_up, made_up_log, never_saturated

KNOWN = {
    "v_max": [(5.3996, 5.5087), (4.418, 6.490), (4.309, 6.599), (0.0, 10.9), (0.0, 11.0)],
    "v_offset": [(-0.5, 0.5)],
    "offset": [(-0.024, 0.024), (-0.025, 0.025)],
    "lag": [(0.031, 0.033), (0.025, 0.039), (0.0, 0.328)],
}
KNOWN["v_max"] += [(0.5, math.inf), (-math.inf, 2.0), (-math.inf, math.inf)]
"""Intervals of parameters."""

LATE = Alternative(name="delay", rms=0.003, held_out_rms=0.003, parameters={"delay": 0.1})
NEXT = (
    {},
    {"verdict": "refused"},
    {"findings": (Finding("friction", ""), Finding("sign", ""))},
    {"findings": (Finding("columns", ""),)},
)
"""Changes of an identification that decide what to do next."""


def test_how_well_a_parameter_is_known_is_said_in_words(snapshot):
    lines = []
    for name, ends in KNOWN.items():
        for each in ends:
            intervals = {**made_up().intervals, name: Interval(*each)}
            (found,) = (row for row in parameters(made_up(intervals=intervals)) if row.name == name)
            assert found.rough == (not found.judgement.startswith("±"))
            lines.append(f"{name} {each[0]:g} to {each[1]:g}: {found.judgement}\n")
    snapshot.check("parameters", "".join(lines))


def test_what_does_not_hold_and_what_to_do_next_is_said_of_each_joint_once(snapshot):
    """Warnings of many joints come once, ordered."""
    found = made_up(alternatives=(LATE,), verdict="worse than a delay")
    parts = [verdict(found), identification_text({"hip": made_up(), "knee": found})]
    finding = never_saturated().findings[0]
    friction = Finding("friction", "the log does not determine dry friction")
    log, drift = Finding("log", "a.csv: torque is off in 20 %"), Finding("pattern", "backlash")
    turned = Finding("pattern", "wraps around")
    every = {}
    for k in range(6):
        found = made_up(findings=(log, friction, finding) if k else (drift, turned, log))
        (fit,) = found.fits
        faster = dataclasses.replace(fit, log=dataclasses.replace(fit.log, times=fit.log.times / 2))
        every[f"joint{k}"] = dataclasses.replace(found, fits=(faster,))
    parts.append(identification_text(every))
    for changes in NEXT:
        text = identification_text({"hip": made_up(**changes)}, "arm.toml")
        parts.append(text.splitlines()[-1])
    snapshot.check("identifications", "\n".join(parts) + "\n")


@pytest.mark.parametrize(
    ("unit", "record", "command"),
    [
        ("rad", 0.5, "--limits-deg -39:51 --rate-hz 50 -o more.csv; then"),
        (
            "rad",
            2.0,
            "--limits-deg -52:63 --rate-hz 50 -o more.csv, or as far as the joint can move; then",
        ),
        (
            "1",
            0.5,
            "--limits-deg 2:89 --rate-hz 50 --model joint.toml -o more.csv; then",
        ),
    ],
)
def test_the_recording_to_make_is_as_large_as_a_finding_asks_for(unit, record, command):
    found = made_up(findings=(Finding("motion", "", record),))
    (fit,) = found.fits
    requests = fit.log.requests if unit == "rad" else np.abs(fit.log.requests)
    log = dataclasses.replace(fit.log, unit=unit, requests=requests)
    found = dataclasses.replace(found, fits=(dataclasses.replace(fit, log=log),))
    assert command in identification_text({"": found}).splitlines()[-1]


def test_no_name_of_a_log_can_break_the_model_file():
    found = {"": made_up(made_up_log(name="a\nv_max = 1\r\x00\udcff.csv", unit="1"))}
    text = models_text({"": found[""].model}, remarks=REMARKS, about=model_comments(found))
    assert tomllib.loads(text)["v_max"] == found[""].model.v_max
    text.encode()


def test_comments_of_a_model_in_shares_have_shares_for_radians():
    found = {"jaw": made_up(made_up_log(unit="1")), "hip": made_up()}
    units = {"jaw": Evidence(error=0.01, unit="range"), "hip": Evidence(error=0.01, unit="rad")}
    models = {name: each.model.with_evidence(units[name]) for name, each in found.items()}
    texts = [models_text(models, about=about) for about in (model_comments(found), {})]
    for jaw, hip in (text.split("[hip]") for text in texts):
        assert "rad" not in jaw.replace("not radians", "")
        assert "# [1/s]" in jaw
        assert "# [1] rms error" in jaw
        assert "# [rad/s]" in hip
        assert "# [rad] rms error" in hip
    assert "shares of the joint's range" in texts[0]


def test_sizes_in_findings_have_their_units():
    rows = {"log": "a.csv", "change": 0.25, "first": 0, "last": 9}
    ends = [told("pattern", "drift", unit, **rows).words for unit in ("1", "rad")]
    assert [" ".join(each.split()[9:-6]) for each in ends] == ["by 25 % of range", "by 14.3 deg"]
    speeds = {"up": 0.5, "down": 0.25}
    assert "reaches 50 %/s upwards" in told("pattern", "asymmetry", "1", **speeds).words
