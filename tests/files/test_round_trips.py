"""What is written is read back, whatever the unit; what is read is understood in SI."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

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
    assert np.max(np.abs(path.values - angles)) <= WRITTEN
    assert path.times == pytest.approx(0.008 * np.arange(len(angles)), abs=WRITTEN)
    path.check_period(0.008)


@given(positions=ANGLES)
def test_a_written_foot_path_is_read_back(tmp_path_factory, positions):
    file = tmp_path_factory.mktemp("paths") / "foot.csv"
    write_foot_path(file, positions)
    path = read_foot_path(file)
    assert path.times is None
    assert np.max(np.abs(path.values - positions)) <= WRITTEN


READ = {
    "degrees": b"\xef\xbb\xbfindex, knee_deg ,sample\r\n0,180,1\r\n\r\n1,-90,2\r\n",
    "radians": b"hip_rad,knee_rad\n0.1,1.5\n0.2,-2\n",
    "shares beside angles": b"hip_deg,jaw_percent\n0,25\n1,50\n",
    "shares": b"t_ms,jaw_range\n5,0.25\n15,0.5\n",
    "loads": b"t_s,hip_deg,knee_deg,knee_load_Nm\n0,1,2,0.5\n0.01,3,4,0.6\n",
    "no loads of these joints": (b"hip_deg,knee_deg,knee_load_Nm\n1,2,0.5\n3,4,0.6\n", ["hip"]),
    "chosen joints": (b"note,knee_deg,hip_deg\nstart,1,2\nend,3,4\n", ["hip", "knee"]),
    "a column of a log": (b"t_s,req_knee_deg,act_knee_deg\n0,1,2\n1,3,4\n", ["act_knee"]),
    "a spreadsheet's": b"sep=;\r\nt_ms;knee_deg\r\n0;1,5\r\n20,5;-2,5e1\r\n",
    "semicolons": b"\n\nt_ms;knee_deg\n0;1,5\n20,5;-2,5e1\n",
    "tabs": b"t_ms\tknee_deg\n0\t1,5\n20,5\t-2.5e1\n",
    "titles of formulas": b"'=1+2_deg,'knee_deg,'-a_deg\n1,2,3\n4,5,6\n",
    "a joint that is called t": b"t_deg,knee_deg\n1,2\n3,4\n",
    "steps that are nearly even": b"t_ms,knee_deg\n0,1\n10,2\n19.91,3\n29.91,4\n",
    "dates": b"clock,knee_deg\n2026-11-23T10:04:00.000,1\n2026-11-23T10:04:00.020,2\n",
    "comments": b"# robot 3\n#t_s, knee_deg\n0,1\n# paused\n0.5,2\n",
    "a length beside a joint": (b"height_m,knee_deg\n1,2\n3,4\n", ["knee"]),
    "metres": b"x_m,y_m,z_m\n1,2,3\n4,5,6\n",
    "centimetres": b"z_cm,note,x_cm,y_cm,t_s\n3,a,1,2,0\n6,b,4,5,0.5\n",
    "millimetres": b"t_us,x_mm,y_mm,z_mm\n0,1,2,3\n2000,4,5,6\n9000,7,8,9\n",
}
"""What a file holds, and the joints to read."""


def test_a_path_is_what_its_columns_say(tmp_path, snapshot):
    file, said = tmp_path / "path.csv", []
    for name, case in READ.items():
        content, joints = case if isinstance(case, tuple) else (case, [])
        file.write_bytes(content)
        table = read_table(file)
        path = (
            foot_path(table, even=False)
            if is_foot_path(table)
            else joint_path(table, joints=joints, even=False)
        )
        values = vars(path).values()
        said.append(
            f"{name}: {[v.tolist() if isinstance(v, np.ndarray) else v for v in values][1:]}\n"
        )
    snapshot.check("paths", "".join(said))


def test_what_is_read_is_read_only(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("knee_rad\n1\n2\n")
    with pytest.raises(ValueError, match="read-only"):
        read_joint_path(file).values[0] = 0.0


def test_a_dash_is_standard_input_and_standard_output(monkeypatch, capsys):
    stdin = io.TextIOWrapper(io.BytesIO(b"knee_rad\n1\n2\n"))
    monkeypatch.setattr(sys, "stdin", stdin)
    path = read_joint_path("-")
    write_joint_path("-", path.names, path.values, period=0.5)
    out = capsys.readouterr().out
    assert out == "t_s,knee_deg\n0.0,57.295779513082\n0.5,114.591559026165\n"


@pytest.mark.parametrize(
    "name", ["=1+2", "+knee", "-knee", "@SUM(A1)", "'=knee", "'knee", "\tknee"]
)
def test_a_title_that_a_spreadsheet_takes_as_a_formula_is_written_as_text_and_read_back(
    tmp_path, name
):
    angles = np.linspace(0.0, 0.1, 12).reshape(6, 2)
    write_joint_path(tmp_path / "path.csv", [name, "hip"], angles, period=0.02)
    titles = (tmp_path / "path.csv").read_text().splitlines()[0].split(",")
    assert not any(title.startswith(("=", "+", "-", "@")) for title in titles)
    assert read_joint_path(tmp_path / "path.csv").names == (name, "hip")
