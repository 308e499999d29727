"""`compare`: the tables, JSON and pictures of a cross-check, and its verdict as exit status."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidInput, JointModel
from planner.evaluation import cross_check as cross_check_module
from planner.files.joint_model import models_text
from planner.files.paths import write_joint_path

JOINT = JointModel.ers210a()


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


def test_joints_of_a_leg_are_compared_in_its_order_each_with_its_own_limits_and_load(
    run, tmp_path, monkeypatch
):
    given = {}

    def compared(models, angles, **arguments):
        given.update(arguments, angles=angles, speeds=[each.v_max for each in models])
        raise InvalidInput("enough")

    monkeypatch.setattr("planner.evaluation.cross_check.cross_check", compared)
    names = ("knee", "rotator", "abductor")
    rows = np.radians([30.0, 10.0, 20.0]) + np.linspace(0.0, 0.1, 6)[:, np.newaxis]
    write_joint_path(tmp_path / "leg.csv", names, rows, period=0.008, loads=10.0 * rows)
    slow = [replace(JOINT, v_max=3.0 + j, compliance=0.1) for j in range(3)]
    (tmp_path / "leg.toml").write_text(models_text(dict(zip(names, slow, strict=True))))
    ask = ("compare", "leg.csv", "--leg", "reference", "--model", "leg.toml", "--load", "column")
    run(*ask, "--limits-deg", "knee=-20:140", "--segments", 3)
    order = [1, 2, 0]
    assert given["names"] == ("rotator", "abductor", "knee")
    assert given["speeds"] == [4.0, 5.0, 3.0]
    np.testing.assert_allclose(given["angles"], rows[:, order], atol=1e-12)
    np.testing.assert_allclose(given["load"], 10.0 * rows[:, order], atol=1e-11)
    np.testing.assert_allclose(np.degrees(given["limits"][0]), [-117.0, -11.0, -20.0])
    assert (given["segments"], given["cyclic"]) == (3, False)


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
