"""``request-planner gait --fastest``: the shortest cycle that keeps a tolerance, and its plan."""

from __future__ import annotations

import json

import pytest

from planner import JointModel
from planner.files.paths import read_foot_path
from planner.gait import shortest_cycle
from planner.model.evidence import Evidence

TESTED = Evidence(0.01, 1.0, 0.0, (-3.0, 3.0))
"""Of a joint whose logs were slow."""


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """A small walk of a leg, without the bounds that take seconds."""
    monkeypatch.setattr(shortest_cycle, "PROOFS", 0)
    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 0)
    file = tmp_path / "joint.toml"
    JointModel.ers210a().with_evidence(TESTED).to_toml(file)
    return "--leg", "front-left", "--model", file


def test_the_path_is_planned_within_the_tolerance_as_is_said(run, tmp_path, walk):
    file = tmp_path / "foot.csv"
    asked = ("gait", *walk, "--half-stroke", 0.01, "--height", 0.005, "--samples", 24)
    result = run(*asked, "--fastest", "--tolerance-cm", 0.2, "-o", file)
    assert result.exit_code == 0, result.output
    assert "plan it with --method foot-optimal --norm max" in result.stderr
    assert "outside what the models were tested on" in result.stderr
    assert "front_left_knee (speed)" in result.stderr
    plan = ("plan", file, *walk, "--method", "foot-optimal", "--norm", "max", "--json")
    assert json.loads(run(*plan).stdout)["foot"]["max_cm"] < 0.2
    assert len(read_foot_path(file).positions) > 12
