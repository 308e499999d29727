"""Commands write only to the outputs that are named, the same bytes every time."""

import os
from pathlib import Path

import pytest

import planner
from tests.robustness.forks import Forks

LOG = "t_s,requested_deg,actual_deg\n" + "".join(
    f"{0.01 * k:.2f},{20 * (k // 30 % 2)},{18 * (k // 30 % 2)}\n" for k in range(180)
)
RUN = '[path]\nfile = "desired.csv"\n[plan]\nmethod = "closed-form"\n[output]\nreport = "r.html"\n'

WRITING = {
    "plan": ["plan", "desired.csv", "--method", "closed-form", "-o", "out/a.csv"],
    "identify": ["identify", "log.csv", "-o", "out/a.toml", "--report", "out/a.html"],
    "compare": ["compare", "desired.csv", "--joint", "knee", "--report", "out/a.html"],
    "export": ["export", "desired.csv", "--format", "csv", "-o", "out/a.csv"],
    "excite": [
        *("excite", "--limits-deg", "-9:9", "--duration-s", "4"),
        *("-o", "out/a.csv", "--expected-log", "out/log.csv"),
    ],
    "run": ["run", "run.toml", "--out", "out/results"],
    "mcap": ["export", "desired.csv", "--format", "mcap", "-o", "out/results"],
    "lerobot": ["export", "desired.csv", "--format", "lerobot", "-o", "out/results"],
}
NEEDED = {"mcap": "rosbags", "lerobot": "pyarrow"}  # packages of formats


@pytest.fixture
def folder(folder):
    (folder / "log.csv").write_text(LOG)
    (folder / "run.toml").write_text(RUN)
    (folder / "out").mkdir()
    (folder / "temporary").mkdir()
    return folder


@pytest.fixture
def watched(forks, folder):
    """A run of the program in the folder: its status, what it says in lines, and what it did."""

    def watched(*arguments):
        temporary = folder / "temporary"
        own = {"TMPDIR": str(temporary), "MPLCONFIGDIR": str(temporary / "matplotlib")}
        done = forks.run(folder, *arguments, environment=own, watch=True)
        return done.returncode, done.stderr.splitlines(), done.changes

    return watched


def _names(folder):
    return {file.relative_to(folder).parts[0] for file in folder.iterdir()}


def steps(changes, folder, out):
    """Changes of the results in ``out`` or of what is in them, by a command that ran in a folder.

    A kill between two of these, and no other, could be told from the results.
    """
    inside = f"{folder / out}{os.sep}"
    return [
        event
        for event, *paths in changes
        if any(f"{folder / path}{os.sep}".startswith(inside) for path in paths)
    ]


@pytest.mark.parametrize("name", WRITING)
def test_nothing_is_written_but_where_it_was_said_and_outputs_by_renames(name, folder, watched):
    """So that an output is the last good one or the new one, whenever the command is killed."""
    if name in NEEDED:
        pytest.importorskip(NEEDED[name])
    before = _names(folder)
    status, said, changes = watched(*WRITING[name])
    assert status in (0, 1), said
    assert list((folder / "out").iterdir()), said
    compiled = f"{Path(planner.__file__).parent}{os.sep}"  # Numba's cache, beside the code
    allowed = (str(folder / "out"), "out/", str(folder / "temporary"), os.devnull, compiled)
    for event, *paths in changes:
        written = [path for path in paths if "/" in path]
        assert written, (event, paths)
        for path in written:
            assert path.startswith(allowed), (event, path)
    assert _names(folder) == before
    again = watched(*WRITING[name])[2]
    for out in (word for word in WRITING[name] if word.startswith("out/")):
        assert steps(changes, folder, out) == ["os.rename"]
        # A new folder takes the place of the last one, which is moved away first.
        assert steps(again, folder, out) == ["os.rename"] * (1 + (folder / out).is_dir())
    left = {file.name for file in (folder / "temporary").iterdir()}
    assert left <= {"matplotlib"}, "temporary files are left"


COMMANDS = {
    "plan optimal": ["plan", "desired.csv"],
    "identify": ["identify", "log.csv", "--hold", "1"],
    "compare": ["compare", "desired.csv", "--joint", "knee", "--segments", "4"],
}
"""Plans, bounds and pages that the commands make, in a file."""


@pytest.fixture(scope="module")
def other_world():
    """A process with more threads for its linear algebra, and a seed of its own for its sets."""
    other = Forks(threads=4, seed=77)
    yield other
    other.close()


@pytest.mark.parametrize("name", COMMANDS)
def test_threads_and_seeds_change_no_byte(name, folder, monkeypatch, other_world, command_line):
    monkeypatch.chdir(folder)
    arguments = [*COMMANDS[name], "--report" if name == "compare" else "-o", "out/it"]
    here = command_line(*arguments)
    first = (folder / "out/it").read_bytes()
    there = other_world.run(folder, *arguments)
    assert (here.exit_code, here.stdout) == (there.returncode, there.stdout), there.stderr
    assert first == (folder / "out/it").read_bytes() != b""
