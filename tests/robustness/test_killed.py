"""Whenever a command is killed, its output is the last good one or the new one, whole.

Between the two renames that replace a folder, the last good one stands beside, under a hidden name.
"""

import re
from hashlib import sha256

import pytest

from tests.robustness.forks import Forks
from tests.robustness.watched import DEATH

MOST = 2  # kills before the last changes; of more changes than that, evenly spaced ones are tried
LAST = 7  # changes at the end, where files are put in place: each of them is tried
PLAN = ["plan", "desired.csv", "--method", "closed-form", "--segments", "5"]
STEPS = ["excite", "--kind", "steps", "--limits-deg", "-10:10", "--duration-s", "1"]
EXCITE = [*STEPS, "--expected-log", "log2.csv"]
RUN = ["run", "run.toml", "--out", "out"]
EXPORT = ["export", "desired.csv", "--cycles"]

COMMANDS = {
    "plan": ([*PLAN, "-o", "a.csv"], [*PLAN, "--rule", "exact", "-o", "a.csv"]),
    "excite": ([*EXCITE, "-o", "a.csv"], [*EXCITE, "--seed", "3", "-o", "a.csv"]),
    "run": (RUN, ["run", "other.toml", "--out", "out"]),
    **{
        f"export {form}": [[*EXPORT, count, "--format", form, "-o", out] for count in "12"]
        for form, out in (("mcap", "a.mcap"), ("lerobot", "a"))
    },
}
"""Two commands with the same output and other content, for each way of writing: a file, two files,
folders. ``fit`` and ``identify`` write as ``plan`` does, ``compare`` and ``reproduce`` as ``run``.
"""

OWN = {"a.csv", "a.mcap", "a", "out", "log2.csv"}
"""Files and folders that the commands are told to write."""


@pytest.fixture(scope="module")
def forks():
    """Forks of a process that has run the commands before: a run is then quick."""
    forks = Forks()
    yield forks
    forks.close()


@pytest.fixture
def folder(folder):
    """All inputs."""
    for name, norm in (("run.toml", "rms"), ("other.toml", "max")):
        (folder / name).write_text(
            f'[path]\nfile = "desired.csv"\n[plan]\nnorm = "{norm}"\n[output]\nreport = ""\n'
        )
    return folder


def _held(folder):
    """What every file of the folder holds, by name."""
    return {
        str(file.relative_to(folder)): sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def _own(files):
    return {name: held for name, held in files.items() if name.split("/")[0] in OWN}


def _moved_away(files):
    """The folder that a run moved away and was killed before it put its own in its place."""
    moved = ((re.fullmatch(r"\.(.+)\.old-\w+(/.+)", name), held) for name, held in files.items())
    return {name[1] + name[2]: held for name, held in moved if name}


@pytest.mark.parametrize("name", COMMANDS)
def test_an_output_is_the_last_good_one_or_the_new_one_whenever_the_run_is_killed(
    name, forks, folder
):
    if name.startswith("export"):
        pytest.importorskip({"lerobot": "pyarrow"}.get(name.split()[1], "rosbags"))
    first, second = COMMANDS[name]
    inputs = _held(folder)
    assert forks.warm(folder, *second) == 0
    assert forks.warm(folder, *first) == 0
    old = _own(_held(folder))
    done = forks.run(folder, *second, watch=True)
    assert done.returncode == 0, done.stderr
    new, changes = _own(_held(folder)), len(done.report["changes"])
    assert changes >= 4, "nothing was changed, so nothing was tested"
    assert old.keys() == new.keys() != set()
    every = max((changes - LAST) // MOST, 1)
    restored = False
    for k in [*range(0, changes - LAST, every), *range(max(changes - LAST, 0), changes)]:
        if not restored:
            again = forks.run(folder, *first)
            assert again.returncode == 0, "a killed run is in the way of the next one"
            assert _own(_held(folder)) == old
        assert forks.run(folder, *second, die_at=k).returncode == DEATH
        held = _held(folder)
        after, restored = _own(held), held.items() >= old.items()
        if name in ("run", "export mcap", "export lerobot"):
            assert after in (old, new) or (not after and _moved_away(held) == old)
        else:  # each file by itself
            assert after.keys() == old.keys()
            assert all(after[file] in (old[file], new[file]) for file in old)
        assert held.items() >= inputs.items()
    assert forks.run(folder, *second).returncode == 0
    assert _own(_held(folder)) == new
