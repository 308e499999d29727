"""Commands write only to the outputs that are named: whole or not at all, always the same bytes."""

import json
import os
import resource
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.files.paths import write_joint_path
from tests.snapshots import held

LOG = "t_s,requested_deg,actual_deg\n" + "".join(
    f"{0.01 * k:.2f},{20 * (k // 30 % 2)},{18 * (k // 30 % 2)}\n" for k in range(180)
)
RUN = '[path]\nfile = "desired.csv"\n[plan]\nmethod = "closed-form"\n[output]\nreport = "r.html"\n'
BRIEF = ("--method", "closed-form", "--segments", "5")

WRITING = {
    "plan": ["plan", "desired.csv", *BRIEF, "-o", "out/a.csv"],
    "identify": ["identify", "log.csv", "-o", "out/a.toml", "--report", "out/a.html"],
    "compare": ["compare", "desired.csv", "--joint", "knee", "--report", "out/a.html"],
    "excite": [
        *("excite", "--limits-deg", "-9:9", "--duration-s", "4"),
        *("-o", "out/a.csv", "--expected-log", "out/log.csv"),
    ],
    "run": ["run", "run.toml", "--out", "out/results"],
    **{
        form: ["export", "desired.csv", "--cycles", "200", "--format", form, "-o", "out/a"]
        for form in ("csv", "yaml", "bag", "mcap", "lerobot")
    },
}
NEEDED = {"yaml": "yaml", "bag": "rosbags", "mcap": "rosbags", "lerobot": "pyarrow"}

CHANGES = {
    *("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate"),
    *("os.chmod", "os.chown", "os.utime", "shutil.rmtree", "shutil.move", "shutil.copyfile"),
    *("tempfile.mkstemp", "tempfile.mkdtemp"),
}

REPEATED = {
    "plan": ["plan", "desired.csv", "-o", "out/it"],
    "identify": ["identify", "log.csv", "--hold", "1", "-o", "out/it"],
    "compare": [
        *("compare", "desired.csv", "--joint", "knee"),
        *("--segments", "4", "--report", "out/it"),
    ],
}

ELSEWHERE = """import json, sys
from click.testing import CliRunner
from planner.cli import cli
result = CliRunner().invoke(cli, sys.argv[1:])
print(json.dumps([result.exit_code, result.stdout]))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with what the commands read, in which they run."""
    monkeypatch.chdir(tmp_path)
    phase = 2.0 * np.pi * np.arange(24) / 24
    angles = np.column_stack([0.2 * np.sin(phase), 0.3 + 0.1 * np.cos(phase)])
    write_joint_path("desired.csv", ["hip", "knee"], angles, period=0.008)
    Path("log.csv").write_text(LOG)
    Path("run.toml").write_text(RUN)
    for name in ("out", "temporary"):
        Path(name).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path


class Watch:
    """An audit hook: the changes of files and folders while it is on, [event, *paths] each."""

    changes = None

    def __call__(self, event, arguments):
        if self.changes is None:
            return
        if event == "open":
            path, _, flags = arguments
            writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            if isinstance(flags, int) and flags & writes and not isinstance(path, int):
                self.changes.append(["open", str(path)])
        elif event in CHANGES:
            self.changes.append([event, *map(str, arguments[:2])])


@pytest.fixture(scope="module")
def watch():
    """The hook, which no process can get rid of."""
    watch = Watch()
    sys.addaudithook(watch)
    return watch


@pytest.fixture
def watched(folder, watch, command_line, monkeypatch):  # noqa: ARG001
    """Run a command: its result, and what it changed."""
    monkeypatch.setattr(
        sys, "dont_write_bytecode", True
    )  # of modules that it is the first to import

    def watched(name):
        watch.changes = []
        try:
            return command_line(*WRITING[name]), watch.changes
        finally:
            watch.changes = None

    return watched


def steps(changes, folder, out):
    """Changes of the results in ``out`` or of what is in them.

    A kill between two of these, and no other, could be told from the results.
    """
    inside = f"{folder / out}{os.sep}"
    return [
        event
        for event, *paths in changes
        if any(f"{folder / path}{os.sep}".startswith(inside) for path in paths)
    ]


@contextmanager
def room(size):
    """Let no file become longer, as on a full disk; SQLite, Arrow and all others meet it."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


@pytest.mark.parametrize("name", WRITING)
def test_nothing_is_written_but_where_it_was_said_and_whole_or_not_at_all(
    name, folder, watched, command_line
):
    """An output is the last good one or the new one, whenever the command is killed."""
    if name in NEEDED:
        pytest.importorskip(NEEDED[name])
    before = sorted(folder.iterdir())
    result, changes = watched(name)
    assert result.exit_code in (0, 1), result.stderr
    assert list((folder / "out").iterdir())
    compiled = f"{Path(planner.__file__).parent}{os.sep}"  # Numba's cache, beside the code
    allowed = (str(folder / "out"), "out/", str(folder / "temporary"), os.devnull, compiled)
    for event, *paths in changes:
        written = [path for path in paths if "/" in path]
        assert written, (event, paths)
        for path in written:
            assert path.startswith(allowed), (event, path)
    assert sorted(folder.iterdir()) == before
    _, again = watched(name)
    outputs = [word for word in WRITING[name] if word.startswith("out/")]
    for out in outputs:
        assert steps(changes, folder, out) == ["os.rename"]
        # A new folder takes the place of the last one, which is moved away first.
        assert steps(again, folder, out) == ["os.rename"] * (1 + (folder / out).is_dir())
    assert list((folder / "temporary").iterdir()) == []
    whole = held(folder)
    with room(500):
        full = command_line(*WRITING[name])
    reason = "disk i/o error" if name == "bag" else "file too large"
    said = f"cannot be written ({reason}); choose another place for the output\n"
    assert (full.exit_code, full.stdout) == (2, "")
    assert any(full.stderr.endswith(f"request-planner: {out}: {said}") for out in outputs)
    assert held(folder) == whole


@pytest.mark.parametrize("name", REPEATED)
def test_threads_and_seeds_change_no_byte(name, folder, command_line):  # noqa: ARG001
    here = command_line(*REPEATED[name])
    first = Path("out/it").read_bytes()
    own = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONHASHSEED": "77"}
    own |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "4")
    there = subprocess.run(
        [sys.executable, "-P", "-c", ELSEWHERE, *REPEATED[name]],
        env=os.environ | own,
        check=True,
        capture_output=True,
        text=True,
    )
    assert json.loads(there.stdout) == [here.exit_code, here.stdout]
    assert first == Path("out/it").read_bytes() != b""
