"""From a URDF to a report at the command line; public robots as docs/any_leg.md has them."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from kinematics import urdf_path
from planner.cli import settings
from planner.cli.desired import find_leg
from planner.files.paths import foot_path, path_table, read_joint_path
from tests.docs.blocks import ROOT
from tests.docs.shell import commands

PAGE = ROOT / "docs" / "any_leg.md"


FRONT = ("--base", "body", "--foot", "front_left_ball")


@pytest.fixture
def robot(tmp_path):
    """A robot of one's own: the shipped one under another name."""
    return shutil.copy(urdf_path("ers210a.urdf"), tmp_path / "robot.urdf")


def blocks(language):
    text = PAGE.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


@pytest.fixture
def console(run, robots, tmp_path):
    """What the page's commands for public robots answer, those with a word in them."""
    (servo,) = blocks("toml")
    (tmp_path / "servo.toml").write_text(servo)
    lines = [line for block in blocks("console") for line in commands(block)]

    def console(word):
        chosen = [line for line in lines if word in line and "request-planner " in line]
        assert chosen, f"{PAGE} has no command with {word}"
        results = []
        for line in chosen:
            assert line.startswith("$ request-planner ")
            arguments = line.replace("$ROBOTS", str(robots)).split()[2:]
            result = run(*arguments)
            assert result.exit_code == 0, result.stderr
            results.append(result)
        return results

    return console


@pytest.mark.usefixtures("no_foot_bound")
@pytest.mark.parametrize("name", ["solo", "arm"])
def test_a_public_robot_gets_from_urdf_to_report(console, tmp_path, name):
    word = {"arm": "ur5", "solo": "solo12"}[name]
    if name == "solo":
        pytest.importorskip("meshcat", reason="needs the extra meshcat")
    step, planned, *_ = console(word)
    assert "half stroke" in step.stderr
    millimetres = 10.0 * float(re.search(r"foot: ([\d.]+) cm rms", planned.stderr)[1])
    assert millimetres < 1.2  # an encoder's step in each joint moves the largest foot as far
    requests = read_joint_path(tmp_path / f"{name}_requests.csv")
    assert requests.values.shape == (len(foot_path(path_table(tmp_path / f"{name}.csv")).values), 3)
    page = (tmp_path / f"{name}.html").read_text()
    assert "By the model the foot stays within" in page
    assert all(joint in page for joint in requests.names)
    assert ("the rest of their models is assumed" in page) == (name != "solo")


def test_a_joint_is_held_where_the_option_says(run, robot, tmp_path):
    hold = ("--lock", "front_left_rotator=20", "--unreachable", "nearest")
    run("gait", "--leg", robot, *FRONT, "--half-stroke", 0.005, "--height", 0.005, "-o", "foot.csv")
    hold = (*hold, "--report", "page.html")
    result = run("plan", "foot.csv", "--leg", robot, *FRONT, *hold, "--method", "foot-optimal")
    assert result.exit_code == 0, result.stderr
    header = result.stdout.splitlines()[0]
    assert "rotator" not in header
    assert "front_left_abductor_deg" in header
    page = (tmp_path / "page.html").read_text()
    assert "rotator = 20.0}<" in page
    assert 'href="robot.urdf"' in page


def test_a_shipped_leg_starts_near_a_pose_too():
    place = find_leg(
        settings.Run(leg=settings.Leg(name="front-left", near={"front_left_knee": 60.0}))
    )
    assert place.near == {"front_left_knee": pytest.approx(np.pi / 3.0)}


def test_speeds_come_from_the_urdf(run, robot, foot):
    papers = run("plan", foot, "--leg", robot, *FRONT).stdout
    assert run("plan", foot, "--leg", robot, *FRONT, "--model", "urdf").stdout == papers
    slow = urdf_path("ers210a.urdf").read_text().replace('velocity="5.454', 'velocity="2.454')
    robot.write_text(slow)
    assert run("plan", foot, "--leg", robot, *FRONT, "--model", "urdf").stdout != papers
    robot.write_text(slow.replace('velocity="2.454', 'velocity="1002.454'))
    result = run("plan", foot, "--leg", robot, *FRONT, "--model", "urdf")
    assert result.exit_code == 2
    assert "the URDF has no usable top speed of joint 'front_left_rotator'" in result.stderr
