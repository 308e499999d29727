"""The benchmark runs, measures exactly what it says, and reads its own runs."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import math
from dataclasses import replace
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

SAME_SEARCH = math.radians(0.2)
"""Difference between requests of two searches that stop at the same error to 1e-4 [rad]."""

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


def test_the_short_way_from_rest_is_measured_in_a_process_of_its_own():
    from benchmark.parts.length import in_child

    answer = in_child(40, cyclic=False)
    assert 0.0 < answer["again"] < answer["first"] + 60.0
    assert answer["memory"] > 1.0


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


def test_an_offset_shifts_the_requests_of_every_rival():
    from benchmark.instances import random_saturating
    from benchmark.parts.inversion import METHODS, OURS

    instance = random_saturating(3, samples=20)
    offset = math.radians(5.0)
    sagging = replace(instance.model, offset=offset)
    for name in METHODS.keys() - {OURS}:
        level, lower = (
            METHODS[name](model, 20)(
                instance.desired, instance.limits, instance.desired - model.offset
            )
            for model in (instance.model, sagging)
        )
        assert np.max(np.abs(level - offset - lower)) <= SAME_SEARCH, name


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


def test_the_derivatives_of_a_rival_are_slopes():
    from benchmark.rivals.scipy_least_squares import Simulation

    rng = np.random.default_rng(0)
    simulation = Simulation(planner.JointModel.ers210a(), 40)
    requests = np.cumsum(rng.normal(size=40))
    radius = 1.0
    jacobian = simulation.jacobian(*simulation.cycle(requests, radius, 0.0)[1:])
    direction, step = rng.normal(size=40), 1e-5
    ahead, _, _ = simulation.cycle(requests + step * direction, radius, 0.0)
    behind, _, _ = simulation.cycle(requests - step * direction, radius, 0.0)
    # Cycles close to 1e-9 degrees, so the difference quotient is good to 1e-4.
    assert np.max(np.abs((ahead - behind) / (2.0 * step) - jacobian @ direction)) <= 1e-4


def test_a_long_walk_repeats_nothing_and_closes():
    from benchmark.instances import long_walk

    desired = long_walk(8800).desired.reshape(100, 88)
    assert np.min(np.ptp(desired, axis=1)) < 0.95 * np.max(np.ptp(desired, axis=1))
    jumps = np.abs(np.diff(np.append(desired.ravel(), desired[0, 0])))
    assert jumps[-1] <= np.max(jumps[:-1])
    assert np.max(np.abs(long_walk(88).desired - REFERENCE_JOINTS[0].desired)) <= 1e-15


def test_rivals_of_a_stream_are_what_they_are_called():
    from benchmark.parts import stream

    path, model = np.array([0.0, 1.0, 1.0, 2.0]), planner.JointModel.ers210a()
    assert np.array_equal(stream.smoothed(path), [0.0, 0.25, 0.4375, 0.828125])
    assert np.array_equal(stream.earlier(path, 1), [0.0, 1.0, 2.0, 2.0])
    slope = 0.5 * np.arange(60) * model.period  # [rad/s]
    late = planner.simulate(model, stream.fed_forward(model, slope), cyclic=False)
    assert abs(late[-5] - slope[-5]) <= 0.5 * model.period  # half a tick: docs/math.md, section 3
    assert list(stream.times(3, fast=(0.008, 0.01)).rows)[:5] == [
        "8 ms",
        "8 ms, with a cycle",
        "10 ms",
        "10 ms, with a cycle",
        "20 ms, 4 ticks of the model, dry friction",
    ]


def test_numbers_are_written_short():
    from benchmark.table import Table, written

    assert [written(x) for x in (0.0, 12345.6, 12.3456, 0.0123456, 1.5e-5)] == [
        "0",
        "12346",
        "12.35",
        "0.0123",
        "1.5e-05",
    ]
    table = Table("t", ("a", "b"), rows={"r": (2.0, math.nan)})
    assert table.as_json() == {"r": {"a": 2.0, "b": None}}
    assert table.against({"r": {"a": 1.0, "b": 3.0}}).rows["r"][0] == 2.0
    assert not table.against({"other": {"a": 1.0}}).rows


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


def test_the_way_of_the_samples_through_a_call_is_counted():
    from benchmark.reference.trace import table

    rows = table().rows
    calls = ["invert_optimal", "the same, not smoothed", "invert_closed_form"]
    assert list(rows) == [*calls, "fit_pwl, 6 segments"]
    for functions, files, given, in_files, names, desired, _ in rows.values():
        assert functions >= given >= desired >= 2
        assert files >= in_files >= 2
        assert names >= 2


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


def test_many_episodes_are_measured_where_they_run():
    from benchmark.parts.scale import carried_out, episode, local, nothing

    with local(1) as engine:
        run, idle = carried_out(episode, 2, engine), carried_out(nothing, 4, engine)
    assert run["in a worker, ms"] > idle["in a worker, ms"] == 0.0
    assert run["memory"] > 1.0
    assert idle["beside, ms"] > 0.0


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
