"""`reproduce`: what it prints, and what it leaves in its folder."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from planner.evaluation import reproduction as paper
from planner.files.paths import read_joint_path
from planner.files.staging import list_files

METHODS = ("direct", "shift", "closed_form_plain", "closed_form", "optimal", "foot_optimal")
PLANS = METHODS[2:]


def test_the_manifest_lists_every_file_of_the_folder(folder, results):
    assert sorted({*results["files"], "results.json"}) == list_files(folder)


def test_what_is_beyond_the_limits_follows_from_the_written_requests(folder, results):
    for method in PLANS:
        requests = read_joint_path(folder / f"requests_{method}.csv").angles
        for j, name in enumerate(paper.JOINTS):
            limits = results["limits"][name]
            degrees = np.degrees(requests[:, j])
            beyond = max(limits["lower"] - degrees.min(), degrees.max() - limits["upper"], 0.0)
            assert limits["excess"][method] == pytest.approx(beyond, abs=1e-9)


def test_the_readme_states_the_figures_of_the_foot(results):
    told = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    for method in PLANS:
        assert re.search(rf"\b{results['foot'][method]['L2']:.2f}\b", told), method
