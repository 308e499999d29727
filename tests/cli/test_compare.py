"""``compare`` and ``reproduce``: verdict, steps, and tables that hold what was computed."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from planner import JointModel
from planner.cli.reproduce import STEPS
from planner.evaluation import cross_check as cross_check_module
from planner.evaluation.checks import CLAIMS
from planner.files.joint_model import models_text, read_model_file
from planner.files.paths import foot_path, path_table, read_joint_path
from planner.files.table import read_table
from planner.model.evidence import Evidence
from planner.report.paper_results import joint_paths
from tests.corpus.page_text import text_of

WRITTEN = 1e-9  # rounding of 12 decimals [deg, m]


@pytest.fixture
def sabotage(monkeypatch):
    """The optimised requests come three samples late."""
    honest = cross_check_module.planned

    def late(*arguments, **options):
        plan = honest(*arguments, **options)
        if plan.method == "closed_form":
            return plan
        return replace(plan, requests=np.roll(plan.requests, 3, axis=0))

    monkeypatch.setattr(cross_check_module, "planned", late)


@pytest.mark.usefixtures("sabotage")
def test_plans_that_fail_their_checks_are_shown_and_end_with_status_1(run, brief):
    result = run("compare", brief, "--report", "late.html", "--json")
    assert result.exit_code == 1
    assert result.stderr.startswith(
        "request-planner: failed: 34 of 38 checks hold; hip, optimised: no worse than closed form"
    )
    assert result.stderr.count("\n") == 1
    document = json.loads(result.stdout)
    assert not document["passed"]
    failed = {check["name"] for check in document["checks"] if not check["passed"]}
    assert failed == {f"no worse than closed form, {r} rule" for r in ("paper's", "exact")}


def test_a_joint_in_shares_is_compared_in_percent_beside_others_in_degrees(run, tmp_path):
    model = JointModel(v_max=2.0, theta_0=0.2, lag=0.03, acceleration_time=0.04, tick=0.02)
    jaw = model.with_evidence(Evidence(unit="range"))
    (tmp_path / "arm.toml").write_text(models_text({"hip": model, "jaw": jaw}))
    rows = [
        f"{20.0 * np.sin(each)},{50.0 + 20.0 * np.sin(each)}" for each in np.arange(0, 6.28, 0.2)
    ]
    (tmp_path / "path.csv").write_text("\n".join(["hip_deg,jaw_percent", *rows]) + "\n")
    asked = ("--cyclic", "--level", "slope", "--model", "arm.toml")
    result = run("compare", "path.csv", *asked, "--report", "page.html", "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    hip, jaw = answer["joints"].values()
    assert hip["model"] == pytest.approx(jaw["model"]) == model.parameters()
    assert np.ptp(jaw["desired_percent"]) == pytest.approx(np.ptp(hip["desired_deg"]))
    # 0.2 of the range are 20 %, and 0.2 rad 11.5 degrees
    assert jaw["methods"]["optimal"]["rms_percent"] < hip["methods"]["optimal"]["rms_deg"]
    page = text_of((tmp_path / "page.html").read_text())
    assert "jaw [% of range]" in page
    closes = [each for each in answer["checks"] if each["name"] == CLAIMS["closes"].name]
    allowed = {each["subject"]: (each["tolerance"], each["unit"]) for each in closes}
    assert allowed == {"hip": (1e-9, "rad"), "jaw": (np.degrees(1e-9), "% of range")}
    assert re.search(r"at most \S+ rad and \S+ % of range from an independent", page)
    assert re.search(r"differ by up to [\d.]+ degrees and [\d.]+ % of range", page)


@pytest.mark.parametrize("robot", ["model", "virtual"])
def test_the_steps_of_the_experiment_are_those_that_are_expected(reproduction_of, robot):
    assert len([*reproduction_of(robot).told, "the report"]) == STEPS[robot]


def check(folder, kept):
    """Compare tables of joints in a folder with angles [rad], by their names."""
    for name, angles in kept.items():
        path = read_joint_path(folder / f"{name}.csv")
        assert path.names == ("rotator", "abductor", "knee")
        assert np.degrees(path.values) == pytest.approx(np.degrees(angles), abs=WRITTEN), name


def test_tables_of_the_experiment_hold_its_angles_and_positions(reproduced):
    answer, folder = reproduced.answer, reproduced.folder
    check(folder, joint_paths(answer))
    feet = {
        "desired": answer.walk.desired_foot,
        **{name: plan.foot for name, plan in answer.plans.items()},
    }
    for name, positions in feet.items():
        written = foot_path(path_table(folder / f"foot_{name}.csv")).values
        assert written == pytest.approx(positions, abs=WRITTEN), name
    tables = {f"{name}.csv" for name in joint_paths(answer)} | {f"foot_{name}.csv" for name in feet}
    assert {file.name for file in folder.glob("*.csv")} == tables


def test_tables_of_the_virtual_robot_hold_its_walks_logs_and_models(virtually_reproduced):
    answer, folder = virtually_reproduced.answer, virtually_reproduced.folder
    check(folder, {"desired": answer.planned.walk.desired})
    for method, run in answer.runs.items():
        kept = {"requests": run.requests, "angles": run.angles, "sensed": run.sensed}
        for kind, angles in kept.items():
            check(folder, {f"{kind}_{method}": np.reshape(angles, (-1, 3))})
    for name, found in zip(answer.planned.walk.joint_names, answer.identifications, strict=True):
        assert read_model_file(folder / f"{name}.toml").for_joints([name]) == (found.model,)
        for fit in found.fits:
            height = np.degrees(np.ptp(fit.log.requests))
            rows = read_table(folder / f"step_test_{name}_{height:.0f}.csv").rows
            kept = fit.log.times, np.degrees(fit.log.requests), np.degrees(fit.log.angles)
            assert np.array(rows, float) == pytest.approx(np.column_stack(kept), abs=WRITTEN)
