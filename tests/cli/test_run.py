"""A run file does what the single commands do, inside its folder, whole or not at all."""

from __future__ import annotations

import json

import numpy as np
import pytest

from planner.files.paths import read_joint_path

ROUNDED = 1e-6
"""A foot path in a file carries 12 decimals of a metre, which the search magnifies [rad]."""

JOINTS = '[path]\nfile = "desired.csv"\n'
"""The least that makes a run, on the file of two joints."""


@pytest.fixture
def write(tmp_path, desired):  # noqa: ARG001
    """Write a run file beside a path of two joints, and say what it is called."""

    def write(content, name="it.toml"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(content, encoding="utf-8")
        return str(file.relative_to(tmp_path))

    return write


@pytest.fixture(scope="module")
def template():
    """The template."""
    from click.testing import CliRunner

    from planner.cli import cli

    return CliRunner().invoke(cli, ["run", "--template"]).stdout


def results(folder):
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


@pytest.mark.usefixtures("no_foot_bound")
def test_the_template_runs_as_it_is_and_plans_what_plan_does(run, write, template, tmp_path):
    result = run("run", write(template, "walk.toml"))
    assert result.exit_code == 0, result.stderr
    run("gait", "-o", "foot.csv")
    leg = ("--leg", "reference", "--unreachable", "clamp", "--method", "foot-optimal")
    run("plan", "foot.csv", *leg, "-o", "plan.csv")
    folder = tmp_path / "walk"
    written, other = (
        read_joint_path(file).values for file in (folder / "requests.csv", tmp_path / "plan.csv")
    )
    assert np.max(np.abs(written - other)) <= ROUNDED
    document = results(folder)
    files = ["angles.csv", "controller.csv", "desired.csv", "foot.csv", "report.html"]
    files += ["requests.csv"]
    assert document["files"] == files
    assert document["within_tolerance"] is True
    angles = read_joint_path(folder / "angles.csv").values
    for j, joint in enumerate(document["joints"].values()):
        assert np.degrees(angles[:, j]) == pytest.approx(joint["predicted_deg"], abs=1e-9)


def test_places_are_relative_to_the_file(run, write, desired, tmp_path, monkeypatch):
    write("v_max = 4.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.04\n", "runs/a.toml")
    content = 'out = "results"\n[path]\nfile = "own.csv"\n[model]\nfile = "a.toml"\n'
    content += '[output]\nreport = "page.html"\n'
    file = write(content, "runs/it.toml")
    desired.rename(tmp_path / "runs" / "own.csv")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    result = run("run", tmp_path / file)
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "runs" / "results" / "results.json").is_file()
    assert list(elsewhere.iterdir()) == []
    page = (tmp_path / "runs" / "results" / "page.html").read_text("utf-8")
    assert all(f'href="../{name}"' in page for name in ("own.csv", "a.toml"))


@pytest.mark.usefixtures("desired")
def test_standard_input_is_a_run_file_too(run, tmp_path):
    assert run("run", "-", "--out", "out", stdin=JOINTS).exit_code == 0
    assert (tmp_path / "out" / "requests.csv").is_file()
    assert run("run", "-", stdin=JOINTS).stderr == (
        "request-planner: name a folder for the results with --out. "
        "See 'request-planner run --help'.\n"
    )


def test_joints_rest_where_the_file_says(run, write, tmp_path):
    start = "[plan]\ncyclic = false\n[start]\ndeg = 2\n[start.joints]\nknee = 20\n"
    assert run("run", write(JOINTS + start)).exit_code == 0
    angles = np.degrees(read_joint_path(tmp_path / "it" / "angles.csv").values)
    assert angles[0] == pytest.approx([2.0, 20.0], abs=1e-9)


def test_a_missed_tolerance_is_status_1_and_all_files(run, write, tmp_path):
    result = run("run", write(JOINTS + '[plan]\nmethod = "closed-form"\n[tolerance]\ndeg = 1e-6\n'))
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].startswith("request-planner: hip is off by ")
    assert result.stderr.endswith("; the files are written all the same\n")
    assert results(tmp_path / "it")["within_tolerance"] is False
    assert (tmp_path / "it" / "requests.csv").is_file()
    assert run("run", "it.toml", "--json").exit_code == 1


def test_exports_are_those_of_export(run, write, tmp_path):
    content = JOINTS + (
        '[output]\nangles = ""\ndesired = ""\n'
        '[[export]]\nformat = "csv"\nfile = "servos/ticks.csv"\nunit = "ticks"\ncycles = 2\n'
        "rate_hz = 250\nzero_tick = 1000\nzero_ticks = {knee = 500}\n"
        '[[export]]\nformat = "csv"\nfile = "deg.csv"\nunit = "deg"\njoint_names = ["a", "b"]\n'
        '[[export]]\nformat = "csv"\nfile = "slow.csv"\nrate_hz = 50\nbetween = "linear"\n'
    )
    result = run("run", write(content))
    assert result.exit_code == 0, result.stderr
    folder = tmp_path / "it"
    assert results(folder)["files"] == ["deg.csv", "requests.csv", "servos/ticks.csv", "slow.csv"]
    ticks = (
        "--format csv --unit ticks --cycles 2 --rate-hz 250 --zero-tick 1000 --zero-tick knee=500"
    )
    degrees = "--format csv --unit deg --joint-names a,b"
    documents = {each.pop("file"): each for each in results(folder)["exports"]}
    assert documents["slow.csv"]["requests_never_sent"] > 0
    slow = ("slow.csv", "--format csv --rate-hz 50 --between linear")
    for file, options in (("servos/ticks.csv", ticks), ("deg.csv", degrees), slow):
        asked = ("export", folder / "requests.csv", *options.split(), "-o", "again", "--json")
        assert json.loads(run(*asked).stdout) == documents[file]
        exported = run("export", folder / "requests.csv", *options.split())
        written = (folder / file).read_text()
        assert exported.stdout.splitlines()[0] == written.splitlines()[0]
        numbers = [
            np.loadtxt(text.splitlines()[1:], delimiter=",") for text in (exported.stdout, written)
        ]
        assert numbers[0] == pytest.approx(numbers[1], abs=1e-9)
    assert result.stderr.count("deg.csv: 88 rows of a, b at 125 Hz, 0.704 s") == 1


def test_a_run_that_fails_leaves_the_last_ones_folder(run, write, tmp_path):
    file = write(JOINTS)
    assert run("run", file).exit_code == 0
    before = {each.name: each.read_bytes() for each in (tmp_path / "it").iterdir()}
    failing = JOINTS + '[plan]\nmethod = "closed-form"\n[limits.joints]\nknee = [5, 29]\n'
    result = run("run", write(failing))
    assert result.exit_code == 1
    assert result.stderr.endswith('plan.method = "optimal" keeps to them\n')
    assert {each.name: each.read_bytes() for each in (tmp_path / "it").iterdir()} == before
    left = [each.name for each in tmp_path.iterdir() if each.name.startswith(".")]
    assert left == []
