"""The view at the command line: a page."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from planner.files.paths import read_foot_path, read_joint_path, write_joint_path
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


def test_the_legs_go_where_the_paths_and_the_requests_say(run, foot, shown):
    run("plan", foot, "--leg", "front-left", "-o", "requests.csv")
    made = read_joint_path("requests.csv")
    write_joint_path("other.csv", made.names[::-1], made.values[:, ::-1], period=0.008)
    shared = ("view", foot, "--leg", "front-left", "--html", "page.html")
    run(*shared, "--requests", "other.csv")  # whose columns stand in another order
    run(*shared, "--method", "optimal")
    run(*shared, "--method", "closed-form")
    (desired, direct, planned), (*_, same), (*_, other) = shown
    requests = made.values
    for motion, sent in ((direct, desired.angles), (planned, requests)):
        for j in range(3):
            answer = planner.simulate(planner.JointModel.ers210a(), sent[:, j])
            assert np.max(np.abs(motion.angles[:, j] - answer)) <= SAME
    assert np.max(np.abs(desired.foot - read_foot_path(foot).values)) <= SAME
    assert np.max(np.abs(same.angles - planned.angles)) <= SAME
    assert np.max(np.abs(other.angles - planned.angles)) > 1e-3
