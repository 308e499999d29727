"""LeRobot datasets as its recorder lays them out, v2.1 and v3.0."""

import json

import numpy as np
import pyarrow as pa
from pyarrow import parquet

FPS = 30
JOINTS = ("shoulder_pan", "elbow_flex", "gripper")
LENGTHS = (5, 4, 6)  # rows of the episodes 0, 1 and 2

NAMES = {
    "flat": list(JOINTS),
    "with .pos": [f"{joint}.pos" for joint in JOINTS],
    "nested": [list(JOINTS)],
    "of motors": {"motors": [f"main_{joint}" for joint in JOINTS]},
    "by place": {joint: j for j, joint in reversed(list(enumerate(JOINTS)))},
}
"""How datasets write the names of joints."""


def values(episode):
    """Action and observation of an episode, shape (n, 3) each [degrees], in float32."""
    k = np.arange(LENGTHS[episode])[:, None]
    action = 10.0 * episode + k + 20.0 * np.arange(len(JOINTS))
    return action.astype(np.float32), (0.5 * action + 1.0).astype(np.float32)


def rows(episode, moved=None, *, fixed=False):
    """An episode's rows as an Arrow table, with its own motion or another."""
    action, state = values(episode) if moved is None else moved
    n = len(action)
    kind = pa.list_(pa.float32(), len(JOINTS)) if fixed else pa.list_(pa.float32())
    return pa.table(
        {
            "action": pa.array(list(action), type=kind),
            "observation.state": pa.array(list(state), type=kind),
            "timestamp": pa.array(np.arange(n, dtype=np.float32) / FPS),
            "frame_index": pa.array(np.arange(n)),
            "episode_index": pa.array(np.full(n, episode)),
            "index": pa.array(np.arange(n)),
            "task_index": pa.array(np.zeros(n, dtype=np.int64)),
        }
    )


def info(version, names):
    feature = {"dtype": "float32", "shape": [len(JOINTS)], "names": names}
    return {
        "codebase_version": version,
        "robot_type": "so100",
        "fps": FPS,
        "features": {
            "action": feature,
            "observation.state": feature,
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        },
    }


def v21(root, names=NAMES["flat"], *, motions=None, **features):
    """A dataset of one file an episode, with other motions or further features if given."""
    about = info("v2.1", names)
    about["features"] |= features
    motions = [values(episode) for episode in range(len(LENGTHS))] if motions is None else motions
    folder = root / "data" / "chunk-000"
    folder.mkdir(parents=True)
    (root / "meta").mkdir()
    (root / "meta" / "info.json").write_text(json.dumps(about))
    for episode, moved in enumerate(motions):
        table = rows(episode, moved, fixed=True)
        parquet.write_table(table, folder / f"episode_{episode:06d}.parquet")
    return root


def v30(root, names=NAMES["with .pos"]):
    """A dataset of many episodes a file: 0 and 1 in the first, 2 in the second."""
    folder = root / "data" / "chunk-000"
    folder.mkdir(parents=True)
    described = root / "meta" / "episodes" / "chunk-000"
    described.mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info("v3.0", names)))
    parquet.write_table(
        pa.table({"episode_index": [0, 1, 2], "length": list(LENGTHS)}),
        described / "file-000.parquet",
    )
    parquet.write_table(pa.concat_tables([rows(0), rows(1)]), folder / "file-000.parquet")
    parquet.write_table(rows(2), folder / "file-001.parquet")
    return root
