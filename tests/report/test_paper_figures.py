"""The figures of the paper: the same on paper and on a screen, from the experiment's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from planner.evaluation.reproduction import STEP_AMPLITUDES
from planner.report.paper_figures import paper_figures
from planner.report.plotly_figure import plot
from tests.report.test_figure import check_words


@pytest.fixture(scope="module")
def reproduction(reproduced):
    return reproduced.answer


@pytest.fixture(scope="module")
def figures(reproduction):
    return {figure.name: figure for figure in paper_figures(reproduction)}


def curve_of(panel, name):
    return next(curve for curve in panel.curves if curve.name == name)


def test_plotly_takes_every_figure_of_the_paper(figures):
    assert {name.split("_")[0] for name in figures} >= {f"figure{k}" for k in range(1, 9)}
    for figure in figures.values():
        check_words(plot(figure))


def test_the_foot_of_the_moving_leg_goes_along_the_drawn_paths(figures):
    figure = figures["figure8_foot_paths"]
    paths = {curve.name: curve for curve in figure.panels[0].curves}
    for motion in figure.live["motions"]:
        if not motion["hidden"]:
            path, foot = paths[motion["name"]], np.array(motion["points"])[:, -1]
            np.testing.assert_allclose(path.x[:-1], foot[:, 0], atol=0.0051)
            np.testing.assert_allclose(path.y[:-1], foot[:, 2], atol=0.0051)


def test_the_step_tests_shade_lag_and_acceleration_time(reproduction, figures):
    period = 1000.0 * reproduction.models[0].period
    for number, amplitude in enumerate(STEP_AMPLITUDES, 3):
        (panel,) = figures[f"figure{number}_step_{amplitude:g}"].panels
        response = reproduction.steps[amplitude]
        lag, acceleration = panel.spans
        assert (lag.start, lag.end) == (
            period * response.step,
            period * (response.step + response.lag),
        )
        assert acceleration.start == lag.end
        assert acceleration.end - acceleration.start == pytest.approx(
            period * response.acceleration
        )
        assert panel.words[0].text == f"lag {response.lag} ticks"
        angles = curve_of(panel, "actual").y[:-1]
        np.testing.assert_array_equal(angles, np.degrees(response.angles))
