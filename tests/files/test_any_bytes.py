"""Messages about files stay short, whole and printable."""

from __future__ import annotations

import pytest

from kinematics import KinematicsError
from planner.exceptions import InvalidFile, PlannerError
from planner.files.paths import read_joint_path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("any") / "file"


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
