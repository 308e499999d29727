"""What the commands write, and that they fit together."""

import json
import math
import re
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import planner
from kinematics import UnsupportedLeg
from planner.approximation.fit_pwl import fit_pwl
from planner.cli.desired import repeats
from planner.files.paths import foot_path, read_joint_path, write_joint_path
from planner.files.table import read_table
from planner.report import meshcat_scene as report
from tests.cli.test_servos import ARM
from tests.instances import joint_of


def from_compiled_code(cause):
    """What Numba makes of an exception that a signal raises while it calls compiled code."""
    for _ in range(3):
        error = SystemError("returned a result with an exception set")
        error.__cause__, cause = cause, error
    return cause


ENDS = {
    "an error of ours": planner.PlannerError("no fit"),
    "a solver": planner.SolverFailed("the requests", "no progress", violation=0.25),
    "a cycle": planner.NoSteadyCycle(math.radians(1.0), 3),
    "arguments": planner.InvalidInput("segments and max error, knots, required and limits: 3, 2"),
    "advice": planner.InvalidInput(
        "give max_error or unreachable='nearest'; x-max_error, max_errors"
    ),
    "a leg": UnsupportedLeg("locked: no joint"),
    "memory": MemoryError(),
    "a place": OSError(13, "Permission denied", "out.csv"),
    "a reader": BrokenPipeError(),
    "a user": KeyboardInterrupt(),
    "a user, in compiled code": from_compiled_code(KeyboardInterrupt()),
    "a signal, in compiled code": from_compiled_code(SystemExit(143)),
}


def test_every_failure_has_its_status_and_one_line(run, desired, monkeypatch, snapshot):
    told = []
    for name, error in ENDS.items():

        def fails(*_, error=error, **__):
            raise error

        monkeypatch.setattr("planner.approximation.fit_pwl.fit_pwl", fails)
        result = run("fit", desired)
        assert result.stdout == ""
        assert result.stderr.count("\n") <= 1
        told.append(f"{name}: status {result.exit_code} {result.stderr.strip()}\n")
    snapshot.check("ends", "".join(told))


def test_each_warning_is_said_once(run, desired, monkeypatch):
    fit = fit_pwl

    def warns(*given, **more):
        warnings.warn(planner.OutsideEquation13("the rule"), stacklevel=1)
        warnings.warn(planner.OutsideEquation13("another"), stacklevel=1)
        warnings.warn(planner.OutsideEquation13("the rule"), stacklevel=1)  # from another line
        return fit(*given, **more)

    monkeypatch.setattr("planner.approximation.fit_pwl.fit_pwl", warns)
    result = run("fit", desired, "--segments", "4", "-q")
    warnings_ = ("the rule", "another")
    assert result.stderr == "".join(f"request-planner: warning: {each}\n" for each in warnings_)


def test_a_path_whose_ends_are_far_apart_is_a_motion_from_rest_unless_it_shall_repeat(
    run, tmp_path
):
    time = np.arange(80) / 79
    np.savetxt(tmp_path / "open.csv", 40 * (3 - 2 * time) * time**2, header="hip_deg", comments="")
    asked = ("plan", "open.csv", "-o", "requests.csv", "--json")
    taken, told, repeated = (run(*asked, *more) for more in ((), ("--no-cyclic",), ("--cyclic",)))
    assert taken.stdout == told.stdout != repeated.stdout
    assert told.stderr == repeated.stderr == ""
    assert "does not end where it begins, but 52.7 of its largest steps away" in taken.stderr
    assert "--cyclic lets it repeat" in taken.stderr
    fitted = run("fit", "open.csv", "--segments", "3", "--json")
    assert fitted.stderr == taken.stderr
    assert json.loads(fitted.stdout)["cyclic"] is False
    run(*asked)
    again = run("simulate", "requests.csv", "--desired", "open.csv", "--json")
    joint = json.loads(taken.stdout)["joints"]["hip"]
    assert json.loads(again.stdout)["joints"]["hip"]["rms_deg"] == pytest.approx(joint["rms_deg"])


def test_a_path_closes_whose_ends_are_at_most_three_of_its_largest_steps_apart_but_for_a_jump():
    for apart, closed in ((2.9, True), (3.1, False)):
        rows = np.concatenate([np.arange(11.0), np.arange(9.0, apart, -1.0), [apart]])
        assert repeats(rows[:, np.newaxis], None)[0] is closed
    assert not repeats(np.repeat([0.0, 50.0], 30)[:, np.newaxis], None)[0]


def test_whether_a_simulation_repeats_follows_from_the_desired_path(run, tmp_path):
    (tmp_path / "sent.csv").write_text("knee_deg\n" + "\n".join(map(str, range(40))) + "\n")
    closed = 10.0 * np.sin(2.0 * np.pi * np.arange(40) / 40)
    (tmp_path / "wanted.csv").write_text("\n".join(["knee_deg", *map(repr, closed.tolist())]))
    ask = ("simulate", "sent.csv", "--json")
    assert json.loads(run(*ask).stdout)["cyclic"] is False
    assert json.loads(run(*ask, "--desired", "wanted.csv").stdout)["cyclic"] is True


SAME = 1e-9


@pytest.mark.parametrize(
    "limits",
    [
        ("--max-step-deg", 0.9),
        ("--max-step-deg", 0.9, "--max-request-speed-deg-s", 1000),
        ("--max-step-deg", 8, "--max-request-speed-deg-s", 112.5),
    ],
)
def test_the_smaller_limit_on_steps_is_kept(run, foot, limits):
    ask = ("plan", foot, "--leg", "front-left", "--method", "optimal", *limits)
    assert run(*ask, "-o", "requests.csv").exit_code == 0
    requests = np.degrees(read_joint_path("requests.csv").values)
    steps = np.abs(np.diff(requests, axis=0, append=requests[:1]))
    assert 0.85 < np.max(steps) <= 0.9 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("unit", "rows", "other", "doubted"),
    [("deg", 88, 1.0, True), ("rad", 88, 1.0, False), ("deg", 9, 1.0, False)],
)
def test_small_motions_in_degrees_are_doubted_unless_one_is_large_or_there_are_few_rows(
    run, tmp_path, unit, rows, other, doubted
):
    motion = 0.03 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
    lines = [f"{angle!r},{other * angle!r}" for angle in motion.tolist()]
    (tmp_path / "small.csv").write_text("\n".join([f"knee_{unit},hip_{unit}", *lines]))
    said = run("plan", "small.csv", "--method", "shift", "-o", "-").stderr
    doubt = "the angles span only 0.06 degrees: are they radians? then rename knee_deg to knee_rad"
    assert (doubt in said) is doubted


def test_an_error_below_its_own_bound_is_reported_and_nothing_is_written(run, desired, monkeypatch):
    monkeypatch.setattr("planner.planning.plan.Plan.lower_bounds", np.full(2, 0.5))
    result = run("plan", desired, "-o", "requests.csv")
    assert result.exit_code == 1
    assert "hip: an error of " in result.stderr
    assert "is below its own lower bound of 28.6479 deg; please report this" in result.stderr
    assert not desired.with_name("requests.csv").exists()


def test_a_page_goes_to_standard_output_when_asked(run, desired):
    result = run("plan", desired, "--method", "shift", "-o", "requests.csv", "--report", "-")
    assert result.stdout.startswith("<!doctype html>")
    assert {file.name for file in desired.parent.iterdir()} == {desired.name, "requests.csv"}


@pytest.mark.parametrize(("rate", "lost"), [(3, True), (50, False)])
def test_a_motion_that_a_low_rate_loses_is_said(run, tmp_path, rate, lost):
    """At 3 requests a second a motion of 3 Hz has the same angle at every request."""
    seconds = 0.008 * np.arange(251)
    rows = [f"{t:.3f},{20.0 * math.sin(6.0 * math.pi * t):.6f}" for t in seconds]
    (tmp_path / "fast.csv").write_text("\n".join(["time_s,knee_deg", *rows]) + "\n")
    result = run("plan", tmp_path / "fast.csv", "--rate-hz", rate, "-o", tmp_path / "r.csv")
    assert result.exit_code == 0
    said = re.search(r"path of knee is missed by (\d+) % of its motion", result.stderr)
    assert ("errors are those from the path that is left" in result.stderr) == (said is not None)
    assert (said is not None and int(said[1]) >= 99) == lost


def test_lines_are_no_faster_than_a_joint_whose_requests_are_held(run, desired):
    """Two ticks to a request: by the tick alone they would be twice as fast."""
    joint_of(1.0, 0.1, 0.01, 0.02, tick=0.004, hold=2).to_toml("held.toml")
    with Path("held.toml").open("a") as file:
        file.write("[knee]\nv_max = 0.5\n")
    result = run("fit", desired, "--model", "held.toml", "--segments", "4", "--json")
    assert result.exit_code == 0, result.stderr
    for name, fastest in (("hip", 1.0), ("knee", 0.5)):
        answer = json.loads(result.stdout)["joints"][name]
        times, values = np.array(answer["knots_s"]), np.radians(answer["values_deg"])
        speeds = np.diff(np.append(values, values[0])) / np.diff(np.append(times, times[0] + 0.704))
        assert np.max(np.abs(speeds)) == pytest.approx(fastest, rel=1e-6)


@pytest.fixture
def shown(monkeypatch):
    """What the pages of the test show, page by page."""
    pytest.importorskip("meshcat", reason="needs the extra meshcat")
    pages = []

    def keep(_, angles, feet, **__):
        pages.append([SimpleNamespace(angles=a, foot=f) for a, f in zip(angles, feet, strict=True)])
        return ""

    monkeypatch.setattr(report, "scene_page", keep)
    return pages


def test_the_legs_go_where_the_paths_and_the_requests_say(run, foot, shown):
    run("plan", foot, "--leg", "front-left", "-o", "requests.csv")
    made = read_joint_path("requests.csv")
    write_joint_path("other.csv", made.names[::-1], made.values[:, ::-1], period=0.008)
    shared = ("view", foot, "--leg", "front-left", "--html", "page.html")
    run(*shared, "--requests", "other.csv")  # whose columns stand in another order
    run(*shared)  # planned there, all joints at once
    (desired, direct, planned), (*_, other) = shown
    requests = made.values
    for motion, sent in ((direct, desired.angles), (planned, requests)):
        for j in range(3):
            answer = planner.simulate(planner.JointModel.ers210a(), sent[:, j])
            assert np.max(np.abs(motion.angles[:, j] - answer)) <= SAME
    assert np.max(np.abs(desired.foot - foot_path(read_table(foot)).values)) <= SAME
    assert np.max(np.abs(other.angles - planned.angles)) > 1e-3


@pytest.fixture
def requests(tmp_path):
    rows = np.radians(np.column_stack([np.arange(10.0), 20.0 - np.arange(10.0)]))
    write_joint_path(tmp_path / "requests.csv", ["hip", "knee"], rows, period=0.008)
    return tmp_path / "requests.csv"


def test_the_servos_of_a_model_file_have_the_zeros_and_directions_of_their_own_joints(
    run, requests, tmp_path
):
    blocks = [
        ARM.replace("joint_1", name)
        .replace("direction = 1", f"direction = {way}")
        .replace("zero_tick = 2048", f"zero_tick = {zero}")
        for name, way, zero in (("wrist", 1, 1), ("knee", -1, 1000), ("hip", 1, 2000))
    ]
    (tmp_path / "arm.toml").write_text("".join(blocks))
    shared = ("export", requests, "--format", "csv", "--unit", "ticks", "--model", "arm.toml")
    rows = run(*shared).stdout.splitlines()
    assert rows[:3] == ["t_s,hip_ticks,knee_ticks", "0.0,2000,772", "0.008,2011,784"]
    named = run(*shared, "--joint-names", "a,b").stdout.splitlines()
    assert named == ["t_s,a_ticks,b_ticks", *rows[1:]]
    (tmp_path / "arm.toml").write_text("".join([blocks[1].replace("4096", "4000"), blocks[2]]))
    mixed = run(*shared).stdout.splitlines()[1]
    assert mixed == "0.0,2000,778", "each servo has its own ticks of a turn"
