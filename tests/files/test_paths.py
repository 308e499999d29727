"""Paths: radians that are degrees are refused, and a path at another rate is resampled."""

import io
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.exceptions import InvalidFile
from planner.files.joint_model import read_model_file
from planner.files.paths import (
    SampledPath,
    foot_path,
    is_foot_path,
    joint_path,
    path_table,
    read_joint_path,
    resampled,
    write_foot_path,
    write_joint_path,
)
from planner.files.table import read_table, write_table

WRITTEN = 1e-12  # a written number is off by half of its last decimal at most [deg, m]
MODEL = "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n"


def _written(file, column, values, times=None):
    times = 0.01 * np.arange(len(values)) if times is None else times
    write_table(file, ["t_s", column], np.column_stack([times, values]))
    return file


def test_a_path_of_uneven_times_is_resampled(tmp_path):
    times = 0.01 * np.arange(100) + 0.002 * np.sin(7.0 * np.pi * np.arange(100) / 99)
    file = _written(tmp_path / "path.csv", "pan_deg", 20.0 * np.sin(2.0 * np.pi * times), times)
    path = joint_path(read_table(file), even=False).in_step(
        0.008, resample=True, cyclic=True, speed=None
    )
    assert path.values.shape == (125, 1)
    np.testing.assert_allclose(path.times, 0.008 * np.arange(125), rtol=0.0, atol=1e-12)
    true = np.radians(20.0 * np.sin(2.0 * np.pi * path.times))
    chord = np.radians(20.0) * (2.0 * np.pi * 0.014) ** 2 / 8.0  # of a straight line of 14 ms
    np.testing.assert_allclose(path.values[:, 0], true, rtol=0.0, atol=chord)


def test_samples_may_be_a_hundredth_of_a_period_closer_than_requests(tmp_path):
    path = read_joint_path(_written(tmp_path / "path.csv", "pan_deg", np.arange(9.0)))
    path.check_period(path.step / 0.991)
    with pytest.raises(InvalidFile, match=r"one sample every 0\.01 s, expected one every 0\.0101"):
        path.check_period(path.step / 0.989)


@pytest.mark.parametrize("resample", [True, False])
def test_times_in_milliseconds_are_refused_before_they_are_resampled(resample):
    path = SampledPath("path.csv", ("knee",), ("deg",), np.zeros((100, 1)), 20.0 * np.arange(100))
    with pytest.raises(InvalidFile, match=r"one sample every 20 s, expected .* milliseconds t_ms"):
        path.in_step(0.02, resample=resample, cyclic=False, speed=None)


@given(
    st.integers(3, 60),
    st.sampled_from([0.004, 0.01, 0.1, 1.0 / 30.0]),
    st.sampled_from([0.005, 0.008, 0.01]),
)
def test_a_resampled_path_has_the_nearest_whole_number_of_samples(count, step, period):
    rows = np.cos(2.0 * np.pi * np.arange(count) / count)[:, np.newaxis]
    cycle = resampled(step * np.arange(count), rows, period, cyclic=True)
    assert abs(len(cycle) - count * step / period) <= 0.5 + 1e-6
    assert cycle[0] == rows[0]
    once = resampled(step * np.arange(count), rows, period, cyclic=False)
    span = (count - 1) * step
    assert span - period < (len(once) - 1) * period <= span + 0.011 * period
    for cyclic in (True, False):  # at its own rate it keeps its rows, the last one too
        same = resampled(0.3 + step * np.arange(count), rows, step, cyclic=cyclic)
        np.testing.assert_allclose(same, rows, rtol=0.0, atol=1e-9)


def test_torques_on_joints_are_read_written_and_resampled_with_them(tmp_path):
    file = tmp_path / "loaded.csv"
    angles = np.radians([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [2.0, 3.0]])
    loads = np.array([[0.1, -0.5], [0.2, -0.4], [0.3, -0.3], [0.2, -0.4]])
    write_joint_path(file, ["hip", "knee"], angles, period=0.02, loads=loads)
    path = read_joint_path(file)
    assert path.names == ("hip", "knee")
    np.testing.assert_allclose(path.loads, loads, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(read_joint_path(file, joints=["knee"]).loads, loads[:, 1:])
    finer = path.in_step(0.01, resample=True, cyclic=True, speed=None)
    np.testing.assert_allclose(finer.loads[:3, 0], [0.1, 0.15, 0.2], rtol=0.0, atol=1e-12)
    assert len(finer.loads) == len(finer.values) == 8


ANGLES = arrays(
    np.float64, st.tuples(st.integers(2, 30), st.just(3)), elements=st.floats(-100.0, 100.0)
)


@given(values=ANGLES)
def test_written_paths_are_read_back(tmp_path_factory, values):
    file = tmp_path_factory.getbasetemp() / "path.csv"
    write_joint_path(file, ["rotator", "abductor", "knee"], values, period=0.008)
    joints = read_joint_path(file)
    assert joints.names == ("rotator", "abductor", "knee")
    write_foot_path(file, values, period=0.008)
    for path in (joints, foot_path(path_table(file))):
        assert np.max(np.abs(path.values - values)) <= WRITTEN
        assert path.times == pytest.approx(0.008 * np.arange(len(values)), abs=WRITTEN)
        path.check_period(0.008)


READ = {
    "units as in logs": b"knee [deg],hip_degrees\n90,45\n180,0\n",
    "a foot's units as in logs": b"x (mm),y_mm,z_mm\n1000,0,0\n0,0,-1000\n",
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
    "comments and decimal commas": b"# t_s;knee_deg\n0;1,5\n0,5;2,5\n",
    "a length beside a joint": (b"height_m,knee_deg\n1,2\n3,4\n", ["knee"]),
    "metres": b"x_m,y_m,z_m\n1,2,3\n4,5,6\n",
    "centimetres": b"z_cm,note,x_cm,y_cm,t_s\n3,a,1,2,0\n6,b,4,5,0.5\n",
    "millimetres": b"t_us,x_mm,y_mm,z_mm\n0,1,2,3\n2000,4,5,6\n9000,7,8,9\n",
}


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
        assert not path.values.flags.writeable
        said.append(
            f"{name}: {[v.tolist() if isinstance(v, np.ndarray) else v for v in values][1:]}\n"
        )
    snapshot.check("paths", "".join(said))


def test_a_dash_is_standard_input_and_standard_output(monkeypatch, capsys):
    stdin = io.TextIOWrapper(io.BytesIO(b"knee_rad\n1\n2\n"))
    monkeypatch.setattr(sys, "stdin", stdin)
    path = read_joint_path("-")
    write_joint_path("-", path.names, path.values, period=0.5)
    out = capsys.readouterr().out
    assert out == "t_s,knee_deg\n0.0,57.295779513082\n0.5,114.591559026165\n"


JOINT_PATHS = {
    "empty": b"",
    "only names": b"knee_deg\n",
    "one row": b"knee_deg\n1\n",
    "not UTF-8": b"knee_deg\n1\n\xb0\n",
    "NaN": b"knee_deg\n1\nnan\n",
    "infinite": b"knee_deg\n1\n-inf\n",
    "text": b"knee_deg\n1\nfast\n",
    "empty cell": b"knee_deg,hip_deg\n1,2\n3,\n",
    "ragged row": b"knee_deg,hip_deg\n1,2\n3\n4,5\n",
    "too many cells": b"knee_deg,hip_deg\n1,2\n3,4,5\n",
    "truncated": b"knee_deg,hip_deg\n1,2\n3,4\n5",
    "no names": b"1.0,2.0\n3.0,4.0\n",
    "a column without a name": b"knee_deg,\n1,2\n3,4\n",
    "a name twice": b"knee_deg,knee_deg\n1,2\n3,4\n",
    "decimal commas between commas": b"knee_deg,hip_deg\n1,5,2,5\n3,5,4,5\n",
    "an open quote": b'knee_deg\n"1\n2\n',
    "no unit": b"knee\n1\n2\n",
    "several without a unit": b"joint_1,hip_deg,joint_2\n0,1,2\n1,2,3\n",
    "a strange unit": b"knee_turns\n1\n2\n",
    "mixed units": b"knee_deg,hip_rad\n1,2\n3,4\n",
    "a joint twice": b"knee_deg,knee [deg]\n1,2\n3,4\n",
    "a number among names": b"knee_deg,7\n1,2\n3,4\n",
    "degrees in radians": b"pan_rad\n0\n45\n20\n",
    "percent called range": b"jaw_range\n0\n45\n20\n",
    "percent far beyond the range": b"pan_deg,jaw_percent\n0,0\n1,45\n2,-201\n",
    "a log": b"t_s,requested_deg,actual_deg\n0,1,0\n1,2,1\n",
    "a log of a joint": b"t_s,goal_hip_deg,present_hip_deg\n0,1,0\n1,2,1\n",
    "only time": b"t_s,index\n0,0\n1,1\n",
    "time backwards": b"t_s,knee_deg\n0,1\n0.02,2\n0.01,3\n",
    "time stands still": b"t_s,knee_deg\n0,1\n0,2\n0.01,3\n",
    "uneven time": b"t_s,knee_deg\n0,1\n0.01,2\n0.02,3\n0.05,4\n",
    "a step too short": b"t_ms,knee_deg\n0,1\n10,2\n19.89,3\n29.89,4\n",
    "a date that is missing": b"clock,knee_deg\n2026-11-23T10:04:00,1\nNaT,2\n",
    "times twice": b"time_s,t_ms,knee_deg\n0,0,1\n0.01,10,2\n",
    "time that is no number": b"t_s,knee_deg\n0,1\nlater,2\n",
}

FOOT_PATHS = {
    "a missing axis": b"x_m,y_m\n1,2\n3,4\n",
    "mixed units": b"x_m,y_cm,z_m\n1,2,3\n4,5,6\n",
    "uneven time": b"t_s,x_m,y_m,z_m\n0,1,2,3\n0.1,2,3,4\n0.3,3,4,5\n",
    "axes without a unit": b"x,y,z\n1,2,3\n3,4,5\n",
    "an axis in other units": b"x_km,y_Inch,z_m\n1,2,3\n3,4,5\n",
    "NaN": b"x_m,y_m,z_m\n1,2,3\n4,NaN,6\n",
}

MODELS = {
    "not TOML": "v_max = 5.0\nlag = = 1\n",
    "empty": "",
    "unknown key": MODEL + "vmax = 3\n",
    "unknown key in a table": MODEL + "[knee]\nlagg = 3\n",
    "missing key": "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\n",
    "missing key in a table": "v_max = 5.0\n[knee]\nlag = 0.03\n",
    "text for a number": MODEL.replace("5.0", "'fast'"),
    "an impossible joint": MODEL.replace("5.0", "-1"),
    "a key twice": MODEL + "lag = 1\n",
    "times in ms": "v_max = 5.0\ntheta_0 = 0.1\nlag = 32\nacceleration_time = 48\n",
    "in degrees": MODEL.replace("5.0", "301.9").replace("0.1\n", "18.25\n"),
    "theta_0 in degrees": "[knee]\n" + MODEL.replace("0.1\n", "18.25\n"),
}

READERS = {
    "joint path": (read_joint_path, JOINT_PATHS),
    "foot path": (lambda file: foot_path(path_table(file)), FOOT_PATHS),
    "model": (read_model_file, MODELS),
}


def test_every_bad_file_says_what_is_wrong(tmp_path, snapshot):
    file = tmp_path / "FILE"

    def read(case):
        reader, content = case
        file.write_bytes(content.encode() if isinstance(content, str) else content)
        reader(file)

    cases = {
        f"{kind}, {name}": (reader, content)
        for kind, (reader, contents) in READERS.items()
        for name, content in contents.items()
    }
    snapshot.refusals("bad_input", read, cases, FILE=file)


def test_a_joint_without_a_model_and_a_misspelt_table_are_refused(tmp_path):
    file = tmp_path / "model.toml"
    tables = "".join(f"[{name}]\n{MODEL}" for name in ("rotator", "knee"))
    file.write_text(tables)
    with pytest.raises(InvalidFile, match="no table for the joint 'abductor'; tables: "):
        read_model_file(file).for_joints(["rotator", "abductor"])
    file.write_text(MODEL + "[rotater]\nlag = 0.05\n")
    with pytest.raises(InvalidFile, match="'rotator' \\(did you mean 'rotater'\\?\\)"):
        read_model_file(file).for_joints(["rotator"])


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
