"""Tasks, replays and sweeps on a real Dask cluster: a scheduler and two workers on loopback.

One cluster serves them all, and its end is the last test.
"""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from planner import JointModel, parallel, simulate
from planner.files.exports import Layout, lerobot_dataset
from planner.files.results import Results
from planner.files.staging import list_files
from planner.parallel import SchedulerLost
from tests.parallel import work
from tests.parallel.test_parallel import run

pytestmark = pytest.mark.usefixtures("importable")
SERVO = JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.02)

GAITS = """
[leg]
name = "reference"
[path.half_ellipse]
samples = 24
forward = 0.03
hip_height = 0.09
height = 0.01
[plan]
method = "optimal"
[sweep.parameters]
length = [0.02, 0.03, 0.2]
"""


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results", {"power": 2})


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


@pytest.fixture
def dataset(tmp_path, monkeypatch):
    """Four episodes of an elbow, its model, and the words that replay them."""
    pytest.importorskip("pyarrow", reason="needs the extra parquet")
    monkeypatch.chdir(tmp_path)
    SERVO.to_toml("arm.toml")
    layout = Layout(features={"action": ("elbow",), "observation.state": ("elbow",)}, rate=50)
    with lerobot_dataset("walks", layout) as add:
        for size in (0.3, 0.5, 0.7, 0.9):
            requests = size * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 60))) / 2.0
            angles = simulate(SERVO, requests, cyclic=False)
            add({"action": requests[:, None], "observation.state": angles[:, None]}, "swing")
    return ("replay", "walks", "--unit", "rad", "--model", "arm.toml", "--as", "lerobot", "-o")


def test_a_replay_and_a_sweep_on_a_cluster_are_those_of_this_machine(
    cluster, dataset, command_line, tmp_path, monkeypatch
):
    """Slow as both workers import the package; they work in another folder than the command."""
    (tmp_path / "gaits.toml").write_text(GAITS)
    for place in ("there", "here"):
        made = command_line(*dataset, place, "--scheduler", cluster[0])
        assert made.exit_code == 0, made.stderr
        where = ("--out", f"sweep_{place}", "--scheduler", cluster[0])
        swept = command_line("sweep", "gaits.toml", "--json", *where)
        assert swept.exit_code == 0, swept.stderr
        assert len(json.loads(swept.stdout)["front"]) == 2
        monkeypatch.setattr(parallel, "executor_of", work.in_this_process)
    for name in ("{}", "sweep_{}"):
        made = [tmp_path / name.format(place) for place in ("there", "here")]
        files = list_files(made[0])
        assert files == list_files(made[1]) != []
        for file in files:
            assert (made[0] / file).read_bytes() == (made[1] / file).read_bytes(), file


def test_a_scheduler_that_goes_away_leaves_what_was_finished(results, cluster):
    """The last test that uses it."""

    def end(_):
        if len(work.held(results.folder)) == 2:
            scheduler.kill()

    address, scheduler = cluster
    with pytest.raises(SchedulerLost, match=r"went away; what was finished is kept, and --resume"):
        run(work.square, work.tasks(50), results, scheduler=address, progress=end)
    assert 2 <= len(work.held(results.folder)) < 50
