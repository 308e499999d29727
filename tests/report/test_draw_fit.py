"""The pictures of a fit show what they say."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.choices import choices
from planner.approximation.fit import fit_pwl
from planner.report.draw_fit import draw_fits, draw_fits_and_choices
from planner.report.render import to_svg
from planner.report.style import applied
from tests.approximation.samples import samples_of

V_MAX = 0.1


def fit_of(kind, *, cyclic=True):
    desired = samples_of(kind, 40, np.random.default_rng(3))
    return fit_pwl(desired, v_max=V_MAX, tick=1.0, cyclic=cyclic, segments=4)


@pytest.mark.parametrize("cyclic", [True, False])
def test_lines_are_coloured_by_how_close_they_are_to_the_top_speed(cyclic):
    fit = fit_of("walk", cyclic=cyclic)
    axes = draw_fits({"hip": fit}).axes[0]
    (lines,) = axes.collections
    starts = np.array([segment[0, 0] for segment in lines.get_segments()])
    ends = np.array([segment[-1, 0] for segment in lines.get_segments()])
    expected = np.abs(fit.slope_at(0.5 * (starts + ends))) / V_MAX
    np.testing.assert_allclose(lines.get_array(), expected)
    assert lines.get_clim() == (0.0, 1.0)
    assert (starts[0], ends[-1]) == (0.0, 40.0 if cyclic else 39.0)


def test_the_scale_of_colours_only_darkens():
    from planner.report.draw_fit import _scale

    colours = _scale()(np.linspace(0.0, 1.0, 64))[:, :3]
    lightness = colours @ np.array([0.2126, 0.7152, 0.0722])
    assert np.all(np.diff(lightness) < 0.0)


def test_errors_fall_towards_the_floor_and_the_automatic_choice_is_marked():
    fit = fit_of("sines")
    found = choices(fit, most=8)
    assert np.all(np.diff(found.rms) <= 1e-6 * found.rms[:-1] + 1e-12)
    assert np.all(found.rms >= found.floor * (1.0 - 1e-9))
    assert found.rms[found.segments.index(4)] == pytest.approx(fit.rms, rel=1e-9)
    assert found.automatic == fit_pwl(fit.desired, v_max=V_MAX, tick=1.0).segments
    with applied():
        svg = to_svg(draw_fits_and_choices({"hip": fit}, {"hip": found}))
    for text in (
        "floor by v_max",
        "automatic",
        "number of lines",
        "|slope| / v_max",
        "hip: 4 lines",
    ):
        assert text in svg
