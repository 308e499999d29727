"""Requests as actions, in the layout of LeRobot datasets v3.0."""

from __future__ import annotations

import json

import numpy as np
import pytest

from planner import InvalidInput, LogOptions, read_logs
from planner.files.exports import Layout, lerobot_dataset, write_lerobot
from planner.files.staging import list_files

SINGLE = 1e-7
"""Half a step of float32 at angles below 1.5 rad, rounded up [rad]."""


@pytest.fixture
def parquet():
    return pytest.importorskip("pyarrow.parquet", reason="needs the extra parquet")


def test_the_description_says_where_everything_is(schedule, tmp_path, parquet):
    out = tmp_path / "walk"
    write_lerobot(out, schedule, task="walk on the spot")
    info = json.loads((out / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] == 125
    assert info["total_frames"] == 64
    assert info["features"]["action"] == {
        "dtype": "float32",
        "shape": [3],
        "names": ["hip", "on", "knee"],
    }
    first = {"chunk_index": 0, "file_index": 0}
    assert (out / info["data_path"].format(**first)).is_file()
    (episode,) = parquet.read_table(
        out / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    ).to_pylist()
    assert episode["tasks"] == ["walk on the spot"]
    assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (0, 64)
    tasks = parquet.read_table(out / "meta" / "tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert tasks.to_pylist() == [{"task_index": 0, "task": "walk on the spot"}]
    stats = json.loads((out / "meta" / "stats.json").read_text())
    assert stats["action"]["max"] == pytest.approx([0.4, 0.3, 1.2], abs=1e-6)
    assert stats["action"]["count"] == [64]


def test_episodes_follow_one_another(tmp_path, parquet):
    rng = np.random.default_rng(2)
    actions = [rng.normal(size=(count, 2)) for count in (4, 5, 3)]
    layout = Layout(features={"action": ("a", "b"), "observation.state": ("a", "b")}, rate=30)
    with lerobot_dataset(tmp_path / "out", layout) as add:
        for number, action in enumerate(actions):
            add({"action": action, "observation.state": -action}, "up" if number > 1 else "down")
    read = read_logs(tmp_path / "out", options=LogOptions(joint="a", unit="rad"))
    for log, action in zip(read, actions, strict=True):
        assert log.requests == pytest.approx(action[:, 0], abs=1e-6)
        assert log.angles == pytest.approx(-action[:, 0], abs=1e-6)
    data = parquet.read_table(tmp_path / "out/data/chunk-000/file-000.parquet").to_pylist()
    assert [row["index"] for row in data] == list(range(12))
    assert [row["frame_index"] for row in data] == [*range(4), *range(5), *range(3)]
    times = [row["timestamp"] for row in data]
    assert times == pytest.approx([row["frame_index"] / 30 for row in data], abs=SINGLE)
    assert [row["episode_index"] for row in data] == [0] * 4 + [1] * 5 + [2] * 3
    assert [row["task_index"] for row in data] == [0] * 9 + [1] * 3
    rows = parquet.read_table(tmp_path / "out" / "meta/episodes/chunk-000/file-000.parquet")
    about = rows.to_pylist()
    assert [each["dataset_from_index"] for each in about] == [0, 4, 9]
    assert [each["data/chunk_index"] for each in about] == [0, 0, 0]
    assert [each["data/file_index"] for each in about] == [0, 0, 0]
    assert [each["length"] for each in about] == [4, 5, 3]
    assert [each["episode_index"] for each in about] == [0, 1, 2]
    assert [each["tasks"] for each in about] == [["down"], ["down"], ["up"]]
    assert [each["dataset_to_index"] for each in about] == [4, 9, 12]
    stats = json.loads((tmp_path / "out" / "meta" / "stats.json").read_text())["action"]
    every = np.vstack(actions).astype(np.float32)
    assert stats["std"] == pytest.approx(every.std(axis=0), abs=1e-6)
    assert stats["mean"] == pytest.approx(every.mean(axis=0), abs=1e-6)
    assert stats["count"] == [12]
    assert stats["min"] == every.min(axis=0).tolist()
    assert stats["max"] == every.max(axis=0).tolist()
    parts = [np.quantile(each.astype(np.float32), 0.99, axis=0) for each in actions]
    assert about[1]["stats/action/q99"] == pytest.approx(parts[1], abs=1e-6)
    assert stats["q99"] == pytest.approx(np.average(parts, axis=0, weights=[4, 5, 3]), abs=1e-6)


def test_a_dataset_that_is_not_finished_is_not_there(tmp_path, parquet):  # noqa: ARG001
    layout = Layout(features={"action": ("a",)}, rate=30)

    def fail():
        with lerobot_dataset(tmp_path / "out", layout) as add:
            add({"action": np.zeros((3, 1))}, "stay")
            raise InvalidInput("an episode failed")

    with pytest.raises(InvalidInput, match="an episode failed"):
        fail()
    assert list_files(tmp_path) == []
