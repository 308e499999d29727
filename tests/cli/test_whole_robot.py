"""A robot of four legs in one file: a gait, a plan of its joints or feet, export and play."""

import json
import shutil

import numpy as np
import pytest

from kinematics import Leg, urdf_path
from planner.files.joint_model import read_legs
from planner.files.paths import read_joint_path
from tests.cli.test_servos import ARM

LEGS = ("front-left", "front-right", "hind-left", "hind-right")
TURNED = "hind_left_knee"  # a joint whose servo is mounted the other way round


def robot_text(*, reach=2.6):
    """A model file of the ERS-210A on a virtual bus."""
    joints = [
        f"{leg.replace('-', '_')}_{joint}"
        for leg in LEGS
        for joint in ("rotator", "abductor", "knee")
    ]
    blocks = ['bus = "virtual"\n']
    motor = ("time_constant", "max_acceleration", "dead_band")  # with which plans take longer
    simple = "\n".join(line for line in ARM.splitlines() if not line.startswith(motor)) + "\n"
    simple = simple.replace("acceleration_time = 0.0201", "acceleration_time = 0.06")
    for number, joint in enumerate(joints):
        block = simple.replace("joint_1", joint).replace("id = 1", f"id = {number + 1}")
        block = block.replace("limits = [-0.7, 0.7]", f"limits = [{-reach}, {reach}]")
        turned = "-1" if joint == TURNED else "1"
        blocks.append(block.replace("direction = 1", f"direction = {turned}"))
    for leg in LEGS:
        foot = f"{leg.replace('-', '_')}_ball"
        frames = f'urdf = "ers210a.urdf"\nbase = "body"\nfoot = "{foot}"\n'
        blocks.append(f"[leg.{leg}]\n{frames}")
    return "\n".join(blocks)


@pytest.fixture
def robot(tmp_path):
    shutil.copy(urdf_path("ers210a.urdf"), tmp_path)
    file = tmp_path / "robot.toml"
    file.write_text(robot_text())
    return file


def foot_errors(robot, path, angles):
    """Errors of the feet [m], rms, by leg."""
    found = {}
    for name, place in read_legs(robot).items():
        leg = Leg.from_urdf(place.urdf, base=place.base, foot=place.foot)
        columns = [path.names.index(joint) for joint in leg.joint_names]
        feet = (leg.foot_positions(each[:, columns]) for each in (path.values, angles))
        found[name] = float(np.sqrt(np.mean(np.sum(np.subtract(*feet) ** 2, axis=1))))
    return found


def test_a_gait_is_planned_for_the_feet_and_played_from_one_file(run, robot, tmp_path):
    robot.write_text(robot_text().replace("hold = 10\n", "hold = 10\nexpected_error = 0.005\n"))
    arguments = ("--samples", "40", "--period", "0.02", "--model", robot)
    assert run("gait", "--pattern", "trot", *arguments, "-o", "trot.csv").exit_code == 0
    desired = read_joint_path(tmp_path / "trot.csv")
    assert len(desired.names) == 12
    errors = {}
    for method in ("optimal", "foot-optimal"):
        chosen = ("--rate-hz", "50", "--model", robot, "--method", method, "--smoothness", "0")
        written = ("-o", "requests.csv", "--report", "page.html")
        result = run("plan", "trot.csv", *chosen, *written, "--json")
        assert result.exit_code == 0, result.stderr
        bounded = "error below the lower bound" in (tmp_path / "page.html").read_text()
        assert bounded == (method == "optimal")  # single joints may compensate for one another
        document = json.loads(result.stdout)
        joints = document["joints"]
        predicted = np.radians([joints[name]["predicted_deg"] for name in desired.names]).T
        errors[method] = foot_errors(robot, desired, predicted)
        for name, error in errors[method].items():
            told = document["legs"][name]
            assert told["rms_cm"] == pytest.approx(100.0 * error, rel=1e-6)
            assert told["rms_cm"] < told["best_shift_rms_cm"] < told["without_plan_rms_cm"]
            assert told["rms_cm"] + 0.001 < told["expected_rms_cm"] < told["rms_cm"] + 0.1
    for name, error in errors["foot-optimal"].items():
        assert error < errors["optimal"][name]
    played = run(
        *("play", "requests.csv", "--model", robot, "--cycles", "3"),
        *("--measured", "measured.csv", "-o", "log.csv"),
    )
    assert played.exit_code == 0, played.stderr
    measured = read_joint_path(tmp_path / "measured.csv").values[-40:]
    for column, measured_column in zip(desired.values.T, measured.T, strict=True):
        if np.std(column) > 0.05:  # the others hardly move
            assert np.corrcoef(column, measured_column)[0, 1] > 0.9
    learnt = run(
        *("refine", "requests.csv", "measured.csv", "--desired", "trot.csv", "--rate-hz", "50"),
        *("--model", robot, "-o", "next.csv"),
    )
    assert learnt.exit_code == 0, learnt.stderr
    assert read_joint_path(tmp_path / "next.csv").names == desired.names


def test_joints_that_are_no_whole_leg_are_planned_by_themselves(run, robot, tmp_path):
    (tmp_path / "path.csv").write_text("t_s,front_left_knee_deg\n0,29\n0.01,31\n0.02,29\n")
    result = run("plan", "path.csv", "--model", robot, "--method", "shift", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout).get("legs", {}) == {}
