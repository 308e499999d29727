"""Where there is no room for an output, one line names it as the user did, and nothing is left.

A limit on the length of files stands for a full disk, so that SQLite, Arrow and all others that
write meet it; the system then says "file too large".
"""

import pytest

from planner.files.staging import list_files

EXPORT = ("export", "desired.csv", "--cycles", "200", "-o", "out", "--format")
PLAN = ("--method", "closed-form", "--segments", "5")

COMMANDS = {
    "plan": ("plan", "desired.csv", *PLAN, "-o", "out"),
    "run": ("run", "run.toml", "--out", "out"),
    **{form: (*EXPORT, form) for form in ("csv", "yaml", "bag", "mcap", "lerobot")},
}

NEEDS = {"yaml": "yaml", "bag": "rosbags", "mcap": "rosbags", "lerobot": "pyarrow"}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_said_of_the_output_by_the_name_that_the_user_gave(name, forks, folder):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    (folder / "run.toml").write_text(
        '[path]\nfile = "desired.csv"\n[plan]\nmethod = "closed-form"\nsegments = 5\n'
    )
    before = list_files(folder)
    done = forks.run(folder, *COMMANDS[name], room=500)
    reason = "disk i/o error" if name == "bag" else "file too large"
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"request-planner: out: cannot be written ({reason}); choose another place for the output\n"
    )
    assert list_files(folder) == before
