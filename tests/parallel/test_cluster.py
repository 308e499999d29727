"""Tasks and sweeps on a real Dask cluster: a scheduler and two workers on loopback.

One cluster serves them all, and its end is the last test.
"""

import json
import os
from dataclasses import replace

import pytest

from planner import parallel
from planner.files.results import Results
from planner.files.staging import list_files
from planner.parallel import SchedulerLost
from tests.cli.test_sweep import GAIT
from tests.parallel import work
from tests.parallel.test_parallel import run

pytestmark = pytest.mark.usefixtures("importable")

GAITS = f"{GAIT.replace('samples = 40', 'samples = 24')}length = [0.02, 0.03, 0.2]\n"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A Dask scheduler with two workers that are ready: its address and its process."""
    distributed = pytest.importorskip("distributed", reason="needs the extra cluster")
    with (
        work.dask_cluster(tmp_path_factory.mktemp("workers")) as (address, scheduler),
        pytest.MonkeyPatch.context() as patch,
    ):
        with distributed.Client(address, timeout=60.0) as client:
            client.wait_for_workers(2, timeout=60.0)
            # A worker that dies while its nanny still starts it takes all workers with it.
            client.run(os.getpid, nanny=True)
        patch.setattr(parallel, "ARRIVAL", 60.0)
        patch.setattr(parallel, "PATIENCE", 60.0)  # a machine at work may take that long to begin
        yield address, scheduler


def test_a_cluster_gives_the_same_bytes(tmp_path, results, cluster):
    """So does one whose worker dies over a task: Dask tries it again."""
    tasks = [replace(task, argument=(task.argument, tmp_path / "mark")) for task in work.tasks()]
    assert run(work.kill_once, tasks, results, scheduler=cluster[0]) == {}
    here = Results(tmp_path / "here", {"power": 2})
    run(work.square, work.tasks(), here, workers=2)
    assert work.held(results.folder) == work.held(here.folder) != {}


def test_a_task_that_fails_on_a_cluster_is_reported(results, cluster):
    tasks, address = work.tasks(), cluster[0]
    with pytest.warns(UserWarning, match="four is even"):
        failures = run(work.refuse_three, tasks, results, scheduler=address)
    assert failures == {"task 3": "episode: got nothing, expected samples"}


def test_a_sweep_on_a_cluster_is_that_of_this_machine(cluster, command_line, tmp_path, monkeypatch):
    """Slow as both workers import the package; they work in another folder than the command."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gaits.toml").write_text(GAITS)
    for place in ("there", "here"):
        where = ("--out", place, "--scheduler", cluster[0])
        swept = command_line("sweep", "gaits.toml", "--json", *where)
        assert swept.exit_code == 0, swept.stderr
        assert len(json.loads(swept.stdout)["front"]) == 2
        monkeypatch.setattr(parallel, "executor_of", work.in_this_process)
    files = list_files(tmp_path / "there")
    assert files == list_files(tmp_path / "here") != []
    for file in files:
        there, here = ((tmp_path / place / file).read_bytes() for place in ("there", "here"))
        assert there == here, file


def test_a_scheduler_that_goes_away_leaves_what_was_finished(results, cluster):
    """The last test that uses it."""

    def end(_):
        if len(work.held(results.folder)) == 2:
            scheduler.kill()

    address, scheduler = cluster
    with pytest.raises(SchedulerLost, match=r"went away; what was finished is kept, and --resume"):
        run(work.square, work.tasks(50), results, scheduler=address, progress=end)
    assert 2 <= len(work.held(results.folder)) < 50
