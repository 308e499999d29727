"""The view at the command line: a page."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from planner.files.paths import read_foot_path, read_joint_path, write_foot_path, write_joint_path
from planner.model.evidence import Evidence
from planner.report import scene as report

SAME = 1e-9
"""Files carry 12 decimals of a degree, and a joint's answer does not magnify that much [rad, m]."""


@pytest.fixture
def meshcat():
    return pytest.importorskip("meshcat", reason="needs the extra meshcat")


@pytest.fixture
def shown(meshcat, monkeypatch):  # noqa: ARG001
    """What the pages of the test show, page by page."""
    pages = []

    def keep(_, motions, **__):
        pages.append(motions)
        return ""

    monkeypatch.setattr(report, "scene_page", keep)
    return pages


def test_a_view_warns_of_a_model_that_is_not_to_be_planned_with(run, foot, shown):
    refused = planner.JointModel.ers210a().with_evidence(Evidence(verdict="refused", reason="odd"))
    refused.to_toml("refused.toml")
    result = run("view", foot, "--leg", "front-left", "--model", "refused.toml", "--html", "a.html")
    assert result.exit_code == 0, result.stderr
    assert len(shown) == 1
    assert "do not plan with the model" in result.stderr


def test_the_legs_go_where_the_paths_and_the_requests_say(run, foot, shown):
    run("plan", foot, "--leg", "front-left", "-o", "requests.csv")
    made = read_joint_path("requests.csv")
    write_joint_path("other.csv", made.names[::-1], made.angles[:, ::-1], period=0.008)
    shared = ("view", foot, "--leg", "front-left", "--html", "page.html")
    run(*shared, "--requests", "other.csv")  # whose columns stand in another order
    run(*shared, "--method", "optimal")
    run(*shared, "--method", "closed-form")
    (desired, direct, planned), (*_, same), (*_, other) = shown
    requests = made.angles
    for motion, sent in ((direct, desired.angles), (planned, requests)):
        for j in range(3):
            answer = planner.simulate(planner.JointModel.ers210a(), sent[:, j])
            assert np.max(np.abs(motion.angles[:, j] - answer)) <= SAME
    assert np.max(np.abs(desired.foot - read_foot_path(foot).positions)) <= SAME
    assert np.max(np.abs(same.angles - planned.angles)) <= SAME
    assert np.max(np.abs(other.angles - planned.angles)) > 1e-3


def test_what_is_out_of_reach_is_desired_all_the_same(run, shown):
    far = np.tile([0.09, 0.075, -0.3], (88, 1))
    write_foot_path("far.csv", far, period=0.008)
    run("view", "far.csv", "--leg", "front-left", "--unreachable", "nearest", "--html", "page.html")
    assert np.array_equal(shown[0][0].foot, far)


def test_the_joints_of_a_path_may_come_in_any_order(run, shown):
    angles = np.radians([[10.0, 20.0, 30.0], [11.0, 21.0, 31.0], [12.0, 22.0, 32.0]])
    write_joint_path("mixed.csv", ["knee", "rotator", "abductor"], angles, period=0.008)
    run("view", "mixed.csv", "--leg", "reference", "--no-cyclic", "--html", "page.html")
    desired, *_ = shown[0]
    assert np.max(np.abs(desired.angles - angles[:, [1, 2, 0]])) <= SAME
    assert (
        np.max(np.abs(desired.foot - planner.reference_walk().leg.foot_positions(desired.angles)))
        == 0.0
    )


@pytest.mark.usefixtures("meshcat", "foot")
@pytest.mark.parametrize(
    ("asked", "method"),
    [
        ("foot.csv", "foot-optimal"),
        ("joints.csv", "optimal"),
        ("foot.csv --method closed-form", "closed-form"),
    ],
)
def test_a_foot_path_is_planned_for_the_foot_unless_another_method_is_named(
    run, monkeypatch, asked, method
):
    names = [f"front_left_{name}" for name in ("rotator", "abductor", "knee")]
    write_joint_path("joints.csv", names, np.full((8, 3), 0.1), period=0.008)
    planned = []

    def plan_of(prepared):
        planned.append(prepared.settings.plan.method)
        raise KeyboardInterrupt

    monkeypatch.setattr("planner.cli.planning.plan_of", plan_of)
    asked = (*asked.split(), "--leg", "front-left", "--html", "page.html")
    assert run("view", *asked).exit_code == 130
    assert planned == [method]


def test_what_is_not_installed_is_named(run, foot, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "meshcat", None)
    result = run("view", foot, "--leg", "front-left", "--html", "walk.html")
    assert result.exit_code == 2
    assert result.stderr == (
        "request-planner: the view in Meshcat needs the extra 'meshcat': python -m pip install "
        "'request-planner[meshcat]', or '.[meshcat]' in a checkout\n"
    )


def test_legs_move_under_the_load_that_their_requests_are_planned_for(run, foot, shown, tmp_path):
    soft = planner.JointModel(
        v_max=5.45, theta_0=0.12, lag=0.032, acceleration_time=0.048, compliance=0.3
    )
    soft.to_toml(tmp_path / "soft.toml")
    leg = ("--leg", "front-left", "--model", "soft.toml")
    run("plan", foot, *leg, "--method", "optimal", "--load", "urdf", "-o", "requests.csv")
    run("view", foot, *leg, "--html", "page.html", "--requests", "requests.csv")
    ((desired, direct, planned),) = shown
    given = read_joint_path("requests.csv")
    for motion, sent in ((direct, desired.angles), (planned, given.angles)):
        for j in range(3):
            answer = planner.simulate(soft, sent[:, j], load=given.loads[:, j])
            assert np.max(np.abs(motion.angles[:, j] - answer)) <= SAME
