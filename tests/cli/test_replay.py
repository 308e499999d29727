"""``request-planner replay``: recordings in, recordings out."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from kinematics import urdf_path
from planner import LogOptions, read_logs, simulate
from planner.cli.recordings import tasks_of
from planner.files.table import read_table, write_table
from planner.identification.grid import sound_rows
from tests.instances import SERVO
from tests.snapshots import held

RATE = 30
ELBOW = SERVO.requested_every(1.0 / RATE)
NAMES = ("shoulder_pan.pos", "elbow_flex.pos", "gripper.pos")
LENGTHS = (60, 75, 50)
UNITS = ("--unit", "range_m100_100,gripper=percent")


def motion(count, size):
    return size * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, count))) / 2.0


@pytest.fixture
def model(tmp_path):
    """Models of two joints in shares of their range, as ``identify`` writes them."""
    file = tmp_path / "arm.toml"
    SERVO.to_toml(file)
    file.write_text(file.read_text() + "expected_error = 0.004\n")
    return file


@pytest.fixture
def demo(tmp_path):
    """A recording of an elbow and a jaw as CSV."""
    times = 0.02006 * np.arange(120)
    requests = motion(120, 40.0)
    angles = np.degrees(simulate(SERVO, np.radians(requests), cyclic=False))
    jaw = np.where(times > 1.0, 0.2, 0.8)
    file = tmp_path / "demo.csv"
    table = np.column_stack([times, requests, angles, jaw, np.maximum(jaw, 0.3)])
    names = ["t_s", "req_elbow_deg", "act_elbow_deg", "req_jaw_range", "act_jaw_range"]
    write_table(file, names, table)
    return file


@pytest.fixture
def dataset(tmp_path):
    """A LeRobot dataset at 30 Hz, -100 to 100, of three episodes, one file each."""
    pytest.importorskip("pyarrow", reason="needs the extra parquet")
    from tests.files.logs.datasets import v21

    motions = []
    for count in LENGTHS:
        requests = 0.5 + motion(count, 0.3)
        angles = simulate(ELBOW, requests, cyclic=False)
        moved = [
            np.column_stack([200.0 * (each - 0.5), 200.0 * (each - 0.5), 50.0 * each])
            for each in (requests, angles)
        ]
        motions.append([each.astype(np.float32) for each in moved])
    motions[1][1][20] = np.nan
    cameras = {"observation.images.top": {}, "observation.images.wrist": {}}
    root = v21(tmp_path / "my_dataset", list(NAMES), motions=motions, **cameras)
    (root / "meta" / "tasks.jsonl").write_text('{"task_index": 0, "task": "lift"}\n')
    return root


@pytest.mark.usefixtures("in_this_process")
def test_a_dataset_comes_back_as_a_dataset(run, dataset, model):
    result = run(
        *("replay", dataset, *UNITS, "--model", model, "--speed", 1.5),
        *("--as", "lerobot", "-o", "planned"),
    )
    assert result.exit_code == 0, result.stderr
    cameras = "observation.images.top, observation.images.wrist"
    assert result.stderr.count(f"{cameras} left out: the frames are of other moments") == 1
    options = LogOptions(joint="all", unit=UNITS[1])
    given, made = read_logs(dataset, options=options), read_logs("planned", options=options)
    assert [log.joint for log in made] == [log.joint for log in given]
    for old, new in zip(given, made, strict=True):
        assert np.allclose(np.diff(new.times), 1.0 / RATE, atol=1e-6)
        sound, moments = sound_rows(old), 1.5 * new.times + old.times[0]
        again, asked = (
            np.interp(moments, old.times[sound], each[sound]) for each in (old.angles, old.requests)
        )
        assert new.angles == pytest.approx(again, abs=1e-5)
        if old.joint == "gripper":
            assert new.requests == pytest.approx(asked, abs=1e-5)
        else:
            answer = simulate(ELBOW, new.requests, cyclic=False, start=new.angles[0])
            assert np.sqrt(np.mean((answer - new.angles) ** 2)) < 0.01
    info = json.loads((dataset.parent / "planned/meta/info.json").read_text())
    assert info["fps"] == RATE
    assert info["robot_type"] == "so100"
    assert info["features"]["action"]["names"] == list(NAMES)
    assert info["total_episodes"] == 3
    told = json.loads((dataset.parent / "planned/replay.json").read_text())["recordings"]
    bridged = "1 angles that are missing, or that no joint takes, are bridged"
    names = ("shoulder_pan", "elbow_flex", "gripper")
    expected = [[], [f"{name}: {bridged}" for name in names], []]
    assert [each["remarks"] for each in told] == expected


@pytest.mark.usefixtures("in_this_process")
def test_models_that_do_not_fit_are_warned_of_once_though_quiet(run, dataset, model):
    model.write_text(re.sub("v_max = .*", "v_max = 0.5", model.read_text()))
    words = ("replay", dataset, *UNITS, "--model", model, "--workers", 1, "--as", "lerobot", "-o")
    for quiet in ((), ("-q",)):
        result = run(*words, f"planned{len(quiet)}", *quiet)
        document = json.loads(Path(f"planned{len(quiet)}/replay.json").read_text())
        (warning,) = document["warnings"]
        example = f"for example '{dataset}, episode 0': the simulated angles of"
        assert warning.startswith(f"3 of 3 recordings, {example}")
        assert result.stderr.count("simulated angles") == 1
        assert f"warning: {warning}" in result.stderr
        rows = document["recordings"]
        assert {each["model_fits_recording"] for each in rows} == {False}
        assert all("the simulated angles of" in each["warnings"][0] for each in rows)


@pytest.fixture
def never_replayed(monkeypatch):
    """Fail where something is planned, or a model read."""

    def planned(*_):
        raise AssertionError("planned again")

    monkeypatch.setattr("planner.cli.recordings.tasks_of", planned)


@pytest.mark.usefixtures("in_this_process")
def test_a_replay_that_is_complete_is_not_computed_again(run, dataset, model, never_replayed):  # noqa: ARG001
    urdf = Path(shutil.copy(urdf_path("ers210a.urdf"), dataset.parent))
    words = ("replay", dataset, "--unit", "deg", "--model", model, "--as", "lerobot")
    words += ("-o", "planned", "--leg", urdf, "--base", "body", "--foot", "front_left_paw")
    for joint, name in zip(NAMES, ("rotator", "abductor", "knee"), strict=True):
        words += ("--urdf-joint", f"{joint.removesuffix('.pos')}=front_left_{name}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.cli.recordings.tasks_of", tasks_of)
        first = run(*words, "--workers", 1, "--json")
    assert first.exit_code == 0, first.stderr
    (dataset.parent / ".planned.results").mkdir()  # killed between writing and tidying up
    before = held(dataset.parent / "planned")
    again = run(*words, "--resume", "--json")
    said = "request-planner: nothing is missing: planned holds all 3 recordings, planned like this"
    assert again.stderr.splitlines()[0] == said
    assert again.stdout == first.stdout
    assert held(dataset.parent / "planned") == before
    assert not (dataset.parent / ".planned.results").exists()
    with pytest.MonkeyPatch.context() as patch:
        old = {key: each for key, each in json.loads(first.stdout).items() if key != "warnings"}
        patch.setattr("planner.files.results.finished", lambda *_: old)  # of an earlier version
        assert run(*words, "--resume", "--report", "page.html").exit_code == 0
    with pytest.raises(AssertionError, match="planned again"):
        run(*words, catch_exceptions=False)
    for changed in (
        *(("--speed", 2), ("--limits-deg", "0:90"), ("--episodes", "0-1"), ("--norm", "max")),
        *(("--unit", "range"), ("--tolerance-deg", 9), ("--base", "head")),
    ):
        with pytest.raises(AssertionError, match="planned again"):
            run(*words, "--resume", *changed, catch_exceptions=False)
    for file, comment in ((model, "# identified again"), (urdf, "<!-- weighed again -->")):
        content = file.read_text()
        file.write_text(f"{content}{comment}\n")
        with pytest.raises(AssertionError, match="planned again"):
            run(*words, "--resume", catch_exceptions=False)
        file.write_text(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.files.results.__version__", "0.0.1")
        with pytest.raises(AssertionError, match="planned again"):
            run(*words, "--resume", catch_exceptions=False)


@pytest.mark.usefixtures("in_this_process")
def test_what_failed_alone_is_done_again_by_the_same_settings_once_it_is_mended(
    run, dataset, model
):
    file = dataset / "data/chunk-000/episode_000001.parquet"
    kept = dataset.parent / ".planned.results"
    good = file.read_bytes()
    words = ("replay", dataset, *UNITS, "--model", model, "--workers", 1, "--as", "lerobot", "-o")
    file.write_bytes(b"PAR1 nothing")
    (dataset / "meta" / "tasks.jsonl").unlink()
    assert run(*words, "planned", "--speed", 2).exit_code == 1
    first = run(*words, "planned")
    assert first.exit_code == 1
    said = f"1 of 3 recordings left out; the others are written, and kept in {kept} for --resume"
    assert said in first.stderr
    assert "the task is called" not in first.stderr  # as the dataset has no tasks
    results = {each: each.stat().st_mtime_ns for each in kept.glob("??/*")}
    assert len(results) == 2
    other = run(*words, "planned", "--resume", "--speed", 2)
    assert (other.exit_code, "holds results for other settings (path)" in other.stderr) == (2, True)
    text = model.read_text()
    for old, new in (("v_max = 4.0", "v_max = 5.0"), ("= 0.004", "= 0.3")):
        model.write_text(text.replace(old, new, 1))
        other = run(*words, "planned", "--resume")
        assert "holds results for other settings (models)" in other.stderr
    model.write_text(text)
    file.write_bytes(good)
    second = run(*words, "planned", "--resume")
    assert second.exit_code == 0, second.stderr
    assert not kept.exists()
    assert run(*words, "whole").exit_code == 0
    assert held(dataset.parent / "planned") == held(dataset.parent / "whole") != {}


def test_a_recording_that_begins_in_motion_is_answered_with_where_to_begin_it(run, demo, model):
    table = read_table(demo)
    rows = np.array(table.numbers(table.names))
    rows[:5, 2] += 30.0 * np.array([1.0, 0.8, 0.6, 0.4, 0.2])  # the arm had been elsewhere
    write_table(demo, table.names, rows)
    ask = ("replay", demo, "--model", model, "-o", "out.csv", "--fastest", "--tolerance-deg", 2)
    refused = run(*ask)
    assert refused.exit_code == 2
    assert (
        "--begin-s: got 0 s, where the recording is in motion: from rest no requests keep elbow"
        in (refused.stderr)
    )
    begin = refused.stderr.split("expected a moment without such motion, as ")[1].split(" s")[0]
    assert 0.1 <= float(begin) < 0.3
    answered = run(*ask, "--begin-s", begin)
    assert answered.exit_code == 0, answered.stderr
    assert "the recording contradicts" not in answered.stderr


def test_a_joint_that_cannot_be_identified_gets_its_recorded_requests_and_is_named(run, demo):
    table = read_table(demo)
    rows = np.column_stack([table.numbers(table.names), np.zeros((120, 2))])
    write_table(demo, [*table.names, "req_wrist_deg", "act_wrist_deg"], rows)
    result = run("replay", demo, "--model", "from-log", "-o", "out.csv")
    assert result.exit_code == 0, result.stderr
    assert "warning: wrist: no model: " in result.stderr
    assert "no model: recorded requests, re-timed" in result.stderr
