"""`plan` for the foot, from where a joint rests, and against a tolerance."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from planner.files.paths import read_joint_path


@pytest.mark.parametrize(
    "limits",
    [
        ("--max-step-deg", 0.9),
        ("--max-step-deg", 0.9, "--max-request-speed-deg-s", 1000),
        ("--max-step-deg", 8, "--max-request-speed-deg-s", 112.5),
    ],
)
def test_the_smaller_limit_on_steps_is_kept(run, foot, limits):
    ask = ("plan", foot, "--leg", "front-left", "--method", "optimal", *limits)
    assert run(*ask, "-o", "requests.csv").exit_code == 0
    requests = np.degrees(read_joint_path("requests.csv").values)
    steps = np.abs(np.diff(requests, axis=0, append=requests[:1]))
    assert 0.85 < np.max(steps) <= 0.9 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("unit", "rows", "other", "doubted"),
    [
        ("deg", 88, 1.0, True),
        ("rad", 88, 1.0, False),
        ("deg", 9, 1.0, False),
    ],
)
def test_small_motions_in_degrees_are_doubted_unless_one_is_large_or_there_are_few_rows(
    run, tmp_path, unit, rows, other, doubted
):
    motion = 0.03 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
    lines = [f"{angle!r},{other * angle!r}" for angle in motion.tolist()]
    (tmp_path / "small.csv").write_text("\n".join([f"knee_{unit},hip_{unit}", *lines]))
    said = run("plan", "small.csv", "--method", "shift", "-o", "-").stderr
    doubt = "the angles span only 0.06 degrees: are they radians? then rename knee_deg to knee_rad"
    assert (doubt in said) is doubted


def test_an_error_below_its_own_bound_is_reported_and_nothing_is_written(run, desired, monkeypatch):
    monkeypatch.setattr("planner.planning.plan.Plan.lower_bounds", np.full(2, 0.5))
    result = run("plan", desired, "-o", "requests.csv")
    assert result.exit_code == 1
    assert "hip: an error of " in result.stderr
    assert "is below its own lower bound of 28.6479 deg; please report this" in result.stderr
    assert not desired.with_name("requests.csv").exists()


def test_a_page_goes_to_standard_output_when_asked(run, desired):
    result = run("plan", desired, "--method", "shift", "-o", "requests.csv", "--report", "-")
    assert result.stdout.startswith("<!doctype html>")
    assert {file.name for file in desired.parent.iterdir()} == {desired.name, "requests.csv"}


@pytest.mark.parametrize(("rate", "lost"), [(3, True), (50, False)])
def test_a_motion_that_a_low_rate_loses_is_said(run, tmp_path, rate, lost):
    """At 3 requests a second a motion of 3 Hz has the same angle at every request."""
    seconds = 0.008 * np.arange(251)
    rows = [f"{t:.3f},{20.0 * math.sin(6.0 * math.pi * t):.6f}" for t in seconds]
    (tmp_path / "fast.csv").write_text("\n".join(["time_s,knee_deg", *rows]) + "\n")
    result = run("plan", tmp_path / "fast.csv", "--rate-hz", rate, "-o", tmp_path / "r.csv")
    assert result.exit_code == 0
    said = re.search(r"path of knee is missed by (\d+) % of its motion", result.stderr)
    assert ("errors are those from the path that is left" in result.stderr) == (said is not None)
    assert (said is not None and int(said[1]) >= 99) == lost
