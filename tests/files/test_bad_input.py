"""Every bad file gives one clear line: path, line, what was found, expected, what to do."""

from __future__ import annotations

import math

import pytest

from planner.exceptions import InvalidFile
from planner.files.joint_model import read_model_file
from planner.files.paths import read_foot_path, read_joint_path

MODEL = "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n"


JOINT_PATHS = {
    "empty": b"",
    "only blank lines": b"\n\n  \n",
    "only names": b"knee_deg\n",
    "one row": b"knee_deg\n1\n",
    "not UTF-8": b"knee_deg\n1\n\xb0\n",
    "NaN": b"knee_deg\n1\nnan\n",
    "infinite": b"knee_deg\n1\n-inf\n",
    "text": b"knee_deg\n1\nfast\n",
    "digits grouped by underscores": b"knee_deg\n1\n1_0\n",
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
    "digits of another script": "knee_deg\n1\n٣\n".encode(),
    "a number among names": b"knee_deg,7\n1,2\n3,4\n",
    "an open quote after comments": b'# a\n# b\nknee_deg\n1\n"2\n',
    "no names after comments": b"# 1.0,2.0\n3.0,4.0\n5,6\n",
    "more names than can be shown": ",".join(f"joint_{k}_deg" for k in range(20)) + "\n1\n2\n",
    "beyond belief": b"t_s,knee_deg,hip_deg\n0,1,2\n0.01,3,-1e300\n",
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
    "an axis twice": b"x_m,x_cm,y_m,z_m\n1,2,3,4\n4,5,6,7\n",
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


def test_every_bad_file_says_what_is_wrong(tmp_path, snapshot):
    said = []
    for kind, read, cases in (
        ("joint path", read_joint_path, JOINT_PATHS),
        ("foot path", read_foot_path, FOOT_PATHS),
        ("model", read_model_file, MODELS),
    ):
        file = tmp_path / "FILE"
        for name, content in cases.items():
            file.write_bytes(content.encode() if isinstance(content, str) else content)
            with pytest.raises(InvalidFile) as caught:
                read(file)
            said.append(f"{kind}, {name}: {caught.value}\n".replace(str(file), "FILE"))
    snapshot.check("bad_input", "".join(said))


PATH = "t_s,knee_deg,hip_deg\n0,1,2\n0.01,3,4\n"


LIMITS = {
    "columns": ("table.MOST_COLUMNS", 3, "3 columns, expected at most 2; leave out"),
    "cells": ("table.MOST_CELLS", 6, "more than 5 cells; split the file"),
    "rows": ("paths.MOST_SAMPLES", 2, "more than 1 rows, expected at most so many samples"),
    "joints": ("paths.MOST_JOINTS", 2, "2 joints, expected at most 1; choose some with --joint"),
    "characters": ("text.MOST_BYTES", len(PATH), "longer than 0 MiB; is it the right file?"),
    "size": ("columns.LARGEST", math.radians(4.0), "'hip_deg': got 4, expected at most 3.99"),
}
"""The constant of a limit, what the path has, and the message of one that has more."""


@pytest.mark.parametrize("limit", LIMITS)
def test_a_path_may_be_as_large_as_a_limit_and_no_larger(tmp_path, monkeypatch, limit):
    place, has, message = LIMITS[limit]
    file = tmp_path / "path.csv"
    file.write_text(PATH)
    monkeypatch.setattr(f"planner.files.{place}", has)
    assert read_joint_path(file).names == ("knee", "hip")
    monkeypatch.setattr(f"planner.files.{place}", has - 1 if has >= 1 else 0.999 * has)
    with pytest.raises(InvalidFile, match=message):
        read_joint_path(file)


def test_a_joint_without_a_model_and_a_misspelt_table_are_refused(tmp_path):
    file = tmp_path / "model.toml"
    tables = "".join(f"[{name}]\n{MODEL}" for name in ("rotator", "knee"))
    file.write_text(tables)
    with pytest.raises(InvalidFile, match="no table for the joint 'abductor'; tables: "):
        read_model_file(file).for_joints(["rotator", "abductor"])
    file.write_text(MODEL + "[rotater]\nlag = 0.05\n")
    with pytest.raises(InvalidFile, match="'rotator' \\(did you mean 'rotater'\\?\\)"):
        read_model_file(file).for_joints(["rotator"])


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("any") / "file"
