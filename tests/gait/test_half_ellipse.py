"""The half ellipse and the reference walk, held against the paper's ten baseline figures."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import InvalidInput
from planner.gait.half_ellipse import half_ellipse, reference_walk, walking_speed

SHAPE = 1e-15
"""The path is its formula to rounding [m]."""

PRINTED = 0.005
"""Half a unit of the last digit of the figures in degrees; centimetres have one digit more."""


def joint_angles_over_cycles(requests, *, v_max=2.5, theta_0=7.0, lag=4, acceleration=6):
    """Equation 3 as it stands in the paper [degrees, ticks], run until it repeats."""
    count = len(requests)
    angle, angles = requests[0], np.zeros(count)
    for _ in range(20):
        for tick in range(count):
            total = 0.0
            for age in range(lag + 1, lag + acceleration + 1):
                error = requests[(tick - age) % count] - angle
                total += min(max(error * v_max / theta_0, -v_max), v_max)
            angle += total / acceleration
            angles[tick] = angle
    return angles


@pytest.fixture(scope="module")
def walk():
    return reference_walk()


@pytest.fixture(scope="module")
def direct(walk):
    """What the joints do when the desired angles are requested [rad]."""
    degrees = np.degrees(walk.desired).T
    return np.radians([joint_angles_over_cycles(joint) for joint in degrees]).T


def foot_errors(walk, angles):
    return 100.0 * np.linalg.norm(walk.leg.foot_positions(angles) - walk.desired_foot, axis=1)


def rms(values, **axis):
    return np.sqrt(np.mean(np.square(values), **axis))


def test_the_joints_miss_the_desired_angles_by_the_known_figures(walk, direct):
    error = np.degrees(direct - walk.desired)
    np.testing.assert_allclose(rms(error, axis=0), [32.80, 28.86, 23.84], atol=PRINTED)
    np.testing.assert_allclose(np.abs(error).max(axis=0), [57.14, 53.09, 58.13], atol=PRINTED)


def test_the_foot_misses_the_desired_path_by_the_known_figures(walk, direct):
    error = foot_errors(walk, direct)
    assert rms(error) == pytest.approx(3.156, abs=0.1 * PRINTED)
    assert error.max() == pytest.approx(4.958, abs=0.1 * PRINTED)


def test_the_best_time_shift_misses_by_the_known_figures(walk, direct):
    errors = [foot_errors(walk, np.roll(direct, -shift, axis=0)) for shift in range(88)]
    best = min(errors, key=rms)
    assert rms(best) == pytest.approx(1.470, abs=0.1 * PRINTED)
    assert best.max() == pytest.approx(3.408, abs=0.1 * PRINTED)
    assert best is errors[12]


def test_the_ten_baseline_figures_agree_with_the_papers_within_ten_percent_on_average(walk, direct):
    paper = [31.0, 29.0, 20.1, 57.2, 59.5, 42.6, 3.23, 4.61, 1.55, 3.57]
    error = np.degrees(direct - walk.desired)
    foot = foot_errors(walk, direct)
    shifted = foot_errors(walk, np.roll(direct, -12, axis=0))
    ours = [*rms(error, axis=0), *np.abs(error).max(axis=0)]
    ours += [rms(foot), foot.max(), rms(shifted), shifted.max()]
    assert np.mean(np.abs(np.array(ours) / paper - 1.0)) < 0.10


def test_fifteen_points_on_the_way_up_to_the_top_of_the_swing_are_out_of_reach(walk):
    top = walk.half_ellipse[:, 2].argmax()
    np.testing.assert_array_equal(np.flatnonzero(~walk.reachable), np.arange(top - 15, top))
    miss = np.linalg.norm(walk.desired_foot - walk.half_ellipse, axis=1)
    np.testing.assert_array_equal(walk.reachable, miss <= 1e-9)


def test_the_desired_angles_are_those_of_the_walks_own_inverse_kinematics(walk):
    upper, lower = 0.064, 0.069
    x, y, z = walk.half_ellipse.T
    square = (walk.half_ellipse**2).sum(axis=1)
    knee = np.arccos(np.clip((square - upper**2 - lower**2) / (2 * upper * lower), -1, 1))
    reach = upper + lower * np.cos(knee)
    abductor = np.arcsin(np.clip(y / reach, -1, 1))
    below, before = reach * np.cos(abductor), lower * np.sin(knee)
    rotator = np.arctan2(x * below + z * before, x * before - z * below)
    limits = np.radians([[-117, -11, -27], [117, 89, 147]])
    expected = np.clip(np.stack([rotator, abductor, knee], axis=1), *limits)
    np.testing.assert_allclose(walk.desired, expected, atol=1e-10)


def test_the_walk_knows_its_joints_and_cannot_be_changed(walk):
    assert walk.joint_names == ("rotator", "abductor", "knee")
    assert walk.desired.shape == walk.desired_foot.shape == walk.half_ellipse.shape == (88, 3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        walk.desired = None
    for array in (walk.half_ellipse, walk.desired, walk.desired_foot, walk.reachable):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


parameters = st.fixed_dictionaries(
    {
        "samples": st.integers(4, 300),
        "length": st.floats(1e-3, 1.0),
        "height": st.floats(0.0, 1.0) | st.floats(0.0, 1e-3),
        "forward": st.floats(-1.0, 1.0),
        "sideways": st.floats(-1.0, 1.0),
        "hip_height": st.floats(0.0, 1.0),
        "ground_fraction": st.floats(0.05, 0.95),
    }
)


@given(given_=parameters)
@settings(deadline=None)
def test_every_point_is_on_the_ground_line_or_on_the_ellipse_above_it(given_):
    x, y, z = half_ellipse(**given_).T
    across = (x - given_["forward"]) / given_["length"]
    up = z + given_["hip_height"]
    phase = np.arange(given_["samples"]) / given_["samples"]
    ground = phase < given_["ground_fraction"]
    np.testing.assert_allclose(up[ground], 0.0, atol=SHAPE)
    np.testing.assert_allclose(
        up[~ground], given_["height"] * np.sqrt(np.maximum(1 - across[~ground] ** 2, 0)), atol=1e-7
    )
    np.testing.assert_array_equal(y, given_["sideways"])
    assert np.abs(across).max() <= 1 + 1e-12


@given(given_=parameters)
@settings(deadline=None)
def test_the_foot_goes_backward_at_constant_speed_on_the_ground_and_forward_in_the_air(given_):
    x = half_ellipse(**given_)[:, 0]
    phase = np.arange(given_["samples"]) / given_["samples"]
    ground = phase < given_["ground_fraction"]
    back = np.diff(x[ground])
    step = -2 * given_["length"] / given_["ground_fraction"] / given_["samples"]
    np.testing.assert_allclose(back, step, atol=1e-12)
    assert (np.diff(x[~ground]) > 0.0).all()


def test_the_cycle_starts_in_front_and_lifts_off_behind():
    path = half_ellipse(samples=8, length=0.1, height=0.05, forward=0.0, sideways=0.0, hip_height=0)
    np.testing.assert_allclose(path[0], [0.1, 0.0, 0.0], atol=SHAPE)
    np.testing.assert_allclose(path[4], [-0.1, 0.0, 0.0], atol=SHAPE)
    np.testing.assert_allclose(path[6], [0.0, 0.0, 0.05], atol=SHAPE)


@given(given_=parameters, heading=st.floats(-7.0, 7.0))
@settings(deadline=None)
def test_a_walk_with_a_heading_is_the_walk_straight_on_turned_about_the_middle_of_its_stroke(
    given_, heading
):
    straight, turned = half_ellipse(**given_), half_ellipse(**given_, heading=heading)
    middle = [given_["forward"], given_["sideways"], 0.0]
    cos, sin = np.cos(heading), np.sin(heading)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned - middle, (straight - middle) @ turn.T, atol=4 * SHAPE)


def test_a_walk_along_y_begins_far_along_y_and_one_without_heading_is_straight_on():
    path = half_ellipse(samples=8, length=0.1, forward=0.2, sideways=0.03, heading=np.pi / 2)
    np.testing.assert_allclose(path[0, :2], [0.2, 0.13], atol=SHAPE)
    np.testing.assert_allclose(path[4, :2], [0.2, -0.07], atol=SHAPE)
    np.testing.assert_array_equal(half_ellipse(heading=0.0), half_ellipse())


def test_more_samples_refine_the_same_path():
    np.testing.assert_allclose(half_ellipse(samples=176)[::2], half_ellipse(), atol=SHAPE)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"samples": 3}, "samples: got 3, expected a whole number, at least 4"),
        ({"samples": 88.0}, "samples: got 88.0, expected a whole number"),
        ({"samples": True}, "samples: got True, expected a whole number"),
        ({"samples": 1_000_001}, "samples: got 1000001, expected at most 1000000"),
        ({"forward": -2e9}, r"forward: got -2e\+09, expected at most 1e\+09; check the unit"),
        ({"length": 0.0}, "length: got 0.0, expected a finite number above 0"),
        ({"length": float("nan")}, "length: got nan, expected a finite number above 0"),
        ({"height": -0.01}, "height: got -0.01, expected a finite number at least 0"),
        ({"forward": float("inf")}, "forward: got inf, expected a finite number"),
        ({"sideways": "2.8"}, "sideways: got '2.8', expected a finite number"),
        ({"hip_height": None}, "hip_height: got None, expected a finite number"),
        ({"heading": float("nan")}, "heading: got nan, expected a finite number"),
        ({"ground_fraction": 0.0}, "ground_fraction: got 0.0, .* above 0 and below 1"),
        ({"ground_fraction": 1.0}, "ground_fraction: got 1.0, .* above 0 and below 1"),
    ],
)
def test_an_impossible_parameter_is_an_error_that_names_it(wrong, message):
    with pytest.raises(InvalidInput, match=message):
        half_ellipse(**wrong)


@pytest.mark.parametrize("ground", [0.5, 0.3])
@pytest.mark.parametrize("heading", [0.0, 90.0, 200.0])
def test_the_speed_is_that_on_the_ground_along_the_heading(heading, ground):
    walk = {"heading": math.radians(heading), "ground_fraction": ground}
    expected = pytest.approx(0.04893 * 2 / (ground * 88 * 0.008))
    assert walking_speed(half_ellipse(**walk), 0.008, **walk) == expected
