"""Test signals stay inside the limits, rest at both ends, and are the same every time."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.exceptions import InvalidInput
from planner.identification.excitation import excite, expect, step_test
from planner.model.joint import JointModel

REACH = 0.7  # of these limits [rad]
EQUAL = 1e-12  # two ways to the same request differ by rounding only [rad]
CONTINUOUS = ("multisine", "slow_triangle")
KINDS = ("combined", "steps", "random_steps", *CONTINUOUS)


def signal(kind, **changes):
    settings = {"limits": (-0.5, 0.9), "period": 0.02, "duration": 20.0, **changes}
    return excite(kind, **settings)


@given(
    kind=st.sampled_from(KINDS),
    low=st.floats(-3.0, 1.0),
    width=st.floats(1e-3, 4.0),
    period=st.floats(0.002, 0.05),
    duration=st.floats(10.0, 30.0),
    seed=st.integers(0, 9),
)
def test_no_request_leaves_the_limits_and_both_ends_rest_at_the_centre(
    kind, low, width, period, duration, seed
):
    limits = low, low + width
    centre = 0.5 * sum(limits)
    made = excite(kind, limits=limits, period=period, duration=duration, seed=seed)
    assert np.all((made.requests >= limits[0]) & (made.requests <= limits[1]))
    rest = int(0.4 / period)  # a little less than the half second that is documented
    assert np.all(made.requests[:rest] == centre)
    assert np.all(made.requests[-rest:] == centre)
    assert len(made.times) == len(made.requests) == round(duration / period)
    np.testing.assert_allclose(np.diff(made.times), period, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_question_has_the_same_answer_that_nobody_can_change(kind):
    first, again = signal(kind), signal(kind)
    np.testing.assert_array_equal(first.requests, again.requests)
    for array in (first.times, first.requests):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    if kind != "random_steps":  # it uses what the limits allow
        assert np.max(np.abs(first.requests - first.centre)) > 0.98 * REACH


def test_steps_are_those_of_equation_1_about_the_centre():
    assert step_test(0.7).tolist() == [0.7] * 44 + [0.0] * 44
    assert step_test(-1.0, samples=6).tolist() == [-1.0] * 3 + [0.0] * 3
    np.testing.assert_allclose(signal("steps").amplitudes, np.array([0.125, 0.5, 1.0]) * 1.4)
    made = signal("steps", amplitudes=(0.2, 1.0), cycles=2, duration=9.0)
    assert made.amplitudes == (0.2, 1.0)
    half = 400 // 8  # 9 s at 50 Hz, less half a second at either end, for 2 tests of 2 cycles
    tests = [step_test(height, samples=2 * half) - 0.5 * height for height in made.amplitudes]
    expected = np.concatenate([np.tile(test, 2) for test in tests])
    played = made.requests[25 : 25 + len(expected)]
    np.testing.assert_allclose(played, made.centre + expected, atol=EQUAL)


def test_a_slow_triangle_tells_friction_and_no_jump_hides_it():
    sticky = JointModel(v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.05, dead_band=0.03)
    made = signal("slow_triangle", duration=20.0)
    assert made.largest_jump <= 8.5 * REACH * made.period / 9.5  # two cycles in 9.5 s
    found = expect(made, sticky)
    (lower, upper) = found.intervals["dead_band"]
    assert lower <= sticky.dead_band <= upper <= 1.2 * lower
    assert (found.model.tick, found.model.hold) == (pytest.approx(0.02 / 3.0), 3)


def test_a_sum_of_sines_is_never_faster_than_its_highest_frequency():
    made = signal("multisine", highest=1.0)
    fastest = 2.0 * np.pi * 1.0 * REACH  # Bernstein's bound, which the swell hardly adds to
    assert made.largest_jump <= 1.1 * fastest * made.period


@pytest.mark.parametrize("kind", CONTINUOUS)
def test_what_is_no_step_sets_out_without_one(kind):
    made = signal(kind)
    begun = int(np.flatnonzero(made.requests != made.centre)[0])
    assert abs(made.requests[begun] - made.centre) < 0.05 * REACH


@pytest.mark.parametrize("period", [0.001, 0.013, 0.02, 0.2])
@pytest.mark.parametrize(("kind", "cycles"), [("steps", 9), ("combined", 1), ("combined", 4)])
def test_the_least_duration_of_step_tests_is_named_and_enough(kind, period, cycles):
    settings = {"limits": (-0.5, 0.7), "period": period, "cycles": cycles}
    with pytest.raises(InvalidInput, match=f"{6 * cycles} half cycles of step tests") as caught:
        excite(kind, duration=41.0 * period, **settings)
    (needed,) = re.findall(r"such as ([\d.]+) s", str(caught.value))
    steps = excite(kind, duration=float(needed), **settings)
    assert len(np.unique(steps.requests)) >= 7  # both levels of three tests, and the centre
