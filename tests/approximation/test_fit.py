"""The invariants of a fit: exact recovery, slopes, equivariance, the bound, errors that teach."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import Infeasible, fit_pwl, lower_bound
from planner.approximation.fit_pwl import choices
from tests.approximation.samples import (
    EXACT_KNOTS,
    EXACT_VALUES,
    KINDS,
    closed,
    on_a_cycle,
    on_a_path,
    problems,
    samples_of,
)
from tests.instances import ERS210A, REFERENCE_JOINTS

SLOPE_ROUNDING = 1e-12  # relative excess over v_max that a slope may have

SAME = 1e-6
"""Relative difference of the rms errors of two fits that should be one: where descents end."""

PATH = {"v_max": 0.2, "tick": 1.0, "cyclic": False}


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_six_segments_come_within_one_percent_of_the_slope_bound_on_the_reference_walk(joint):
    fit = fit_pwl(joint.desired, v_max=ERS210A.v_max, tick=ERS210A.tick, segments=6)
    bound = lower_bound(ERS210A, joint.desired, level="slope")
    assert bound * (1.0 - SAME) <= fit.rms <= 1.01 * bound


@settings(max_examples=60, deadline=None)
@given(problems(), st.none() | st.integers(2, 8), st.sampled_from([1e-3, 0.008, 1.0]))
def test_no_slope_exceeds_v_max_whatever_is_fitted(problem, segments, tick):
    desired, step, cyclic = problem
    if segments is not None:
        segments = min(segments, desired.size - 1)
    fit = fit_pwl(desired, v_max=step / tick, tick=tick, cyclic=cyclic, segments=segments)
    knots, values = closed(fit)
    slopes = np.diff(values) / (np.diff(knots) * tick)
    assert np.all(np.abs(slopes) <= step / tick * (1.0 + SLOPE_ROUNDING))
    assert np.all(np.abs(fit.slopes) <= step / tick * (1.0 + SLOPE_ROUNDING))
    assert segments in (None, fit.segments)
    assert np.all(np.diff(knots) >= 1.0 - 1e-6)  # no segment is shorter than a sample
    assert fit.knots[0] >= 0.0
    assert fit.knots[-1] < desired.size


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("step", [0.3, 1e3])
def test_every_number_of_segments_that_few_samples_allow_has_a_fit(cyclic, step):
    rng = np.random.default_rng([5, 8, 6])  # open paths of 8 samples failed here
    for samples in range(3, 13):
        desired = rng.normal(size=samples)
        for segments in range(2 if cyclic else 1, samples + cyclic):
            fit = fit_pwl(desired, v_max=step, tick=1.0, cyclic=cyclic, segments=segments)
            assert fit.segments == segments


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
def test_a_curve_that_is_piecewise_linear_is_recovered_with_its_own_corners(scale):
    fit = fit_pwl(scale * on_a_cycle(), v_max=100.0 * scale, tick=0.008)
    np.testing.assert_allclose(fit.knots, EXACT_KNOTS, atol=1e-8)
    np.testing.assert_allclose(fit.values, scale * EXACT_VALUES, atol=1e-8 * scale)
    assert fit.max_error <= 1e-14 * scale
    fit = fit_pwl(on_a_path(), v_max=100.0, tick=0.008, cyclic=False)
    np.testing.assert_allclose(fit.knots, [0.0, *EXACT_KNOTS, 87.0], atol=1e-8)
    assert fit.max_error <= 1e-14


def test_the_search_finds_corners_between_samples_without_reading_them_off():
    desired = on_a_cycle() + 1e-7 * np.random.default_rng(0).normal(size=88)
    fit = fit_pwl(desired, v_max=100.0, tick=0.008, segments=4)
    np.testing.assert_allclose(fit.knots, EXACT_KNOTS, atol=1e-4)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_constant_is_one_segment(cyclic):
    for segments in (None, 1):
        fit = fit_pwl(np.full(9, 0.1), v_max=1.0, tick=0.1, cyclic=cyclic, segments=segments)
        assert (fit.segments, fit.max_error, fit.fewest_segments) == (1, 0.0, None)
    bounds = [
        ({"max_error": 0.01}, 1),
        ({"max_rms": 0.01}, None),
        ({"max_rms": 0.01, "exact": True}, 1),
    ]
    for bound, fewest in bounds:
        most = {"segments": 3, **bound}
        bounded = fit_pwl(np.full(9, 0.1), v_max=1.0, tick=0.1, cyclic=cyclic, **most)
        assert (bounded.segments, bounded.fewest_segments) == (1, fewest)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(KINDS),
    st.integers(0, 10**6),
    st.integers(3, 6),
    st.integers(0, 39) | st.none(),
    st.sampled_from([1e-6, 1e-2, 37.3, 1e3]),
    st.booleans(),
    st.booleans(),
)
def test_samples_shifted_scaled_mirrored_and_reversed_have_the_same_fit(
    kind, seed, segments, shift, scale, mirrored, backwards
):
    """A path, which has no shift, or a cycle."""
    desired, cyclic = samples_of(kind, 40, np.random.default_rng(seed)), shift is not None
    fit = fit_pwl(desired, v_max=0.1, tick=1.0, segments=segments, cyclic=cyclic)
    sign = -1.0 if mirrored else 1.0
    moved = sign * scale * np.roll(desired, shift or 0)[:: -1 if backwards else 1] + 3.0 * scale
    other = fit_pwl(moved, v_max=scale * 0.1, tick=1.0, segments=segments, cyclic=cyclic)
    assert other.rms / scale == pytest.approx(fit.rms, rel=SAME, abs=1e-9)


def test_the_last_digits_of_samples_do_not_choose_among_equally_close_curves():
    sine = 0.5 * np.sin(2.0 * np.pi * np.arange(40) / 40)
    arguments = {"v_max": ERS210A.v_max, "tick": ERS210A.tick, "segments": 6}
    fit = fit_pwl(sine, **arguments)
    for seed in range(4):
        digits = np.random.default_rng(seed).integers(-3, 4, sine.size)
        other = fit_pwl(sine * (1.0 + 1e-16 * digits), **arguments)
        np.testing.assert_allclose(other.knots, fit.knots, rtol=0.0, atol=1e-9)


def test_automatic_follows_a_sine_in_few_corners_and_noise_in_none():
    t = np.arange(88) / 88
    noise = np.random.default_rng(0).normal(size=88)
    sine = fit_pwl(np.sin(2 * np.pi * t), v_max=100.0, tick=0.008)
    assert 4 <= sine.segments <= 8
    assert sine.rms <= 0.02
    assert fit_pwl(noise, v_max=1e4, tick=0.008).segments <= 6
    noisy = fit_pwl(np.sin(2 * np.pi * t) + 0.1 * noise, v_max=100.0, tick=0.008)
    assert noisy.segments <= 6


def test_choices_never_rise_and_go_up_to_the_number_of_the_fit():
    """Of this impulse the five lines that are found alone are a little worse than the four."""
    impulse = (np.arange(40) == 20).astype(float)
    fit = fit_pwl(impulse, **PATH, segments=6)
    found = choices(fit, most=3)
    assert found.segments == (1, 2, 3, 4, 5, 6)
    assert np.all(np.diff(found.rms) <= 0.0)
    assert found.rms[-1] == fit.rms
    assert found.floor == pytest.approx(fit_pwl(impulse, **PATH, segments=39).rms, rel=SAME)
    cycle = fit_pwl(np.roll(impulse, 20), v_max=0.2, tick=1.0, segments=3)  # it begins at the peak
    assert choices(cycle, most=3).floor == pytest.approx(found.floor, rel=SAME)


def test_an_error_out_of_reach_is_infeasible_and_says_what_is_in_reach():
    jump = np.r_[np.zeros(10), np.ones(10)]
    # One sample apart, one unit apart, 0.2 allowed: each side gives way by 0.4.
    with pytest.raises(Infeasible, match=r"max_error: got 0\.1 rad.*attainable is 0\.4 rad"):
        fit_pwl(jump, v_max=0.2, tick=1.0, cyclic=False, max_error=0.1)


def test_ten_thousand_samples_are_fitted_with_hundreds_of_segments():
    rng = np.random.default_rng(0)
    desired = np.resize(samples_of("sines", 100, rng), 10_000) + 0.01 * rng.normal(size=10_000)
    fit = fit_pwl(desired, v_max=0.1, tick=1.0, segments=800)
    ideal = fit_pwl(desired[:100], v_max=0.1, tick=1.0, segments=8)
    assert np.max(np.abs(fit.slopes)) <= 0.1 * (1.0 + 1e-12)
    assert fit.rms <= 1.5 * ideal.rms
