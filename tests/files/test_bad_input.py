"""Every bad file gives one clear line: path, line, what was found, expected, what to do."""

from __future__ import annotations

import pytest

from planner.exceptions import InvalidFile
from planner.files.foot_path import read_foot_path
from planner.files.joint_model import read_models
from planner.files.joint_path import read_joint_path

MODEL = "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n"

JOINT_PATHS = {
    "empty": (
        b"",
        "FILE: empty; expected a line of column names and one row per sample",
    ),
    "only blank lines": (
        b"\n\n  \n",
        "FILE: empty; expected a line of column names and one row per sample",
    ),
    "only names": (b"knee_deg\n", "FILE: rows of samples: got 0, expected at least 2"),
    "one row": (b"knee_deg\n1\n", "FILE: rows of samples: got 1, expected at least 2"),
    "not UTF-8": (
        b"knee_deg\n1\n\xb0\n",
        "FILE, line 3: byte 0xb0 is not UTF-8; save the file as UTF-8 text",
    ),
    "NaN": (
        b"knee_deg\n1\nnan\n",
        "FILE, line 3: column 'knee_deg': got 'nan', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "infinite": (
        b"knee_deg\n1\n-inf\n",
        "FILE, line 3: column 'knee_deg': got '-inf', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "text": (
        b"knee_deg\n1\nfast\n",
        "FILE, line 3: column 'knee_deg': got 'fast', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "digits grouped by underscores": (
        b"knee_deg\n1\n1_0\n",
        "FILE, line 3: column 'knee_deg': got '1_0', expected a finite number; "
        "remove or interpolate the sample",
    ),
    "empty cell": (
        b"knee_deg,hip_deg\n1,2\n3,\n",
        "FILE, line 3: column 'hip_deg': got nothing, expected a finite number; "
        "remove or interpolate the sample",
    ),
    "ragged row": (
        b"knee_deg,hip_deg\n1,2\n3\n4,5\n",
        "FILE, line 3: got 1 cell, expected 2 (knee_deg, hip_deg); mend the row or its commas",
    ),
    "too many cells": (
        b"knee_deg,hip_deg\n1,2\n3,4,5\n",
        "FILE, line 3: got 3 cells, expected 2 (knee_deg, hip_deg); mend the row or its commas",
    ),
    "truncated": (
        b"knee_deg,hip_deg\n1,2\n3,4\n5",
        "FILE, line 4: got 1 cell, expected 2 (knee_deg, hip_deg); is the file cut short?",
    ),
    "no names": (
        b"1.0,2.0\n3.0,4.0\n",
        "FILE, line 1: the first line holds numbers (1.0,2.0), expected names; "
        "put a line of column names above them",
    ),
    "a column without a name": (
        b"knee_deg,\n1,2\n3,4\n",
        "FILE, line 1: column 2 has no name; name or remove it",
    ),
    "a name twice": (
        b"knee_deg,knee_deg\n1,2\n3,4\n",
        "FILE, line 1: 2 columns are named 'knee_deg', expected one; rename the others",
    ),
    "semicolons": (
        b"knee_deg;hip_deg\n1;2\n3;4\n",
        "FILE, line 1: one column named 'knee_deg;hip_deg', expected names separated by commas; "
        "save the file with commas between columns and points in numbers",
    ),
    "an open quote": (
        b'knee_deg\n"1\n2\n',
        "FILE, line 3: not CSV (unexpected end of data); expected comma-separated numbers",
    ),
    "no unit": (
        b"knee\n1\n2\n",
        "FILE, line 1: column 'knee' has no unit; expected knee_deg or knee_rad: "
        "rename it, or remove it",
    ),
    "a strange unit": (
        b"knee_degrees\n1\n2\n",
        "FILE, line 1: column 'knee_degrees' has no unit; expected knee_deg or knee_rad: "
        "rename it, or remove it",
    ),
    "mixed units": (
        b"knee_deg,hip_rad\n1,2\n3,4\n",
        "FILE, line 1: mixed units (knee_deg, hip_rad); expected one unit in all columns",
    ),
    "beyond belief": (
        b"knee_deg\n1\n1e300\n",
        "FILE, line 3: column 'knee_deg': got 1e300, expected at most 5.72958e+07 either way; "
        "check the unit",
    ),
    "only time": (
        b"t_s,index\n0,0\n1,1\n",
        "FILE, line 1: only t_s, index; expected columns <joint>_deg or <joint>_rad",
    ),
    "time backwards": (
        b"t_s,knee_deg\n0,1\n0.02,2\n0.01,3\n",
        "FILE, line 4: t_s is 0.01 after 0.02, expected times that increase; "
        "sort the rows and remove doubles",
    ),
    "time stands still": (
        b"t_s,knee_deg\n0,1\n0,2\n0.01,3\n",
        "FILE, line 3: t_s is 0 after 0, expected times that increase; "
        "sort the rows and remove doubles",
    ),
    "uneven time": (
        b"t_s,knee_deg\n0,1\n0.01,2\n0.02,3\n0.05,4\n",
        "FILE, line 5: t_s advances by 0.03 s where most steps are 0.01 s, expected even steps; "
        "resample the path at one rate",
    ),
    "time that is no number": (
        b"t_s,knee_deg\n0,1\nlater,2\n",
        "FILE, line 3: column 't_s': got 'later', expected a finite number; "
        "remove or interpolate the sample",
    ),
}

FOOT_PATHS = {
    "a missing axis": (
        b"x_m,y_m\n1,2\n3,4\n",
        "FILE, line 1: no column z_m or z_cm or z_mm; columns: x_m, y_m",
    ),
    "mixed units": (
        b"x_m,y_cm,z_m\n1,2,3\n4,5,6\n",
        "FILE, line 1: mixed units (x_m, y_cm, z_m); expected one unit in all columns",
    ),
    "an axis twice": (
        b"x_m,x_cm,y_m,z_m\n1,2,3,4\n4,5,6,7\n",
        "FILE, line 1: 'x' comes in mixed units (x_m, x_cm), expected one column; "
        "remove the others",
    ),
    "NaN": (
        b"x_m,y_m,z_m\n1,2,3\n4,NaN,6\n",
        "FILE, line 3: column 'y_m': got 'NaN', expected a finite number; "
        "remove or interpolate the sample",
    ),
}

KEYS = "v_max, theta_0, lag, acceleration_time, tick, hold, offset"

MODELS = {
    "not TOML": (
        "v_max = 5.0\nlag = = 1\n",
        "FILE, line 2: not TOML: Invalid value at column 7; "
        "expected lines such as 'v_max = 5.45', and 0.1 for .1",
    ),
    "empty": (
        "",
        "FILE: no v_max, theta_0, lag, acceleration_time; "
        "expected v_max, theta_0, lag, acceleration_time in rad/s, rad, s, s",
    ),
    "unknown key": (
        MODEL + "vmax = 3\n",
        f"FILE, line 5: unknown key 'vmax' (did you mean 'v_max'?); keys: {KEYS}",
    ),
    "unknown key in a table": (
        MODEL + "[knee]\nlagg = 3\n",
        f"FILE, line 6: unknown key 'lagg' in [knee] (did you mean 'lag'?); keys: {KEYS}",
    ),
    "missing key": (
        "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\n",
        "FILE: no acceleration_time; "
        "expected v_max, theta_0, lag, acceleration_time in rad/s, rad, s, s",
    ),
    "missing key in a table": (
        "v_max = 5.0\n[knee]\nlag = 0.03\n",
        "FILE: table [knee]: no theta_0, acceleration_time; "
        "expected v_max, theta_0, lag, acceleration_time in rad/s, rad, s, s",
    ),
    "text for a number": (
        MODEL.replace("5.0", "'fast'"),
        "FILE: v_max: got 'fast', expected a finite number in SI units",
    ),
    "an impossible joint": (
        MODEL.replace("5.0", "-1"),
        "FILE: v_max: got -1, expected more than 0",
    ),
    "a key twice": (
        MODEL + "lag = 1\n",
        "FILE, line 5: not TOML: Cannot overwrite a value at column 8; "
        "expected lines such as 'v_max = 5.45', and 0.1 for .1",
    ),
}


@pytest.mark.parametrize(("content", "message"), JOINT_PATHS.values(), ids=JOINT_PATHS)
def test_a_bad_joint_path_says_what_is_wrong(tmp_path, content, message):
    file = tmp_path / "path.csv"
    file.write_bytes(content)
    with pytest.raises(InvalidFile) as caught:
        read_joint_path(file)
    assert str(caught.value).replace(str(file), "FILE") == message


@pytest.mark.parametrize(("content", "message"), FOOT_PATHS.values(), ids=FOOT_PATHS)
def test_a_bad_foot_path_says_what_is_wrong(tmp_path, content, message):
    file = tmp_path / "foot.csv"
    file.write_bytes(content)
    with pytest.raises(InvalidFile) as caught:
        read_foot_path(file)
    assert str(caught.value).replace(str(file), "FILE") == message


@pytest.mark.parametrize(("content", "message"), MODELS.values(), ids=MODELS)
def test_a_bad_model_says_what_is_wrong(tmp_path, content, message):
    file = tmp_path / "model.toml"
    file.write_text(content)
    with pytest.raises(InvalidFile) as caught:
        read_models(file)
    assert str(caught.value).replace(str(file), "FILE") == message


def test_a_joint_that_is_not_in_the_file_is_named_with_the_nearest(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("knee_deg,hip_deg\n1,2\n3,4\n")
    with pytest.raises(InvalidFile) as caught:
        read_joint_path(file, joints=["kne"])
    assert str(caught.value) == (
        f"{file}, line 1: no column kne_deg or kne_rad (did you mean 'knee'?); "
        "columns: knee_deg, hip_deg"
    )


def test_a_file_that_does_not_exist_and_a_folder_are_bad_input(tmp_path):
    with pytest.raises(InvalidFile, match="no such file; check the name and the folder"):
        read_joint_path(tmp_path / "nothing.csv")
    with pytest.raises(InvalidFile, match="cannot be read \\(is a directory\\)"):
        read_joint_path(tmp_path)


def test_a_path_at_another_rate_than_the_joint_is_refused(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("t_s,knee_deg\n0,1\n0.02,2\n0.04,3\n")
    path = read_joint_path(file)
    path.check_period(0.02)
    with pytest.raises(InvalidFile) as caught:
        path.check_period(0.008)
    assert str(caught.value) == (
        f"{file}: one sample every 0.02 s, expected one every 0.008 s, the time between requests; "
        "resample the path, drop column t_s, or set tick and hold in the model"
    )


def test_a_joint_without_a_model_and_a_misspelt_table_are_refused(tmp_path):
    file = tmp_path / "model.toml"
    tables = "".join(f"[{name}]\n{MODEL}" for name in ("rotator", "knee"))
    file.write_text(tables)
    with pytest.raises(InvalidFile, match="no table for the joint 'abductor'; tables: "):
        read_models(file).for_joints(["rotator", "abductor"])
    file.write_text(MODEL + "[rotater]\nlag = 0.05\n")
    with pytest.raises(InvalidFile, match="'rotator' \\(did you mean 'rotater'\\?\\)"):
        read_models(file).for_joints(["rotator"])
