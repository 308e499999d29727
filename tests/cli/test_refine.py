"""``request-planner refine``: executed requests and measured angles in, the next requests out."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from planner import JointModel, half_ellipse, simulate
from planner.files.paths import read_joint_path, write_foot_path, write_joint_path
from planner.model.evidence import Evidence
from tests.instances import ERS210A

TRUE = replace(ERS210A, theta_0=1.2 * ERS210A.theta_0, lag=1.2 * ERS210A.lag, offset=0.01)

LEG = ("--leg", "reference", "--unreachable", "clamp", "--method", "foot-optimal")


@pytest.fixture
def execute():
    """Play requests from a file on joints that are not the model; measured angles to a file."""

    def execute(requests="requests.csv", measured="measured.csv"):
        path = read_joint_path(requests)
        angles = np.column_stack([simulate(TRUE, column) for column in path.values.T])
        write_joint_path(measured, path.names, angles, period=0.008)
        return angles

    return execute


def test_what_all_recordings_have_of_the_first_cycles_is_learnt(run, desired, execute):
    """Two files of one cycle and 12 rows more, the second in radians and without one joint."""
    run("plan", desired, "-o", "requests.csv")
    for file, factor in (("one.csv", 1.0), ("two.csv", 0.9)):
        angles = factor * execute()
        rows = np.vstack([angles, angles[:12]])
        write_joint_path(file, ("hip", "knee"), rows, period=0.008)
    write_joint_path("two.csv", ("knee",), rows[:, 1:], period=0.008, units=("rad",))
    write_joint_path("exact.csv", ("hip", "knee"), execute(), period=0.008)
    line = ("refine", "requests.csv", "one.csv", "two.csv", "--desired", desired)
    line = (*line, "--no-reidentify", "-o", "next.csv", "--cycles")
    both, first = (run(*line, cycles) for cycles in (2, 1))
    for result, count in ((both, "2 measured cycles"), (first, "1 measured cycle")):
        assert "warning: 24 measured rows after the last whole cycle are not used" in result.stderr
        assert "no measured angles of hip: requests kept as they are\n" in result.stderr
        assert f"\n{count} of 88 requests" in result.stderr
    assert "got 2 of 88 rows, expected 3 cycles" in run(*line, 3).stderr
    alone = run("refine", "requests.csv", "exact.csv", *line[4:], "1", "--joint", "knee").stderr
    assert alone.splitlines()[-1] == first.stderr.splitlines()[-1]
    assert both.stderr.splitlines()[-1] != first.stderr.splitlines()[-1]
    assert "12 more than 1 cycles of 88" in run(*line, 1, "--no-cyclic").stderr


def test_a_first_cycle_that_is_a_transient_of_one_joint_is_ignored_of_it_alone(
    run, desired, execute, monkeypatch
):
    """In what is learnt, and in the mean cycle of the page."""
    run("plan", desired, "-o", "requests.csv")
    angles, pages = execute(), []
    cycles = np.vstack([angles + np.array([0.2, 0.0]), angles, angles])
    write_joint_path("three.csv", ("hip", "knee"), cycles, period=0.008)
    page = "planner.report.learning_page.learning_page"
    monkeypatch.setattr(page, lambda *_, **given: pages.append(given))
    words = ("refine", "requests.csv", "three.csv", "--desired", desired, "-o", "next.csv")
    run(*words, "--report", "page.html")
    np.testing.assert_allclose(pages[0]["measured"], angles, atol=1e-9)
    names = [line[:4] for line in run(*words).stderr.splitlines() if "the first cycle" in line]
    assert names == ["hip:"]


@pytest.fixture
def late(run, desired, execute):
    """A line that refines from three cycles whose rows come early or late and are lost."""
    run("plan", desired, "-o", "requests.csv")
    angles = np.degrees(execute())
    count = len(angles)

    def late(*names, lost=(100,), drift=1.0):
        rows = np.arange(3 * count)
        at = rows + 0.2 * np.sin(rows**2)  # as uneven as it gets
        columns = [np.interp(at, rows, np.tile(column, 3)) for column in angles.T]
        table = np.delete(np.column_stack([0.008 * drift * at + 7.0, *columns]), lost, axis=0)
        np.savetxt("late.csv", table, "%.5f", ",", header=",".join(names), comments="")
        line = ("refine", "requests.csv", "late.csv", "--desired", desired, "--no-reidentify")
        return run(*line, "-o", "next.csv")

    return late


def test_measured_rows_at_uneven_times_are_those_at_even_ones_and_a_hole_is_refused(
    run, desired, late
):
    """Clocks jitter by a fifth of a period here, one of 264 rows is lost, and loops fall behind."""
    line = ("refine", "requests.csv", "measured.csv", "--desired", desired, "--no-reidentify")
    run(*line, "-o", "next.csv")
    even = read_joint_path("next.csv").values
    for changed in ({}, {"drift": 1.005}):
        result = late("t_s", "hip_deg", "knee_deg", **changed)
        assert "3 measured cycles of 88 requests" in result.stderr
        assert read_joint_path("next.csv").values == pytest.approx(even, abs=np.radians(0.3))
    result = late("t_s", "hip_deg", "knee_deg", lost=(100, 101, 102, 103))
    assert result.exit_code == 2
    assert "late.csv, line 102: 0.0" in result.stderr
    assert "leave out the cycle with the hole" in result.stderr


def test_the_actual_angles_of_a_log_are_measured_ones(run, desired, execute):
    run("plan", desired, "-o", "requests.csv")
    requests, angles = read_joint_path("requests.csv").values, execute()
    names = ("hip_requested", "hip_actual", "knee_requested", "knee_actual")
    rows = np.stack([requests, angles], axis=2).reshape(len(angles), 4)
    write_joint_path("log.csv", names, rows, period=0.008)
    said = [
        run("refine", "requests.csv", file, "--desired", desired, "--no-reidentify").stdout
        for file in ("measured.csv", "log.csv")
    ]
    assert said[0] == said[1] != ""
    write_joint_path("log.csv", ("requested", "actual"), rows[:, 2:], period=0.008)
    line = ("refine", "requests.csv", "log.csv", "--desired", desired, "--no-reidentify")
    alone = run(*line, "--joint", "knee")
    assert alone.exit_code == 0, alone.output
    late = np.column_stack([np.roll(rows[:, 2], 2), rows[:, 3]])
    write_joint_path("log.csv", ("requested", "actual"), late, period=0.008)
    assert run(*line, "--joint", "knee").stdout == alone.stdout, "requests two rows late"


def test_cycles_of_the_same_requests_are_averaged_or_begin_anew_in_the_unit_of_the_path(run):
    """Of a joint in shares, with the desired path for requests; the joint becomes slower."""
    path = 0.5 * np.sin(2.0 * np.pi * np.arange(88)[:, np.newaxis] / 88.0)
    write_joint_path("path.csv", ("jaw",), path, period=0.008, units=("percent",))
    for name, theta_0 in (("old", 0.2), ("new", 0.4)):
        angles = simulate(replace(ERS210A, theta_0=theta_0), path[:, 0])[:, np.newaxis]
        write_joint_path(f"{name}.csv", ("jaw",), angles, period=0.008, units=("percent",))
    JointModel.ers210a().with_evidence(Evidence(unit="range")).to_toml("jaw.toml")
    line = ("refine", "path.csv", "--desired", "path.csv", "--model", "jaw.toml", "--history", "h")
    first, second, third = (
        run(*line, name, "-o", "r.csv") for name in ("old.csv", "old.csv", "new.csv")
    )
    assert "warning: the requests are the desired path: if they were planned" in first.stderr
    assert "jaw: 1 new and 1 earlier cycle of the same requests are averaged" in second.stderr
    number = r"[\d.]+ % of range"
    said = f"jaw: the same requests gave {number} rms where 2 earlier cycles had {number}, "
    assert re.search(said, third.stderr), third.stderr


@pytest.mark.usefixtures("no_foot_bound")
def test_after_a_plan_for_the_foot_the_measured_joints_learn_their_part_of_it(
    run, execute, tmp_path
):
    """They come to follow their angles in that plan; a foot measured whole is learnt as ever."""
    file = tmp_path / "foot.csv"
    write_foot_path(file, half_ellipse(samples=40, length=0.015, height=0.005), period=0.008)
    assert run("plan", file, *LEG, "-o", "requests.csv").exit_code == 0
    first = read_joint_path("requests.csv")
    planned = np.column_stack([simulate(ERS210A, column) for column in first.values.T])
    line = ("refine", "requests.csv", "measured.csv", "--desired", file, *LEG, "--no-reidentify")
    line = (*line, "--history", "all.json", "--json", "-o", "requests.csv", "--report", "page.html")
    name, errors = first.names[1], []
    for _ in range(2):
        errors.append(np.sqrt(np.mean((execute()[:, 1] - planned[:, 1]) ** 2)))
        alone = read_joint_path("measured.csv", joints=(name,)).values
        write_joint_path("measured.csv", (name,), alone, period=0.008)
        result = run(*line)
        assert result.exit_code == 0, result.output
        assert "no measured angles of rotator, knee: requests kept" in result.stderr
        said = f"{name} learnt by the angles of the plan for the foot"
        assert said in result.stderr
        assert said in (tmp_path / "page.html").read_text("utf-8")
        learning = json.loads(result.stdout)["learning"]
        assert learning.keys() == {name}
        assert np.radians(learning[name]["errors_deg"]) == pytest.approx(errors, rel=1e-6)
        sent = read_joint_path("requests.csv").values
        np.testing.assert_allclose(sent[:, [0, 2]], first.values[:, [0, 2]], atol=1e-12)
    left = np.sqrt(np.mean((execute()[:, 1] - planned[:, 1]) ** 2))
    assert left < 0.25 * errors[0]
    answer = json.loads(run(*line).stdout)
    assert answer["learning"]["foot"]["trials"] == 1
    assert json.loads((tmp_path / "all.json").read_text())["plans"].keys() == {name, "foot"}
