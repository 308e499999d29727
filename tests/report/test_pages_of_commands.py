"""The page of every command: the files of its run linked from where it stands, and versions."""

from __future__ import annotations

import re
from html import unescape
from urllib.parse import unquote

import numpy as np
import pytest
from click.testing import CliRunner

import planner
from planner.cli import cli
from planner.files.paths import write_joint_path

SERVO = planner.JointModel.ers210a()
SAMPLES = 32

pytestmark = pytest.mark.usefixtures("undrawn")

RUN = """
[path]
file = "wanted angles.csv"
[output]
report = "pages/plan.html"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a path to follow and a run, in which commands are called."""
    monkeypatch.chdir(tmp_path)
    phase = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    angles = 0.15 * np.column_stack([np.sin(phase), np.cos(phase)])
    write_joint_path(tmp_path / "wanted angles.csv", ["hip", "knee"], angles, period=SERVO.period)
    (tmp_path / "run.toml").write_text(RUN)
    return tmp_path


def linked_from(page):
    """The files that a page links to, and its text."""
    text = page.read_text(encoding="utf-8")
    links = [unescape(link) for link in re.findall(r'href="([^"#][^"]*)"', text)]
    return {
        (page.parent / unquote(link)).resolve() for link in links if not link.startswith("data:")
    }, text


def test_a_page_below_a_folder_of_results_links_all_others_in_it(folder):
    done = CliRunner().invoke(cli, ["run", "run.toml", "--out", "o"])
    assert done.exit_code == 0, done.output
    page = folder / "o/pages/plan.html"
    linked, text = linked_from(page)
    others = {file for file in (folder / "o").rglob("*") if file.is_file()} - {page}
    assert linked == others | {folder / "wanted angles.csv", folder / "run.toml"}
    assert str(folder) not in text


def test_a_plan_from_standard_input_to_standard_output_links_no_file(folder):
    text = (folder / "wanted angles.csv").read_text()
    done = CliRunner().invoke(cli, ["plan", "-", "--report", "plan.html"], input=text)
    assert done.exit_code == 0, done.output
    assert linked_from(folder / "plan.html")[0] == set()
