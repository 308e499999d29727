"""The benchmark runs, measures exactly what it says, and reads its own runs."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import planner
from planner.trajectory import rms
from tests.instances import REFERENCE_JOINTS

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"

SAME_CYCLE = math.radians(1e-6)
"""Difference between two simulations of a cycle [rad]: where they stop closing it."""


BARELY_ROUNDED = 1e-9
"""Radius of corners that no angle feels [degrees]."""


@pytest.fixture(autouse=True)
def _importable(monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPTS))


class Answer(NamedTuple):
    """What a command prints, and its status."""

    returncode: int
    stdout: str
    stderr: str


def run(*arguments: str, module: str = "benchmark.__main__") -> Answer:
    """A command of the benchmark, in this process."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            status = importlib.import_module(module).main(arguments)
        except SystemExit as end:
            status = end.code
    return Answer(status, printed.getvalue(), said.getvalue())


def test_a_run_is_kept_compared_and_written_down(tmp_path):
    kept, page = tmp_path / "run.json", tmp_path / "page.md"
    arguments = ["quality", "--quick", "--instances", "1", "--samples", "30"]
    first = run(*arguments, "--save", str(kept), "--markdown", str(page))
    assert first.returncode == 0, first.stderr
    tables = json.loads(kept.read_text())["tables"]
    assert tables["Gaps, rms error"]["rotator"]["over envelope, %"] > 0.0
    assert all(f"## {title}\n" in page.read_text() for title in tables)
    second = run(*arguments, "--compare", str(kept))
    assert second.returncode == 0, second.stderr
    ratios = second.stdout.partition("Gaps, rms error: new over old")[2].splitlines()
    assert next(line for line in ratios if line.startswith("rotator")).split()[1:] == ["1"] * 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["speed"], "no part speed"),
        (["fit", "--compare", "nowhere.json"], "nowhere.json: not a run kept by --save"),
    ],
)
def test_what_cannot_be_measured_is_said_in_a_line(arguments, message):
    answer = run(*arguments)
    assert answer.returncode == 2
    assert message in answer.stderr.splitlines()[-1]


def test_every_method_stays_within_limits_and_improves_on_the_closed_form():
    from benchmark.instances import random_saturating
    from benchmark.parts.inversion import METHODS, OURS, closed_form, compare
    from benchmark.rivals.problem import exact_rms

    instance = random_saturating(
        3, samples=30, limited=True
    )  # compare raises where one leaves them
    results = compare(instance, 0, repeats=1)
    start = exact_rms(instance.model, instance.desired, closed_form(instance.model, instance))
    assert list(results) == list(METHODS)
    for name, result in results.items():
        assert result.rms < start
        assert result.rms <= 1.1 * results[OURS].rms, name


@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_the_rivals_simulate_the_same_joint(offset):
    from benchmark.rivals.problem import DEGREE
    from benchmark.rivals.scipy_least_squares import Simulation

    joint = REFERENCE_JOINTS[0]
    aibo = planner.JointModel.ers210a()
    model = planner.JointModel(
        v_max=aibo.v_max,
        theta_0=aibo.theta_0,
        lag=0.0353,
        acceleration_time=0.0421,
        offset=offset * DEGREE,
    )
    angles, *_ = Simulation(model, 88).cycle(joint.desired / DEGREE, BARELY_ROUNDED, 0.0)
    exact = planner.simulate(model, joint.desired)
    assert np.max(np.abs(angles * DEGREE - exact)) <= SAME_CYCLE


def reference(*arguments: str) -> Answer:
    return run(*arguments, module="benchmark.reference.__main__")


def test_reference_results_are_recorded_and_compared_to_the_last_bit(tmp_path):
    kept = tmp_path / "reference.json"
    arguments = [str(kept), "--only", "fits,plans", "--every", "60"]
    recorded = reference("record", *arguments)
    assert recorded.returncode == 0, recorded.stderr
    before = json.loads(kept.read_text())["sections"]
    assert [len(before[name]["cases"]) for name in ("fits", "plans")] == [11, 2]
    again = reference("compare", *arguments, "--with", str(kept))
    assert again.returncode == 0, again.stdout
    assert next(line for line in again.stdout.splitlines() if line.startswith("fits"))
    assert "no section nothing" in reference("compare", str(kept), "--only", "nothing").stderr


def test_a_worse_result_fails_the_comparison():
    from benchmark.reference.compare import checks_of, compared

    def run(error, segments, steepest, seconds):
        numbers = {"error": error, "floor": 1e-6, "segments": segments, "steepest": steepest}
        return {"fits": {"pace": 1.0, "cases": {"a": numbers | {"seconds": seconds}}}}

    old = run(1.0, 6, 0.0, 1.0)
    for new, failed in [
        (run(1.0 + 1e-12, 6, 0.0, 1.1), 0),
        (run(1.01, 6, 0.0, 1.0), 3),  # median, mean and share
        (run(1.0, 6, 1e-9, 1.0), 1),
        (run(1.0, 6, 0.0, 1.5), 1),
        ({"fits": {"pace": 1.0, "cases": {"a": {"failed": "ValueError", "seconds": 1.0}}}}, 1),
    ]:
        section = compared(old, new)["fits"]
        assert sum(not check.passed for check in checks_of("fits", section)) == failed


def test_another_curve_of_the_same_error_is_as_good_on_another_processor(tmp_path):
    from benchmark.reference.processors import beside

    def kept(name, **cases):
        cases = {
            case: {"error": error, "floor": 1e-6, "segments": 6, "knots": [knot], "seconds": 1.0}
            for case, (error, knot) in cases.items()
        }
        run = {"sections": {"fits": {"pace": 1.0, "cases": cases}}}
        (tmp_path / name).write_text(json.dumps(run))
        return tmp_path / name

    first = kept("first", equal=(1.0, 2.0), near=(1.0, 2.0), other=(1.0, 2.0), worse=(1.0, 2.0))
    second = kept(
        "second", equal=(1.0, 2.0), near=(1.0, 2.0 + 1e-12), other=(1.0, 3.0), worse=(1.1, 3.0)
    )
    table, lines = beside("that", first, second)
    assert table.rows["fits"][:5] == (4, 1, 2, 1, 1)
    assert lines.splitlines() == ["  fits, worse: by 0.5, loss 10 %"]


def test_after_a_log_of_steps_a_plan_tells_the_error_of_a_servo_that_is_not_the_model():
    """The integral of the servo's speed loop shortens the delay of requests that move."""
    from benchmark.plants import random_servo

    servo, random = random_servo(4), np.random.default_rng(4)
    held = [np.full(random.integers(50, 125), random.uniform(-0.3, 1.9)) for _ in range(10)]
    found = planner.identify(servo.log(np.concatenate(held)[:700]))
    desired = 0.8 + 0.5 * np.sin(2.0 * np.pi * np.arange(100) / 100)
    plan = planner.plan(found.model, desired).inversions[0]
    servo.rest(float(plan.requests[0]))
    true, _ = servo.play(plan.requests)
    met = rms(true[0] - desired)
    bare = found.tested._replace(delay_error=0.0)
    assert bare.error_of(plan.predicted, period=0.02, cyclic=True) < met / 3.0
    assert met < plan.expected.error < 2.0 * met
    assert plan.expected.untested == ("moving requests",)
