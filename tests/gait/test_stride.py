"""A walk for any leg, as large as the leg traces it well, and its shortest cycle."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Limits
from planner import Infeasible, half_ellipse, invert_foot
from planner.gait import stride as cycles
from planner.gait.stride import (
    DEXTEROUS,
    HIGHEST,
    LEGS,
    LONGEST,
    PATTERNS,
    dexterity,
    gait,
    in_samples,
    standing_pose,
    stride,
)
from tests.instances import ERS210A
from tests.kinematics.made_up_robots import Joint, X, Y, ers210a_leg, made_up_leg

TRACED = 1e-9  # largest distance to the foot that the inverse leaves [m]
SAMPLES = 80  # of a cycle: every phase is a whole number of them
TOLERANCE = 0.004


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """A leg of 0.3 m whose body hangs half a metre up."""
    joints = [
        Joint((0.2, 0.1, 0), X, lower=-1.0, upper=1.0),
        Joint((0, 0.03, 0), Y),
        Joint((0, 0, -0.15), Y),
    ]
    return made_up_leg(tmp_path_factory.mktemp("leg"), joints, (0, 0, -0.15))


def test_a_roomy_leg_gets_the_largest_stride_near_its_pose(leg):
    made = stride(replace(leg, near=np.radians([0.0, 50.0, -100.0])))
    assert made.length == pytest.approx(LONGEST * leg.chain.size)
    assert made.height == pytest.approx(HIGHEST * leg.chain.size)
    np.testing.assert_allclose(made.centre, leg.foot_positions(made.pose[None])[0], atol=TRACED)
    pose = np.radians([0.0, 40.0, -80.0])
    made = stride(replace(leg, near=pose))
    np.testing.assert_array_equal(made.pose, pose)
    assert (made.angles[:, 2] < 0.0).all()


def test_the_path_is_a_half_ellipse_that_its_angles_trace(leg):
    made = stride(leg, samples=40, ground_fraction=0.6)
    x, y, z = made.centre
    expected = half_ellipse(
        samples=40,
        length=made.length,
        height=made.height,
        forward=x,
        sideways=y,
        hip_height=-z,
        ground_fraction=0.6,
    )
    np.testing.assert_array_equal(made.foot, expected)
    np.testing.assert_allclose(leg.foot_positions(made.angles), made.foot, atol=TRACED)


@pytest.mark.parametrize("heading", [0.5 * np.pi, np.pi, -0.7])
def test_a_stride_with_a_heading_goes_there_and_is_as_large_as_the_leg_allows(leg, heading):
    made = stride(leg, heading=heading)
    along = (made.foot - made.centre)[:, :2] @ [np.cos(heading), np.sin(heading)]
    across = (made.foot - made.centre)[:, :2] @ [-np.sin(heading), np.cos(heading)]
    assert np.ptp(along) == pytest.approx(2.0 * made.length)
    np.testing.assert_allclose(across, 0.0, atol=TRACED)
    np.testing.assert_allclose(leg.foot_positions(made.angles), made.foot, atol=TRACED)
    least = DEXTEROUS * dexterity(leg.chain, made.pose[None])[0]
    assert dexterity(leg.chain, made.angles).min() >= least


@settings(max_examples=10)
@given(reach=st.floats(0.35, 1.0))
def test_a_leg_with_less_room_gets_a_smaller_stride_that_it_traces_well(reach, tmp_path_factory):
    joints = [Joint((0, 0, 0), X), Joint((0, 0, 0), Y), Joint((0, 0, -0.15), Y)]
    leg = made_up_leg(tmp_path_factory.mktemp("leg"), joints, (0, 0, -0.15))
    tight = replace(leg, limits=Limits(*(reach * limit for limit in leg.limits)))
    made = stride(tight)
    assert 0.0 < made.length <= LONGEST * leg.chain.size
    assert made.height / made.length == pytest.approx(HIGHEST / LONGEST)
    assert (made.angles >= tight.limits.lower).all()
    assert (made.angles <= tight.limits.upper).all()
    assert not leg.jumps(np.vstack([made.angles, made.angles[:1]])).size
    least = DEXTEROUS * dexterity(leg.chain, made.pose[None])[0]
    assert dexterity(leg.chain, made.angles).min() >= least


def test_what_is_given_is_kept(leg):
    side = stride(leg).centre[1] + 0.01
    made = stride(leg, length=0.02, forward=0.21, sideways=side, hip_height=0.22)
    assert made.length == 0.02
    np.testing.assert_array_equal(made.centre, [0.21, side, -0.22])
    np.testing.assert_allclose(made.foot[:, 1], side, rtol=1e-12)
    assert np.min(made.foot[:, 2]) == pytest.approx(-0.22)
    assert made.height == pytest.approx(HIGHEST * leg.chain.size)
    both = stride(leg, length=0.06, height=0.01)
    assert (both.length, both.height) == (0.06, 0.01)
    stretched = stride(leg, length=0.16, height=0.01)  # farther than one made unasked may be
    reached, stands = (dexterity(leg.chain, each) for each in (stretched.angles, both.pose[None]))
    assert 0.0 < reached.min() < DEXTEROUS * stands[0]
    high = stride(leg, hip_height=0.29)  # nearly stretched, by bisection to a thousandth
    assert high.length < 0.9 * LONGEST * leg.chain.size
    assert dexterity(leg.chain, high.angles).min() == pytest.approx(DEXTEROUS * stands[0], rel=0.02)


def test_a_stride_out_of_reach_or_on_which_the_leg_would_leap_is_an_error(leg):
    with pytest.raises(Infeasible, match=r"of half stroke 0.4 m and of height 0.1 m .* of reach"):
        stride(leg, length=0.4, height=0.1)
    # With the hip within 0.6 rad one end is for the knee bent forward, the other for it bent back.
    limits = Limits(np.array([-0.1, -0.6, -1.5]), np.array([0.1, 0.6, 1.5]))
    shape = {"height": 0.0, "forward": 0.2, "hip_height": 0.26}
    stands = leg.foot_positions([[0.0, 0.0, 0.0]])[0]
    given = {**shape, "sideways": float(stands[1])}
    assert stride(replace(leg, limits=limits), length=0.01, **given).length == 0.01
    with pytest.raises(Infeasible, match="leap to another pose after sample"):
        stride(replace(leg, limits=limits), length=0.14, **given)


@pytest.fixture(scope="module")
def legs():
    return {name: ers210a_leg(name.replace("-", "_")) for name in sorted(LEGS)}


def heights(legs, made):
    """Heights of the feet above the ground [m], by leg, (n,)."""
    return {
        name: legs[name].foot_positions(each.angles)[:, 2] - each.centre[2]
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
    strides = list(made.values())
    for one in strides:
        assert (one.length, one.height) == (strides[0].length, strides[0].height)
        assert one.centre[2] == pytest.approx(-min(hips))
    alone = {"samples": SAMPLES, "ground_fraction": PATTERNS[pattern][0], "hip_height": min(hips)}
    own = [stride(leg, **alone, **walk) for leg in legs.values()]
    for name in ("length", "height"):
        assert getattr(strides[0], name) == min(getattr(each, name) for each in own) > 0.0
    assert walk.items() <= vars(strides[0]).items()
    assert list(made) == list(legs)


@pytest.fixture(scope="module")
def front_leg(legs):
    return legs["front-left"]


@pytest.fixture(scope="module")
def circle(front_leg):
    """A circle of 1 cm around the foot of a bent front_leg [m], in 24 samples."""
    middle = front_leg.foot_positions(np.radians([[0.0, 10.0, 60.0]]))[0]
    phase = 2.0 * np.pi * np.arange(24) / 24
    return middle + 0.01 * np.column_stack([np.cos(phase), np.zeros(24), np.sin(phase)])


def test_the_foot_keeps_the_tolerance_and_not_in_a_sample_less(front_leg, circle, monkeypatch):
    monkeypatch.setattr(cycles, "FEWEST", 11)
    found = cycles.shortest_cycle(
        ERS210A, front_leg, lambda count: in_samples(circle, count), tolerance=TOLERANCE, samples=16
    )
    assert found.max_error <= TOLERANCE
    task, count = found.plan.task, len(found.requests)
    np.testing.assert_array_equal([task.lower, task.upper], front_leg.limits)
    if count > 11:
        shorter = in_samples(circle, count - 1)
        assert invert_foot(ERS210A, front_leg, shorter, norm="max").max_error > TOLERANCE


def test_a_path_in_as_many_samples_is_itself(circle):
    assert in_samples(circle, 24) == pytest.approx(circle)
    assert in_samples(circle, 12) == pytest.approx(circle[::2])
    twice = in_samples(circle, 48)
    assert twice[::2] == pytest.approx(circle)
    assert twice[1::2] == pytest.approx((circle + np.roll(circle, -1, axis=0)) / 2.0)


def test_a_path_that_any_cycle_keeps_takes_the_fewest_samples(front_leg, circle):
    middle = circle.mean(axis=0)
    found = cycles.shortest_cycle(
        ERS210A,
        front_leg,
        lambda count: np.tile(middle, (count, 1)),
        tolerance=TOLERANCE,
        samples=16,
    )
    assert len(found.requests) == cycles.FEWEST


def test_a_tolerance_that_no_cycle_keeps_is_refused_with_the_largest_distance(
    front_leg, circle, monkeypatch
):
    monkeypatch.setattr(cycles, "MOST", 20)
    largest = invert_foot(ERS210A, front_leg, in_samples(circle, 16), norm="max").max_error
    with pytest.raises(Infeasible, match=f"cycle of 16 samples .* {100.0 * largest:.3g} cm off"):
        cycles.shortest_cycle(
            ERS210A, front_leg, lambda count: in_samples(circle, count), tolerance=1e-9, samples=16
        )
