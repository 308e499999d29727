"""Requests as actions, in the layout of LeRobot datasets v3.0."""

from __future__ import annotations

import json

import numpy as np
import pytest

from planner.exceptions import InvalidInput, MissingExtra
from planner.files.exports.lerobot import write_lerobot
from planner.files.output_folder import list_files
from planner.robot.schedule import Schedule

SINGLE = 1e-7
"""Half a step of float32 at angles below 1.5 rad, rounded up [rad]."""


@pytest.fixture
def parquet():
    return pytest.importorskip("pyarrow.parquet", reason="needs the extra parquet")


def test_actions_come_back_with_their_frames(schedule, tmp_path, parquet):
    write_lerobot(tmp_path / "walk", schedule)
    data = parquet.read_table(tmp_path / "walk" / "data" / "chunk-000" / "file-000.parquet")
    assert data.column_names == [
        "action",
        "timestamp",
        "frame_index",
        "episode_index",
        "index",
        "task_index",
    ]
    assert str(data.schema.field("action").type.value_type) == "float"
    assert np.max(np.abs(np.array(data["action"].to_pylist()) - schedule.requests)) <= SINGLE
    assert np.allclose(data["timestamp"].to_pylist(), np.arange(64) * 0.008, atol=SINGLE)
    assert data["frame_index"].to_pylist() == data["index"].to_pylist() == list(range(64))
    assert set(data["episode_index"].to_pylist()) == set(data["task_index"].to_pylist()) == {0}


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


def test_a_single_joint_is_a_plain_column_as_lerobot_has_it(tmp_path, parquet):
    write_lerobot(tmp_path / "knee", Schedule(("knee",), np.array([[0.5], [0.25]]), 0.02))
    data = parquet.read_table(tmp_path / "knee" / "data" / "chunk-000" / "file-000.parquet")
    assert data["action"].to_pylist() == [0.5, 0.25]


def test_the_same_requests_make_the_same_files(schedule, tmp_path, parquet):  # noqa: ARG001
    for place in ("one", "two"):
        write_lerobot(tmp_path / place, schedule)
    names = list_files(tmp_path / "one")
    assert names == list_files(tmp_path / "two")
    for name in names:
        one, two = (tmp_path / place / name for place in ("one", "two"))
        assert one.read_bytes() == two.read_bytes(), name


def test_frames_come_at_a_whole_rate(tmp_path, parquet):  # noqa: ARG001
    odd = Schedule(("knee",), np.zeros((4, 1)), 0.0123)
    with pytest.raises(InvalidInput, match=r"is 81.3008 per second, expected a whole number"):
        write_lerobot(tmp_path / "out", odd)
    assert list_files(tmp_path) == []


def test_what_is_not_installed_is_named(schedule, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtra, match=r"request-planner\[parquet\]"):
        write_lerobot(tmp_path / "out", schedule)
