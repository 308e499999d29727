"""What `request-planner fit` can be asked for beyond a number of lines."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest


def joint(result, name):
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)["joints"][name]


def test_fit_keeps_an_rms_error(run, desired):
    answer = joint(run("fit", desired, "--max-rms", "0.5", "--json"), "hip")
    assert answer["rms_deg"] <= 0.5
    fewer = str(answer["segments"] - 1)
    assert joint(run("fit", desired, "--segments", fewer, "--json"), "hip")["rms_deg"] > 0.5


def test_fit_puts_knots_where_they_are_required_at_the_angle_given(run, desired):
    asked = ["--required-s", "0.08=3", "--required-s", "0.4", "--segments", "6", "--json"]
    answer = joint(run("fit", desired, *asked, "--joint", "hip"), "hip")
    assert {10.0, 50.0} <= set(answer["knots"])
    assert answer["values_deg"][answer["knots"].index(10.0)] == pytest.approx(3.0, abs=1e-9)


def test_fit_keeps_the_shortest_duration_and_the_samples(run, desired):
    asked = ["--shortest-s", "0.04", "--on-samples", "--segments", "8", "--json"]
    knots = np.array(joint(run("fit", desired, *asked), "knee")["knots"])
    assert np.min(np.diff(np.append(knots, knots[0] + 88))) >= 5.0
    assert np.array_equal(knots, np.round(knots))


def test_fit_takes_all_knots_as_given(run, desired):
    asked = [part for time in ("0.1", "0.3", "0.52") for part in ("--knot-s", time)]
    answer = joint(run("fit", desired, *asked, "--json"), "knee")
    np.testing.assert_allclose(answer["knots"], [12.5, 37.5, 65.0], atol=1e-9)


def test_fit_meets_the_ends_of_a_path(run, desired):
    asked = ["--no-cyclic", "--start-deg", "1", "--end-deg", "-2", "--joint", "hip", "--json"]
    answer = joint(run("fit", desired, *asked), "hip")
    assert answer["values_deg"][0] == pytest.approx(1.0, abs=1e-9)
    assert answer["values_deg"][-1] == pytest.approx(-2.0, abs=1e-9)


def test_fit_weighs_samples_by_a_column_or_by_a_file(run, desired, tmp_path):
    header, *rows = desired.read_text().splitlines()
    weights = [100.0 if 20 <= k < 30 else 1.0 for k in range(88)]
    both = tmp_path / "both.csv"
    lines = [f"{row},{weight}" for row, weight in zip(rows, weights, strict=True)]
    both.write_text("\n".join([f"{header},care", *lines]))
    alone = tmp_path / "alone.csv"
    alone.write_text("\n".join(["weight", *map(str, weights)]))
    plain = joint(run("fit", desired, "--segments", "4", "--json"), "hip")
    column = run("fit", both, "--segments", "4", "--weights", "care", "--json")
    assert set(json.loads(column.stdout)["joints"]) == {"hip", "knee"}
    file = run("fit", desired, "--segments", "4", "--weights", alone, "--json")
    assert joint(column, "hip") == joint(file, "hip")
    angles = np.degrees(0.4 * np.sin(2.0 * np.pi * np.arange(88) / 88))[20:30]
    careful, careless = (
        np.max(np.abs(np.array(each["angles_deg"])[20:30] - angles))
        for each in (joint(column, "hip"), plain)
    )
    assert careful < 0.5 * careless


def test_fit_refuses_weights_that_are_none(run, desired, tmp_path):
    result = run("fit", desired, "--weights", "care")
    assert result.exit_code == 2
    assert "--weights: got 'care', expected a column" in result.stderr
    result = run("fit", desired, "--weights", desired)
    assert result.exit_code == 2
    assert "expected one of weights" in result.stderr
    (tmp_path / "short.csv").write_text("weight\n1\n2\n")
    result = run("fit", desired, "--weights", "short.csv")
    assert result.exit_code == 2
    assert "weights: got 2, expected 88, one per sample" in result.stderr


def test_fit_proves_its_answer_on_request(run, desired):
    proved = joint(run("fit", desired, "--segments", "4", "--exact", "--json"), "hip")
    sought = joint(run("fit", desired, "--segments", "4", "--on-samples", "--json"), "hip")
    assert proved["rms_deg"] <= sought["rms_deg"] * (1.0 + 1e-6)


def test_fit_writes_the_knots_of_a_joint(run, desired, tmp_path):
    result = run("fit", desired, "--joint", "hip", "--knots", "knots.csv", "-o", "angles.csv")
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "knots.csv").read_text().startswith("knot_s,value_deg\n")


@pytest.mark.parametrize(("name", "start"), [("fit.svg", b"<?xml"), ("fit.png", b"\x89PNG")])
def test_fit_draws_its_lines(run, desired, tmp_path, name, start):
    result = run("fit", desired, "--segments", "4", "--joint", "hip", "--figure", name, "-o", "a")
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["--max-rms", "0"], "--max-rms: got '0', expected more than 0 degrees"),
        (["--shortest-s", "-1"], "--shortest-s: got '-1', expected more than 0 seconds"),
        (["--required-s", "soon"], "--required-s: got 'soon', expected seconds"),
        (["--required-s", "0.1=up"], "--required-s: got '0.1=up'"),
        (["--figure", "fit.pdf"], "--figure: got 'fit.pdf', expected a name that ends in"),
        (["--knots", "k.csv"], "--knots writes one joint, got hip, knee"),
        (["--start-deg", "3"], "--start-deg: a cycle has no ends; add --no-cyclic"),
        (["--required-s", "0=0", "--required-s", "0.016=90"], "got a slope of"),
        (["--exact"], "--exact: expected segments or --max-rms"),
    ],
)
def test_what_fit_cannot_do_is_one_line_and_status_2(run, desired, asked, message):
    result = run("fit", desired, *asked)
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_verbose_says_what_the_solver_of_the_values_reports(run, desired):
    said = run("fit", desired, "--joint", "hip", "--segments", "20", "--verbose").stderr
    line = r"^request-planner: values at \d+ knots: OSQP says solved\b.* after \d+ iterations$"
    assert re.search(line, said, re.MULTILINE), said
