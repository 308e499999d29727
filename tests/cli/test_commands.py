"""What the commands write, and that they fit together."""

from __future__ import annotations

import json
import math
import warnings

import numpy as np
import pytest

from kinematics import UnsupportedLeg
from planner.approximation.fit import fit_pwl
from planner.exceptions import (
    InvalidInput,
    NoSteadyCycle,
    OutsideEquation13,
    PlannerError,
    SolverFailed,
)

ENDS = {
    "an error of ours": (PlannerError("no fit"), 1, "hip: no fit"),
    "a solver": (
        SolverFailed("the requests", "no progress", violation=0.25),
        1,
        "hip: the requests: the solver stopped with status 'no progress'; worst constraint "
        "violated by 0.25",
    ),
    "a cycle": (
        lambda: NoSteadyCycle(math.radians(1.0), 3),
        1,
        "hip: no steady cycle after 3 cycles: its ends are 1 deg apart; under these requests the "
        "joint drifts or, with inertia, rings; bring them closer to its range, make them smoother, "
        "or simulate from rest (--no-cyclic)",
    ),
    "arguments": (
        InvalidInput("max step and highest, locked, limits, start, rate and lead: 3, 2"),
        2,
        "hip: --max-step-deg and --highest-hz, --lock, --limits-deg, --start-deg, --rate-hz and "
        "--lead-s: 3, 2",
    ),
    "advice": (
        InvalidInput("give max_error, max_rms or unreachable='nearest'; x-max_error, max_errors"),
        2,
        "hip: give --max-error, --max-rms or --unreachable nearest; x-max_error, max_errors",
    ),
    "a leg": (UnsupportedLeg("locked: no joint"), 2, "hip: --lock: no joint"),
    "memory": (
        MemoryError(),
        2,
        "not enough memory for so many samples; shorten the path, or plan fewer requests per "
        "second",
    ),
    "a place": (
        OSError(13, "Permission denied", "out.csv"),
        2,
        "out.csv: permission denied; choose another place",
    ),
    "a reader": (BrokenPipeError(), 141, None),
    "a user": (KeyboardInterrupt(), 130, None),
}
"""What may be raised, the exit status, and what is said on standard error."""


@pytest.mark.parametrize(("error", "status", "said"), ENDS.values(), ids=ENDS)
def test_every_failure_has_its_status_and_one_line(run, desired, monkeypatch, error, status, said):
    def fails(*_, **__):
        raise error() if callable(error) else error

    monkeypatch.setattr("planner.approximation.fit.fit_pwl", fails)
    result = run("fit", desired)
    assert (result.exit_code, result.stdout) == (status, "")
    assert result.stderr.strip() == ("" if said is None else f"request-planner: {said}")
    assert result.stderr.count("\n") <= 1


def test_each_warning_is_said_once(run, desired, monkeypatch):
    fit = fit_pwl

    def warns(*given, **more):
        warnings.warn(OutsideEquation13("the rule"), stacklevel=1)
        warnings.warn(OutsideEquation13("another"), stacklevel=1)
        warnings.warn(OutsideEquation13("the rule"), stacklevel=1)  # from another line
        return fit(*given, **more)

    monkeypatch.setattr("planner.approximation.fit.fit_pwl", warns)
    result = run("fit", desired, "--segments", "4", "-q")
    assert result.stderr == (
        "request-planner: warning: the rule\nrequest-planner: warning: another\n"
    )


def test_a_path_whose_ends_are_far_apart_is_a_motion_from_rest_unless_it_shall_repeat(
    run, tmp_path
):
    time = np.arange(80) / 79
    np.savetxt(tmp_path / "open.csv", 40 * (3 - 2 * time) * time**2, header="hip_deg", comments="")
    asked = ("plan", "open.csv", "-o", "requests.csv", "--json")
    taken, told, repeated = (run(*asked, *more) for more in ((), ("--no-cyclic",), ("--cyclic",)))
    assert taken.stdout == told.stdout != repeated.stdout
    assert told.stderr == repeated.stderr == ""
    assert "does not close, its ends are 52.7 times its largest step apart" in taken.stderr
    assert "--cyclic lets it repeat" in taken.stderr
    fitted = run("fit", "open.csv", "--segments", "3", "--json")
    assert fitted.stderr == taken.stderr
    assert json.loads(fitted.stdout)["cyclic"] is False
    run(*asked)
    again = run("simulate", "requests.csv", "--desired", "open.csv", "--json")
    joint = json.loads(taken.stdout)["joints"]["hip"]
    assert json.loads(again.stdout)["joints"]["hip"]["rms_deg"] == pytest.approx(joint["rms_deg"])


def test_whether_a_simulation_repeats_follows_from_the_desired_path(run, tmp_path):
    (tmp_path / "sent.csv").write_text("knee_deg\n" + "\n".join(map(str, range(40))) + "\n")
    closed = 10.0 * np.sin(2.0 * np.pi * np.arange(40) / 40)
    (tmp_path / "wanted.csv").write_text("\n".join(["knee_deg", *map(repr, closed.tolist())]))
    ask = ("simulate", "sent.csv", "--json")
    assert json.loads(run(*ask).stdout)["cyclic"] is False
    assert json.loads(run(*ask, "--desired", "wanted.csv").stdout)["cyclic"] is True
