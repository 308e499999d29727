"""LeRobot datasets: joints by name, a log an episode, units only as the user says them."""

import json

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from planner import InvalidFile, LogOptions, joints_in, read_logs
from planner.files.logs.lerobot import find_dataset, lerobot_episodes, read_episode
from tests.files.logs.datasets import FPS, JOINTS, LENGTHS, NAMES, info, rows, v21, v30, values
from tests.files.logs.told import told

EXACT = 1e-12  # angles come through unchanged but for one product of float64 [rad]
CLOCK = 1e-7  # times are written in float32; below a second this is their last digit [s]
LAYOUTS = {"v2.1": v21, "v3.0": v30}
ELBOW = LogOptions(joint="elbow_flex", unit="deg")
FEATURES = info("v2.1", [f"{joint}.pos" for joint in JOINTS])["features"]
GRIPPER = {"joint": "gripper", "unit": "deg"}
FOUR = [[1.0, 2.0, 3.0]] * 4


def _assert_is(log, episode, joint):
    action, state = (part[:, JOINTS.index(joint)].astype(float) for part in values(episode))
    np.testing.assert_allclose(log.requests, np.radians(action), atol=EXACT)
    np.testing.assert_allclose(log.angles, np.radians(state), atol=EXACT)
    np.testing.assert_allclose(log.times, np.arange(LENGTHS[episode]) / FPS, atol=CLOCK)
    assert log.joint == joint
    assert log.name.endswith(f"episode {episode}")


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_episode_is_a_log_of_the_named_joint(tmp_path, layout, names):
    root = LAYOUTS[layout](tmp_path / "set", NAMES[names])
    assert joints_in(root) == JOINTS
    logs = read_logs(root, options=ELBOW)
    assert len(logs) == len(LENGTHS)
    for episode, log in enumerate(logs):
        _assert_is(log, episode, "elbow_flex")
    assert logs[0].notes[:2] == (
        "time from 'timestamp', requested from 'action' (sent at the time of its row), actual from "
        "'observation.state'",
        "angles in deg, as --unit said",
    )


def test_episodes_come_in_the_order_of_their_numbers_whatever_the_order_of_their_files(tmp_path):
    folder = v30(tmp_path / "set") / "data" / "chunk-000"
    first, second = folder / "file-000.parquet", folder / "file-001.parquet"
    first.rename(folder / "last.parquet")
    second.rename(first)
    (folder / "last.parquet").rename(second)
    found = lerobot_episodes(tmp_path / "set", ELBOW)
    assert [number for _, number in found] == [0, 1, 2]


@pytest.mark.parametrize("group", [1, 3, 100])
def test_an_episode_is_whole_in_whatever_row_groups_it_lies(tmp_path, group):
    file = v30(tmp_path / "set") / "data" / "chunk-000" / "file-000.parquet"
    parquet.write_table(parquet.read_table(file), file, row_group_size=group)
    for episode in (0, 1):
        found = read_episode(file, episode)
        np.testing.assert_array_equal(found.action, values(episode)[0])
        np.testing.assert_array_equal(found.state, values(episode)[1])


def test_an_episode_has_the_task_of_its_own_rows(tmp_path):
    root = v30(tmp_path / "set")
    file = root / "data" / "chunk-000" / "file-000.parquet"
    numbers = [0] * (LENGTHS[0] - 1) + [1] * (LENGTHS[1] + 1)  # the last row has the next task
    parquet.write_table(_set(parquet.read_table(file), "task_index", numbers), file)
    tasks = pa.table({"task_index": [0, 1], "__index_level_0__": ["lift", "drop"]})
    parquet.write_table(tasks, root / "meta" / "tasks.parquet")
    found = [read_episode(*each).task for each in lerobot_episodes(root, LogOptions())]
    assert found == ["lift", "drop", "lift"]
    (root / "meta" / "tasks.parquet").unlink()
    lines = [{"task_index": k, "task": task} for k, task in enumerate(("lift", "drop"))]
    lines.append({"task_index": 2})
    (root / "meta" / "tasks.jsonl").write_text("\n\n".join(map(json.dumps, lines)))
    assert find_dataset(root).tasks() == {0: "lift", 1: "drop", 2: ""}


def _described(root, **changes):
    """Change what a dataset says of itself."""
    file = root / "meta" / "info.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def _with_features(root, action, state):
    names = {"action": {"names": action}, "observation.state": {"names": state}}
    _described(root, features=names)


READ = {
    "an old version": (
        lambda root: _described(root, codebase_version="v2.0"),
        {"joint": "gripper"},
    ),
    "another order": (
        lambda root: _with_features(root, list(JOINTS), list(JOINTS[::-1])),
        {"joint": "gripper"},
    ),
    "names that would be the same": (
        lambda root: _with_features(root, *[["main_a", "a.pos", "b.pos"]] * 2),
        {"joint": "a.pos"},
    ),
    "names that would be empty": (
        lambda root: _with_features(root, *[["main_", "a", "b"]] * 2),
        {"joint": "main_"},
    ),
    "joints in one of both": (
        lambda root: _with_features(root, ["x", "a", "z"], ["a", "y", "z"]),
        {"joint": "all"},
    ),
    "places in groups": (
        lambda root: _with_features(root, *[{"arm": {"a": 1, "b": 0}, "hand": ["c"]}] * 2),
        {"joint": "a"},
    ),
    "an unusual description": (
        lambda root: _described(
            root, fps=0, robot_type=3, features=FEATURES | {"images": {}, "index": {}}
        ),
        {"joint": "gripper"},
    ),
    "29.97 frames": (lambda root: _described(root, fps=29.97), {"joint": "gripper"}),
    "units by joints": (lambda _: None, {"joint": "all", "unit": "ticks,gripper=percent"}),
    "two episodes": (lambda _: None, {"joint": "gripper", "episodes": "2,0"}),
}


def test_a_dataset_says_what_its_description_and_the_options_say(tmp_path, snapshot):
    said = []
    for name, (change, options) in READ.items():
        root = v21(tmp_path / name)
        change(root)
        asked = {"unit": "ticks", "ticks_per_turn": 360.0, "episodes": "1", **options}
        logs = read_logs(root, options=LogOptions(**asked))
        dataset = find_dataset(root)
        known = dataset.written["action"], dataset.others, dataset.rate, dataset.robot_type
        said += [f"{name}: {known}\n", told(logs)]
    snapshot.check("lerobot_read", "".join(said))


ASKED = (
    {"joint": "gripper"},
    {"unit": "deg"},
    {"joint": "elbow", "unit": "deg"},
    {"joint": "gripper", "unit": "ticks"},
    {"time": "timestamp"},
)


def _read(path, **options):
    return read_logs(path, options=LogOptions(**options))


def test_what_a_dataset_does_not_tell_is_asked_for(tmp_path, snapshot):
    root = v21(tmp_path / "set")
    cases = {f"{options}": options for options in ASKED}
    snapshot.refusals("lerobot_options", lambda each: _read(root, **each), cases, FILE=root)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_episode_that_is_not_there_is_reported_with_those_that_are(tmp_path, layout):
    root = LAYOUTS[layout](tmp_path / "set")
    for episodes in ("1,7", "7", "9,2,7"):
        with pytest.raises(InvalidFile, match=r"set: no episode 7; episodes: 0-2$"):
            _read(root, **GRIPPER, episodes=episodes)


def _with_table(tmp_path, change):
    """A dataset of one episode whose table is changed."""
    root = v21(tmp_path / "set")
    file = root / "data" / "chunk-000" / "episode_000000.parquet"
    parquet.write_table(change(rows(0)), file)
    return root, file


def _set(table, name, column):
    return table.set_column(table.column_names.index(name), name, pa.array(column))


TABLES = {
    "no rows": lambda table: table.slice(0, 0),
    "no action": lambda table: table.drop_columns("action"),
    "of another robot": lambda table: _set(table, "action", [[1.0, 2.0]] * 5),
    "rows of different lengths": lambda table: _set(table, "action", [*FOUR, [1.0]]),
    "text": lambda table: _set(table, "timestamp", list("abcde")),
    "unsorted": lambda table: _set(table, "timestamp", [0.0, 0.1, 0.3, 0.2, 0.4]),
    "no episode's number": lambda table: _set(table, "episode_index", [0.5] * 5),
    "the same column twice": lambda table: table.append_column("action", table["action"]),
    "one row": lambda table: table.slice(0, 1),
}


@pytest.mark.parametrize("last", [None, [1.0, 2.0, None], [1.0, 2.0, np.nan]])
def test_a_row_with_an_empty_cell_is_left_out_with_a_note(tmp_path, last):
    root, _ = _with_table(tmp_path, lambda table: _set(table, "action", [*FOUR, last]))
    (log,) = read_logs(root, options=LogOptions(joint="gripper", unit="deg", episodes="0"))
    assert len(log.times) == 4
    assert "row 5: left out, as the time or the request is missing" in log.notes


def test_a_table_that_cannot_be_read_is_reported_with_its_place(tmp_path, snapshot):
    root, file = _with_table(tmp_path, lambda table: table)

    def read(change):
        parquet.write_table(change(rows(0)), file)
        _read(root, **GRIPPER, episodes="0")

    snapshot.refusals("lerobot_tables", read, TABLES, FILE=file)


INFOS = {
    "another version": {**info("v1.6", list(JOINTS))},
    "a list": [],
    "no features": {"codebase_version": "v3.0"},
    "no joint in common": {
        "codebase_version": "v2.1",
        "features": {"action": {"names": ["x", "y", "z"]}, "observation.state": {"names": JOINTS}},
    },
    "no observation": {"codebase_version": "v3.0", "features": {"action": {"names": list(JOINTS)}}},
}


def test_a_description_that_cannot_be_understood_is_refused(tmp_path, snapshot):
    root = v21(tmp_path / "set")
    file = root / "meta" / "info.json"

    def read(content):
        file.write_text(json.dumps(content))
        _read(root)

    snapshot.refusals("lerobot_descriptions", read, INFOS, FILE=file, SET=root)


def test_a_file_that_is_cut_short_is_refused(tmp_path):
    root, file = _with_table(tmp_path, lambda table: table)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(InvalidFile, match=r"not Parquet that .*; is the file cut short\?$"):
        _read(root, **GRIPPER, episodes="0")
