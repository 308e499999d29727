"""Whatever happened to a file on its way, it is read or refused with one line that names it.

Damaged logs, Parquet files, bags and datasets are in ``tests/files/logs/test_any_log.py``.
"""

from __future__ import annotations

import click
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinematics import KinematicsError, Leg, urdf_path
from planner import InvalidInput, read_logs
from planner.cli.run_file import read_run
from planner.files.joint_model import read_model_file
from planner.files.paths import read_foot_path, read_joint_path

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


def _read_robot(path):
    leg = Leg.from_urdf(path, base="hip", foot="foot")
    leg.inverse(leg.foot_positions(np.zeros((2, len(leg.joint_names)))), unreachable="nearest")


READERS = {
    "joints.csv": (JOINTS.encode(), read_joint_path),
    "foot.csv": (FOOT.encode(), read_foot_path),
    "log.csv": (LOG.encode(), read_logs),
    "models.toml": (MODELS.encode(), read_model_file),
    "run.toml": (RUN.encode(), lambda path: read_run(str(path))),
    "robot.urdf": (ROBOT, _read_robot),
}
"""A file of every format, and what reads it."""

SPLINTERS = [
    *(b"\0", b"\n", b"\r", b",", b";", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b"#", b".", b"-"),
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"9" * 40, b"9" * 5000, b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b"true", b"null", b"[[", b"[a]\n", b"a.b = 1\n", b"<", b">", b"</robot>", b"&x;", b"<!--"),
    *(b"\xf0\x9f\x92\xa9", "\u202e".encode(), b"\x1b[31m", b"__import__('os')", b"!!python/none"),
]
"""What is pushed in."""

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


@pytest.mark.parametrize("name", READERS)
def test_the_whole_file_is_read(name, tmp_path):
    content, read = READERS[name]
    (tmp_path / name).write_bytes(content)
    read(tmp_path / name)


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=100)
@given(accidents=st.lists(DAMAGE, min_size=1, max_size=4))
@example(accidents=[("cut", 0, 0, b"\0")])
def test_a_damaged_file_is_read_or_refused(name, accidents, tmp_path_factory):
    content, read = READERS[name]
    for accident in accidents:
        content = damaged(content, accident)
    file = tmp_path_factory.getbasetemp() / name
    file.write_bytes(content)
    try:
        read(file)
    except (InvalidInput, KinematicsError) as error:
        message = str(error)
        assert message.isprintable(), message
        assert len(message) < 2000, message
    except click.UsageError:
        pass  # options that the run file's keys stand for
