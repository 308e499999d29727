"""Files and folders appear whole or not at all, and nothing of the user's is lost."""

import json
import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from planner.exceptions import InvalidFile
from planner.files import staging
from planner.files.paths import growing_log
from planner.files.staging import list_files, output_folder, staged
from planner.files.text import to_json, write_text
from tests.parallel.work import at_work_on


def _run(folder, name="a.csv", content="1"):
    with output_folder(folder) as new:
        (new / name).write_text(content)
        (new / "results.json").write_text(json.dumps({"files": [name]}))


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    file = tmp_path / "plan.csv"
    write_text(file, "old")

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(staging.Path, "open", full)
        with pytest.raises(InvalidFile, match=r"cannot be written \(no space left on device\)"):
            write_text(file, "new")
    assert file.read_text() == "old"
    assert list_files(tmp_path) == ["plan.csv"]


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


def test_a_killed_run_leaves_the_last_good_one(tmp_path):
    out = tmp_path / "out"
    _run(out)
    with at_work_on(out):
        pass
    assert len(list(tmp_path.glob(".out.new-*"))) == 1
    assert list_files(out) == ["a.csv", "results.json"]


def test_two_runs_on_one_folder_leave_one_of_them_whole(tmp_path):
    out = tmp_path / "out"
    with output_folder(out) as new:
        (new / "half").touch()
        _run(out, "b.csv")
        (new / "results.json").write_text('{"files": ["half"]}')
    assert list_files(tmp_path) == ["out/half", "out/results.json"]


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
