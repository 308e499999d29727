"""Sweeps: points that are planned as their run files are, and the front of speed and error."""

import csv
import itertools
import json
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest

import planner
from kinematics import urdf_path
from planner.cli.points import planned_points, read_sweep
from planner.evaluation.pareto_front import Outcome, Requirement, Swept
from planner.files.paths import write_joint_path
from planner.files.results import Results
from planner.report.sweep_page import verdict
from tests.parallel.work import InThisProcess

GAIT = """
[leg]
name = "reference"

[path.half_ellipse]
samples = 40
forward = 0.03
hip_height = 0.09
height = 0.01

[plan]
method = "optimal"

[sweep.parameters]
"""


@pytest.fixture
def space(tmp_path):

    def space(text):
        (tmp_path / "sweep.toml").write_text(text)
        return read_sweep(str(tmp_path / "sweep.toml"))

    return space


@pytest.fixture
def swept(space, tmp_path):
    """What a sweep file comes to, and how many points were planned."""

    def swept(text):
        executor, results = InThisProcess(), Results(tmp_path / "results", {})
        made = planned_points(space(text), results, executor, progress=lambda _: None)
        return made, executor.ran

    return swept


def test_the_slowest_joint_of_a_point_is_the_one_that_would_have_to_be_fastest(swept, tmp_path):
    phase = 2.0 * np.pi * np.arange(40) / 40
    angles = np.column_stack([0.05 * np.sin(phase), np.sin(phase)])
    write_joint_path(tmp_path / "path.csv", ["hip", "knee"], angles, period=0.008)
    made, _ = swept('path = { file = "path.csv" }\n[sweep.parameters]\nspeed = [1.0, 1.5]\n')
    assert [each.slowest for each in made.outcomes] == ["knee", "knee"]


def test_errors_are_in_the_unit_of_the_joints_that_are_planned(space, tmp_path):
    (tmp_path / "path.csv").write_text("hip_deg,jaw_percent\n0,50\n1,51\n")
    for joints, unit in (('["hip"]', "deg"), ('["jaw"]', "percent"), ("[]", "deg_or_percent")):
        path = f'path = {{ file = "path.csv", joints = {joints} }}'
        text = f"{path}\n[sweep.parameters]\nspeed = [1.0, 1.5]\n"
        assert space(text).swept.error_unit == unit


def test_the_speed_of_a_gait_is_twice_its_length_in_its_time_on_the_ground(swept):
    made, _ = swept(GAIT + "length = [0.02]\nground_fraction = [0.5, 0.75]\n")
    for outcome, fraction in zip(made.outcomes, (0.5, 0.75), strict=True):
        assert outcome.speed == pytest.approx(100.0 * 0.04 / (fraction * 40 * 0.008), rel=1e-9)


def test_periods_are_rounded_to_whole_requests(space):
    rounded = space(GAIT + "period_s = [0.4, 0.5]\n")
    for samples in range(20, 130):
        (period,) = rounded.point([samples * 0.008 + 0.003 * (-1.0) ** samples])
        assert period == pytest.approx(samples * 0.008, abs=1e-12)
        content = rounded.content((period,))
        assert content["path"]["half_ellipse"]["samples"] == samples


SOUGHT = GAIT.replace("height = 0.01\n", "") + (
    "length = [0.01, 0.04]\nheight = [0.01, 0.05]\n[sweep]\nmethod = 'cma'\n"
)


def known(argument):
    """Points whose best are known: speed 10 + 30 x, error 0.05 + x^2 + (y - 0.4)^2."""
    walk = argument[0]["path"]["half_ellipse"]
    x, y = (walk["length"] - 0.01) / 0.03, (walk["height"] - 0.01) / 0.04
    assert 0.0 <= x <= 1.0
    assert 0.0 <= y <= 1.0
    said = {"speed": 10.0 + 30.0 * x, "error": 0.05 + x**2 + (y - 0.4) ** 2}
    return json.dumps({"reason": "too high"} if y > 0.8 else said).encode()


@pytest.fixture
def sought(swept, monkeypatch):
    """Search where the best points are known."""
    pytest.importorskip("cma", reason="needs the extra sweep")
    monkeypatch.setattr("planner.cli.points.evaluate", known)
    return lambda more: swept(SOUGHT + more)


def test_a_search_finds_the_fastest_within_an_error_and_the_least_error_of_a_speed(sought):
    fastest, ran = sought("evaluations = 80\nat_error_cm = 0.3\n")
    assert len(fastest.outcomes) == ran
    assert 70 < ran <= 80
    assert 24.0 < fastest.best.speed < 25.0 + 1e-6
    least, _ = sought("evaluations = 80\nat_speed_cm_s = 25\n")
    assert 0.3 - 1e-6 < least.best.error < 0.33


def test_the_front_has_no_point_that_another_beats_in_both():
    rng = np.random.default_rng(2)
    outcomes = tuple(Outcome((float(k),), *rng.random(2)) for k in range(60))
    outcomes = (*outcomes, Outcome((60.0,), reason="none"))
    made = Swept("a.toml", ("length",), outcomes, "cm/s", "cm", Requirement("speed", 0.5))
    for each in made.front:
        assert not any(other.speed >= each.speed and other.error < each.error for other in outcomes)
    beaten = [each for each in outcomes if each.planned and each not in made.front]
    for each in beaten:
        assert any(o.speed >= each.speed and o.error <= each.error for o in made.front)
    assert list(made.front) == sorted(made.front, key=lambda each: each.speed)


def test_the_nearest_point_is_told_where_none_meets_what_is_required():
    outcomes = tuple(
        Outcome((float(k),), speed, error)
        for k, (speed, error) in enumerate([(1.0, 0.2), (2.0, 0.9), (2.0, 0.6), (3.0, 1.5)])
    )
    swept = Swept("a.toml", ("length",), outcomes, "cm/s", "cm", Requirement("speed", 1.0))
    assert [each.point for each in swept.front] == [(0.0,), (2.0,), (3.0,)]
    assert verdict(swept).startswith("The best point with at least 1 cm/s has 1 cm/s at 0.2 cm:")
    ends = "3 points on the front: from 1 cm/s at 0.2 cm to 3 cm/s at 1.5 cm"
    assert verdict(replace(swept, requirement=None)) == ends
    swept = replace(swept, requirement=Requirement("error", 2.0))
    assert verdict(swept).startswith("The best point with at most 2 cm has 3 cm/s at 1.5 cm:")
    swept = replace(swept, requirement=Requirement("error", 0.1))
    assert verdict(swept) == "No point has at most 0.1 cm: the nearest has 1 cm/s at 0.2 cm"
    swept = replace(swept, requirement=Requirement("speed", 4.0))
    assert verdict(swept) == "No point has at least 4 cm/s: the nearest has 3 cm/s at 1.5 cm"


def test_the_command_of_a_point_gives_its_error(tmp_path, run):
    (tmp_path / "gaits.toml").write_text(GAIT + "length = [0.02, 0.03]\nperiod_s = [0.4, 0.6]\n")
    result = run("sweep", "gaits.toml", "--json", "--workers", "1")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    with (tmp_path / "gaits" / "points.csv").open() as stream:
        table = {int(row["point"]): row for row in csv.DictReader(stream)}
    assert [int(row["point"]) for row in table.values() if row["on_front"] == "True"]
    assert len(document["commands"]) == len(document["front"]) >= 2
    for number, command in document["commands"].items():
        again = run(*shlex.split(command)[1:], "--json")
        assert again.exit_code == 0, again.stderr
        found = json.loads(again.stdout)["foot"]["rms_cm"]
        assert found == pytest.approx(float(table[int(number)]["error_cm"]), rel=1e-12)
    assert (tmp_path / "gaits" / "report.html").exists()
    assert not (tmp_path / ".gaits.results").exists()


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_that_is_complete_is_resumed_without_a_plan_unless_it_has_changed(
    tmp_path, monkeypatch, run
):
    file = tmp_path / "gaits.toml"
    file.write_text(GAIT + "length = [0.02, 0.2]\n[sweep]\nat_error_cm = 1e-9\n")
    words = ("sweep", "gaits.toml", "--json", "--workers", "1")
    first = run(*words)
    missed = json.loads(first.stdout)["missed"]
    assert first.stderr == f"request-planner: {missed}; the files are written all the same\n"
    again = run(*words)
    assert (again.exit_code, again.stdout, again.stderr) == (1, first.stdout, first.stderr)
    with monkeypatch.context() as patch:
        patch.setattr("planner.cli.points.planned_points", None)
        again = run(*words, "--resume")
    said = "request-planner: nothing is missing: gaits holds all 2 points, planned like this\n"
    assert (again.exit_code, again.stdout, again.stderr) == (1, first.stdout, said + first.stderr)
    file.write_text(GAIT + "length = [0.02, 0.03, 0.2]\n")
    other = run(*words, "--resume")
    assert (len(json.loads(other.stdout)["points"]), other.stderr) == (3, "")


def test_outcomes_depend_on_the_content_of_all_files(tmp_path):
    walk = "[path.half_ellipse]\n[sweep.parameters]\nlength = [0.03]\n"
    text = '[leg]\nname = "r.urdf"\nbase = "hip"\nfoot = "foot"\n[model]\nfile = "all.toml"\n'
    (tmp_path / "s.toml").write_text(f"{text}{walk}")
    shutil.copy(urdf_path("reference_leg.urdf"), tmp_path / "r.urdf")
    planner.JointModel.ers210a().to_toml(tmp_path / "all.toml")
    seen = [read_sweep(str(tmp_path / "s.toml")).inputs()]
    for name in ("r.urdf", "all.toml"):
        with (tmp_path / name).open("a") as file:
            file.write("\n")
        seen.append(read_sweep(str(tmp_path / "s.toml")).inputs())
    assert all(one != other for one, other in itertools.pairwise(seen))
    with (tmp_path / "s.toml").open("a") as file:
        file.write("[sweep]\nat_error_cm = 1\n")
    assert read_sweep(str(tmp_path / "s.toml")).inputs() == seen[-1]


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_is_resumed_whatever_has_become_of_its_files(tmp_path, monkeypatch, run):
    """A kept result that is damaged, what a killed repeat left, and a damaged answer."""
    (tmp_path / "gaits.toml").write_text(GAIT + "length = [0.02, 0.03]\n")
    words = ("sweep", "gaits.toml", "--json", "--resume", "--workers", "1")

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("planner.cli.run.write_sweep", killed)
        assert run(*words).exit_code == 130
        fresh = run("sweep", "gaits.toml", "--workers", "1")
        assert "2 results of an earlier sweep removed; --resume keeps them" in fresh.stderr
    left = tmp_path / ".gaits.results"
    for kept, damage in zip(sorted(left.glob("??/*")), (b"", b"{}"), strict=True):
        kept.write_bytes(damage)
    first = run(*words)
    assert (first.exit_code, first.stderr.count("Traceback")) == (0, 0)
    answer = tmp_path / "gaits" / "results.json"
    answer.write_text(answer.read_text().replace('"points"', '"joints"'))
    again = run(*words)
    assert (again.exit_code, again.stdout) == (0, first.stdout)
    assert "nothing is missing" not in again.stderr
    left.mkdir()
    assert run(*words).stdout == first.stdout
    assert sorted(file.name for file in tmp_path.iterdir()) == ["gaits", "gaits.toml"]
