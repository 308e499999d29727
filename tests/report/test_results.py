"""`reproduce`: what it prints, and what it leaves in its folder."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.evaluation import paper
from planner.files.paths import read_foot_path, read_joint_path
from planner.files.staging import list_files

METHODS = ("direct", "shift", "closed_form_plain", "closed_form", "optimal", "foot_optimal")
PAIRS = ("Des,Dir", "Des,Plain", "Pwl,Plain", "Des,MB", "Pwl,MB", "Des,Opt", "Des,Foot")
PLANS = METHODS[2:]


def test_the_foot_has_a_bound_and_its_plan_a_gap(results):
    bound = results["foot_bound"]
    planned = results["foot"]["foot_optimal"]["L2"]
    assert 0.0 < bound["L2"] <= planned
    assert bound["gap"] == pytest.approx(planned / bound["L2"] - 1.0, abs=1e-12)


def test_the_manifest_lists_every_file_of_the_folder(folder, results):
    assert sorted({*results["files"], "results.json"}) == list_files(folder)


@pytest.mark.parametrize(
    ("method", "pair"),
    [
        ("closed_form_plain", "Des,Plain"),
        ("closed_form", "Des,MB"),
        ("optimal", "Des,Opt"),
        ("foot_optimal", "Des,Foot"),
    ],
)
def test_the_written_requests_give_the_written_angles_and_the_stated_error(
    folder, results, method, pair
):
    requests = read_joint_path(folder / f"requests_{method}.csv")
    angles = read_joint_path(folder / f"angles_{method}.csv").angles
    desired = read_joint_path(folder / "desired.csv").angles
    assert requests.names == paper.JOINTS
    joint = planner.JointModel.ers210a()
    for j, name in enumerate(paper.JOINTS):
        simulated = planner.simulate(joint, requests.angles[:, j])
        assert simulated == pytest.approx(angles[:, j], abs=1e-10)
        rms = np.degrees(np.sqrt(np.mean((simulated - desired[:, j]) ** 2)))
        assert results["table2"][name][pair]["L2"] == pytest.approx(rms, abs=1e-9)


def test_what_is_beyond_the_limits_follows_from_the_written_requests(folder, results):
    for method in PLANS:
        requests = read_joint_path(folder / f"requests_{method}.csv").angles
        for j, name in enumerate(paper.JOINTS):
            limits = results["limits"][name]
            degrees = np.degrees(requests[:, j])
            beyond = max(limits["lower"] - degrees.min(), degrees.max() - limits["upper"], 0.0)
            assert limits["excess"][method] == pytest.approx(beyond, abs=1e-9)


def test_only_the_closed_form_goes_beyond_the_limits_and_only_for_the_abductor(results, printed):
    beyond = {
        (joint, method)
        for joint, limits in results["limits"].items()
        for method, excess in limits["excess"].items()
        if excess > 0.0
    }
    assert ("abductor", "closed_form_plain") in beyond
    assert beyond <= {("abductor", "closed_form_plain"), ("abductor", "closed_form")}
    assert "the closed form knows none" in printed[1]


def test_the_written_foot_paths_have_the_stated_distances(folder, results):
    desired = read_foot_path(folder / "foot_desired.csv").positions
    for method in METHODS:
        positions = read_foot_path(folder / f"foot_{method}.csv").positions
        distances = 100.0 * np.linalg.norm(positions - desired, axis=1)
        assert results["foot"][method]["Linf"] == pytest.approx(np.max(distances), abs=1e-9)


@pytest.mark.usefixtures("ready_experiments", "undrawn")
def test_the_json_on_standard_output_is_the_file(folder, tmp_path):
    from click.testing import CliRunner

    from planner.cli import cli

    out = tmp_path / "again"
    result = CliRunner().invoke(cli, ["reproduce", "--out", str(out), "--json"])
    assert result.stdout == (out / "results.json").read_text()
    assert list_files(out) == list_files(folder)
    tables = {name for name in list_files(out) if name.endswith(".csv")}
    for name in tables:
        assert (out / name).read_bytes() == (folder / name).read_bytes(), name


def test_the_readme_states_the_figures_of_the_foot(results):
    told = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    for method in PLANS:
        assert re.search(rf"\b{results['foot'][method]['L2']:.2f}\b", told), method
