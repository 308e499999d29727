"""What the command line says besides its data: warnings, failures, progress."""

from __future__ import annotations

import json
import sys

import pytest

from planner.cli.say import Progress, naming, to_json
from planner.exceptions import PlannerError, SolverFailed


def test_a_rule_outside_its_domain_is_a_warning_in_one_line(run, desired, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text("v_max = 5.0\ntheta_0 = 0.03\nlag = 0.03\nacceleration_time = 0.08\n")
    result = run("plan", desired, "--model", model, "--method", "closed-form", "--json")
    assert result.exit_code == 0
    json.loads(result.stdout)
    assert result.stderr.startswith("request-planner: warning: the paper's rule assumes")
    assert result.stderr.count("\n") == 1


def test_a_solver_that_fails_is_one_line_and_status_1(run, desired, monkeypatch):
    def fail(*_, **__):
        raise SolverFailed("the requests", "no progress", violation=0.25)

    monkeypatch.setattr("planner.inversion.optimal.invert_optimal", fail)
    result = run("plan", desired)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr == (
        "request-planner: hip: the requests: the solver stopped with status 'no progress'; "
        "worst constraint violated by 0.25\n"
    )


def test_only_errors_of_ours_are_said_to_be_about_a_joint():
    with pytest.raises(PlannerError) as ours, naming("hip"):
        raise SolverFailed("the requests", "no progress")
    assert ours.value.__notes__ == ["hip"]
    with pytest.raises(MemoryError) as other, naming("hip"):
        raise MemoryError
    assert not hasattr(other.value, "__notes__")


def test_a_plan_below_its_own_bound_is_a_failed_check(run, desired, monkeypatch):
    from planner.inversion.result import Inversion

    monkeypatch.setattr(Inversion, "lower_bound", 1.0)
    result = run("plan", desired)
    assert result.exit_code == 1
    assert "is below its own lower bound of 57.2958 deg" in result.stderr


def test_json_has_no_numbers_that_are_none():
    text = to_json({"gap": float("inf"), "list": [float("nan"), 1.5], "name": "Δ"})
    assert json.loads(text) == {"gap": None, "list": [None, 1.5], "name": "Δ"}


@pytest.mark.parametrize("watched", [True, False], ids=["terminal", "file"])
def test_progress_is_for_terminals(monkeypatch, capsys, watched):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: watched, raising=False)
    progress = Progress()
    progress("the walk")
    progress.done()
    said = capsys.readouterr()
    assert said.out == ""
    assert ("the walk" in said.err) is watched
