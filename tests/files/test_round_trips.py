"""What is written is read back, whatever the unit; what is read is understood in SI."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.exceptions import InvalidFile
from planner.files.joint_model import read_model_file, write_model
from planner.files.paths import (
    foot_path,
    is_foot_path,
    joint_path,
    read_foot_path,
    read_joint_path,
    write_foot_path,
    write_joint_path,
)
from planner.files.table import read_table
from planner.model.joint import JointModel

WRITTEN = 1e-12
"""A written number is off by half of its last decimal at most [deg, m]."""

ANGLES = arrays(
    np.float64, st.tuples(st.integers(2, 30), st.just(3)), elements=st.floats(-100.0, 100.0)
)


@given(angles=ANGLES)
def test_a_written_joint_path_is_read_back(tmp_path_factory, angles):
    file = tmp_path_factory.mktemp("paths") / "path.csv"
    write_joint_path(file, ["rotator", "abductor", "knee"], angles, period=0.008)
    path = read_joint_path(file)
    assert path.names == ("rotator", "abductor", "knee")
    assert np.max(np.abs(path.angles - angles)) <= WRITTEN
    assert path.times == pytest.approx(0.008 * np.arange(len(angles)), abs=WRITTEN)
    path.check_period(0.008)


@given(positions=ANGLES)
def test_a_written_foot_path_is_read_back(tmp_path_factory, positions):
    file = tmp_path_factory.mktemp("paths") / "foot.csv"
    write_foot_path(file, positions)
    path = read_foot_path(file)
    assert path.times is None
    assert np.max(np.abs(path.positions - positions)) <= WRITTEN


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_a_foot_path_may_be_in_any_unit_and_any_order_of_columns(tmp_path, unit, factor):
    file = tmp_path / "foot.csv"
    file.write_text(f"z_{unit},note,x_{unit},y_{unit}\n3,a,1,2\n6,b,4,5\n")
    table = read_table(file)
    assert is_foot_path(table)
    assert foot_path(table).positions == pytest.approx(
        factor * np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    )


def test_degrees_radians_byte_order_marks_blank_lines_and_carriage_returns_are_understood(
    tmp_path,
):
    file = tmp_path / "path.csv"
    file.write_bytes(b"\xef\xbb\xbfindex, knee_deg \r\n0,180\r\n\r\n1,-90\r\n")
    assert read_joint_path(file).angles[:, 0] == pytest.approx([np.pi, -np.pi / 2])
    file.write_text("knee_rad\n1.5\n-2\n")
    assert read_joint_path(file).angles[:, 0].tolist() == [1.5, -2.0]
    assert not is_foot_path(read_table(file))


def test_chosen_joints_come_in_the_chosen_order_and_leave_other_columns_alone(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("note,knee_deg,hip_deg\nstart,1,2\nend,3,4\n")
    path = joint_path(read_table(file), joints=["hip", "knee"])
    assert path.names == ("hip", "knee")
    assert np.degrees(path.angles) == pytest.approx(np.array([[2.0, 1.0], [4.0, 3.0]]))


def test_what_is_read_is_read_only(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("knee_rad\n1\n2\n")
    with pytest.raises(ValueError, match="read-only"):
        read_joint_path(file).angles[0] = 0.0


def test_a_dash_is_standard_input_and_standard_output(monkeypatch, capsys):
    stdin = io.TextIOWrapper(io.BytesIO(b"knee_rad\n1\n2\n"))
    monkeypatch.setattr(sys, "stdin", stdin)
    path = read_joint_path("-")
    write_joint_path("-", path.names, path.angles, period=0.5)
    out = capsys.readouterr().out
    assert out == "t_s,knee_deg\n0.0,57.295779513082\n0.5,114.591559026165\n"


def test_a_written_model_is_read_back(tmp_path):
    file = tmp_path / "model.toml"
    model = JointModel(
        v_max=5.45, theta_0=0.122, lag=0.0321, acceleration_time=0.047, tick=0.005, hold=4
    )
    write_model(file, model)
    assert read_model_file(file).for_joints(["any", "other"]) == (model, model)


def test_a_table_per_joint_changes_only_what_it_says(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n[knee]\nlag = 0.02\n"
    )
    hip, knee = read_model_file(file).for_joints(["hip", "knee"])
    assert (hip.lag, knee.lag) == (0.03, 0.02)
    assert (hip.v_max, knee.v_max) == (5.0, 5.0)


def test_a_joints_own_table_inherits_parameters_and_not_what_is_known_of_them(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.04\n"
        "expected_error = 0.01\nv_max_interval = [4.0, 6.0]\n"
        "[knee]\nv_max = 4.5\n[hip]\nlag = 0.02\nlag_interval = [0.01, 0.03]\n"
    )
    models = read_model_file(file)
    assert models.common.evidence.intervals == {"v_max": (4.0, 6.0)}
    assert models.by_joint["knee"].theta_0 == 0.1
    assert models.by_joint["knee"].evidence is None
    assert models.by_joint["hip"].evidence.intervals == {"lag": (0.01, 0.03)}
    assert np.isnan(models.by_joint["hip"].evidence.error)


def test_what_rounds_to_nothing_is_written_without_a_sign(tmp_path):
    write_joint_path(tmp_path / "path.csv", ["knee"], np.array([[-1e-16], [0.0]]), period=0.008)
    assert (tmp_path / "path.csv").read_text() == "t_s,knee_deg\n0.0,0.0\n0.008,0.0\n"


@pytest.mark.parametrize("name", ["=1+2", "+knee", "-knee", "@SUM(A1)", "'=knee", "'knee"])
def test_a_title_that_a_spreadsheet_takes_as_a_formula_is_written_as_text_and_read_back(
    tmp_path, name
):
    angles = np.linspace(0.0, 0.1, 12).reshape(6, 2)
    write_joint_path(tmp_path / "path.csv", [name, "hip"], angles, period=0.02)
    titles = (tmp_path / "path.csv").read_text().splitlines()[0].split(",")
    assert not any(title.startswith(("=", "+", "-", "@")) for title in titles)
    assert read_joint_path(tmp_path / "path.csv").names == (name, "hip")


def test_standard_input_that_is_closed_is_said_to_be(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(InvalidFile, match="standard input is closed; give it a file or a pipe"):
        read_joint_path("-")
