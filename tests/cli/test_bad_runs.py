"""Whatever is wrong with a run file: one line with file, line, key and what to do, and status 2."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.cli.run_keys import RUN
from planner.exceptions import InvalidFile
from planner.files.schema import understand
from planner.files.schema_text import toml_value
from planner.files.toml import Toml, read_toml

WALK = '[leg]\nname = "reference"\nunreachable = "clamp"\n[path.half_ellipse]\n'
JOINTS = '[path]\nfile = "desired.csv"\n'

WRONG = {
    "no TOML": (
        "[path\n",
        "line 1: not TOML: Expected ']' at the end of a table declaration at column 6; expected "
        "lines such as 'method = \"optimal\"', and 0.1 for .1",
    ),
    "a misspelt key": (
        JOINTS + '[plan]\nmethd = "optimal"\n',
        "line 4: unknown key 'plan.methd' (did you mean 'method'?); keys of [plan]: method, "
        "cyclic, norm, solver, weights, segments, rule",
    ),
    "a key of another table": (
        JOINTS + "weights = [1, 1, 1]\n",
        "line 3: unknown key 'path.weights' (did you mean 'plan.weights'?); keys of [path]: file, "
        "joints, half_ellipse",
    ),
    "a misspelt table": (
        JOINTS + "[plann]\n",
        "line 3: unknown key 'plann' (did you mean 'plan'?); keys: out, leg, model, path, plan, "
        "limits, start, tolerance, output, export",
    ),
    "a misspelt choice": (
        JOINTS + '[plan]\nmethod = "optiml"\n',
        "line 4: plan.method: got 'optiml', expected one of closed-form, optimal, foot-optimal "
        "(did you mean 'optimal'?)",
    ),
    "a number as text": (
        WALK + 'samples = "88"\n',
        "line 5: path.half_ellipse.samples: got '88', expected a whole number from 4 to 1000000; "
        "without quotes",
    ),
    "a number out of range": (
        WALK + "ground_fraction = 1.5\n",
        "line 5: path.half_ellipse.ground_fraction: got 1.5, expected a number above 0 and below 1",
    ),
    "no number": (
        WALK + "height = nan\n",
        "line 5: path.half_ellipse.height: got nan, expected a number of at least 0",
    ),
    "a value for a table": ("plan = 3\n", "line 1: plan: got 3, expected a table [plan]"),
    "a table for a value": (
        JOINTS + "[plan.method]\n",
        "line 3: plan.method: got a table, expected one of closed-form, optimal, foot-optimal",
    ),
    "one export that is no list": (
        JOINTS + '[export]\nformat = "csv"\n',
        "line 3: export: got a table, expected tables [[export]]",
    ),
    "an export without a file": (
        JOINTS + '[[export]]\nformat = "csv"\n',
        "line 3: export[0]: no key 'file', expected the name of a file inside the folder of the "
        "results; add it",
    ),
    "an export's key that its format ignores": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "a.csv"\nlead_s = 1\n',
        "line 3: export[0]: lead_s has no effect on format csv, only on yaml, bag, mcap",
    ),
    "ticks of no ticks": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "a.csv"\nzero_ticks = {knee = 1}\n',
        "line 3: export[0]: zero_tick needs unit ticks",
    ),
    "a file outside the folder": (
        JOINTS + '[output]\nrequests = "../requests.csv"\n',
        "line 4: output.requests: got '../requests.csv', expected the name of a file inside the "
        'folder of the results, or "" for none; all that a run writes stays inside that folder',
    ),
    "a file at the root": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "/tmp/a.csv"\n',
        "line 5: export[0].file: got '/tmp/a.csv', expected the name of a file inside the folder "
        "of the results; all that a run writes stays inside that folder",
    ),
    "two files of one name": (
        JOINTS + '[output]\nangles = "Requests.csv"\n',
        "line 4: output.angles: got 'Requests.csv', which output.requests takes; choose another "
        "name",
    ),
    "the name of the results": (
        JOINTS + '[output]\nangles = "results.json"\n',
        "line 4: output.angles: got 'results.json', which the results takes; choose another name",
    ),
    "a file inside a file": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "requests.csv/a.csv"\n',
        "line 5: export[0].file: got 'requests.csv/a.csv', which output.requests takes; choose "
        "another name",
    ),
    "no path": ("", "path: nothing to follow, expected file or [path.half_ellipse]"),
    "two paths": (
        WALK + '[path]\nfile = "desired.csv"\n',
        "line 4: path.half_ellipse: stands beside path.file, expected one of them; remove the "
        "other",
    ),
    "a half ellipse without a leg": (
        "[path.half_ellipse]\n",
        "line 1: path.half_ellipse: is a foot path: name the leg with leg.name, or with leg.urdf, "
        "leg.base and leg.foot",
    ),
    "two legs": (
        '[leg]\nurdf = "a.urdf"\n' + 'name = "reference"\n' + JOINTS,
        "line 3: leg.name is a shipped leg: leave out leg.urdf, leg.base, leg.foot and leg.lock",
    ),
    "standard input": (
        '[path]\nfile = "-"\n',
        "line 2: path.file: got '-', expected the name of a file; a run reads no standard input, "
        "so write it to a file first",
    ),
    "a name beyond any name": (
        f'[path]\nfile = "{"x" * 1001}"\n',
        f"line 2: path.file: got '{'x' * 58}…, expected the name of a file of at most 1000 "
        "characters",
    ),
    "limits upside down": (
        JOINTS + "[limits]\ndeg = [10, -10]\n",
        "line 4: limits.deg: got [10, -10], expected two numbers [LOW, HIGH] with LOW below HIGH",
    ),
    "limits of nobody": (
        JOINTS + "[limits.joints]\nkne = [0, 1]\n",
        "line 4: limits.joints.kne: no such joint in the path (did you mean 'knee'?); joints: "
        "hip, knee",
    ),
    "a model of nobody": (
        JOINTS + "[model.joints.kne]\nlag = 0.03\n",
        "line 3: model.joints.kne: no such joint in the path (did you mean 'knee'?); joints: "
        "hip, knee",
    ),
    "a model of half its parameters": (
        JOINTS + "[model.parameters]\nlag = 0.03\n",
        "line 3: model.parameters: no v_max, theta_0, acceleration_time; expected v_max, theta_0, "
        "lag, acceleration_time in rad/s, rad, s, s",
    ),
    "a model twice": (
        JOINTS + '[model]\nfile = "ers210a"\n[model.parameters]\nlag = 0.03\n',
        "line 5: model.parameters: stands beside model.file, expected one of them; remove the "
        "other",
    ),
    "a start for a cycle": (
        JOINTS + "[start]\ndeg = 3\n",
        "line 4: start.deg: a cycle has no start; add plan.cyclic = false",
    ),
    "a key that the method ignores": (
        JOINTS + "[plan]\nsegments = 6\n",
        "line 4: plan.segments has no effect with plan.method optimal",
    ),
    "a foot's tolerance for joints": (
        JOINTS + "[tolerance]\ncm = 1\n",
        "line 4: tolerance.cm is for a foot path: use tolerance.deg",
    ),
    "a level of no comparison": (
        JOINTS + '[output]\nlevel = "exact"\n',
        "line 4: output.level: has no effect without output.comparison = true",
    ),
    "an export at a rate of atoms": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "a"\nrate_hz = 1e9\n',
        "line 3: export[0]: 0.704 s at 1e+09 Hz make 704000000 rows, expected at most 1000000; "
        "ask for a lower rate",
    ),
    "names of other joints": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "a"\njoint_names = ["a"]\n',
        "line 3: export[0]: joint names: got a, expected 2 different names, one per column of the "
        "requests",
    ),
    "ticks of nobody": (
        JOINTS + '[[export]]\nformat = "csv"\nfile = "a"\nunit = "ticks"\nzero_ticks = {kne = 1}\n',
        "line 3: export[0]: zero tick: no joint 'kne'; joints: hip, knee",
    ),
    "a topic without a name": (
        JOINTS + '[[export]]\nformat = "mcap"\nfile = "a"\ntopic = "/"\n',
        "line 3: export[0]: topic: got '/', expected a name such as "
        "/joint_trajectory_controller/joint_trajectory",
    ),
    "a rate that LeRobot has not": (
        JOINTS + '[[export]]\nformat = "lerobot"\nfile = "a"\nrate_hz = 12.5\n',
        "line 3: export[0]: a request every 0.08 s is 12.5 per second, expected a whole number "
        "for LeRobot; resample to one",
    ),
    "a lead beyond ROS": (
        JOINTS + '[[export]]\nformat = "yaml"\nfile = "a"\nlead_s = 1e10\n',
        "line 3: export[0]: a request every 0.008 s until 1e+10 s: ROS has whole nanoseconds up "
        "to 2147483647 s; export fewer cycles, or at another rate",
    ),
    "a scene without a leg": (
        JOINTS + '[output]\nscene = "a.html"\n',
        "line 4: output.scene: needs a leg, and a path of all its joints",
    ),
}


@pytest.mark.parametrize(("content", "message"), WRONG.values(), ids=WRONG)
def test_a_bad_run_file_is_one_line_and_status_2(run, desired, tmp_path, content, message):
    (tmp_path / "it.toml").write_text(content)
    before = sorted(tmp_path.rglob("*"))
    result = run("run", "it.toml", "--out", "out")
    place = "it.toml, " if message.startswith("line") else "it.toml: "
    assert result.stderr == f"request-planner: {place}{message}\n"
    assert result.stdout == ""
    assert result.exit_code == 2
    assert sorted(tmp_path.rglob("*")) == before
    assert desired.exists()


def test_files_that_are_named_speak_for_themselves(run, tmp_path):
    (tmp_path / "it.toml").write_text(JOINTS)
    assert run("run", "it.toml").stderr == (
        "request-planner: desired.csv: no such file; check the name and the folder\n"
    )
    assert run("run", "other.toml").stderr == (
        "request-planner: other.toml: no such file; check the name and the folder\n"
    )
    (tmp_path / "it.toml").write_text(WALK.replace("clamp", "raise"))
    result = run("run", "it.toml")
    assert result.exit_code == 2
    assert result.stderr.endswith("or ask for leg.unreachable = 'nearest'\n")
    assert result.stderr.count("\n") == 1


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

KEYS = [(table, key) for table in RUN for key in table.keys]


def refused(file):
    """What is said against a file; nothing if it is taken."""
    try:
        understand(file, RUN)
    except InvalidFile as error:
        return str(error)
    return ""


@given(place=st.sampled_from(KEYS), value=VALUES)
def test_any_value_of_any_key_is_taken_or_refused_in_a_line(place, value):
    table, key = place
    content = {} if value is None else {key.name: value}
    content = {"knee": content} if table.named else content
    whole = [content] if table.repeated else content
    for part in reversed(table.name):
        whole = {part: whole}
    said = refused(Toml("it.toml", "", whole))
    assert said.isprintable()
    assert len(said) < 1000


@given(content=st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_bytes_are_taken_or_refused_in_a_line(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "any.toml"
    file.write_bytes(content)
    try:
        said = refused(read_toml(file, example="a = 1"))
    except InvalidFile as error:
        said = str(error)
    assert said.isprintable()


def test_values_are_written_as_toml_reads_them(tmp_path):
    values = {"a": 1.5, "b": [1, 2], "c": {"x y": 'é"\n\\'}, "d": True, "e": float("inf")}
    file = tmp_path / "values.toml"
    file.write_text("".join(f"{key} = {toml_value(value)}\n" for key, value in values.items()))
    assert read_toml(file, example="").content == values
