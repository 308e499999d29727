"""Whatever is wrong with the input: one line on standard error, exit status 2, nothing else."""

from __future__ import annotations

import pytest

FOR_THE_FOOT = ("plan", "foot.csv", "--leg", "front-left", "--method", "foot-optimal")

WRONG = {
    "no such command": (
        ["bogus"],
        "No such command 'bogus'. See 'request-planner --help'.",
    ),
    "no such option": (
        ["gait", "--sampels", "3"],
        "No such option '--sampels'. Did you mean '--samples'? See 'request-planner gait --help'.",
    ),
    "no path": (["plan"], "Missing argument 'PATH'. See 'request-planner plan --help'."),
    "no such file": (["plan", "x.csv"], "x.csv: no such file; check the name and the folder"),
    "a foot path without a leg": (
        ["plan", "foot.csv"],
        "foot.csv is a foot path: name its leg with --leg. See 'request-planner plan --help'.",
    ),
    "two legs": (
        ["plan", "foot.csv", "--leg", "reference", "--base", "hip"],
        "--leg is a shipped leg: leave out --urdf, --base, --foot and --lock. "
        "See 'request-planner plan --help'.",
    ),
    "frames without a robot": (
        ["plan", "foot.csv", "--base", "hip"],
        "--base, --foot, --lock and --near are of a leg: add --leg. "
        "See 'request-planner plan --help'.",
    ),
    "a robot without frames": (
        ["plan", "foot.csv", "--urdf", "robot.urdf", "--base", "hip"],
        "a URDF needs --base and --foot, the frames at the leg's two ends. "
        "See 'request-planner plan --help'.",
    ),
    "no such leg": (
        ["plan", "foot.csv", "--leg", "middle-left"],
        "Invalid value for '--leg': 'middle-left' is not one of 'reference', 'front-left', "
        "'front-right', 'hind-left', 'hind-right', nor a .urdf file. "
        "See 'request-planner plan --help'.",
    ),
    "a robot twice": (
        ["plan", "foot.csv", "--leg", "robot.urdf", "--urdf", "robot.urdf"],
        "--leg and --urdf name a file each: leave one out. See 'request-planner plan --help'.",
    ),
    "a joint held nowhere": (
        ["gait", "--leg", "robot.urdf", "--base", "hip", "--foot", "foot", "--lock", "wrist"],
        "--lock: got 'wrist', expected JOINT=DEG, such as wrist=-90. "
        "See 'request-planner gait --help'.",
    ),
    "a pose without a number": (
        ["gait", "--leg", "front-left", "--near", "knee=bent"],
        "--near: got 'knee=bent', expected JOINT=DEG, such as wrist=-90. "
        "See 'request-planner gait --help'.",
    ),
    "a pose of a joint that the leg has not": (
        ["gait", "--leg", "reference", "--near", "hip=10"],
        "near: joint 'hip' is not on the leg; its joints: rotator, abductor, knee",
    ),
    "speeds of no robot": (
        ["plan", "desired.csv", "--model", "urdf"],
        "--model urdf takes speeds from a leg's URDF: name it with --leg. "
        "See 'request-planner plan --help'.",
    ),
    "joints that the leg has not": (
        ["plan", "desired.csv", "--leg", "reference"],
        "joint 'hip' of desired.csv is not on the leg; its joints: rotator, abductor, knee. "
        "See 'request-planner plan --help'.",
    ),
    "joints of a foot path": (
        ["plan", "foot.csv", "--leg", "front-left", "--joint", "knee"],
        "--joint chooses columns of a joint path; a foot moves all joints. "
        "See 'request-planner plan --help'.",
    ),
    "an option that the method ignores": (
        ["plan", "desired.csv", "--segments", "6"],
        "--segments has no effect with --method optimal. See 'request-planner plan --help'.",
    ),
    "limits upside down": (
        ["plan", "desired.csv", "--limits-deg", "10:-10"],
        "--limits-deg: got '10:-10', expected LOW:HIGH or JOINT=LOW:HIGH in degrees with LOW below "
        "HIGH, such as knee=-27:147. See 'request-planner plan --help'.",
    ),
    "limits of nobody": (
        ["plan", "desired.csv", "--limits-deg", "ankle=0:1"],
        "--limits-deg: no joint 'ankle' in the path; joints: hip, knee. "
        "See 'request-planner plan --help'.",
    ),
    "no such model": (
        ["simulate", "desired.csv", "--model", "robot.toml"],
        "robot.toml: no such file; check the name and the folder",
    ),
    "a joint at another rate": (
        ["simulate", "desired.csv", "--model", "slow.toml"],
        "desired.csv: one sample every 0.008 s, expected one every 0.02 s, the time between "
        "requests; resample the path, drop column t_s, or set tick and hold in the model",
    ),
    "joints at different rates": (
        ["simulate", "desired.csv", "--model", "mixed.toml"],
        "mixed.toml: 'knee' takes a request every 0.02 s and 'hip' every 0.008 s, expected one "
        "rate; plan them one by one with --joint",
    ),
    "a start for a cycle": (
        ["simulate", "desired.csv", "--start-deg", "3"],
        "--start-deg: a cycle has no start; add --no-cyclic. "
        "See 'request-planner simulate --help'.",
    ),
    "a start of nobody": (
        ["plan", "desired.csv", "--no-cyclic", "--start-deg", "ankle=3"],
        "--start-deg: no joint 'ankle' in the path; joints: hip, knee. "
        "See 'request-planner plan --help'.",
    ),
    "a start that is no angle": (
        ["plan", "desired.csv", "--no-cyclic", "--start-deg", "knee=high"],
        "--start-deg: got 'knee=high', expected DEG or JOINT=DEG, such as knee=30. "
        "See 'request-planner plan --help'.",
    ),
    "a start beyond the limits": (
        ["plan", "desired.csv", "--no-cyclic", "--start-deg", "knee=90", "--limits-deg", "-60:60"],
        "knee: start: it is 1.5708 rad, 0.524 rad beyond the angles -1.0472 to 1.0472 rad where "
        "the limits on the requests let the joint rest; clip the trajectory, or widen the limits",
    ),
    "a plan for the foot of a joint path": (
        ["plan", "desired.csv", "--method", "foot-optimal"],
        "--method foot-optimal plans for a foot path: give columns x_m, y_m, z_m and a leg. "
        "See 'request-planner plan --help'.",
    ),
    "weights of axes for joints": (
        ["plan", "desired.csv", "--weights", "1", "1", "2"],
        "--weights has no effect with --method optimal. See 'request-planner plan --help'.",
    ),
    "weights that are none": (
        [*FOR_THE_FOOT, "--weights", "1", "-1", "2"],
        "weights: got (1.0, -1.0, 2.0), expected three numbers, 0 or more and not all 0",
    ),
    "a tolerance of nothing": (
        ["plan", "desired.csv", "--tolerance-deg", "0"],
        "--tolerance-deg: got 0, expected more than 0 degrees. See 'request-planner plan --help'.",
    ),
    "a tolerance of the foot for joints": (
        ["plan", "desired.csv", "--tolerance-cm", "1"],
        "--tolerance-cm is for a foot path: use --tolerance-deg. "
        "See 'request-planner plan --help'.",
    ),
    "a tolerance of the joints for the foot": (
        [*FOR_THE_FOOT, "--tolerance-deg", "1"],
        "--tolerance-deg is for joints, which --method foot-optimal lets err for the foot's sake: "
        "use --tolerance-cm. See 'request-planner plan --help'.",
    ),
    "a foot path where there are no legs": (
        ["simulate", "foot.csv"],
        "foot.csv is a foot path, expected columns <joint>_deg or <joint>_rad. "
        "See 'request-planner simulate --help'.",
    ),
    "another length": (
        ["simulate", "desired.csv", "--desired", "short.csv"],
        "short.csv: got 2 samples, expected 88, one per request; "
        "compare with the path that the requests were planned for",
    ),
    "too few samples": (
        ["gait", "--samples", "1"],
        "samples: got 1, expected a whole number, at least 4",
    ),
    "more samples than anybody needs": (
        ["gait", "--samples", "999999999999"],
        "Invalid value for '--samples': 999999999999 is not in the range x<=1000000. "
        "See 'request-planner gait --help'.",
    ),
    "an error below zero": (
        ["fit", "desired.csv", "--max-error", "-1"],
        "--max-error: got -1, expected more than 0 degrees. See 'request-planner fit --help'.",
    ),
    "no period": (
        ["gait", "--period", "0"],
        "--period: got 0, expected 1e-06 to 1000 seconds. See 'request-planner gait --help'.",
    ),
    "a folder that is not ours": (
        ["reproduce", "--out", "."],
        ".: holds files that no earlier run made (desired.csv and 4 more), expected a new or empty "
        "folder or an earlier run's; choose another folder or move them away",
    ),
    "an output folder that is not there": (
        ["gait", "-o", "nowhere/foot.csv"],
        "nowhere/foot.csv: cannot be written (no such file or directory); "
        "choose another place for the output",
    ),
}

MODEL = "v_max = 5.0\ntheta_0 = 0.2\nlag = 0.03\nacceleration_time = 0.05\n"


@pytest.mark.parametrize(("arguments", "message"), WRONG.values(), ids=WRONG)
def test_bad_input_is_one_line_and_status_2(run, desired, foot, tmp_path, arguments, message):
    assert desired.exists()
    assert foot.exists()
    (tmp_path / "slow.toml").write_text(MODEL + "tick = 0.02\n")
    (tmp_path / "mixed.toml").write_text(MODEL + "[knee]\ntick = 0.02\n")
    (tmp_path / "short.csv").write_text("hip_deg,knee_deg\n1,2\n3,4\n")
    result = run(*arguments)
    assert result.stderr == f"request-planner: {message}\n"
    assert result.stdout == ""
    assert result.exit_code == 2


@pytest.mark.parametrize("command", ["plan", "compare"])
def test_an_unreachable_foot_lists_the_points(run, command):
    path = run("gait").stdout
    result = run(command, "-", "--leg", "reference", stdin=path)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("request-planner: 15 of 88 foot positions are out of reach")
    assert result.stderr.endswith("or ask for --unreachable nearest\n")
    assert result.stderr.count("\n") == 1


def test_an_unknown_frame_lists_those_that_there_are(run, foot):
    from kinematics import urdf_path

    result = run(
        "plan", foot, "--urdf", urdf_path("ers210a.urdf"), "--base", "body", "--foot", "paw"
    )
    assert result.exit_code == 2
    assert "foot: frame 'paw' is not in the URDF; frames: " in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_plan_beyond_the_limits_that_were_asked_for_is_status_1_and_no_plan(run, desired):
    result = run("plan", desired, "--method", "closed-form", "--limits-deg", "knee=5:29")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "beyond the limits 5.00 to 29.00; --method optimal keeps to them" in result.stderr
