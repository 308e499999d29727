"""Whatever is wrong with the input: one line on standard error, exit status 2, nothing written."""

import shlex
from pathlib import Path

import pytest

from tests.snapshots import held

MODEL = "v_max = 5.0\ntheta_0 = 0.2\nlag = 0.03\nacceleration_time = 0.05\n"
GOOD = "t_s,hip_deg,knee_deg\n0,1,20\n0.008,2,30\n0.016,3,10\n0.024,1,10\n"
LEG = ",".join(f"front_left_{name}_deg" for name in ("rotator", "abductor", "knee"))
GAITS = '[leg]\nname = "reference"\n[path.half_ellipse]\n[sweep.parameters]\nlength = [0.02]\n'

HIP = (
    '<robot name="r"><link name="a"/><link name="b"/><joint name="hip" type="revolute">'
    '<parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
    '<limit lower="-0.5" upper="2" effort="1" velocity="1"/></joint></robot>'
)

FILES = {
    "d.csv": GOOD.encode(),
    "e.csv": GOOD.encode(),
    "slow.csv": b"t_s,hip_deg,knee_deg\n0,1,20\n0.02,1002,30\n0.04,3,10\n0.06,1,10\n",
    "slow_path.toml": b'[path]\nfile = "slow.csv"\n',
    "pulses.csv": b"t_s,arm_us\n0,1500\n0.02,1600\n0.04,1500\n",
    "book.xlsx": b"PK\3\4\x14\0\x06\0",
    "spaced.csv": GOOD.replace(",", " ").encode(),
    "ankle.toml": f"[ankle]\n{MODEL}[ankle.servo]\nid = 1\n".encode(),
    "limited.toml": f"{MODEL}[hip.servo]\nid=1\n[knee.servo]\nid=2\nlimits=[0,0.4]\n".encode(),
    "jaw.csv": b"t_s,jaw_percent\n0,1\n0.02,20\n0.04,30\n0.06,2\n",
    "log.csv": b"t_s,requested_deg,actual_deg\n"
    + b"".join(
        b"%.2f,%d,%d\n" % (k / 100, 20 * (k // 30 % 2), 18 * (k // 30 % 2)) for k in range(180)
    ),
    "hip.urdf": HIP.encode(),
    "no_range.urdf": HIP.replace('lower="-0.5" upper="2" ', "").encode(),
    "empty.toml": b"",
    "named": b'[path]\nfile = "d.csv"\n',
    "lost.toml": b'[path]\nfile = "no.csv"\n',
    "slow.toml": MODEL.encode() + b"tick = 0.02\n",
    "mixed.toml": MODEL.encode() + b"[knee]\ntick = 0.02\n",
    "short.csv": b"hip_deg,knee_deg\n1,2\n3,4\n",
    "some.csv": b"knee_deg\n1\n2\n1\n",
    "leg_short.csv": f"{LEG}\n1,2,3\n1,2,3\n".encode(),
    "leg_slow.csv": f"t_s,{LEG}\n0,1,2,3\n0.02,1,2,3\n0.04,1,2,3\n".encode(),
    "hip_log.csv": b"t_s,hip_requested_deg,hip_actual_deg\n0,1,0\n1,2,1\n2,3,2\n",
    "knee_log.csv": b"t_s,knee_requested_deg,knee_actual_deg\n0,1,0\n1,2,1\n2,3,2\n",
    "others.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n0.008,2,2\n0.016,14,5\n0.024,9,9\n",
    "gaits": GAITS.encode(),
    "gaits.toml": f"out = 'o'\n{GAITS}height = [0.02]\n".encode(),
    "share.toml": MODEL.encode() + b"tick = 0.02\nangle_unit = 'range'\n",
    "turn.toml": MODEL.encode() + b"tick = 0.02\nangle_unit = 'rad'\n",
    "soft.toml": MODEL.encode() + b"tick = 0.008\ncompliance = 0.1\n",
}
"""What the commands find, beside ``desired.csv``, ``foot.csv`` and an empty ``folder``."""

BAD = Path(__file__).parent / "snapshots" / "bad_commands.txt"
"""Command lines with something wrong, after each what is said of it."""

ODD = (
    f"export d.csv --format csv --cycles 1{'0' * 400}",
    "'\u202enalp'",
)

WALK = '[leg]\nname = "reference"\nunreachable = "clamp"\n[path.half_ellipse]\n'
JOINTS = '[path]\nfile = "desired.csv"\n'
SWEPT = WALK + "[sweep.parameters]\n"


def test_bad_input_is_one_line_and_status_2_and_nothing_is_written(
    run, desired, foot, tmp_path, snapshot
):
    assert [desired.name, foot.name] == ["desired.csv", "foot.csv"]
    (tmp_path / "folder").mkdir()
    for name in ("loop", "loop.urdf"):
        (tmp_path / name).symlink_to(name)
    (tmp_path / "linked.csv").symlink_to("d.csv")
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    before = held(tmp_path)
    said = []
    lines = [line[2:] for line in BAD.read_text("utf-8").splitlines() if line.startswith("$ ")]
    for line in (*lines, *ODD):
        result = run(*shlex.split(line))
        assert (result.exit_code, result.stdout) == (2, ""), line
        assert result.stderr.startswith("request-planner: "), line
        assert result.stderr.count("\n") == 1, line
        assert result.stderr.rstrip("\n").isprintable(), line
        assert len(result.stderr) < 2000
        assert held(tmp_path) == before, line
        if line not in ODD:
            said.append(f"$ {line}\n{result.stderr.removeprefix('request-planner: ')}")
    snapshot.check("bad_commands", "".join(said))


@pytest.mark.parametrize("place", ["--output", "--report"])
def test_an_output_that_cannot_be_written_is_refused_before_anything_is_computed(
    run, desired, monkeypatch, place
):
    monkeypatch.setattr("planner.cli.planning.plan_of", None)
    result = run("plan", desired, place, "nowhere/file")
    assert result.exit_code == 2
    assert "nowhere/file: cannot be written (no such file or directory)" in result.stderr


WRONG = {
    "no TOML": "[path\n",
    "starts of joints in a cycle": JOINTS + "[plan]\ncyclic = true\n[start.joints]\nknee = 3\n",
    "a misspelt key": JOINTS + '[plan]\nmethd = "optimal"\n',
    "a key of another table": JOINTS + "weights = [1, 1, 1]\n",
    "a misspelt table": JOINTS + "[plann]\n",
    "a misspelt choice": JOINTS + '[plan]\nmethod = "optiml"\n',
    "an abbreviated choice": JOINTS + '[plan]\nmethod = "opt"\n',
    "a number as text": WALK + 'samples = "88"\n',
    "a word for a number": WALK + 'samples = "many"\n',
    "a number for a table of joints": JOINTS + "[limits]\njoints = 3\n",
    "a number out of range": WALK + "ground_fraction = 1.5\n",
    "a number beyond floats": WALK + f"ground_fraction = 1{'0' * 400}\n",
    "no number": WALK + "height = nan\n",
    "a value for a table": "plan = 3\n",
    "one export that is no list": JOINTS + '[export]\nformat = "csv"\n',
    "an export without a file": JOINTS + '[[export]]\nformat = "csv"\n',
    "the second of two exports": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a.csv"\n'
    + '[[export]]\nformat = "csv"\nfile = "b.csv"\nlead_s = 1\n',
    "a LeRobot dataset of rare rows": JOINTS
    + 'rate_hz = 0.5\nspeed = 0.05\n[[export]]\nformat = "lerobot"\nfile = "a"\n',
    "ticks of no ticks": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a.csv"\nzero_ticks = {knee = 1}\n',
    "a file outside the folder": JOINTS + '[output]\nrequests = "../requests.csv"\n',
    "a file that is the folder": JOINTS + '[output]\nrequests = "./"\n',
    "a file at the root": JOINTS + '[[export]]\nformat = "csv"\nfile = "/tmp/a.csv"\n',
    "two files of one name": JOINTS + '[output]\nangles = "Requests.csv"\n',
    "the name of the results": JOINTS + '[output]\nangles = "results.json"\n',
    "a file inside a file": JOINTS + '[[export]]\nformat = "csv"\nfile = "requests.csv/a.csv"\n',
    "a file where a folder is": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a/a.csv"\n[[export]]\nformat = "csv"\nfile = "a"\n',
    "no path": "",
    "two paths": WALK + '[path]\nfile = "desired.csv"\n',
    "a half ellipse without a leg": "[path.half_ellipse]\n",
    "limits of nobody": JOINTS + "[limits.joints]\nkne = [0, 1]\n",
    "limits of a joint upside down": JOINTS + "[limits.joints]\nhip = [0, 1]\nknee = [1, 0]\n",
    "joints of a half ellipse": WALK + '[path]\njoints = ["knee"]\n',
    "a joint that slides on no leg": "[leg.lock_m]\nslide = 0.1\n" + JOINTS,
    "a start for a cycle": JOINTS + "[start]\ndeg = 3\n",
    "a key that the method ignores": JOINTS + "[plan]\nsegments = 6\n",
    "a robust plan without intervals": JOINTS + '[plan]\nrobust = "mean"\n',
    "ticks of nobody": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a"\nunit = "ticks"\nzero_ticks = {kne = 1}\n',
    "a reversed joint of nobody": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a"\nunit = "us"\nreverse = ["kne"]\n',
}

WRONG_SWEEPS = {
    "an unknown parameter": SWEPT + "lenght = [0.1]\n",
    "values that fall": SWEPT + "length = [0.2, 0.1]\n",
    "a value out of range": SWEPT + "length = [0.0, 0.1]\n",
    "a period of a request": SWEPT + "period_s = [0.01]\n",
    "a period without end": SWEPT + "period_s = [0.5, 1e308]\n",
    "the speed of a gait": SWEPT + "speed = [1.0, 2.0]\n",
    "no parameter": SWEPT,
    "a speed of joints for a foot": SWEPT + "length = [0.1]\n[sweep]\nat_speed = 2.0\n",
    "a search along a line": SWEPT + "length = [0.1, 0.2]\n[sweep]\nmethod = 'cma'\n",
    "two requirements": SWEPT + "length = [0.1]\n[sweep]\nat_error_cm = 1\nat_speed_cm_s = 20\n",
    "a gait without a leg": "[path.half_ellipse]\n[sweep.parameters]\nlength = [0.1]\n",
}


def test_a_bad_file_of_a_run_or_a_sweep_is_one_line_and_status_2(run, desired, tmp_path, snapshot):
    text = desired.read_text()
    (tmp_path / "some.csv").write_text(text.replace("hip", "rotator"))
    said = []
    files = [("run", *each) for each in WRONG.items()]
    files += [("sweep", *each) for each in WRONG_SWEEPS.items()]
    for command, name, content in files:
        (tmp_path / "it.toml").write_text(content)
        before = sorted(tmp_path.rglob("*"))
        result = run(command, "it.toml", "--out", "out")
        assert (result.exit_code, result.stdout) == (2, ""), name
        assert result.stderr.startswith("request-planner: it.toml"), name
        assert result.stderr.count("\n") == 1, name
        assert sorted(tmp_path.rglob("*")) == before, name
        said.append(f"{name}: {result.stderr.removeprefix('request-planner: ')}")
    snapshot.check("bad_runs", "".join(said))
