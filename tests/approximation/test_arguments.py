"""What is required of a curve holds on what is returned, or the pair that forbids it is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import Infeasible, InvalidInput, fit_pwl
from tests.approximation.samples import KINDS, closed, problems, samples_of

SLOPE_ROUNDING = 1e-12  # relative excess over v_max that a slope may have
PLACE = 1e-9  # rounding of the length of a segment and of a knot [samples]
SINE = np.sin(2.0 * np.pi * np.arange(60) / 60)


def check(fit, v_max):
    knots, values = closed(fit)
    slopes = np.diff(values) / (np.diff(knots) * fit.tick)
    assert np.max(np.abs(slopes)) <= v_max * (1.0 + SLOPE_ROUNDING)
    assert np.min(np.diff(knots)) >= 1.0 - PLACE


@settings(max_examples=80)
@given(problems(least=12), st.integers(2, 9), st.integers(0, 2**16), st.booleans())
def test_whatever_is_required_at_once_holds_on_the_curve(problem, segments, seed, whole):
    desired, step, cyclic = problem
    n = desired.size
    rng = np.random.default_rng(seed)
    places = np.sort(rng.choice(np.arange(4, n - 4, 3.0), rng.integers(0, 3), replace=False))
    places = places + (0.0 if whole else rng.uniform(0.0, 0.4))
    first = rng.choice(desired)
    pins = {}
    for number, place in enumerate(places.tolist()):
        within = 0.9 * step * (place - places[0])
        if cyclic:
            within = 0.9 * step * min(place - places[0], n - place + places[0])
        pins[place] = None if number == 2 else float(first + rng.uniform(-1.0, 1.0) * within)
    pieces = np.diff(
        np.r_[places, places[:1] + n] if cyclic and places.size else np.r_[0, places, n - 1]
    )
    room = int(np.sum(np.floor(pieces)))
    fit = fit_pwl(
        desired,
        v_max=step,
        tick=1.0,
        cyclic=cyclic,
        segments=min(max(segments, places.size + 1), room),
        required=pins,
    )
    check(fit, step)
    scale = max(np.max(np.abs(desired)), np.ptp(desired))
    for place, pin in pins.items():
        assert np.min(np.abs(fit.knots - place)) <= PLACE
        if pin is not None:
            assert fit(place) == pytest.approx(pin, rel=1e-9, abs=1e-9 * scale)


@pytest.mark.parametrize("ends", [{0: 0.3}, {59: -0.2}, {0: 0.3, 59: -0.2}])
def test_required_angles_at_the_ends_of_a_path_are_met(ends):
    fit = fit_pwl(SINE, v_max=0.2, tick=1.0, cyclic=False, segments=5, required=ends)
    check(fit, 0.2)
    for place, angle in ends.items():
        assert fit(place) == pytest.approx(angle, abs=1e-14)
    free = fit_pwl(SINE, v_max=0.2, tick=1.0, cyclic=False, segments=5)
    assert fit.rms >= free.rms * (1.0 - 1e-6)


def test_required_knots_cost_no_more_than_their_own_segments():
    free = fit_pwl(SINE, v_max=0.2, tick=1.0, segments=4)
    fit = fit_pwl(SINE, v_max=0.2, tick=1.0, segments=6, required=[10, 41.5])
    assert {10.0, 41.5} <= set(fit.knots.tolist())
    assert fit.rms <= free.rms * (1.0 + 1e-6)


def test_times_over_a_period_are_the_samples_that_they_miss_by_rounding():
    places = [-1e-12, 0.3 / 0.1, 59.0 + 1e-11]
    fit = fit_pwl(SINE, v_max=0.2, tick=1.0, cyclic=False, segments=5, required=places, exact=True)
    assert {0.0, 3.0, 59.0} <= set(fit.knots.tolist())


def test_fixed_knots_are_kept_and_their_values_are_best():
    knots = np.array([3.0, 17.5, 30.0, 44.25])
    fit = fit_pwl(SINE, v_max=0.2, tick=1.0, knots=knots)
    assert np.array_equal(fit.knots, knots)
    assert fit.max_error > 0.0
    for k in range(4):
        for nudge in (1e-3, -1e-3):
            values = fit.values + nudge * (np.arange(4) == k)
            other = np.interp(np.arange(60), knots, values, period=60) - SINE
            assert np.mean(other**2) >= fit.rms**2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cyclic", [True, False])
def test_max_rms_is_kept_with_no_more_segments_than_it_takes(kind, cyclic):
    desired = samples_of(kind, 60, np.random.default_rng(9))
    five = fit_pwl(desired, v_max=1.0, tick=1.0, cyclic=cyclic, segments=5)
    bound = five.rms * (1.0 + 1e-6) + 1e-9
    fit = fit_pwl(desired, v_max=1.0, tick=1.0, cyclic=cyclic, max_rms=bound)
    assert fit.rms <= bound
    assert fit.segments <= 5


@settings(max_examples=40)
@given(problems(least=12), st.floats(0.0, 0.99), st.floats(0.01, 0.2))
def test_a_largest_error_is_kept_beside_a_required_knot_between_samples(problem, place, share):
    desired, step, cyclic = problem
    bound = share * max(float(np.ptp(desired)), 1e-6)
    bound += fit_pwl(
        desired, v_max=step, tick=1.0, cyclic=cyclic, knots=range(desired.size)
    ).max_error
    asked = {"v_max": step, "tick": 1.0, "cyclic": cyclic, "max_error": bound}
    free = fit_pwl(desired, **asked)
    fit = fit_pwl(desired, **asked, required=[5.0 + place])
    assert fit.max_error <= bound * (1.0 + 1e-9)
    assert np.max(np.abs(fit.slopes)) <= step * (1.0 + SLOPE_ROUNDING)
    assert np.min(np.abs(fit.knots - 5.0 - place)) <= PLACE
    assert free.fewest_segments <= fit.segments
    assert fit.segments - cyclic <= fit.fewest_segments <= fit.segments
    assert fit.segments <= free.segments + 1 + cyclic


@pytest.mark.parametrize("cyclic", [True, False])
def test_an_attainable_rms_error_with_a_required_angle_is_not_refused(cyclic):
    desired = np.full(21, 0.7)
    desired[10] = 0.0
    asked = {"v_max": 0.1, "tick": 1.0, "cyclic": cyclic, "required": {10: 0.5}}
    attainable = fit_pwl(desired, knots=np.arange(21), **asked).rms
    fit = fit_pwl(desired, max_rms=attainable * (1.0 + 1e-9), **asked)
    assert fit.rms <= attainable * (1.0 + 2e-9)
    with pytest.raises(Infeasible, match="max_rms and v_max"):
        fit_pwl(desired, max_rms=attainable * (1.0 - 1e-4), **asked)


def test_arguments_that_exclude_each_other_are_named_before_knots_too_close():
    asked = {"v_max": 0.2, "tick": 1.0}
    with pytest.raises(InvalidInput, match="knots, segments: got both"):
        fit_pwl(SINE, knots=[3.0, 3.5], segments=4, **asked)
    with pytest.raises(Infeasible, match="required knots at sample 3 and sample 3"):
        fit_pwl(SINE, knots=[20.0], required=[3.0, 3.5], **asked)
    with pytest.raises(Infeasible, match=r"^knots at sample 3 and sample 3\.5: they are less"):
        fit_pwl(SINE, knots=[3.5], required=[3.0], **asked)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_constant_takes_every_requirement(cyclic):
    asked = {"cyclic": cyclic, "required": {7.5: 0.1}, "segments": 4}
    fit = fit_pwl(np.full(30, 0.1), v_max=1.0, tick=1.0, **asked)
    assert (fit.segments, fit.max_error) == (4, 0.0)
    assert 7.5 in fit.knots
    check(fit, 1.0)
