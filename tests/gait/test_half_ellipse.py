"""The half ellipse and the reference walk, held against the paper's ten baseline figures."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.gait.half_ellipse import half_ellipse, reference_walk, walking_speed

SHAPE = 1e-15  # the path is its formula to rounding [m]


@pytest.fixture(scope="module")
def walk():
    return reference_walk()


def test_the_walks_angles_are_those_of_its_inverse_and_fifteen_points_are_out_of_reach(walk):
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
    top = walk.half_ellipse[:, 2].argmax()
    np.testing.assert_array_equal(np.flatnonzero(~walk.reachable), np.arange(top - 15, top))
    miss = np.linalg.norm(walk.desired_foot - walk.half_ellipse, axis=1)
    np.testing.assert_array_equal(walk.reachable, miss <= 1e-9)


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


@pytest.mark.parametrize("ground", [0.5, 0.3])
@pytest.mark.parametrize("heading", [0.0, 90.0, 200.0])
def test_the_speed_is_that_on_the_ground_along_the_heading(heading, ground):
    walk = {"heading": math.radians(heading), "ground_fraction": ground}
    expected = pytest.approx(0.04893 * 2 / (ground * 88 * 0.008))
    assert walking_speed(half_ellipse(**walk), 0.008, **walk) == expected
