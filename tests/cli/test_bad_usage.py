"""Whatever is wrong with the input: one line on standard error, exit status 2, nothing written."""

from __future__ import annotations

import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.cli.declared import NUMBER, tables, understand
from planner.cli.settings import Run
from planner.exceptions import InvalidFile
from planner.files.text import Toml

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
    "typo.toml": MODEL.replace("lag", "lagg").encode(),
    "held.toml": MODEL.encode() + b"hold = 1000000\n",
    "ankle.toml": f"[ankle]\n{MODEL}[ankle.servo]\nid = 1\n".encode(),
    "no_id.toml": f"[ankle]\n{MODEL}[ankle.servo]\ndirection = 1\n".encode(),
    "jaw.csv": b"t_s,jaw_percent\n0,1\n0.02,20\n0.04,30\n0.06,2\n",
    "one.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n",
    "still.csv": b"t_s,requested_deg,actual_deg\n" + b"".join(b"%d,1,1\n" % k for k in range(200)),
    "log.csv": b"t_s,requested_deg,actual_deg\n"
    + b"".join(
        b"%.2f,%d,%d\n" % (k / 100, 20 * (k // 30 % 2), 18 * (k // 30 % 2)) for k in range(180)
    ),
    "copied.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n0.01,2,2\n0.02,3,3\n0.03,3,3\n",
    "page.urdf": b"<html></html>",
    "hip.urdf": HIP.encode(),
    "no_range.urdf": HIP.replace('lower="-0.5" upper="2" ', "").encode(),
    "empty.toml": b"",
    "named": b'[path]\nfile = "d.csv"\n',
    "lost.toml": b'[path]\nfile = "no.csv"\n',
    "slow.toml": MODEL.encode() + b"tick = 0.02\n",
    "mixed.toml": MODEL.encode() + b"[knee]\ntick = 0.02\n",
    "short.csv": b"hip_deg,knee_deg\n1,2\n3,4\n",
    "some.csv": b"knee_deg\n1\n2\n",
    "leg_short.csv": f"{LEG}\n1,2,3\n1,2,3\n".encode(),
    "leg_slow.csv": f"t_s,{LEG}\n0,1,2,3\n0.02,1,2,3\n0.04,1,2,3\n".encode(),
    "hip_log.csv": b"t_s,hip_requested_deg,hip_actual_deg\n0,1,0\n1,2,1\n2,3,2\n",
    "knee_log.csv": b"t_s,knee_requested_deg,knee_actual_deg\n0,1,0\n1,2,1\n2,3,2\n",
    "others.csv": b"t_s,requested_deg,actual_deg\n0,1,1\n0.008,2,2\n0.016,14,5\n0.024,9,9\n",
    "gaits": GAITS.encode(),
    "gaits.toml": f"out = 'o'\n{GAITS}height = [0.02]\n".encode(),
    "soft.toml": MODEL.encode() + b"tick = 0.008\ncompliance = 0.1\n",
}
"""What the commands find, beside ``desired.csv``, ``foot.csv`` and an empty ``folder``."""

LOOPS = {
    f"a link to itself, in {line.split()[0]}": line
    for line in (
        "plan loop",
        "identify loop",
        "run loop --out out",
        "gait --leg ./loop.urdf --base a --foot b",
    )
}
"""One for each kind of file."""

EXCITE = "excite --limits-deg -30:40 --duration-s 8 --rate-hz 50"
EXPORT = "export desired.csv"

BAD = {
    **LOOPS,
    "a bus without a port": "calibrate --bus feetech --ids 1",
    "a foot path to export": "export foot.csv --format csv",
    "a model as a log": "identify soft.toml",
    "a bus that is none": "calibrate --bus modbus --ids 1",
    "a kind that speaks otherwise": "virtual-bus --kind xl-320 --protocol feetech",
    "a robot without a name": "calibrate --bus lerobot: --ids 1",
    "a rate too low for the test motion": "calibrate --bus virtual --ids 1 --yes --rate-hz 15",
    "a port of no bus": "calibrate --bus virtual --port p --ids 1",
    "a rate that no port has": "calibrate --bus feetech --port p --baud-rate 12345 --ids 1",
    "a port that is not there": "calibrate --bus feetech --port p --ids 1",
    "a stroke of metres": "gait --half-stroke 5",
    "a stroke too long for its leg": "gait --leg front-left --half-stroke 0.5",
    "limits of many turns": "excite --limits-deg -2000:2000",
    "smoothness in percent": "plan desired.csv --smoothness 5",
    "a page beside JSON on standard output": "plan desired.csv -o r.csv --report - --json",
    "a rate beyond any joint": "plan desired.csv --rate-hz 1e9",
    "a joint without a servo": "calibrate --bus virtual --ids 1 --joint knee",
    "a model that was not tested": "check --bus virtual --model ankle.toml",
    "models without servos": "play d.csv --bus virtual --model held.toml",
    "a servo of another joint": "play d.csv --bus virtual --model ankle.toml",
    "a servo without an identifier": "record --bus virtual --model no_id.toml",
    "a fault that is none": "virtual-bus --fault rust=1",
    "a fault of no servo": "virtual-bus --servos 2 --fault stall=3@1",
    "no such command": "bogus",
    "no such option": "gait --sampels 3",
    "no path": "plan",
    "a foot path without a leg": "plan foot.csv",
    "two legs": "plan foot.csv --leg reference --base hip",
    "a pose of no leg": "plan desired.csv --near knee=10",
    "no such leg": "plan foot.csv --leg middle-left",
    "a robot twice": "plan foot.csv --leg robot.urdf --urdf robot.urdf",
    "a joint held nowhere": "gait --leg robot.urdf --base hip --foot foot --lock wrist",
    "a joint held beyond its range": "gait --leg hip.urdf --base a --foot b --lock hip=1e9",
    "a pose far beyond any turn": "gait --leg front-left --near front_left_knee=1e9",
    "speeds of no robot": "plan desired.csv --model urdf",
    "joints that the leg has not": "plan desired.csv --leg reference",
    "joints of a foot path": "plan foot.csv --leg front-left --joint knee",
    "an option that the method ignores": "plan desired.csv --segments 6",
    "one limit where there are two": "excite --limits-deg 45 -o steps.csv",
    "limits of a joint without a name": "plan desired.csv --limits-deg =0:1",
    "limits of nobody": "plan desired.csv --limits-deg ankle=0:1",
    "no such model": "simulate desired.csv --model robot.toml",
    "a joint at another rate": "simulate desired.csv --model slow.toml",
    "joints at different rates": "simulate desired.csv --model mixed.toml",
    "a start for a cycle": "simulate desired.csv --start-deg 3",
    "a start beyond the limits": "plan desired.csv --no-cyclic --start-deg knee=90 "
    "--limits-deg -60:60",
    "a plan for the foot of a joint path": "plan desired.csv --method foot-optimal",
    "a tolerance of the joints for the foot": "plan foot.csv --leg front-left --method "
    "foot-optimal --tolerance-deg 1",
    "a foot path where there are no legs": "simulate foot.csv",
    "another length": "simulate desired.csv --desired short.csv",
    "more samples than anybody needs": "gait --samples 999999999999",
    "an error below zero": "fit desired.csv --max-error -1",
    "a period of hours": "gait --period 1001",
    "the fastest of no tolerance": "gait --leg front-left --fastest",
    "a view of requests by a method": "view foot.csv --leg front-left --html a --requests r "
    "--method optimal",
    "a folder that is not ours": "reproduce --out .",
    "a path in place of which its requests would be written": "plan d.csv -o d.csv",
    "an input by another name": "plan linked.csv -o d.csv",
    "two outputs on standard output": "fit d.csv --joint hip --knots -",
    "two outputs in one file": "plan d.csv -o new.csv --report new.csv",
    "an unknown option value": "plan d.csv --method magic",
    "more segments than samples": "plan d.csv --method closed-form --segments 99",
    "a joint that is not there": "plan d.csv --joint ankle",
    "actual angles that are the requests": "identify copied.csv",
    "a unit of nobody": "identify log.csv --unit deg,hpi=rad",
    "a model without a file": "plan d.csv --model ers201a",
    "limits beside the path": "plan d.csv --limits-deg 80:90",
    "an argument too many": "plan d.csv e.csv",
    "a folder for a file": "plan folder",
    "an output below a file": "gait -o d.csv/a.csv",
    "a model with a typo": "simulate d.csv --model typo.toml",
    "a model held for ever": "simulate d.csv --model held.toml",
    "fit of a share of a range": "fit jaw.csv --model slow.toml",
    "fit with two sizes": "fit d.csv --max-error 1 --max-rms 1",
    "fit with a knot outside": "fit d.csv --knot-s 9",
    "fit with a required knot of text": "fit d.csv --required-s now",
    "fit exactly for an error": "fit d.csv --exact --max-error 1",
    "a log of one row": "identify one.csv",
    "a log that never moves": "identify -q still.csv",
    "a log in another unit": "identify log.csv --unit yards",
    "a hold of nothing": "identify log.csv --hold 0",
    "no such column of a log": "identify log.csv --requested wanted",
    "an export of no format": "export d.csv -o a.csv",
    "an export with too few names": "export d.csv --format csv --joint-names a -o a.csv",
    "a leg without a file": "gait --leg no.urdf --base a --foot b",
    "a leg of another XML": "gait --leg page.urdf --base a --foot b",
    "a leg whose joints have no limits": "plan foot.csv --leg no_range.urdf --base a --foot b",
    "a centre beyond the range": f"{EXCITE} --centre-deg 50",
    "an excitation at no rate": "excite --limits-deg -30:40 --rate-hz 0",
    "cycles of a chirp": f"{EXCITE} --kind chirp --cycles 2",
    "a step beyond the range": f"{EXCITE} --amplitude-deg 90",
    "an excitation of no time": "excite --limits-deg -30:40 --rate-hz 50 --duration-s 0.1",
    "a required knot between samples": "fit desired.csv --required-s 0.7=0 --exact --segments 4",
    "required angles too far apart": "fit desired.csv --required-s 0=0 --required-s 0.016=90",
    "knots of two joints": "fit desired.csv --knots k.csv",
    "fit exactly for nothing": "fit desired.csv --exact",
    "a joint that the log does not have": "identify log.csv --joint hip",
    "velocities of a table": f"{EXPORT} --format csv --velocities",
    "ticks without the unit": f"{EXPORT} --format csv --zero-tick 3",
    "half a tick": f"{EXPORT} --format csv --unit ticks --zero-tick knee=1.5",
    "a lead that ROS cannot hold": f"{EXPORT} --format yaml --lead-s 3e9",
    "a topic without a name": f"{EXPORT} --format mcap --topic / -o new",
    "a bag on standard output": f"{EXPORT} --format bag",
    "lines without a rate": f"{EXPORT} --format csv --between linear",
    "requests without times": "export short.csv --format csv",
    "a rate that leaves requests out": f"{EXPORT} --format csv --rate-hz 50",
    "a run file that is empty": "run empty.toml",
    "a run without a name for its folder": "run named",
    "workers here and there": "replay log.csv log.csv --model from-log --workers 2 --scheduler tcp://a:1",
    "a sweep from a pipe": "sweep -",
    "a point without a folder": "sweep gaits.toml --at length=0.02",
    "a point without all of its values": "sweep gaits.toml --at height=0.02 --out it",
    "a log of other requests": "refine d.csv others.csv --desired d.csv --joint hip",
    "a view without a leg": "view desired.csv --html a",
    "a view of some of the joints": "view some.csv --leg reference --html a",
    "a view of requests at another rate": "view foot.csv --leg front-left --html a "
    "--requests leg_slow.csv",
    "a view of requests of another path": "view foot.csv --leg front-left --html a "
    "--requests leg_short.csv",
    "a robust plan of the paper's joint": "plan desired.csv --robust mean",
    "a robust plan without intervals": "plan desired.csv --model soft.toml --robust mean",
    "shares of a range for the paper's joint": "plan jaw.csv",
    "a load that the path does not have": "plan desired.csv --model soft.toml --load column",
    "a load without an arm": "replay log.csv --model soft.toml --load urdf",
    "a torque that was not recorded": "replay log.csv --model soft.toml --load column",
    "a leg that was not recorded": "replay log.csv --model soft.toml --load urdf --leg front-left",
    "logs of different joints": "identify -q hip_log.csv knee_log.csv",
    "a model in place of what is none": "identify log.csv -o lost.toml",
    "a model in no folder": "identify log.csv -o nowhere/joint.toml --report page.html",
    "quiet and verbose at once": "-q gait -v",
    "cycles beyond counting": f"export d.csv --format csv --cycles 1{'0' * 400}",
    "a sensor finer than atoms": "excite --limits-deg -9:9 --resolution-deg 1e-320",
    "a command that writes from right to left": "'\u202enalp'",
    "a word without end": f"plan d.csv --norm {'x' * 5000}",
}
"""Command lines with something wrong; the snapshot holds what is said of each."""


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
    before = _held(tmp_path)
    said = []
    for name, line in BAD.items():
        result = run(*shlex.split(line))
        assert (result.exit_code, result.stdout) == (2, ""), name
        assert result.stderr.startswith("request-planner: "), name
        assert result.stderr.count("\n") == 1, name
        assert result.stderr.rstrip("\n").isprintable(), name
        assert _held(tmp_path) == before, name
        said.append(f"{name}: {result.stderr.removeprefix('request-planner: ')}")
    snapshot.check("bad_commands", "".join(said))


def _held(folder):
    """Every file and its content."""
    return {each: each.read_bytes() if each.is_file() else None for each in folder.rglob("*")}


@pytest.mark.parametrize("place", ["--output", "--report"])
def test_an_output_that_cannot_be_written_is_refused_before_anything_is_computed(
    run, desired, monkeypatch, place
):
    monkeypatch.setattr("planner.cli.planning.plan_of", None)
    result = run("plan", desired, place, "nowhere/file")
    assert result.exit_code == 2
    assert "nowhere/file: cannot be written (no such file or directory)" in result.stderr


WALK = '[leg]\nname = "reference"\nunreachable = "clamp"\n[path.half_ellipse]\n'
JOINTS = '[path]\nfile = "desired.csv"\n'

WRONG = {
    "no TOML": "[path\n",
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
    "two legs": '[leg]\nurdf = "a.urdf"\n' + 'name = "reference"\n' + JOINTS,
    "a name beyond any name": f'[path]\nfile = "{"x" * 1001}"\n',
    "limits of nobody": JOINTS + "[limits.joints]\nkne = [0, 1]\n",
    "limits of a joint upside down": JOINTS + "[limits.joints]\nhip = [0, 1]\nknee = [1, 0]\n",
    "joints of a half ellipse": WALK + '[path]\njoints = ["knee"]\n',
    "a joint that slides on no leg": "[leg.lock_m]\nslide = 0.1\n" + JOINTS,
    "a start for a cycle": JOINTS + "[start]\ndeg = 3\n",
    "a key that the method ignores": JOINTS + "[plan]\nsegments = 6\n",
    "a robust plan without intervals": JOINTS + '[plan]\nrobust = "mean"\n',
    "ticks of nobody": JOINTS
    + '[[export]]\nformat = "csv"\nfile = "a"\nunit = "ticks"\nzero_ticks = {kne = 1}\n',
}


def test_a_bad_run_file_is_one_line_and_status_2(run, desired, tmp_path, snapshot):
    text = desired.read_text()
    (tmp_path / "some.csv").write_text(text.replace("hip", "rotator"))
    said = []
    for name, content in WRONG.items():
        (tmp_path / "it.toml").write_text(content)
        before = sorted(tmp_path.rglob("*"))
        result = run("run", "it.toml", "--out", "out")
        assert (result.exit_code, result.stdout) == (2, ""), name
        assert result.stderr.startswith("request-planner: it.toml"), name
        assert result.stderr.count("\n") == 1, name
        assert sorted(tmp_path.rglob("*")) == before, name
        said.append(f"{name}: {result.stderr.removeprefix('request-planner: ')}")
    snapshot.check("bad_runs", "".join(said))


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats()
    | st.text(max_size=8)
    | st.dates(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2)
    ),
    max_leaves=4,
)
"""What TOML can hold, and None, which stands for a key that is not there."""

KEYS = [(*table.place, key) for table in tables(Run) for key in table.keys]


def refused(file):
    """What is said against a file; nothing if it is taken."""
    try:
        understand(file, Run)
    except InvalidFile as error:
        return str(error)
    return ""


@given(place=st.sampled_from(KEYS), value=VALUES)
def test_any_value_of_any_key_is_taken_or_refused_in_a_line(place, value):
    whole = {} if value is None else {place[-1]: value}
    for part in reversed(place[:-1]):
        whole = (
            ([whole] if place[0] == "export" else {"knee": whole})
            if part == NUMBER
            else {part: whole}
        )
    said = refused(Toml("it.toml", "", whole))
    assert said.isprintable()
    assert len(said) < 1000
