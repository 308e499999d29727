"""Whatever is wrong with a run file: one line with file, line, key and what to do, and status 2."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from planner.cli.declared import NUMBER, tables, understand
from planner.cli.settings import Run
from planner.exceptions import InvalidFile
from planner.files.text import Toml

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
