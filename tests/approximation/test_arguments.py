"""What is required of a curve holds on what is returned, or the pair that forbids it is named."""

import numpy as np
import pytest

from planner import fit_pwl
from tests.approximation.samples import KINDS, closed, samples_of

SLOPE_ROUNDING = 1e-12  # relative excess over v_max that a slope may have
PLACE = 1e-9  # rounding of the length of a segment and of a knot [samples]
SINE = np.sin(2.0 * np.pi * np.arange(60) / 60)


def check(fit, v_max):
    knots, values = closed(fit)
    slopes = np.diff(values) / (np.diff(knots) * fit.tick)
    assert np.max(np.abs(slopes)) <= v_max * (1.0 + SLOPE_ROUNDING)
    assert np.min(np.diff(knots)) >= 1.0 - PLACE


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cyclic", [True, False])
def test_max_rms_is_kept_with_no_more_segments_than_it_takes(kind, cyclic):
    desired = samples_of(kind, 60, np.random.default_rng(9))
    five = fit_pwl(desired, v_max=1.0, tick=1.0, cyclic=cyclic, segments=5)
    bound = five.rms * (1.0 + 1e-6) + 1e-9
    fit = fit_pwl(desired, v_max=1.0, tick=1.0, cyclic=cyclic, max_rms=bound)
    assert fit.rms <= bound
    assert fit.segments <= 5


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_constant_takes_any_number_of_segments(cyclic):
    fit = fit_pwl(np.full(30, 0.1), v_max=1.0, tick=1.0, cyclic=cyclic, segments=4)
    assert (fit.segments, fit.max_error) == (4, 0.0)
    check(fit, 1.0)
    fewest = fit_pwl(
        np.full(30, 0.1), v_max=1.0, tick=1.0, cyclic=cyclic, max_error=0.1, segments=4
    )
    assert fewest.segments == 1
