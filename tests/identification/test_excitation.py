"""Test signals stay inside the limits, rest at both ends, and are the same every time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.exceptions import InvalidInput
from planner.identification.excitation import MEANING, excite, expect, step_test
from planner.model.joint import JointModel

EQUAL = 1e-12
"""Two ways to the same request differ by rounding only [rad]."""

KINDS = tuple(MEANING)
CONTINUOUS = ("multisine", "chirp", "triangle", "slow_triangle")


def signal(kind, **changes):
    settings = {"limits": (-0.5, 0.9), "period": 0.02, "duration": 20.0, **changes}
    return excite(kind, **settings)


@given(
    kind=st.sampled_from(KINDS),
    low=st.floats(-3.0, 1.0),
    width=st.floats(1e-3, 4.0),
    middle=st.floats(0.05, 0.95),
    period=st.floats(0.002, 0.05),
    duration=st.floats(5.0, 30.0),
    seed=st.integers(0, 9),
)
def test_no_request_leaves_the_limits_and_both_ends_rest_at_the_centre(
    kind, low, width, middle, period, duration, seed
):
    limits, centre = (low, low + width), low + middle * width
    made = excite(kind, limits=limits, period=period, duration=duration, centre=centre, seed=seed)
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


@pytest.mark.parametrize("kind", ["combined", "multisine", "random_steps"])
def test_another_seed_gives_another_signal(kind):
    assert np.any(signal(kind).requests != signal(kind, seed=1).requests)


@pytest.mark.parametrize("name", ["noise", "resolution"])
def test_a_sensor_that_is_none_is_refused(name):
    for wrong in (-0.1, np.inf):
        with pytest.raises(InvalidInput, match=rf"^{name}: got {wrong} rad, expected 0 or more"):
            expect(signal("steps"), JointModel.ers210a(), **{name: wrong})


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "random_steps"])
def test_a_signal_uses_what_the_limits_allow(kind):
    made = signal(kind)
    assert np.max(np.abs(made.requests - made.centre)) > 0.98 * made.reach


@pytest.mark.parametrize("centre", [0.1, 0.3])
def test_a_signal_deflects_as_far_to_one_side_of_its_centre_as_to_the_other(centre):
    made = signal("triangle", centre=centre)
    assert made.reach == pytest.approx(min(centre + 0.5, 0.9 - centre))
    ends = [np.min(made.requests), np.max(made.requests)]
    np.testing.assert_allclose(ends, [centre - made.reach, centre + made.reach], atol=0.02)


def test_steps_are_those_of_equation_1_about_the_centre():
    made = signal("steps", amplitudes=(0.2, 1.0), cycles=2, duration=9.0, centre=0.1)
    assert made.amplitudes == (0.2, 1.0)
    half = 400 // 8  # 9 s at 50 Hz, less half a second at either end, for 2 tests of 2 cycles
    expected = np.concatenate(
        [np.tile(step_test(height, samples=2 * half) - 0.5 * height, 2) for height in (0.2, 1.0)]
    )
    played = made.requests[25 : 25 + len(expected)]
    np.testing.assert_allclose(played, 0.1 + expected, atol=EQUAL)


def test_no_step_is_higher_than_asked():
    assert signal("steps", amplitudes=np.array([0.3, 0.1])).largest_jump == pytest.approx(
        0.3, abs=EQUAL
    )


def test_the_default_steps_reach_from_an_eighth_to_the_whole_of_the_range():
    np.testing.assert_allclose(signal("steps").amplitudes, np.array([0.125, 0.5, 1.0]) * 1.4)


def test_a_triangle_doubles_its_speed_three_times():
    made = signal("triangle", duration=41.0)
    speeds = np.abs(np.diff(made.requests)) / made.period
    parts = np.array_split(speeds[25:-25], 4)
    found = [np.median(part) for part in parts]
    np.testing.assert_allclose(found, found[0] * np.array([1.0, 2.0, 4.0, 8.0]), rtol=1e-6)
    assert found[0] == pytest.approx(4.0 * made.reach / 10.0)


def test_a_slow_triangle_tells_friction_and_no_jump_hides_it():
    sticky = JointModel(v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.05, dead_band=0.03)
    made = signal("slow_triangle", duration=20.0)
    assert made.largest_jump <= 8.5 * made.reach * made.period / 9.5  # two cycles in 9.5 s
    found = expect(made, sticky)
    (lower, upper) = found.intervals["dead_band"]
    assert lower <= sticky.dead_band <= upper <= 1.2 * lower
    assert "dead band" in made.meaning
    assert (found.model.tick, found.model.hold) == (pytest.approx(0.02 / 3.0), 3)


@pytest.mark.parametrize("kind", ["multisine", "chirp"])
def test_a_sine_is_never_faster_than_its_highest_frequency(kind):
    made = signal(kind, highest=1.0)
    fastest = 2.0 * np.pi * 1.0 * made.reach  # Bernstein's bound, which the swell hardly adds to
    assert made.largest_jump <= 1.1 * fastest * made.period


@pytest.mark.parametrize("kind", CONTINUOUS)
def test_what_is_no_step_sets_out_without_one(kind):
    made = signal(kind)
    begun = int(np.flatnonzero(made.requests != made.centre)[0])
    assert abs(made.requests[begun] - made.centre) < 0.05 * made.reach


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "noise"}, "kind: got 'noise', expected one of combined, steps"),
        ({"limits": (1.0, -1.0)}, "limits: got 1 to -1 rad, expected the lower one first"),
        ({"limits": (np.nan, 1.0)}, "limits: got nan to 1 rad"),
        ({"centre": 0.9}, "centre: got 0.9 rad, expected between the limits"),
        ({"period": 0.0}, "period: got 0 s, expected more than 0"),
        ({"duration": 0.5}, "duration: got 0.5 s, expected 40 to"),
        ({"duration": np.inf}, "duration: got inf s"),
        ({"amplitudes": (2.0,)}, "amplitudes: got a step of 2 rad, expected more than 0 and at"),
        ({"amplitudes": ()}, "amplitudes: got none"),
        ({"cycles": 0}, "cycles: got 0, expected 1 or more"),
        ({"cycles": 500}, "leave 0 for a half cycle, expected at least 2"),
        ({"kind": "chirp", "highest": 26.0}, "highest: got 26 Hz, expected more than 0 and at"),
    ],
)
def test_what_cannot_be_made_is_refused_with_what_to_do(changes, message):
    with pytest.raises(InvalidInput, match=message):
        signal(changes.pop("kind", "steps"), **changes)


def test_rounding_does_not_leave_the_limits_either():
    low, high = -1.4, 0.8
    middle = 0.5 * (low + high)
    assert middle + (middle - low) > high  # so that there is something to round
    made = excite("steps", limits=(low, high), period=0.02, duration=10.0)
    assert low <= np.min(made.requests) <= np.max(made.requests) <= high


@pytest.mark.parametrize(("period", "highest"), [(0.01, 5.0), (0.05, 2.0)])
def test_the_highest_frequency_is_a_tenth_of_the_rate_and_at_most_5_hertz(period, highest):
    made, same = (signal("chirp", period=period, highest=each) for each in (None, highest))
    assert np.array_equal(made.requests, same.requests)
