"""Plans for joints with dry friction, speeds that differ by direction and a load."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.evaluation.cross_check import cross_check
from planner.exceptions import Infeasible
from planner.gait.half_ellipse import reference_walk
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_foot, invert_optimal
from planner.planning.line_inverse import RULES
from planner.planning.task import NORMS
from tests.independent import from_rest, next_cycle
from tests.strategies import models, trajectories

WITHOUT = JointModel(v_max=4.0, theta_0=0.25, lag=0.02, acceleration_time=0.04, tick=0.005, hold=4)
"""A hobby servo at 50 Hz by its four numbers."""

SERVO = replace(WITHOUT, dead_band=0.035, v_offset=0.3, compliance=0.06, speed_per_torque=0.4)
"""The same, with 2 degrees of dry friction, faster upwards, and soft."""

SAMPLES = 150

ENCODER_STEP = 2.0 * np.pi / 4096.0
"""Of an encoder of 12 bits [rad]."""

PHASE = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES

PATHS = {
    "slow sine": 0.5 * np.sin(PHASE),
    "fast sine": 0.5 * np.sin(5.0 * PHASE),
    "square": 0.4 * np.sign(np.sin(2.0 * PHASE) + 1e-9),
    "holds": np.clip(0.75 * np.sin(PHASE), -0.5, 0.5),
}

LOADS = {"none": None, "constant": 0.5, "gravity": 0.8 * np.cos(0.5 * np.sin(PHASE))}


@cache
def _optimal(path, load, cyclic):
    return invert_optimal(SERVO, PATHS[path], cyclic=cyclic, load=LOADS[load])


@cache
def _closed_forms(path, load, cyclic):
    made = [
        invert_closed_form(SERVO, PATHS[path], rule=rule, cyclic=cyclic, load=LOADS[load])
        for rule in RULES
    ]
    return dict(zip(RULES, made, strict=True))


def optimal(path, load, *, cyclic=True):
    """The optimal plan of a path under a load, made once."""
    return _optimal(path, load, cyclic)


def closed_form(path, load, *, cyclic=True, rule="paper"):
    """The closed form of a path under a load, made once."""
    return _closed_forms(path, load, cyclic)[rule]


def rms(angles, desired):
    return float(np.sqrt(np.mean((angles - desired) ** 2)))


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("load", LOADS)
def test_what_a_plan_predicts_is_what_another_simulation_finds(load, cyclic):
    desired = PATHS["holds"]
    torques = np.broadcast_to(0.0 if LOADS[load] is None else LOADS[load], SAMPLES)
    for invert in (optimal, closed_form):
        made = invert("holds", load, cyclic=cyclic)
        if cyclic:
            again = next_cycle(SERVO, made.requests, made.predicted[-1], load=torques)
        else:
            again = from_rest(SERVO, made.requests, start=desired[0], load=torques)
        np.testing.assert_allclose(again, made.predicted, rtol=0.0, atol=1e-9)


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
    missed = rms(simulate(SERVO, four_numbers.requests, load=torque), desired)
    assert made.rms < missed / 20.0
    assert closed_form("slow sine", load).rms < missed / 3.0


@settings(max_examples=8)
@given(
    model=models(friction=True, overshoots=False),
    desired=trajectories(least=5, most=30, reach=1.0),
    seed=st.integers(0, 2**32 - 1),
)
@pytest.mark.parametrize("norm", NORMS)
def test_any_joint_gets_a_plan_that_keeps_its_bound(norm, model, desired, seed):
    load = np.random.default_rng(seed).uniform(-1.0, 1.0, len(desired))
    for cyclic in (True, False):
        made = invert_optimal(model, desired, cyclic=cyclic, norm=norm, load=load)
        assert made.lower_bound <= made.error + 1e-9
        assert made.load is None or np.array_equal(made.load, load)


def test_a_mirrored_joint_has_the_mirrored_plan():
    mirrored = replace(SERVO, v_offset=-SERVO.v_offset)
    for path, desired in PATHS.items():
        other = invert_optimal(mirrored, -desired, load=-LOADS["gravity"])
        assert other.rms == pytest.approx(optimal(path, "gravity").rms, rel=1e-3)


def test_requests_within_limits_must_be_able_to_hold_the_angles_under_the_load():
    desired = np.full(20, 0.5)
    sag = float(SERVO.sag(-0.5))
    reach = 0.5 - sag - SERVO.dead_band
    made = invert_optimal(SERVO, desired, limits=(-1.0, reach + 1e-3), load=-0.5)
    assert np.max(made.requests) <= reach + 1e-3
    with pytest.raises(Infeasible, match=r"desired: sample 0 is .* let the joint rest"):
        invert_optimal(SERVO, desired, limits=(-1.0, reach - 2e-3), load=-0.5)


def test_the_cross_check_passes_for_joints_with_friction_and_load():
    path, gravity = PATHS["fast sine"][:24], LOADS["gravity"][:24]
    check = cross_check(SERVO, path, cyclic=False, load=gravity)
    assert not check.failures, [failure.name for failure in check.failures]


@pytest.mark.usefixtures("brief_search")
def test_a_leg_with_friction_and_load_brings_its_foot_closer_than_without():
    walk = reference_walk()
    without = JointModel.ers210a()
    model = replace(without, dead_band=0.03, compliance=0.05, v_offset=0.2)
    load = np.column_stack([0.5 * np.cos(walk.desired[:, 0]), *np.zeros((2, len(walk.desired)))])
    made = invert_foot(model, walk.leg, walk.desired_foot, load=load)
    blind = invert_foot(without, walk.leg, walk.desired_foot)
    met = replace(made, requests=blind.requests)
    assert made.rms < 0.97 * met.rms
    assert made.lower_bound <= made.error
    for j, torque in enumerate(load.T):
        again = simulate(model, made.requests[:, j], load=torque)
        np.testing.assert_array_equal(made.predicted[:, j], again)


UNEVEN = replace(WITHOUT, v_max=5.0, theta_0=0.3, v_offset=1.1)
"""Upwards it reaches 6.1 rad/s, downwards 3.9."""


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("share", [0.35, 0.65])
@pytest.mark.parametrize("refine", [True, False])
def test_the_lines_of_a_closed_form_keep_the_speed_of_either_direction(refine, share, cyclic):
    rise = round(50 * share)
    desired = 5.8 * 0.02 * rise * np.interp(np.arange(50), [0, rise, 50], [0, 1, 0])
    made = invert_closed_form(UNEVEN, desired, cyclic=cyclic, rule="exact", refine=refine)
    low, high = UNEVEN.speed_limits()
    slopes = made.approximation.slopes
    assert np.all((slopes >= low * (1.0 + 1e-11)) & (slopes <= high * (1.0 + 1e-11)))
    if share < 0.5 and cyclic:  # within both: 5.8 rad/s up, 3.1 down, but for the corners
        assert made.rms < np.radians(1.6)
        assert np.max(slopes) > 5.5


def test_from_rest_the_first_request_is_the_one_in_the_dead_band_that_serves_best():
    """It holds the joint at the start, at whichever place in the band that is."""
    band = np.radians(8.0)
    servo = JointModel(v_max=4.0, theta_0=0.1, lag=0.016, acceleration_time=0.064, dead_band=band)
    desired = np.where(np.arange(30) < 2, 0.0, 0.5)
    for way in (1.0, -1.0):
        options = {"cyclic": False, "smoothness": 0.0, "max_step": 0.07}
        plan = invert_optimal(servo, way * desired, **options)
        assert 0.9 * band < way * plan.requests[0] <= band
        held = simulate(servo, np.full(30, plan.requests[0]), cyclic=False, start=0.0)
        assert np.max(np.abs(held)) == 0.0
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
        held = simulate(joint, np.full(30, made.requests[0]), cyclic=False, start=made.start)
        assert np.array_equal(held, np.full(30, made.start))
