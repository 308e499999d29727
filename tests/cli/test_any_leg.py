"""A leg of one's own at the command line, and ``gait --fastest``."""

import json
import re
import shutil

import numpy as np
import pytest

from kinematics import urdf_path
from planner import JointModel
from planner.cli import settings
from planner.cli.desired import find_leg
from planner.files.paths import foot_path, read_joint_path
from planner.files.table import read_table
from planner.model.evidence import Evidence
from tests.docs.blocks import ROOT
from tests.docs.shell import commands

FRONT = ("--base", "body", "--foot", "front_left_ball")
TESTED = Evidence(0.01, 1.0, 0.0, (-3.0, 3.0))  # of a joint whose logs were slow


@pytest.fixture
def robot(tmp_path):
    """A robot of one's own: the shipped one under another name."""
    return shutil.copy(urdf_path("ers210a.urdf"), tmp_path / "robot.urdf")


def test_a_joint_is_held_where_the_option_says(run, robot, tmp_path):
    hold = ("--lock", "front_left_rotator=20", "--unreachable", "nearest", "--report", "page.html")
    run("gait", "--leg", robot, *FRONT, "--half-stroke", 0.005, "--height", 0.005, "-o", "foot.csv")
    result = run("plan", "foot.csv", "--leg", robot, *FRONT, *hold, "--method", "foot-optimal")
    assert result.exit_code == 0, result.stderr
    header = result.stdout.splitlines()[0]
    assert "rotator" not in header
    assert "front_left_abductor_deg" in header
    page = (tmp_path / "page.html").read_text()
    assert "rotator = 20.0}<" in page
    assert 'href="robot.urdf"' in page


def test_a_shipped_leg_starts_near_a_pose_too():
    leg = settings.Leg(name="front-left", near={"front_left_knee": 60.0})
    place = find_leg(settings.Run(leg=leg))
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


def walk():
    size = ("--samples", 24, "--half-stroke", 0.01, "--height", 0.005)
    return "gait", "--leg", "front-left", *size


@pytest.fixture
def fastest(run, tmp_path, monkeypatch):
    """Seek the shortest cycle of a small walk, without the bounds that take seconds."""
    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 0)
    JointModel.ers210a().with_evidence(TESTED).to_toml(tmp_path / "joint.toml")

    def fastest(*more):
        search = ("--fastest", "--tolerance-cm", 0.2, "-o", "foot.csv")
        result = run(*walk(), "--model", "joint.toml", *search, *more)
        assert result.exit_code == 0, result.output
        return result

    return fastest


def test_the_path_is_planned_within_the_tolerance_as_is_said(run, fastest):
    said = fastest().stderr
    assert "s, is the shortest at which the planned foot stays within 0.2 cm by the model\n" in said
    assert "\nplan it with --method foot-optimal" in said
    assert "outside what the models were tested on" in said
    assert "front_left_knee (speed)" in said
    asked = ("--leg", "front-left", "--model", "joint.toml", "--method", "foot-optimal")
    plan = json.loads(run("plan", "foot.csv", *asked, "--norm", "max", "--json").stdout)
    document = json.loads(fastest("--json").stdout)
    found, count = document["fastest"], len(foot_path(read_table("foot.csv")).values)
    assert plan["foot"]["max_cm"] == pytest.approx(found.pop("max_cm"), rel=1e-3)
    assert plan["foot"]["max_cm"] < 0.2
    whole = json.loads(run(*walk(), "--json").stdout)["stride"]
    for joint, speed in document["stride"].pop("speeds_deg_s").items():
        assert speed == pytest.approx(whole["speeds_deg_s"][joint] * 24 / count)
    assert document["stride"] == {key: whole[key] for key in document["stride"]}
    assert 12 < count < 24
    assert found.pop("untested")["front_left_knee"] == ["speed"]
    assert found == {
        "tolerance_cm": 0.2,
        "samples": count,
        "cycle_s": pytest.approx(0.008 * count),
    }


PAGE = ROOT / "docs" / "any_leg.md"


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
    assert requests.values.shape == (len(foot_path(read_table(tmp_path / f"{name}.csv")).values), 3)
    page = (tmp_path / f"{name}.html").read_text()
    assert "By the model the foot stays within" in page
    assert all(joint in page for joint in requests.names)
    assert ("the rest of their models is assumed" in page) == (name != "solo")
