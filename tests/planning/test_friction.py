"""Plans for joints with dry friction, speeds that differ by direction and a load."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.arrays import rms, turning_points, without_small_reversals
from planner.model.evidence import ENCODER_STEP
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from planner.planning.line_inverse import RULES
from tests.instances import attainable, joint_of, random_model
from tests.strategies import trajectories

WITHOUT = JointModel(v_max=4.0, theta_0=0.25, lag=0.02, acceleration_time=0.04, tick=0.005, hold=4)
"""A hobby servo at 50 Hz by its four numbers."""

SERVO = replace(WITHOUT, dead_band=0.035, v_offset=0.3, compliance=0.06, speed_per_torque=0.4)
"""The same, with 2 degrees of dry friction, faster upwards, and soft."""

SAMPLES = 150
PHASE = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES

PATHS = {
    "slow sine": 0.5 * np.sin(PHASE),
    "fast sine": 0.5 * np.sin(5.0 * PHASE),
    "square": 0.4 * np.sign(np.sin(2.0 * PHASE) + 1e-9),
    "holds": np.clip(0.75 * np.sin(PHASE), -0.5, 0.5),
}

LOADS = {"none": None, "constant": 0.5, "gravity": 0.8 * np.cos(0.5 * np.sin(PHASE))}

SYMMETRIC = replace(WITHOUT, dead_band=0.035, compliance=0.06)
SINE, HOLDS = 0.5 * np.sin(PHASE), np.clip(0.9 * np.sin(PHASE), -0.6, 0.6)
NOISE = 0.001  # standard deviation of a path's noise [rad]: 3 % of the dead band


@cache
def optimal(path, load, *, cyclic=True):
    """The optimal plan of a path under a load, made once."""
    return invert_optimal(SERVO, PATHS[path], cyclic=cyclic, load=LOADS[load])


@cache
def closed_form(path, load, *, cyclic=True, rule="paper"):
    """The closed form of a path under a load, made once."""
    return invert_closed_form(SERVO, PATHS[path], rule=rule, cyclic=cyclic, load=LOADS[load])


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize(("path", "load"), list(zip(PATHS, ["gravity", "none"] * 2, strict=True)))
def test_a_plan_is_no_worse_than_the_closed_form_and_no_better_than_the_bound(path, load, cyclic):
    made = optimal(path, load, cyclic=cyclic)
    for rule in RULES:
        other = closed_form(path, load, cyclic=cyclic, rule=rule).rms
        assert made.rms <= max(1.005 * other, ENCODER_STEP)  # smoothed
    assert made.lower_bound <= made.rms


@pytest.mark.parametrize("load", LOADS)
def test_a_plan_that_knows_friction_and_load_is_a_twentieth_of_one_that_does_not(load):
    desired, torque = PATHS["slow sine"], LOADS[load]
    made = optimal("slow sine", load)
    four_numbers = invert_optimal(WITHOUT, desired)
    missed = rms(simulate(SERVO, four_numbers.requests, load=torque) - desired)
    assert made.rms < missed / 20.0
    assert closed_form("slow sine", load).rms < missed / 3.0


def assert_held(plan, joint):
    """The first request holds the joint where it starts."""
    start = plan.plan.task.starts[0]
    held = simulate(joint, np.full(30, plan.requests[0]), cyclic=False, start=start)
    np.testing.assert_array_equal(held, start)


def test_from_rest_the_first_request_is_the_one_in_the_dead_band_that_serves_best():
    """It holds the joint at the start, at whichever place in the band that is."""
    band = np.radians(8.0)
    servo = JointModel(v_max=4.0, theta_0=0.1, lag=0.016, acceleration_time=0.064, dead_band=band)
    desired = np.where(np.arange(30) < 2, 0.0, 0.5)
    for way in (1.0, -1.0):
        options = {"cyclic": False, "smoothness": 0.0, "max_step": 0.07}
        plan = invert_optimal(servo, way * desired, **options)
        assert 0.9 * band < way * plan.requests[0] <= band
        assert_held(plan, servo)
        # From the middle of the band no plan is better than 18.5 degrees.
        assert plan.rms < np.radians(17.4)
    rests = invert_optimal(servo, np.zeros(24), cyclic=False)
    assert np.max(np.abs(rests.requests)) == 0.0


def test_from_rest_beyond_the_limits_the_first_request_still_holds_the_joint():
    """Dry friction holds it up to a dead band beyond: the band's middle is then out of reach."""
    joint = JointModel(v_max=5.0, theta_0=0.4, lag=0.016, acceleration_time=0.024, dead_band=0.05)
    desired = np.maximum(0.44 - 0.02 * np.arange(30), 0.0)
    for way in (1.0, -1.0):
        limits = (-1.0, 0.4) if way > 0.0 else (-0.4, 1.0)
        made = invert_optimal(joint, way * desired, cyclic=False, limits=limits, smoothness=0.0)
        first = way * made.requests[0]
        assert 0.39 <= first <= 0.4  # a dead band from the start, 0.44, and within the limits
        assert_held(made, joint)


@pytest.mark.parametrize("seed", [None, 150, 252, 354])
def test_no_closed_form_does_better_on_a_square_out_of_reach_or_small_motions_in_a_dead_band(seed):
    """Searched for alone, the plans for these motions are four to six times as far off."""
    rng = np.random.default_rng(seed)
    if seed is None:
        model = joint_of(6.6, 0.1, 0.012, 0.027, hold=2, max_acceleration=81.0)
        path = 0.8 * np.repeat([1.0, -1.0], 20)
    else:
        plain = random_model(rng, whole=False, hold=1)
        model = replace(plain, dead_band=rng.uniform(0.1, 1.0) * plain.theta_0)
        path = 0.3 * attainable(rng, model, samples=24)
    plan = invert_optimal(model, path, smoothness=0.0)
    forms = [invert_closed_form(model, path, rule=rule) for rule in RULES]
    assert plan.rms <= min(form.rms for form in forms) + 1e-12


def noisy(path, seed):
    return path + NOISE * np.random.default_rng(seed).standard_normal(len(path))


def reversals(requests):
    """How often a cycle's requests turn by more than half the dead band."""
    turned = np.roll(requests, -int(np.argmax(requests)))
    return len(turning_points(np.append(turned, turned[0]), SYMMETRIC.dead_band / 2.0))


@pytest.mark.parametrize("cyclic", [True, False])
@given(path=trajectories(least=3, most=40), least=st.floats(0.0, 2.0))
def test_what_is_left_turns_deeply_only_and_stays_near(cyclic, path, least):
    left = without_small_reversals(path, least, cyclic=cyclic)
    assert left.shape == path.shape
    assert np.max(np.abs(left - path)) <= least + 1e-12
    turns = turning_points(left, 1e-12)
    deep = turning_points(path, least)
    assert len(turns) <= len(deep) + 2  # a cycle may turn at its first sample too
    np.testing.assert_array_equal(without_small_reversals(path, 0.0, cyclic=cyclic), path)


def test_turning_points_are_the_extrema_of_a_zigzag():
    zigzag = np.array([0.0, 1.0, 0.9, 2.0, 0.5, 0.6, 0.4, 3.0])
    assert turning_points(zigzag, 0.3) == [(0, False), (3, True), (6, False)]


@pytest.mark.parametrize("load", [None, LOADS["gravity"]], ids=["no load", "gravity"])
def test_on_a_slow_sine_requests_turn_where_the_path_does(load):
    """With noise, too; without the rules against it they turn 80 to 110 times."""
    for path in (SINE, noisy(SINE, 0), noisy(SINE, 1)):
        plan = invert_optimal(SYMMETRIC, path, load=load)
        assert reversals(plan.requests) == reversals(path) == 1 + 1
        assert plan.rms < (ENCODER_STEP if path is SINE else 0.1 * SYMMETRIC.dead_band)


@pytest.mark.parametrize("load", [None, LOADS["gravity"]], ids=["no load", "gravity"])
def test_at_holds_requests_return_to_the_middle_of_the_dead_band_and_the_joint_rests(load):
    """With noise on the path they turn back for it, within the dead band."""
    sag = SYMMETRIC.sag(0.0 if load is None else load)
    for path in (HOLDS, noisy(HOLDS, 0), noisy(HOLDS, 1)):
        plan = invert_optimal(SYMMETRIC, path, load=load)
        assert reversals(plan.requests) <= 12
        assert plan.rms < (ENCODER_STEP if path is SINE else 0.1 * SYMMETRIC.dead_band)
        middle = plan.requests + sag - plan.predicted
        held = slice(SAMPLES // 4 - 8, SAMPLES // 4 + 8)  # in the middle of the hold
        assert np.max(np.abs(middle[held][2:-2])) < SYMMETRIC.dead_band
        if path is HOLDS:
            assert np.max(np.abs(middle[held][4:-4])) < 0.25 * SYMMETRIC.dead_band
        assert np.ptp(plan.predicted[held]) < (1e-9 if load is None else 0.02 * SYMMETRIC.dead_band)


def test_without_dry_friction_every_reversal_is_followed():
    path = SINE + 5.0 * (noisy(SINE, 0) - SINE)  # beyond an encoder's step
    plan = invert_optimal(replace(SYMMETRIC, dead_band=0.0), path)
    assert plan.rms < 5.0 * NOISE / 2.0


def test_a_rough_path_is_followed_as_well_as_by_the_closed_form_whatever_the_dead_band():
    """Reversals of a fifth of the dead band are those of the path, not noise."""
    servo = replace(SYMMETRIC, dead_band=np.radians(7.1))
    path = SINE[::3] + 0.15 * servo.dead_band * np.sin(9.0 * PHASE[::3] + 0.5)
    other = invert_closed_form(servo, path, rule="exact")
    exact, plan = (invert_optimal(servo, path, smoothness=share) for share in (0.0, 0.005))
    assert exact.rms <= other.rms
    assert plan.rms <= max(1.005 * exact.rms, ENCODER_STEP)
