"""From a log to a model file, a page and a plan, at the command line."""

from __future__ import annotations

import io
import json
import math
import os
import re
import shutil
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from planner.cli import cli
from planner.files.joint_model import models_text, read_model_file
from planner.files.paths import read_joint_path, write_joint_path
from planner.files.table import write_table
from planner.identification.excitation import excite
from planner.model.evidence import Evidence
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.robot.arm import Servo

TRUE = JointModel.ers210a()

NOISE = math.radians(0.1)
"""Standard deviation of the angles in the log [rad]."""

CLOSE = {"v_max": 0.02, "theta_0": 0.15, "lag": 0.15, "acceleration_time": 0.15}
"""How far estimates from eight seconds may be from the truth [share]; only that they are its."""


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


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """A folder with a log, the model and the page made of it, and what was said."""
    folder = tmp_path_factory.mktemp("identified")
    write_log(folder / "log.csv")
    result = CliRunner().invoke(
        cli,
        [
            "identify",
            str(folder / "log.csv"),
            "-o",
            str(folder / "joint.toml"),
            "--report",
            str(folder / "report.html"),
        ],
    )
    return folder, result


def test_plan_takes_the_model_that_identify_wrote(identified, run, desired, tmp_path):
    folder, _ = identified
    model = folder / "joint.toml"
    result = run("plan", desired, "--model", model, "-o", tmp_path / "requests.csv", "--json")
    assert result.exit_code == 0, result.stderr
    requests = np.radians(json.loads(result.stdout)["joints"]["hip"]["requests_deg"])
    wanted = read_joint_path(desired, joints=["hip"]).angles[:, 0]
    direct = simulate(TRUE, wanted) - wanted
    planned = simulate(TRUE, requests) - wanted  # on the true joint, not on the identified one
    assert np.sqrt(np.mean(planned**2)) < 0.1 * np.sqrt(np.mean(direct**2))


def test_the_same_log_gives_the_same_file(identified, run):
    folder, _ = identified
    again = run("identify", folder / "log.csv")
    assert again.stdout == (folder / "joint.toml").read_text()
    shutil.copy(folder / "log.csv", "copy.csv")
    options = ("--joint", "all", "--no-hold-out", "--report", "page.html")
    named = run("identify", folder / "log.csv", "copy.csv", *options)
    assert "\n[knee]\n" in named.stdout
    page = Path("page.html").read_text()
    assert re.findall(r'<a href="[^"]*?(\w+\.csv)"', page) == ["log.csv", "copy.csv"]


def test_a_joint_that_says_nothing_is_left_out_of_all_and_ends_with_status_1(run, tmp_path):
    write_log("still.csv", joints=("hip", "knee", "toe"), moving=1)
    result = run("identify", "still.csv", "--joint", "all", "-o", "all.toml", "--no-hold-out")
    assert result.exit_code == 1
    assert "warning: knee is left out: " in result.stderr
    assert "warning: toe is left out: " in result.stderr
    assert result.stderr.endswith(
        "request-planner: no model of knee, toe; the others are written\n"
    )
    assert list(read_model_file(tmp_path / "all.toml").by_joint) == ["hip"]
    alone = run("identify", "still.csv", "--joint", "knee")
    assert alone.exit_code == 2
    assert alone.stdout == ""


def test_a_model_that_does_not_fit_is_written_and_ends_with_status_1(run, tmp_path):
    draw = np.random.default_rng(2)
    times = 0.02 * np.arange(600)
    requests = np.repeat(draw.uniform(-40.0, 40.0, 20), 30)
    elsewhere = np.repeat(draw.uniform(-40.0, 40.0, 30), 20)  # another joint's angles
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


def test_a_model_that_a_pure_delay_beats_is_not_accepted_and_its_file_says_why(run, tmp_path):
    times = 0.008 * np.arange(1200)
    requests = np.degrees(0.4 * np.sin(times**2 / 2.0) + 0.2 * np.sin(3.1 * times))
    late = np.concatenate([np.full(5, requests[0]), requests[:-5]])
    header = ["t_s", "requested_deg", "actual_deg"]
    write_table("late.csv", header, np.column_stack([times, requests, late]))
    result = run("identify", "late.csv", "-o", "late.toml", "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert (document["accepted"], document["verdict"]) == (False, "worse than a delay")
    reason = "the error of a pure delay is 0 % of its own on rows held out"
    assert f"do not plan with the model of the joint ({reason})" in result.stderr
    keys = tomllib.loads((tmp_path / "late.toml").read_text())
    assert (keys["verdict"], keys["verdict_reason"]) == ("worse than a delay", reason)


class Terminal(io.StringIO):
    """What is written on a terminal."""

    def isatty(self):
        return True


def test_the_table_of_many_joints_fits_a_terminal_of_80_columns(tmp_path, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    write_log(tmp_path / "arm.csv", joints=("hip", "knee"))
    with pytest.raises(SystemExit):
        cli.main(["identify", str(tmp_path / "arm.csv"), "--joint", "all", "-o", os.devnull])
    lines = terminal.getvalue().splitlines()
    tables = [line for line in lines if line.startswith(("joint  ", "hip  ", "knee  "))]
    assert len(tables) == 6
    assert max(map(len, tables)) <= 80
    assert "best delay" in tables[3]


def test_joints_identified_in_processes_are_those_identified_one_by_one(run, tmp_path, monkeypatch):
    write_log("arm.csv", joints=("hip", "knee", "toe"), moving=2, duration=4.0)
    answers = []
    for few in (0, 10_000):
        monkeypatch.setattr("planner.cli.identify.FEW_ROWS", few)
        result = run("identify", "arm.csv", "--joint", "all", "-o", f"{few}.toml")
        assert result.exit_code == 1
        assert "warning: toe is left out: " in result.stderr
        answers.append(result.stderr.replace(f"{few}.toml", "arm.toml"))
    assert answers[0] == answers[1]
    assert (tmp_path / "0.toml").read_text() == (tmp_path / "10000.toml").read_text()


RUN_FILE = """
[path]
file = "desired.csv"
[model]
file = "bad.toml"
"""

SWEEP_FILE = f"""{RUN_FILE}
[sweep.parameters]
speed = [1.0]
"""


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize(
    "line",
    [
        "plan desired.csv --model bad.toml -o out.csv",
        "simulate desired.csv --model bad.toml -o out.csv",
        "simulate desired.csv --model bad.toml --desired desired.csv -o out.csv",
        "compare brief.csv --model bad.toml",
        "refine desired.csv measured.csv --desired desired.csv --model bad.toml -o out.csv "
        "--no-reidentify",
        "run run.toml --out folder",
        "run run.toml --check",
        "sweep sweep.toml --out folder --workers 1",
        "replay demo.csv --model bad.toml -o out.csv",
    ],
)
def test_every_command_says_once_of_all_joints_that_a_model_is_not_to_be_planned_with(
    run, desired, tmp_path, line
):
    known = Evidence(verdict="refused", reason="it misses 41 % of the motion")
    TRUE.with_evidence(known).to_toml(tmp_path / "bad.toml")
    (tmp_path / "run.toml").write_text(RUN_FILE)
    (tmp_path / "sweep.toml").write_text(SWEEP_FILE)
    path = read_joint_path(desired)
    angles = np.roll(path.angles, 8, axis=0)
    write_joint_path("measured.csv", path.names, angles, period=0.008)
    columns = np.column_stack([0.008 * np.arange(88), np.degrees(path.angles), np.degrees(angles)])
    names = [f"{joint}_{which}_deg" for which in ("req", "act") for joint in path.names]
    write_table("demo.csv", ["t_s", *names], columns)
    result = run(*line.split())
    assert result.exit_code == 0, result.output
    (said,) = [line for line in result.stderr.splitlines() if "not plan with" in line]
    assert said == (
        "request-planner: warning: do not plan with the models of hip, knee (it misses 41 % of the "
        "motion): identify them anew"
    )


@pytest.mark.parametrize("command", ["plan", "simulate"])
def test_answers_for_machines_have_the_verdict_on_each_model(run, desired, tmp_path, command):
    known = Evidence(verdict="refused", reason="it misses 41 % of the motion")
    models = {"hip": TRUE.with_evidence(known), "knee": TRUE}
    (tmp_path / "leg.toml").write_text(models_text(models))
    method = ["--method", "closed-form"] if command == "plan" else []
    result = run(command, desired, "--model", "leg.toml", *method, "--json", "-o", "out.csv")
    assert result.exit_code == 0, result.stderr
    joints = json.loads(result.stdout)["joints"]
    assert joints["hip"]["verdict"] == "refused"
    assert joints["hip"]["verdict_reason"] == "it misses 41 % of the motion"
    assert "verdict" not in joints["knee"], "nothing is known of it"


@pytest.mark.parametrize(
    ("verdict", "recommended"), [("refused", None), ("worse than a delay", "shift")]
)
def test_text_page_and_json_recommend_the_same_of_a_model_not_to_be_planned_with(
    run, desired, tmp_path, verdict, recommended
):
    known = Evidence(error=1e-3, over_delay=1.2, verdict=verdict, reason="it misses 41%")
    TRUE.with_evidence(known).to_toml(tmp_path / "bad.toml")
    line = ["plan", desired, "--model", "bad.toml", "--method", "closed-form", "-o", "out.csv"]
    document = json.loads(run(*line, "--json").stdout)
    assert document["recommended_method"] == recommended
    assert recommended or not document["refining_recommended"]
    told = run(*line, "--report", "page.html")
    by_shift = "do not plan with the models of hip, knee (it misses 41%): use --method shift, or"
    assert (by_shift in told.stderr) == (recommended is not None)
    assert ("recommended: --method shift" in told.output) == (recommended is not None)
    page = Path("page.html").read_text()
    assert ("Recommended: --method shift" in page) == (recommended is not None)


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


def test_a_joint_that_takes_the_model_above_all_tables_takes_a_new_one_too(run):
    write_log("log.csv", joints=("",))
    old = "v_max = 3.0\ntheta_0 = 0.3\nlag = 0.01\nacceleration_time = 0.02\n"
    Path("arm.toml").write_text(f"{old}[hip.servo]\nid = 1\n[knee]\nv_max = 2.0\n")
    assert run("identify", "log.csv", "-o", "arm.toml").exit_code == 0
    assert tables_of("arm.toml")["hip"]["servo"]["id"] == 1
    file = read_model_file("arm.toml")
    assert file.common == file.by_joint["hip"]
    assert file.common.v_max == pytest.approx(TRUE.v_max, rel=0.02)
    assert file.by_joint["knee"].v_max == 2.0


def test_rows_and_their_rate_are_told_and_times_that_may_be_row_numbers_asked_about(run):
    write_log("log.csv")
    told = run("identify", "log.csv", "--no-hold-out").stderr
    assert "log.csv (knee): 1000 rows, one every 8 ms" in told
    assert "in seconds" not in told
    lines = Path("log.csv").read_text().splitlines()
    lines[1:] = [f"{k},{line.partition(',')[2]}" for k, line in enumerate(lines[1:])]
    Path("log.csv").write_text("\n".join(lines))
    told = run("identify", "log.csv", "--no-hold-out").stderr
    assert "log.csv (knee): one row every 1 s: are the times in seconds?" in told


def test_a_joint_whose_process_died_is_left_out_with_the_reason(run, tmp_path, monkeypatch):
    write_log("arm.csv", joints=("hip", "knee"))

    def outcomes(function, tasks, _):
        for task in reversed(tasks):
            died = task.name == "hip"
            result = None if died else function(task.argument)
            yield task, SimpleNamespace(result=result, reason="its process died")

    monkeypatch.setattr("planner.cli.identify.FEW_ROWS", 0)
    monkeypatch.setattr("planner.parallel.outcomes", outcomes)
    result = run("identify", "arm.csv", "--joint", "all", "--no-hold-out", "-o", "arm.toml")
    assert "warning: hip is left out: its process died\n" in result.stderr
    assert list(read_model_file(tmp_path / "arm.toml").by_joint) == ["knee"]
