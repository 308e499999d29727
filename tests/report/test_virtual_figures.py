"""The figures and results of the virtual robot are those of its experiment."""

from __future__ import annotations

import numpy as np
import pytest

from planner.report.paper_figures import ROLES, virtual_figures


@pytest.fixture(scope="module")
def outcome(virtually_reproduced):
    return virtually_reproduced.answer


@pytest.fixture(scope="module")
def figures(outcome):
    return {figure.name: figure for figure in virtual_figures(outcome)}


def values(curve):
    """The values of a curve without its gaps and without the sample that closes each cycle."""
    parts = np.split(curve.y, np.flatnonzero(np.isnan(curve.y)))
    return np.array([part[np.isfinite(part)][:-1] for part in parts])


def test_every_cycle_of_every_joint_is_drawn_under_its_method(outcome, figures):
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
    for name, method in (
        ("joints_direct", "direct"),
        ("foot_optimised_trajectories", "foot_optimal"),
    ):
        for j, panel in enumerate(figures[name].panels):
            mean, actual = (each for each in panel.curves if each.name.startswith("actual"))
            assert values(mean) == pytest.approx(values(actual).mean(axis=0, keepdims=True))
            told = next(each for each in panel.curves if each.name == "predicted")
            assert values(actual) == pytest.approx(np.degrees(outcome.runs[method].angles[..., j]))
            assert values(told) == pytest.approx(
                np.degrees([outcome.planned.plans[method].predicted[:, j]])
            )
