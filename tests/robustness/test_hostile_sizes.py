"""Files and options that claim or unfold into too much: one error, soon, within little memory."""

import json

import numpy as np
import pytest

MEMORY = 2 * 2**30  # address space that a command gets [bytes]: its libraries take a third of it
SECONDS = 20  # processor time that a command gets [s], its imports done
LEG = ("--leg", "robot.urdf", "--base", "a", "--foot", "b")


def _sparse(folder, name, start, size):
    """A file that claims a size, but takes no room on the disk."""
    with (folder / name).open("wb") as stream:
        stream.write(start)
        stream.truncate(size)


def _robot(inside, head=""):
    return f'{head}<robot name="r">{inside}</robot>'


def _laughing(folder):
    entities = "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9))
    head = f'<!DOCTYPE r [<!ENTITY a "ha">{entities}]>'
    (folder / "robot.urdf").write_text(_robot("&j;", head))


def _long_chain(folder):
    links = "".join(f'<link name="l{k}"/>' for k in range(20001))
    joints = "".join(
        f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k in range(20000)
    )
    (folder / "robot.urdf").write_text(_robot(links + joints))


def _parquet_bomb(folder):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    (folder / "meta").mkdir()
    features = {key: {"shape": [30]} for key in ("action", "observation.state")}
    info = {"codebase_version": "v2.1", "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    row = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(30 * 10**6)), 30)
    times = pa.array(np.zeros(10**6))
    columns = dict.fromkeys(features, row) | {"timestamp": times, "episode_index": times}
    parquet.write_table(pa.table(columns), folder / "bomb.parquet", compression="zstd")


def _json_bomb(folder):
    (folder / "log.json").write_text('{"entries": ' + "[" * 10**6 + "]" * 10**6 + "}")


HOSTILE = {
    "a file of zeros without end": (
        lambda folder: _sparse(folder, "x.csv", b"knee_deg\n1\n", 2**42),
        ("plan", "x.csv"),
        "x.csv: longer than 64 MiB; is it the right file?",
    ),
    "a header of a million columns": (
        lambda folder: (folder / "x.csv").write_bytes(b"knee_deg" + 2**20 * b",a_deg"),
        ("plan", "x.csv"),
        "columns, expected at most 10000",
    ),
    "a run file nested deeply": (
        lambda folder: (folder / "run.toml").write_text("a = " + "[" * 10**5),
        ("run", "run.toml"),
        "run.toml",
    ),
    "a run file of a path of dots": (
        lambda folder: (folder / "run.toml").write_text("a" + ".a" * 10**4 + " = 1\n"),
        ("run", "run.toml"),
        "run.toml, line 1: a key of more than 100 parts",
    ),
    "an excitation without end": (
        lambda folder: folder,
        ("excite", "--limits-deg", "-10:10", "--kind", "chirp", "--duration-s", "1e15"),
        "",
    ),
    "episodes without end": (
        lambda folder: (folder / "x.csv").write_text(
            "t_s,requested_deg,actual_deg\n0,1,1\n1,2,2\n2,3,3\n"
        ),
        ("identify", "x.csv", "--episodes", "0-999999999"),
        "episodes",
    ),
    "a billion laughs": (_laughing, ("gait", *LEG), "input amplification factor"),
    "a robot of 20000 joints": (_long_chain, ("gait", *LEG), "more than 200 joints"),
    "a robot without end": (
        lambda folder: _sparse(folder, "robot.urdf", b"<robot>", 2**42),
        ("gait", *LEG),
        "robot.urdf: is longer than 64 MiB",
    ),
    "Parquet that unfolds": (
        _parquet_bomb,
        ("identify", "bomb.parquet", "--joint", "0", "--unit", "rad"),
        "bomb.parquet: more than 256 MiB",
    ),
    "JSON nested deeply": (_json_bomb, ("identify", "log.json"), "nested too deeply"),
}
"""What makes the files, the command, and what its one line says.

All text is read by one function, so that one file without end stands for those of every format.
"""


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_too_large_is_refused_soon_and_within_little_memory(name, forks, tmp_path):
    make, arguments, message = HOSTILE[name]
    make(tmp_path)
    before = sorted(tmp_path.iterdir())
    done = forks.run(tmp_path, *arguments, memory=MEMORY, seconds=SECONDS)
    assert done.returncode == 2, done.stderr[-500:] or done.stdout[-200:]
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert len(done.stderr) < 2000
    assert done.stdout == ""
    assert sorted(tmp_path.iterdir()) == before
