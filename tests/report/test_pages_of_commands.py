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
    """A folder with a path to follow, a log and a run, in which commands are called."""
    monkeypatch.chdir(tmp_path)
    phase = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    angles = 0.15 * np.column_stack([np.sin(phase), np.cos(phase)])
    write_joint_path(tmp_path / "wanted angles.csv", ["hip", "knee"], angles, period=SERVO.period)
    requests = np.repeat(np.tile([0.6, -0.6, 0.1, -0.2], 6), 40)
    moved = planner.simulate(SERVO, requests, cyclic=False)
    times = SERVO.period * np.arange(len(requests))
    rows = np.column_stack([times, requests, moved])
    header = "t_s,requested_rad,actual_rad"
    np.savetxt("log.csv", rows, fmt="%.6f", delimiter=",", header=header, comments="")
    (tmp_path / "run.toml").write_text(RUN)
    return tmp_path


def linked_from(page):
    """The files that a page links to, and its text."""
    text = page.read_text(encoding="utf-8")
    links = [unescape(link) for link in re.findall(r'href="([^"#][^"]*)"', text)]
    return {
        (page.parent / unquote(link)).resolve() for link in links if not link.startswith("data:")
    }, text


def call(*arguments):
    done = CliRunner().invoke(cli, [str(each) for each in arguments])
    assert done.exit_code == 0, done.output


def told_at_the_end(text):
    """What stands after the last table."""
    return text[text.rindex("</table>") : text.index('<script type="application/json"')]


@pytest.mark.parametrize(
    ("command", "page", "files"),
    [
        (
            ["plan", "wanted angles.csv", "-o", "out/requests.csv", "--report", "pages/plan.html"],
            "pages/plan.html",
            ["wanted angles.csv", "out/requests.csv"],
        ),
        (
            ["compare", "wanted angles.csv", "--figure", "a.svg", "--report", "pages/c.html"],
            "pages/c.html",
            ["wanted angles.csv", "a.svg"],
        ),
        (
            ["identify", "log.csv", "--out", "joint.toml", "--report", "pages/i.html"],
            "pages/i.html",
            ["log.csv", "joint.toml"],
        ),
    ],
    ids=["plan", "compare", "identify"],
)
def test_a_page_links_what_was_read_and_what_was_written(folder, command, page, files):
    (folder / "pages").mkdir()
    (folder / "out").mkdir()
    call(*command)
    linked, text = linked_from(folder / page)
    assert linked == {folder / file for file in files}
    assert all(file.is_file() for file in linked)
    end = told_at_the_end(text)
    assert planner.__version__ in end
    assert "<dt>numpy</dt>" in end


@pytest.mark.parametrize(
    ("command", "page", "read"),
    [
        (["compare", "wanted angles.csv", "--out", "o"], "o/report.html", ["wanted angles.csv"]),
        (
            ["run", "run.toml", "--out", "o"],
            "o/pages/plan.html",
            ["wanted angles.csv", "run.toml"],
        ),
    ],
    ids=["compare", "run"],
)
def test_a_page_in_a_folder_of_results_links_all_others_in_it(folder, command, page, read):
    call(*command)
    page = folder / page
    linked, text = linked_from(page)
    others = {file for file in (folder / "o").rglob("*") if file.is_file()} - {page}
    assert linked == others | {folder / file for file in read}
    assert "<dt>numpy</dt>" in told_at_the_end(text)
    assert str(folder) not in text


def test_the_page_of_a_reproduction_links_every_file_of_its_folder(printed):
    page = printed[0] / "report.html"
    linked, text = linked_from(page)
    assert linked == {file for file in printed[0].rglob("*") if file.is_file()} - {page}
    assert "<dt>numpy</dt>" in told_at_the_end(text)


def test_a_plan_from_standard_input_to_standard_output_links_no_file(folder):
    text = (folder / "wanted angles.csv").read_text()
    done = CliRunner().invoke(cli, ["plan", "-", "--report", "plan.html"], input=text)
    assert done.exit_code == 0, done.output
    assert linked_from(folder / "plan.html")[0] == set()
