"""The README's first screen is short, its files are there; tests/docs runs what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from planner.files.joint_model import read_model_file

README = Path(__file__).parent.parent / "README.md"


def _block(language):
    match = re.search(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert match is not None, f"the README has no block of {language}"
    return match[1]


def test_the_first_screen_has_a_few_lines_of_python():
    assert len([line for line in _block("python").splitlines() if line]) <= 10


def test_the_model_file_of_the_readme_is_one(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(_block("toml"))
    hip, knee = read_model_file(file).for_joints(["hip", "knee"])
    assert (hip.lag, knee.lag) == pytest.approx((0.032, 0.040))


def test_the_files_that_the_readme_names_are_there():
    for name in re.findall(r"\]\((\w[\w/.]*)\)|`(\w+/\w+\.md|[A-Z]+\.md)`", README.read_text()):
        assert (README.parent / (name[0] or name[1])).is_file(), name
