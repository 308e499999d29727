"""Where there is no room for an output, one line names it as the user did, and nothing is left.

A limit on the length of files stands for a full disk, so that SQLite, Arrow and all others that
write meet it; the system then says "file too large".
"""

from __future__ import annotations

import numpy as np
import pytest

from planner.files.paths import write_joint_path
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
def test_a_full_disk_is_said_of_the_output_by_the_name_that_the_user_gave(name, forks, tmp_path):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    phase = 2.0 * np.pi * np.arange(24) / 24
    angles = np.column_stack([0.2 * np.sin(phase), 0.3 + 0.1 * np.cos(phase)])
    write_joint_path(tmp_path / "desired.csv", ["hip", "knee"], angles, period=0.008)
    (tmp_path / "run.toml").write_text(
        '[path]\nfile = "desired.csv"\n[plan]\nmethod = "closed-form"\nsegments = 5\n'
    )
    before = list_files(tmp_path)
    done = forks.run(tmp_path, *COMMANDS[name], room=500)
    reason = "disk i/o error" if name == "bag" else "file too large"
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"request-planner: out: cannot be written ({reason}); choose another place for the output\n"
    )
    assert list_files(tmp_path) == before
