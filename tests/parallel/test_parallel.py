"""Tasks in parallel: the same results however they are run, and none lost whatever dies."""

import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from planner import InvalidInput, MissingExtra, parallel
from planner.files.results import Results, Task
from planner.parallel import carry_out, executor_of
from tests.parallel import work

pytestmark = pytest.mark.usefixtures("importable")


def run(function, tasks, results, *, workers=None, scheduler=None, **more):
    """Why tasks fail, by their names."""
    with executor_of(workers, scheduler) as place:
        return carry_out(function, tasks, results, place, **more)


def test_every_task_has_its_result_and_an_empty_list_of_tasks_none(results):
    assert run(work.square, work.tasks(), results, workers=2) == {}
    assert [results.read(task) for task in work.tasks()] == [b"%d" % k**2 for k in range(8)]
    assert run(work.square, [], results) == {}


def test_a_task_that_kills_every_worker_is_reported_and_no_other_is_lost(tmp_path, results):
    tasks = [replace(task, argument=(task.argument, tmp_path / "mark")) for task in work.tasks()]
    failures = run(work.kill_always, tasks, results, workers=2)
    assert (tmp_path / "mark").read_text().count("killed") == 2
    assert failures == {"task 3": "its process died, 2 times (out of memory?)"}
    assert len(work.held(results.folder)) == 7


def test_a_worker_uses_one_thread_and_this_process_what_it_did(results, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    task = Task("threads", "OMP_NUM_THREADS")
    run(work.threads, [task], results, workers=1)
    assert results.read(task) == b"1"
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_only_what_is_missing_is_computed_and_results_belong_to_their_inputs(results):
    tasks = work.tasks()
    run(work.square, tasks[:5], results, workers=1)
    for task in tasks[:5]:
        results.write(task, b"kept")
    seen = []
    run(work.square, tasks, results, workers=1, progress=seen.append)
    assert sorted(seen) == sorted(task.name for task in tasks), "progress counts them all"
    assert [results.read(task) for task in tasks] == [b"kept"] * 5 + [b"25", b"36", b"49"]
    task = Task("task 2", 2, inputs="digest of the file")
    results.write(task, b"4")
    assert task in results
    assert replace(task, inputs="digest of the changed file") not in results


@pytest.mark.parametrize("damage", [b"", b"\0" * 40], ids=repr)
def test_a_damaged_result_counts_as_missing_and_is_computed_again(damage, tmp_path):
    tasks, results = work.tasks(), Results(tmp_path / "results", {"power": 2})
    run(work.square, tasks, results, workers=1)
    whole = work.held(results.folder)
    broken = sorted(whole)[3]
    (results.folder / broken).write_bytes(damage)
    again = Results(tmp_path / "results", {"power": 2}, resume=True)
    assert sum(task in again for task in tasks) == 7
    assert run(work.square, tasks, again, workers=1) == {}
    assert work.held(results.folder) == whole


def test_a_folder_of_results_is_removed_unless_it_is_resumed_with_its_own_settings(tmp_path):
    settings, task = {"speed": 1.5, "joints": ("hip", "knee")}, Task("task", 2)
    first = Results(tmp_path / "out", settings)
    first.write(task, b"4")
    assert task in Results(tmp_path / "out", settings, resume=True)
    again = Results(tmp_path / "out", settings)
    assert (task in again, again.removed) == (False, 1)
    again.remove()
    assert list(tmp_path.iterdir()) == []
    first = Results(tmp_path / "a", {"speed": 1.5})
    with pytest.raises(InvalidInput, match=r"--resume: .* other settings \(speed\); set what was"):
        Results(tmp_path / "a", {"speed": 2.0}, resume=True)
    (first.folder / "settings.json").write_text("[]")
    with pytest.raises(InvalidInput, match="other settings"):
        Results(tmp_path / "a", {"speed": 1.5}, resume=True)


def test_the_tasks_handed_over_at_once_do_not_grow_with_their_number(monkeypatch):
    monkeypatch.setattr(parallel, "AHEAD", 4)
    executor = work.InThisProcess()
    finished = parallel.outcomes(work.square, work.tasks(50), executor)
    assert all(executor.ran - done <= 4 for done, _ in enumerate(finished))
    assert executor.ran == 50


def test_a_cluster_needs_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match="a Dask scheduler needs the extra 'cluster'"):
        executor_of(scheduler="tcp://a:1").__enter__()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "http://127.0.0.1:8786"])
def test_a_scheduler_that_is_not_there_is_one_clear_error(address, results, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra cluster")
    monkeypatch.setattr(parallel, "PATIENCE", 0.2)
    with pytest.raises(InvalidInput, match=r"--scheduler: (nothing answers|got '.*', expected)"):
        run(work.square, work.tasks(), results, scheduler=address)


@pytest.mark.parametrize("finished", [1, 7])
def test_a_command_that_is_killed_loses_nothing_and_leaves_no_process(finished, tmp_path, results):
    """Kill -9 once some results are there. Its workers hold the pipe that is read to its end."""
    output, folder = tmp_path / "killed", tmp_path / ".killed.results"
    command = [sys.executable, "-P", "-m", "tests.parallel.work", output]
    killed = subprocess.run([*command, str(finished)], capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    before = {name: (folder / name).stat().st_mtime_ns for name in work.held(folder)}
    assert finished <= len(before) < 8 or finished == 7
    run(work.square, work.tasks(), Results(output, {"power": 2}, resume=True), workers=2)
    run(work.square, work.tasks(), results, workers=2)
    assert work.held(folder) == work.held(results.folder)
    assert all((folder / name).stat().st_mtime_ns == time for name, time in before.items())
