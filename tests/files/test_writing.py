"""Files and folders appear whole or not at all, and nothing of the user's is lost."""

import json
import math
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from planner.exceptions import InvalidFile
from planner.files.paths import growing_log
from planner.files.staging import list_files, output_folder, staged
from planner.files.text import to_json, write_text
from tests.parallel.work import at_work_on


def _run(folder, name="a.csv", content="1"):
    with output_folder(folder) as new:
        (new / name).write_text(content)
        (new / "results.json").write_text(json.dumps({"files": [name]}))


def test_a_written_file_keeps_its_permissions_and_its_link(tmp_path):
    plain, written = tmp_path / "plain", tmp_path / "written"
    plain.touch()
    write_text(written, "new")
    assert written.stat().st_mode == plain.stat().st_mode
    written.chmod(0o640)
    write_text(written, "newer")
    assert written.stat().st_mode & 0o777 == 0o640
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("old")
    link.symlink_to(file)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"


def test_a_file_that_another_process_writes_is_not_swept_away(tmp_path):
    file = tmp_path / "plan.csv"
    code = (
        "import sys; from planner.files.staging import staged\n"
        f"with staged({str(file)!r}, b'slow'):\n"
        "    print('written', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-P", "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        write_text(file, "quick")
        assert file.read_text() == "quick"
    assert process.returncode == 0
    assert file.read_text() == "slow"
    assert list_files(tmp_path) == ["plan.csv"]


def test_several_files_appear_or_none_where_one_cannot(tmp_path):
    with pytest.raises(InvalidFile, match="is a directory"), staged(tmp_path, b"text"):
        write_text(tmp_path / "other", "text")
    assert list(tmp_path.iterdir()) == []


def test_a_run_makes_its_folder_the_next_run_replaces_it_and_a_failed_one_does_not(tmp_path):
    out = tmp_path / "deep" / "out"
    _run(out, "a.csv")
    _run(out, "b.csv", "2")
    held = ["deep/out/b.csv", "deep/out/results.json"]
    assert list_files(tmp_path) == held

    def stopped_half_way():
        with output_folder(out) as new:
            (new / "half.csv").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped_half_way()
    assert list_files(tmp_path) == held


def test_a_users_files_are_kept_and_a_folder_with_some_is_never_replaced(tmp_path):
    out = tmp_path / "out"
    _run(out)
    with pytest.raises(InvalidFile, match=r"late\.txt"), output_folder(out):
        (out / "late.txt").write_text("mine")
    assert list_files(out) == ["a.csv", "late.txt", "results.json"]
    (out / "late.txt").rename(out / "notes.txt")
    with pytest.raises(InvalidFile) as caught:
        _run(out)
    assert str(caught.value) == (
        f"{out}: holds files that no earlier run made (notes.txt), expected a new or empty folder "
        "or an earlier run's; choose another folder or move them away"
    )
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "content",
    ['{"files": 3}', '{"files": "a"}', '{"files": {"a": 1}}', "3", "[" * 10**5, "\0", '{"files": '],
)
def test_what_only_looks_like_the_results_of_a_run_is_the_users(tmp_path, content):
    out = tmp_path / "out"
    out.mkdir()
    (out / "results.json").write_text(content)
    (out / "a").touch()
    with pytest.raises(InvalidFile, match="no earlier run made"):
        _run(out)
    assert (out / "results.json").read_text() == content


def test_a_killed_run_leaves_the_last_good_one_and_the_next_good_one_nothing_of_it(tmp_path):
    out = tmp_path / "out"
    _run(out)
    for _ in range(3):
        with at_work_on(out):
            pass
    assert len(list(tmp_path.glob(".out.new-*"))) == 1
    (tmp_path / ".out.old-run").mkdir()
    others = {".out.new-mine", ".outer.new-run", "out.new-run"}
    for name in others:
        (tmp_path / name).mkdir()
    assert list_files(out) == ["a.csv", "results.json"]
    _run(out, "b.csv")
    assert list_files(out) == ["b.csv", "results.json"]
    assert {file.name for file in tmp_path.iterdir()} == {"out", *others}


def test_what_killed_commands_left_beside_a_file_is_removed_when_it_is_written_again(tmp_path):
    file, old = tmp_path / "a[1].csv", f".a[1].csv.new-{16 * '0'}"
    for name in (old, f".a[1].csv.new-{16 * '1'}", f".a1.csv.new-{16 * '2'}"):
        (tmp_path / name).write_text("half")
    for name in (old, f".a1.csv.new-{16 * '2'}"):
        os.utime(tmp_path / name, (0.0, 0.0))
    with staged(file, b"whole"):
        (own,) = set(tmp_path.glob(".a[[]1].csv.new-*")) - {tmp_path / f"{old[:-16]}{16 * '1'}"}
        os.utime(own, (0.0, 0.0))  # another command leaves what one still writes
        with staged(file, b"other"):
            pass
    assert file.read_bytes() == b"whole"
    left = {f".a[1].csv.new-{16 * '1'}", f".a1.csv.new-{16 * '2'}"}  # young, and of another file
    assert {each.name for each in tmp_path.iterdir()} == {"a[1].csv", *left}


def test_what_a_failed_run_finds_moved_away_stays(tmp_path):
    """A process that is killed between two renames leaves the last good run beside."""
    moved = tmp_path / ".out.old-run"
    _run(tmp_path / "out")
    (tmp_path / "out").rename(moved)
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert list_files(tmp_path) == [f"{moved.name}/a.csv", f"{moved.name}/results.json"]


def test_a_run_at_work_is_left_alone_by_a_second_one_on_the_same_folder(tmp_path):
    out, link = tmp_path / "out", tmp_path / "link"
    link.symlink_to(out)
    _run(out)
    with at_work_on(out):
        before = list_files(tmp_path)
        for name in (out, link):
            with pytest.raises(InvalidFile, match="another command is at work on it; wait until"):
                _run(name, "b.csv")
        assert list_files(tmp_path) == before
        _run(tmp_path / "other")
    _run(out, "b.csv")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["link", "other", "out"]


def test_everything_is_on_the_disk_before_a_rename_makes_it_an_output(tmp_path, monkeypatch):
    flushed, renamed = [], []
    fsync, replace = os.fsync, os.replace

    def noted(descriptor):
        state = os.fstat(descriptor)
        flushed.append((state.st_ino, state.st_size))
        fsync(descriptor)

    def checked(source, target):
        for file in [Path(source), *Path(source).rglob("*")]:
            state = file.stat()
            assert (state.st_ino, state.st_size) in flushed, f"{file} would be lost"
        renamed.append(Path(target).name)
        flushed.clear()
        replace(source, target)

    monkeypatch.setattr("os.fsync", noted)
    monkeypatch.setattr("os.replace", checked)
    write_text(tmp_path / "a.csv", "text")
    assert tmp_path.stat().st_ino in {inode for inode, _ in flushed}, "the name is not on the disk"
    with output_folder(tmp_path / "out", export="test") as new:
        (new / "deep").mkdir()
        write_text(new / "deep" / "a.csv", "text")
        (new / "b.csv").write_text("more")
    assert tmp_path.stat().st_ino in {inode for inode, _ in flushed}, "the name is not on the disk"
    assert renamed == ["a.csv", "out"]


def test_a_folder_that_cannot_be_replaced_stays_as_it_was(tmp_path, monkeypatch):
    out = tmp_path / "out"
    _run(out)
    rename = Path.replace

    def refuse(self, target):
        if ".new-" in self.name:
            raise OSError(18, "Invalid cross-device link")
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(InvalidFile, match=r"cannot be replaced \(invalid cross-device link\)"):
        _run(out, "b.csv")
    assert list_files(tmp_path) == ["out/a.csv", "out/results.json"]


def test_a_log_has_every_row_as_soon_as_it_was_measured_and_its_name_at_the_end(tmp_path):
    file, part = tmp_path / "deep" / "a.log", tmp_path / "deep" / "a.log.part"
    with growing_log(file, ["hip", "knee"]) as keep:
        head = "t_s,hip_requested_deg,hip_actual_deg,knee_requested_deg,knee_actual_deg\n"
        assert part.read_text() == head
        keep(0.02, np.array([0.1, -1e-12]), np.array([math.nan, 1.0]))
        text = f"{head}0.020000,5.729578,,0.000000,57.295780\n"
        assert part.read_text() == text
    assert list_files(tmp_path) == ["deep/a.log"]
    assert file.read_text() == text
    with growing_log(file, ["hip"], kinds=[""]):
        assert part.read_text() == "t_s,hip_deg\n"
    assert list_files(tmp_path) == ["deep/a.log"], "a log without a row is left"
    with suppress(KeyboardInterrupt), growing_log(file, ["hip"], kinds=[""]) as keep:
        keep(0.0, np.array([0.0]))
        raise KeyboardInterrupt
    assert part.read_text() == "t_s,hip_deg\n0.000000,0.000000\n"
    assert file.read_text() == text


def test_numbers_that_json_has_not_become_null():
    assert json.loads(to_json({"a": [1.5, math.inf], "b": ({"c": -math.inf}, math.nan, 2)})) == {
        "a": [1.5, None],
        "b": [{"c": None}, None, 2],
    }
