"""Files that claim or unfold into too much: one error, soon, within little memory."""

import json
import resource
import subprocess

import numpy as np
import pytest

from tests.cli.test_process import RUN

MEMORY = 2 * 2**30  # address space that a command gets [bytes]: its libraries take a third of it
SECONDS = 40  # processor time that a command gets [s]


def _endless(folder):
    with (folder / "x.csv").open("wb") as stream:
        stream.write(b"knee_deg\n1\n")
        stream.truncate(2**42)  # without room on the disk


def _unfolding(folder):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    (folder / "meta").mkdir()
    features = {key: {"shape": [30]} for key in ("action", "observation.state")}
    info = {"codebase_version": "v2.1", "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    row = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(30 * 600_000)), 30)
    times = pa.array(np.zeros(600_000))
    columns = dict.fromkeys(features, row) | {"timestamp": times, "episode_index": times}
    parquet.write_table(pa.table(columns), folder / "x.parquet", compression="zstd")


LARGE = {
    "a file without end": (_endless, ("plan", "x.csv"), "x.csv: longer than 64 MiB"),
    "a million columns": (
        lambda folder: (folder / "x.csv").write_bytes(b"knee_deg" + 2**20 * b",a_deg"),
        ("plan", "x.csv"),
        "columns, expected at most 10000",
    ),
    "a key of 20,000 parts": (
        lambda folder: (folder / "run.toml").write_text("a" + ".a" * 20_000 + " = 1\n"),
        ("run", "run.toml"),
        "run.toml, line 1: a key of more than 100 parts",
    ),
    "Parquet that unfolds": (
        _unfolding,
        ("identify", "x.parquet", "--joint", "0", "--unit", "rad"),
        "x.parquet: more than 256 MiB",
    ),
}


@pytest.mark.parametrize("name", LARGE)
def test_what_is_too_large_is_refused_soon_and_within_little_memory(name, tmp_path):
    make, arguments, message = LARGE[name]
    make(tmp_path)

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))

    done = subprocess.run(
        [*RUN, *arguments],
        cwd=tmp_path,
        preexec_fn=limit,
        check=False,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (2, ""), done.stderr[-500:]
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
