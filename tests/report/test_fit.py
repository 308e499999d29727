"""The pictures of a fit show what they say."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.fit import fit_pwl
from planner.report.fit import AT_TOP_SPEED, fit_figure
from tests.approximation.samples import samples_of

V_MAX = 0.1


def fit_of(kind, *, cyclic=True):
    desired = samples_of(kind, 40, np.random.default_rng(3))
    return fit_pwl(desired, v_max=V_MAX, tick=1.0, cyclic=cyclic, segments=4)


@pytest.mark.parametrize("cyclic", [True, False])
def test_the_lines_go_through_the_curve_and_those_at_the_top_speed_stand_out(cyclic):
    fit = fit_of("walk", cyclic=cyclic)
    figure = fit_figure("hip", fit)
    curves = {curve.name: curve for curve in figure.panels[0].curves}
    lines = curves["lines"]
    np.testing.assert_allclose(lines.y, np.degrees(fit(lines.x)))  # a tick is a second here
    assert (lines.x[0], lines.x[-1]) == (0.0, 40.0 if cyclic else 39.0)
    shares = np.abs(np.diff(lines.y) / np.diff(lines.x)) / np.degrees(V_MAX)
    starts = lines.x[:-1][shares >= AT_TOP_SPEED]
    assert len(starts) > 0
    np.testing.assert_array_equal(curves["at the top speed"].x[::3], starts)
    assert len(curves["knots"].x) == len(fit.knots)
