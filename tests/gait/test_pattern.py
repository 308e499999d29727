"""Gaits of four legs: footfalls at the phases of the pattern, and one walk for all legs."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics import Leg, urdf_path
from planner.gait.stride import LEGS, PATTERNS, gait, standing_pose

SAMPLES = 80
"""Of a cycle: every phase is a whole number of them."""

TRACED = 1e-9
"""Largest distance to the foot that the inverse leaves [m]."""


@pytest.fixture(scope="module")
def legs():
    urdf = urdf_path("ers210a.urdf")
    feet = {name: f"{name.replace('-', '_')}_ball" for name in sorted(LEGS)}
    return {name: Leg.from_urdf(urdf, base="body", foot=foot) for name, foot in feet.items()}


def heights(legs, made):
    """Heights of the feet above the ground [m], by leg, (n,)."""
    return {
        name: legs[name].foot_positions(each.angles)[:, 2] - each.stride.centre[2]
        for name, each in made.items()
    }


def later(name, other, lifted):
    """By which share of the cycle a foot leaves the ground later than another."""
    begins = [int(np.argmax(lifted[each] & ~np.roll(lifted[each], 1))) for each in (name, other)]
    return (begins[0] - begins[1]) % SAMPLES / SAMPLES


@pytest.mark.parametrize(
    ("pattern", "together", "apart", "ground"),
    [
        ("trot", ("front-left", "hind-right"), ("front-left", "front-right"), 0.5),
        ("pace", ("front-left", "hind-left"), ("front-left", "front-right"), 0.5),
        ("bound", ("front-left", "front-right"), ("front-left", "hind-left"), 0.4),
    ],
)
def test_feet_fall_in_the_pairs_of_the_gait(legs, pattern, together, apart, ground):
    made = gait(legs, pattern, samples=SAMPLES)
    lifted = {name: each > TRACED for name, each in heights(legs, made).items()}
    assert later(*together, lifted) == 0.0
    assert later(*apart, lifted) == 0.5
    for each in lifted.values():
        assert np.mean(~each) == pytest.approx(ground, abs=1.5 / SAMPLES)


def test_a_walk_lifts_one_foot_after_the_other_from_behind_on_each_side(legs):
    lifted = {
        name: each > TRACED
        for name, each in heights(legs, gait(legs, "walk", samples=SAMPLES)).items()
    }
    order = [later(name, "hind-left", lifted) for name in LEGS]
    assert order == [0.0, 0.25, 0.5, 0.75]
    assert np.max(np.sum(list(lifted.values()), axis=0)) == 1


@pytest.mark.parametrize(
    ("pattern", "walk"),
    [(name, {}) for name in PATTERNS] + [("trot", {"length": 0.02}), ("trot", {"height": 0.01})],
)
def test_all_legs_have_one_stroke_at_the_height_of_the_body_at_which_the_lowest_stands(
    legs, pattern, walk
):
    made = gait(legs, pattern, samples=SAMPLES, **walk)
    hips = [-float(leg.foot_positions(standing_pose(leg)[None])[0, 2]) for leg in legs.values()]
    assert min(hips) < max(hips)
    strides = [each.stride for each in made.values()]
    for one in strides:
        assert (one.length, one.height) == (strides[0].length, strides[0].height)
        assert one.centre[2] == pytest.approx(-min(hips))
    assert min(strides[0].length, strides[0].height) > 0.0
    assert walk.items() <= vars(strides[0]).items()
    assert list(made) == list(legs)
