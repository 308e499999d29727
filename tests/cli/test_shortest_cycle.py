"""``request-planner gait --fastest``: the shortest cycle that keeps a tolerance, and its plan."""

from __future__ import annotations

import json

import pytest

from planner import JointModel
from planner.files.paths import foot_path, path_table
from planner.gait import stride
from planner.model.evidence import OPEN_TOP_SPEED, Evidence

TESTED = Evidence(0.01, 1.0, 0.0, (-3.0, 3.0))
"""Of a joint whose logs were slow."""


def walk():
    """A small walk of a leg."""
    size = ("--samples", 24, "--half-stroke", 0.01, "--height", 0.005)
    return "gait", "--leg", "front-left", *size


@pytest.fixture
def fastest(run, tmp_path, monkeypatch):
    """Seek the shortest cycle of a small walk, without the bounds that take seconds."""
    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 0)
    monkeypatch.setattr(stride, "PROOFS", 0)
    found = stride.ShortestCycle

    def fastest(evidence, proof, *more, of_knee=""):
        monkeypatch.setattr(
            stride,
            "ShortestCycle",
            lambda plan, too_short: found(plan=plan, too_short=proof or too_short),
        )
        model = JointModel.ers210a().with_evidence(evidence)
        model.to_toml(tmp_path / "all.toml")
        (tmp_path / "joint.toml").write_text((tmp_path / "all.toml").read_text() + of_knee)
        search = ("--fastest", "--tolerance-cm", 0.2, "-o", "foot.csv")
        result = run(*walk(), "--model", "joint.toml", *search, *more)
        assert result.exit_code == 0, result.output
        return result

    return fastest


def test_the_path_is_planned_within_the_tolerance_as_is_said(run, fastest):
    said = fastest(TESTED, None).stderr
    assert "s, is the shortest at which the planned foot stays within 0.2 cm by the model; " in said
    assert "; no shorter one is proved impossible\nplan it with --method foot-optimal" in said
    assert "outside what the models were tested on" in said
    assert "front_left_knee (speed)" in said
    asked = ("--leg", "front-left", "--model", "joint.toml", "--method", "foot-optimal")
    plan = json.loads(run("plan", "foot.csv", *asked, "--norm", "max", "--json").stdout)
    document = json.loads(fastest(TESTED, None, "--json").stdout)
    found, count = document["fastest"], len(foot_path(path_table("foot.csv")).values)
    assert plan["foot"]["max_cm"] == pytest.approx(found.pop("max_cm"), rel=1e-3)
    assert plan["foot"]["max_cm"] < 0.2
    whole = json.loads(run(*walk(), "--json").stdout)["stride"]
    for joint, speed in document["stride"].pop("speeds_deg_s").items():
        assert speed == pytest.approx(whole["speeds_deg_s"][joint] * 24 / count)
    assert document["stride"] == {key: whole[key] for key in document["stride"]}
    assert 12 < count < 24
    assert found.pop("untested")["front_left_knee"] == ["speed"]
    assert found == {
        "tolerance_cm": 0.2,
        "samples": count,
        "cycle_s": pytest.approx(0.008 * count),
        "too_short": None,
    }


def test_a_cycle_that_is_proved_too_short_is_told_with_what_the_proof_holds_for(fastest):
    proof = stride.TooShort(12, 0.0022)
    evidence = Evidence(0.01, intervals={"v_max": (5.0, 5.5)})
    knee = "[front_left_knee]\nv_max_interval = [5.0, inf]\n"
    said = fastest(evidence, proof, of_knee=knee).stderr
    assert "by the model; in 0.096 s no requests keep it there" in said
    assert f"holds for the models only: {OPEN_TOP_SPEED}\n" in said
    document = json.loads(fastest(evidence, proof, "--json", of_knee=knee).stdout)
    assert document["fastest"]["too_short"] == {
        "samples": 12,
        "cycle_s": pytest.approx(0.096),
        "lower_bound_cm": pytest.approx(0.22),
        "of_model_only": True,
    }
