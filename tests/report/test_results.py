"""`reproduce`: what it prints, and what it leaves in its folder."""

from __future__ import annotations

import re
from pathlib import Path

from planner.files.staging import list_files

METHODS = ("direct", "shift", "closed_form_plain", "closed_form", "optimal", "foot_optimal")
PLANS = METHODS[2:]


def test_the_manifest_lists_every_file_of_the_folder(folder, results):
    assert sorted({*results["files"], "results.json"}) == list_files(folder)


def test_the_readme_states_the_figures_of_the_foot(results):
    told = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    for method in PLANS:
        assert re.search(rf"\b{results['foot'][method]['L2']:.2f}\b", told), method
