"""`plan` for the foot, from where a joint rests, and against a tolerance."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.files.paths import read_joint_path, write_joint_path
from planner.model.evidence import Evidence

JOINT = planner.JointModel.ers210a()
REFERENCE = ("--leg", "reference", "--unreachable", "clamp", "--method", "foot-optimal")


@pytest.fixture(scope="module")
def walk():
    return planner.reference_walk()


@pytest.mark.parametrize(
    ("more", "words"), [(("--norm", "max"), "at most"), (("--weights", 1, 1, 2), "rms as weighted")]
)
def test_the_bound_of_a_foot_is_told_in_its_norm_and_as_weighted(
    run, foot, monkeypatch, more, words
):
    monkeypatch.setattr("planner.planning.plan.Plan.lower_bounds", np.array([1e-6]))
    ask = ("plan", foot, "--leg", "front-left", "--method", "foot-optimal", "-o", "out.csv")
    assert f"no requests within the limits bring it below 0.000 cm {words}: the plan is" in (
        run(*ask, *more).stderr
    )


@pytest.mark.parametrize(
    "limits",
    [
        ("--max-step-deg", 0.9),
        ("--max-step-deg", 0.9, "--max-request-speed-deg-s", 1000),
        ("--max-step-deg", 8, "--max-request-speed-deg-s", 112.5),
    ],
)
@pytest.mark.parametrize("method", ["optimal", "foot-optimal"])
def test_the_smaller_limit_on_steps_is_kept_by_joints_and_feet(
    run, foot, method, limits, monkeypatch
):
    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 0)
    ask = ("plan", foot, "--leg", "front-left", "--method", method, *limits)
    assert run(*ask, "-o", "requests.csv").exit_code == 0
    requests = np.degrees(read_joint_path("requests.csv").angles)
    steps = np.abs(np.diff(requests, axis=0, append=requests[:1]))
    assert 0.85 < np.max(steps) <= 0.9 * (1.0 + 1e-9)


def test_every_joint_keeps_its_own_model_at_another_rate(run, desired):
    JOINT.to_toml("models.toml")
    with Path("models.toml").open("a") as file:
        file.write("[knee]\nlag = 0.06\n")
    ask = ("plan", desired, "--model", "models.toml", "--rate-hz", 62.5, "--json")
    both, knee = (json.loads(run(*ask, *words).stdout) for words in ((), ("--joint", "knee")))
    assert both["joints"]["knee"] == knee["joints"]["knee"]
    assert both["period_s"] == 0.016


def test_a_tolerance_of_the_foot_is_of_the_norm_that_is_planned_for(run):
    leg = ("--leg", "reference", "--unreachable", "clamp", "--method", "optimal", "--norm", "max")
    ask = ("plan", "-", *leg, "--tolerance-cm", 0.5, "--json", "-o", "out.csv")
    result = run(*ask, stdin=run("gait").stdout)
    assert result.exit_code == 1
    largest = json.loads(result.stdout)["foot"]["max_cm"]
    assert f"the foot is off by {largest:.4g} cm (max), expected at most 0.5" in result.stderr


def test_joints_of_other_ticks_that_are_requested_at_one_rate_are_planned(run, desired):
    JOINT.to_toml("models.toml")
    with Path("models.toml").open("a") as file:
        file.write("[knee]\ntick = 0.004\nhold = 2\n")
    result = run("plan", desired, "--model", "models.toml", "-o", "requests.csv")
    assert result.exit_code == 0, result.stderr


@pytest.mark.parametrize(
    ("unit", "rows", "other", "doubted"),
    [
        ("deg", 88, 1.0, True),
        ("rad", 88, 1.0, False),
        ("deg", 88, 500.0, False),
        ("deg", 10, 1.0, True),
        ("deg", 9, 1.0, False),
        ("deg", 88, 0.0, True),
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


def test_uneven_times_are_resampled_for_another_rate_or_speed_and_else_refused(run, tmp_path):
    times = np.cumsum(np.tile([0.008, 0.012], 20))
    rows = [f"{t:.3f},{10.0 * math.sin(15.0 * t):.4f}" for t in times]
    (tmp_path / "uneven.csv").write_text("\n".join(["t_s,knee_deg", *rows]))
    ask = ("plan", "uneven.csv", "--method", "shift", "-o", "out.csv")
    answers = [run(*ask, *more).exit_code for more in ((), ("--speed", 1), ("--rate-hz", 125))]
    assert answers == [2, 0, 0]


def test_an_error_below_its_own_bound_is_reported_and_nothing_is_written(run, desired, monkeypatch):
    monkeypatch.setattr("planner.planning.plan.Plan.lower_bounds", np.full(2, 0.5))
    result = run("plan", desired, "-o", "requests.csv")
    assert result.exit_code == 1
    assert "hip: an error of " in result.stderr
    assert "is below its own lower bound of 28.6479 deg; please report this" in result.stderr
    assert not desired.with_name("requests.csv").exists()


@pytest.fixture
def uncertain(tmp_path):
    """A model that may be slower, as a file."""
    known = Evidence(intervals={"v_max": (4.0, 5.6), "lag": (0.03, 0.034)})
    JOINT.with_evidence(known).to_toml(tmp_path / "uncertain.toml")
    return tmp_path / "uncertain.toml"


def test_a_robust_plan_for_the_foot_tells_the_errors_of_the_foot_over_the_models(
    run, walk, uncertain, monkeypatch
):
    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 0)
    foot = walk.desired_foot[::4]
    rows = "\n".join(["x_m,y_m,z_m", *(",".join(map(repr, row)) for row in foot.tolist())])
    ask = ("plan", "-", *REFERENCE, "--model", uncertain, "--robust", "mean", "-o", "out.csv")
    document = json.loads(run(*ask, "--json", stdin=rows).stdout)
    library = planner.invert_foot(planner.read_models(uncertain)[""], walk.leg, foot, robust="mean")
    assert document["robust"] == "mean"
    assert {joint["over_models"] for joint in document["joints"].values()} == {None}
    for name, made in (("robust_plan", library), ("nominal_plan", library.nominal)):
        told = document["foot"]["over_models"][name]
        assert told["of_each_cm"] == pytest.approx(100.0 * made.errors_of_models, abs=1e-9)
        assert told["nominal_cm"] == pytest.approx(100.0 * made.error, abs=1e-9)
        assert told["mean_cm"] == pytest.approx(100.0 * made.over_models.mean, abs=1e-9)
        assert told["worst_cm"] == pytest.approx(100.0 * made.over_models.worst, abs=1e-9)
    text = run(*ask, stdin=rows).stderr
    assert "rms errors over the nominal model and 8 drawn from its intervals:\nplan  " in text
    for kind, made in (("mean", library), ("nominal model", library.nominal)):
        row = next(line for line in text.splitlines() if line.startswith(f"foot, for the {kind}"))
        assert row.split()[-3:] == [f"{100.0 * error:.3f}" for error in made.over_models]


def test_joints_in_shares_of_their_range_are_answered_in_percent(run, tmp_path):
    model = planner.JointModel(v_max=1.1, theta_0=0.11, lag=0.03, acceleration_time=0.05)
    model.to_toml(tmp_path / "jaw.toml")
    shares = 0.5 + 0.1 * np.sin(2.0 * np.pi * np.arange(80) / 80)
    np.savetxt(tmp_path / "jaw.csv", shares, header="jaw_range", comments="")
    arguments = ("--model", tmp_path / "jaw.toml", "-o", tmp_path / "out.csv")
    # Unsmoothed: smoothing allows for an encoder's step, which is an angle and not a share.
    asked = run("plan", tmp_path / "jaw.csv", *arguments, "--smoothness", 0, "--json")
    assert asked.exit_code == 0, asked.stderr
    library = planner.invert_optimal(model, shares, smoothness=0.0)
    jaw = json.loads(asked.stdout)["joints"]["jaw"]
    assert jaw["rms_percent"] == pytest.approx(100.0 * library.rms, abs=1e-3)
    assert jaw["lower_bound_percent"] == pytest.approx(100.0 * library.lower_bound, abs=1e-3)
    assert (tmp_path / "out.csv").read_text().startswith("t_s,jaw_range\n")
    known = model.with_evidence(Evidence(intervals={"v_max": (1.0, 1.2), "lag": (0.02, 0.04)}))
    known.to_toml(tmp_path / "known.toml")
    robust = ("--model", tmp_path / "known.toml", "--robust", "mean")
    drawn = run("plan", tmp_path / "jaw.csv", *robust, "--smoothness", 0, "--json").stdout
    told = json.loads(drawn)["joints"]["jaw"]["over_models"]["nominal_plan"]["of_each_percent"]
    errors = planner.invert_optimal(known, shares, smoothness=0.0, robust="mean").nominal
    assert told == pytest.approx(100.0 * errors.errors_of_models, abs=1e-3)
    beyond = run("plan", tmp_path / "jaw.csv", *arguments, "--limits-deg", "0:55")
    assert re.search(r"jaw: desired: sample 20 is 60 percent, 5 percent beyond", beyond.stderr)


@pytest.mark.parametrize(
    ("most", "size", "said"), [("inf", 40.0, True), ("1.2", 40.0, False), ("inf", 5.0, False)]
)
def test_bounds_of_a_path_above_an_unknown_top_speed_are_of_the_model_only(
    run, tmp_path, most, size, said
):
    model, page = tmp_path / "joint.toml", tmp_path / "page.html"
    model.write_text(
        "v_max = 1.0\ntheta_0 = 0.1\nlag = 0.02\nacceleration_time = 0.05\ntick = 0.02\n"
        f"expected_error = 0.002\nv_max_interval = [1.0, {most}]\n"
    )
    desired = size * np.sin(2.0 * np.pi * np.arange(50) / 50.0)
    path = "elbow_deg\n" + "".join(f"{angle}\n" for angle in desired)
    output = ("-o", tmp_path / "r.csv", "--report", page)
    done = run("plan", "-", "--model", model, *output, stdin=path)
    assert (
        "lower bounds of the model only: elbow (the logs do not determine" in done.stderr
    ) == said
    assert ("For elbow this holds for the model only" in page.read_text()) == said


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


def test_a_blank_line_stands_between_two_tables_and_not_between_the_parts_of_one(
    run, desired, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "60")
    result = run("plan", desired, "-o", "out.csv")
    joints, requests = result.stderr.split("\n\n")
    assert "requests  " not in joints
    assert "reversals/s" in requests
    assert "outside desired [deg]" in requests
    assert requests.count("requests  ") == 2


def test_a_path_of_some_joints_of_a_leg_has_their_limits_and_no_foot(run, tmp_path):
    angles = np.radians([[0.0, 40.0]] * 10)
    write_joint_path(tmp_path / "two.csv", ["rotator", "knee"], angles, period=0.008)
    result = run("plan", "two.csv", "--leg", "reference", "--report", "page.html", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["foot"] is None
    assert 'id="leg"' not in (tmp_path / "page.html").read_text()
