"""From a log to a model file, a page and a plan, at the command line."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from planner import JointModel, read_logs, simulate
from planner.files.joint_model import models_text, read_model_file
from planner.files.paths import read_joint_path
from planner.files.table import write_table
from planner.identification.excitation import excite
from planner.model.evidence import Evidence
from planner.robot.arm import Servo

TRUE = JointModel.ers210a()
NOISE = math.radians(0.1)  # standard deviation of the angles in the log [rad]


def write_log(file, *, joints=("knee",), model=TRUE, moving=9, duration=8.0):
    """Step tests of each joint, at the model's rate, so many seconds; some first ones move."""
    signal = excite("steps", limits=(-0.6, 0.6), period=model.period, duration=duration)
    draw = np.random.default_rng(11)
    names, columns = ["t_s"], [signal.times]
    for joint in joints:
        angles = simulate(model, signal.requests, cyclic=False)
        names += [f"{joint}_requested_deg", f"{joint}_actual_deg"]
        columns += [signal.requests, angles + NOISE * draw.standard_normal(len(angles))]
    table = np.column_stack(columns)
    table[:, 1:] = np.degrees(table[:, 1:])
    table[:, 1 + 2 * moving :] = 0.0
    write_table(file, names, table)


def test_a_model_that_does_not_fit_is_written_and_ends_with_status_1(run, tmp_path):
    draw = np.random.default_rng(2)
    times = 0.02 * np.arange(300)
    requests = np.repeat(draw.uniform(-40.0, 40.0, 10), 30)
    elsewhere = np.repeat(draw.uniform(-40.0, 40.0, 15), 20)  # another joint's angles
    write_table(
        "wrong.csv",
        ["t_s", "requested_deg", "actual_deg"],
        np.column_stack([times, requests, elsewhere]),
    )
    result = run("identify", "wrong.csv", "-o", "wrong.toml", "--report", "wrong.html")
    assert result.exit_code == 1
    assert "THE MODEL DOES NOT FIT" in result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("request-planner: do not plan with the model of the joint (it misses ")
    assert last.endswith("); written all the same")
    assert "DOES NOT FIT" in (tmp_path / "wrong.toml").read_text()
    assert "not identified" in (tmp_path / "wrong.html").read_text()


def test_joints_are_identified_alike_in_processes_and_one_that_says_nothing_is_left_out(
    run, tmp_path, monkeypatch
):
    write_log("arm.csv", joints=("hip", "knee", "toe"), moving=2, duration=4.0)
    answers = []
    for few in (0, 10_000):
        monkeypatch.setattr("planner.cli.identify.FEW_ROWS", few)
        result = run("identify", "arm.csv", "--joint", "all", "-o", f"{few}.toml")
        assert result.exit_code == 2, "as of toe alone"
        answers.append(result.stderr.replace(f"{few}.toml", "arm.toml"))
    assert answers[0] == answers[1]
    assert "warning: toe is left out: " in answers[0]
    assert answers[0].endswith("request-planner: no model of toe; the others are written\n")
    assert (tmp_path / "0.toml").read_text() == (tmp_path / "10000.toml").read_text()
    assert list(read_model_file(tmp_path / "0.toml").models) == ["hip", "knee"]
    alone = run("identify", "arm.csv", "--joint", "toe")
    assert (alone.exit_code, alone.stdout) == (2, "")


def tables_of(file):
    return tomllib.loads(Path(file).read_text())


def test_a_model_file_that_is_replaced_keeps_all_but_the_model_of_the_joint(run):
    write_log("knee.csv")
    other = JointModel(v_max=3.0, theta_0=0.3, lag=0.01, acceleration_time=0.02)
    servos = {"hip": Servo(id=1), "knee": Servo(id=2, zero_tick=2000, settings={"p_gain": 16})}
    old = other.with_evidence(Evidence(error=0.1, verdict="refused", reason="it is old"))
    models = {"hip": other, "knee": old}
    leg = '[leg.left]\nurdf = "leg.urdf"\nbase = "hip"\nfoot = "foot"\n'
    Path("arm.toml").write_text(models_text(models, servos=servos, bus={"bus": "virtual"}) + leg)
    before = tables_of("arm.toml")
    for more in ((), ("--joint", "all")):
        result = run("identify", "knee.csv", "-o", "arm.toml", *more)
        assert result.exit_code == 0, result.stderr
        assert "arm.toml: the models of hip stay" in result.stderr
        after = tables_of("arm.toml")
        assert {**after, "knee": 0} == {**before, "knee": 0}
        assert after["knee"]["servo"] == before["knee"]["servo"]
        assert after["knee"]["v_max"] == pytest.approx(TRUE.v_max, rel=0.02)
        assert after["knee"]["verdict"] == "holds"
        assert after["knee"]["verdict_reason"] != "it is old"


def test_a_model_for_any_joint_keeps_the_name_of_its_own_beside_another_joint(run):
    for joint in ("knee", "hip"):
        write_log(f"{joint}.csv", joints=(joint,))
    for _ in range(2):
        assert run("identify", "knee.csv", "-o", "arm.toml").exit_code == 0
        assert read_model_file("arm.toml").joint == "knee"
    knee = read_model_file("arm.toml").for_joints(["toe"])
    result = run("identify", "hip.csv", "-o", "arm.toml")
    assert "arm.toml: the models of knee stay" in result.stderr
    after = read_model_file("arm.toml")
    assert list(after.models) == ["knee", "hip"]
    assert after.for_joints(["knee"]) == knee


def test_a_signal_for_a_joint_in_shares_is_in_percent_of_its_range(run, tmp_path):
    model = JointModel(v_max=2.0, theta_0=0.2, lag=0.03, acceleration_time=0.04, tick=0.02)
    model.with_evidence(Evidence(unit="range")).to_toml(tmp_path / "jaw.toml")
    asked = ("--kind", "steps", "--limits-deg", "10:90", "--duration-s", "8", "--joint", "jaw")
    files = ("-o", "test.csv", "--expected-log", "log.csv")
    result = run("excite", *asked, "--model", "jaw.toml", *files, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["centre_percent"] == pytest.approx(50.0)
    assert document["amplitudes_percent"] == pytest.approx([10.0, 40.0, 80.0])
    assert document["expected"]["model"]["v_max"] == pytest.approx(2.0, rel=0.02)
    (log,) = read_logs([str(tmp_path / "log.csv")])
    assert log.unit == "1"
    path = read_joint_path(tmp_path / "test.csv")
    assert path.units == ("percent",)
    assert np.degrees(path.values[:, 0]) == pytest.approx(100.0 * log.requests)
    again = run("excite", *asked, "--model", "jaw.toml", "-o", "test.csv")
    assert "begins and ends at 50 % of range" in again.stderr


def test_angles_that_may_be_radians_are_a_warning_with_the_advice_unless_a_joint_moves_far(
    run, tmp_path
):
    times = 0.02 * np.arange(100.0)
    angles = np.sin(3.0 * times), np.sin(3.0 * times - 0.1)
    names = [f"{joint}_{what}_deg" for joint in "ab" for what in ("requested", "actual")]
    advice = "are they radians? then rename the column, or give --unit rad where it has no unit"
    for factor, warned in ((1.0, True), (60.0, False)):
        columns = [times, *angles, *(factor * each for each in angles)]
        write_table(tmp_path / "log.csv", ["t_s", *names], np.column_stack(columns))
        told = run("identify", "log.csv", "--joint", "all", "-o", "m.toml").stderr
        assert advice in told
        assert ("warning: log.csv (a)" in told) == warned
