"""Whatever bytes a file holds, it is read or refused with one line; nothing else ever happens."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import KinematicsError
from planner.exceptions import InvalidFile, PlannerError
from planner.files.joint_model import read_model_file
from planner.files.paths import read_foot_path, read_joint_path

CSV_PIECES = st.sampled_from(
    [
        *("t_s", "knee_deg", "knee_rad", "x_m", "y_m", "z_m", "z_cm", "index"),
        *("0", "1", "-2.5", "1e3", "1e999", "nan", "1_0", "٣"),
        *',,,,\n\n\r\0 ";\ufeff',
    ]
)
TOML_PIECES = st.sampled_from(
    [
        *("v_max", "theta_0", "lag", "acceleration_time", "tick", "hold", "offset"),
        *("[knee]", "[[knee]]", "1", "0.5", "-1", "nan", "inf", "true", "'x'", "[1]", "{a=1}"),
        *("1979-05-27", "9" * 400, "[[[["),
        *'====\n\n\n #."',
    ]
)
ANY_CSV = st.one_of(
    st.binary(max_size=200),
    st.lists(CSV_PIECES, max_size=40).map("".join).map(str.encode),
)
ANY_TOML = st.one_of(
    st.binary(max_size=200),
    st.lists(TOML_PIECES, max_size=40).map("".join).map(str.encode),
)


def _read(reader, file, content):
    file.write_bytes(content)
    try:
        return reader(file)
    except InvalidFile as error:
        message = str(error)
    assert message.startswith(str(file))
    assert "\n" not in message
    return None


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("any") / "file"


@settings(max_examples=100)
@given(content=ANY_CSV)
def test_any_bytes_are_a_joint_path_or_bad_input(file, content):
    path = _read(read_joint_path, file, content)
    assert path is None or np.isfinite(path.angles).all()


@settings(max_examples=100)
@given(content=ANY_CSV)
def test_any_bytes_are_a_foot_path_or_bad_input(file, content):
    path = _read(read_foot_path, file, content)
    assert path is None or np.isfinite(path.positions).all()


@settings(max_examples=100)
@given(content=ANY_TOML)
def test_any_bytes_are_models_or_bad_input(file, content):
    models = _read(read_model_file, file, content)
    assert models is None or models.common is not None or models.by_joint


@pytest.mark.parametrize("character", ["\u200b", "\u202e", "\U000e0001"])
def test_a_name_without_end_that_cannot_be_printed_keeps_a_message_short_and_whole(file, character):
    file.write_text(f"knee_deg,ankle{character * 9999}\n1,2\n3,4\n")
    with pytest.raises(InvalidFile) as caught:
        read_joint_path(file)
    message = str(caught.value)
    escaped = character.encode("unicode_escape").decode()
    assert message.startswith(f"{file}, line 1: column 'ankle{escaped}{escaped}")
    assert message.endswith("rename it, or remove it")
    assert message.isprintable()
    assert len(message) < 2000


@pytest.mark.parametrize("error", [PlannerError, KinematicsError])
def test_a_message_is_short_after_it_is_made_printable(error):
    message = str(error("\0" * 10**5))
    assert message.isprintable()
    assert len(message) < 2000
