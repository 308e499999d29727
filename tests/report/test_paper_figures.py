"""The figures of the paper: the same on paper and on a screen, from the experiment's numbers."""

import re
from pathlib import Path

import numpy as np
import pytest

from planner.files.staging import list_files
from planner.report.paper_figures import ROLES, paper_figures, virtual_figures

METHODS = ("direct", "shift", "closed_form_plain", "closed_form", "optimal", "foot_optimal")
PLANS = METHODS[2:]


@pytest.fixture(scope="module")
def figures(reproduced):
    return {figure.name: figure for figure in paper_figures(reproduced.answer)}


def test_the_foot_of_the_moving_leg_goes_along_the_drawn_paths(figures):
    figure = figures["figure8_foot_paths"]
    paths = {curve.name: curve for curve in figure.panels[0].curves}
    for motion in figure.live["motions"]:
        if not motion["hidden"]:
            path, foot = paths[motion["name"]], np.array(motion["points"])[:, -1]
            np.testing.assert_allclose(path.x[:-1], foot[:, 0], atol=0.0051)
            np.testing.assert_allclose(path.y[:-1], foot[:, 2], atol=0.0051)


def values(curve):
    """The values of a curve without its gaps and without the sample that closes each cycle."""
    parts = np.split(curve.y, np.flatnonzero(np.isnan(curve.y)))
    return np.array([part[np.isfinite(part)][:-1] for part in parts])


def test_every_cycle_of_every_joint_is_drawn_under_its_method(virtually_reproduced):
    outcome = virtually_reproduced.answer
    figures = {figure.name: figure for figure in virtual_figures(outcome)}
    panels, walk = figures["joints_by_method"].panels, outcome.planned.walk
    for j, (panel, name) in enumerate(zip(panels[:3], walk.joint_names, strict=True)):
        assert panel.title == name
        curves = {curve.name: curve for curve in panel.curves}
        assert values(curves["desired"]) == pytest.approx(np.degrees([walk.desired[:, j]]))
        for method, role in ROLES.items():
            if method != "shift":
                curve = curves[role.label]
                angles = np.degrees(outcome.runs[method].angles[:, :, j])
                assert values(curve) == pytest.approx(angles)
                assert curve.hidden == (method == "optimal")
    for j, panel in enumerate(figures["joints_direct"].panels):
        mean, actual = (each for each in panel.curves if each.name.startswith("actual"))
        assert values(mean) == pytest.approx(values(actual).mean(axis=0, keepdims=True))
        told = next(each for each in panel.curves if each.name == "predicted")
        assert values(actual) == pytest.approx(np.degrees(outcome.runs["direct"].angles[..., j]))
        assert values(told) == pytest.approx(
            np.degrees([outcome.planned.plans["direct"].predicted[:, j]])
        )


def test_the_manifest_lists_every_file_of_the_folder(reproduced):
    assert sorted({*reproduced.results["files"], "results.json"}) == list_files(reproduced.folder)


def test_the_readme_states_the_figures_of_the_foot(reproduced):
    told = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    for method in PLANS:
        assert re.search(rf"\b{reproduced.results['foot'][method]['L2']:.2f}\b", told), method
