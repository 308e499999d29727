"""Whatever happened to a file on its way, it is read or refused with one line that names it."""

import json

import click
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinematics import KinematicsError, Leg, urdf_path
from planner import InvalidInput, LogOptions, read_logs
from planner.cli.run import read_run
from planner.files.joint_model import read_model_file
from planner.files.paths import foot_path, path_table, read_joint_path
from tests.files.logs.bags import START, Kit, only_file, store, write
from tests.files.logs.datasets import v21

JOINTS = "t_s,hip_deg,knee_deg\n" + "".join(f"{0.008 * k:.3f},{k},{-k}\n" for k in range(9))
FOOT = "x_m,y_m,z_m\n" + "".join(f"{0.01 * k:.2f},0.02,-0.1\n" for k in range(9))
LOG = "t_s,requested_deg,actual_deg\n" + "".join(f"{0.01 * k:.2f},{k},{k - 1}\n" for k in range(9))
MODEL = "v_max = 5.0\ntheta_0 = 0.2\nlag = 0.03\nacceleration_time = 0.05\ntick = 0.008\n"
MODELS = f"{MODEL}[knee]\nlag = 0.02\n"
RUN = """\
[leg]
name = "reference"
unreachable = "clamp"
near = {knee = 20.0}
[path.half_ellipse]
samples = 12
[model]
file = "ers210a"
[plan]
method = "optimal"
norm = "rms"
[limits.joints]
knee = [-60, 60]
[[export]]
format = "csv"
file = "robot.csv"
joint_names = ["a", "b", "c"]
"""
ROBOT = urdf_path("reference_leg.urdf").read_bytes()
ENTRY = {"goal_position": 0.5, "position": 0.25, "torque_enable": True}
BAM = json.dumps({"entries": [{"timestamp": 0.01 * k, **ENTRY} for k in range(6)]})


def _read_robot(path):
    leg = Leg.from_urdf(path, base="hip", foot="foot")
    leg.inverse(leg.foot_positions(np.zeros((2, len(leg.joint_names)))), unreachable="nearest")


def _read_logs(path):
    for log in read_logs(path, options=LogOptions(joint="all", unit="rad")):
        assert np.isfinite(log.requests).all()
        assert (np.diff(log.times) > 0).all()


READERS = {
    "joints.csv": (JOINTS.encode(), read_joint_path),
    "foot.csv": (FOOT.encode(), lambda path: foot_path(path_table(path))),
    "log.csv": (LOG.replace("_deg", "").encode(), _read_logs),
    "log.json": (BAM.encode(), _read_logs),
    "models.toml": (MODELS.encode(), read_model_file),
    "run.toml": (RUN.encode(), lambda path: read_run(str(path))),
    "robot.urdf": (ROBOT, _read_robot),
}

SPLINTERS = [
    *(b"\0", b"\n", b"\r", b",", b";", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b"#", b".", b"-"),
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"9" * 40, b"9" * 5000, b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b"true", b"null", b"[[", b"[a]\n", b"a.b = 1\n", b"<", b">", b"</robot>", b"&x;", b"<!--"),
    *(b"\xf0\x9f\x92\xa9", "\u202e".encode(), b"\x1b[31m", b"__import__('os')", b"!!python/none"),
]

DAMAGE = st.tuples(
    st.sampled_from(["flip", "cut", "drop", "double", "insert", "swap"]),
    st.integers(0, 10**6),
    st.integers(0, 10**6),
    st.one_of(st.sampled_from(SPLINTERS), st.binary(min_size=1, max_size=4)),
)


def damaged(content, damage):
    """The content after one accident."""
    kind, one, other, splinter = damage
    start, end = sorted((one % (len(content) + 1), other % (len(content) + 1)))
    if kind == "flip":
        return content[:start] + splinter + content[start + len(splinter) :]
    if kind == "cut":
        return content[:end]
    if kind == "drop":
        return content[:start] + content[min(end, start + 40) :]
    if kind == "double":
        return content[:end] + content[start:end] + content[end:]
    if kind == "insert":
        return content[:start] + splinter + content[start:]
    lines = content.splitlines(keepends=True) or [b""]
    a, b = one % len(lines), other % len(lines)
    lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


@pytest.fixture(scope="module", params=[*READERS, "db3", "mcap", "bag", "parquet", "yaml"])
def kept(request, tmp_path_factory):
    """A file of a format, what it holds, and what reads it, alone or with others beside it."""
    folder, kind = tmp_path_factory.mktemp("files"), request.param
    if kind in READERS:
        content, read = READERS[kind]
        return folder / kind, content, read
    if kind == "parquet":
        file = v21(folder / "set") / "data" / "chunk-000" / "episode_000001.parquet"
        return file, file.read_bytes(), _read_logs
    ros1 = kind == "bag"
    types = store(ros1=ros1)
    states = [Kit(types).state(START + k, [0.1 * k, 0.2], [0.1, 0.2]) for k in range(4)]
    messages = [("/s", START + k, each) for k, each in enumerate(states)]
    storage = {"bag": "ros1", "mcap": "mcap"}.get(kind, "sqlite3")
    run = write(folder / ("run.bag" if ros1 else "run"), types, messages, storage=storage)
    if kind == "yaml":
        file = run / "metadata.yaml"
        return file, file.read_bytes(), lambda _: _read_logs(run)
    file = run if ros1 else only_file(run, f".{kind}")
    return file, file.read_bytes(), _read_logs


@settings(max_examples=100)
@given(accidents=st.lists(DAMAGE, min_size=0, max_size=4))
@example(accidents=[("cut", 0, 0, b"\0")])
@example(accidents=[])
def test_a_whole_file_is_read_and_a_damaged_one_read_or_refused(kept, accidents):
    file, content, read = kept
    for accident in accidents:
        content = damaged(content, accident)
    file.write_bytes(content)
    try:
        read(file)
    except (InvalidInput, KinematicsError) as error:
        message = str(error)
        assert accidents, message
        assert message.isprintable(), message
        assert len(message) < 2000, message
    except click.UsageError:
        pass  # options that the run file's keys stand for
