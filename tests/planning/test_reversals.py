"""Small reversals of a path, and requests that do not chatter in the dead band for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.model.joint import JointModel
from planner.planning.closed_form import invert_closed_form
from planner.planning.ideal import turning_points, without_small_reversals
from planner.planning.inversion import invert_optimal
from tests.strategies import trajectories

SERVO = JointModel(
    v_max=4.0,
    theta_0=0.25,
    lag=0.02,
    acceleration_time=0.04,
    tick=0.005,
    hold=4,
    dead_band=0.035,
    compliance=0.06,
)

SAMPLES = 150

ENCODER_STEP = 2.0 * np.pi / 4096.0
"""Of an encoder of 12 bits [rad]."""

PHASE = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES

LOAD = 0.8 * np.cos(0.5 * np.sin(PHASE))

SINE = 0.5 * np.sin(PHASE)

HOLDS = np.clip(0.9 * np.sin(PHASE), -0.6, 0.6)


NOISE = 0.001
"""Standard deviation of a path's noise [rad]: 3 % of the dead band."""


def noisy(path, seed):
    return path + NOISE * np.random.default_rng(seed).standard_normal(len(path))


def reversals(requests):
    """How often a cycle's requests turn by more than half the dead band."""
    turned = np.roll(requests, -int(np.argmax(requests)))
    return len(turning_points(np.append(turned, turned[0]), SERVO.dead_band / 2.0))


@pytest.mark.parametrize("cyclic", [True, False])
@given(path=trajectories(least=3, most=40), least=st.floats(0.0, 2.0))
def test_what_is_left_turns_deeply_only_and_stays_near(cyclic, path, least):
    left = without_small_reversals(path, least, cyclic=cyclic)
    assert left.shape == path.shape
    assert np.max(np.abs(left - path)) <= least + 1e-12
    turns = turning_points(left, 1e-12)
    deep = turning_points(path, least)
    assert len(turns) <= len(deep) + 2  # a cycle may turn at its first sample too


@given(path=trajectories(least=3, most=40))
def test_a_path_without_small_reversals_is_left_alone(path):
    for cyclic in (True, False):
        np.testing.assert_array_equal(without_small_reversals(path, 0.0, cyclic=cyclic), path)
    np.testing.assert_array_equal(without_small_reversals(SINE, 0.1, cyclic=True), SINE)


def test_turning_points_are_the_extrema_of_a_zigzag():
    zigzag = np.array([0.0, 1.0, 0.9, 2.0, 0.5, 0.6, 0.4, 3.0])
    assert turning_points(zigzag, 0.3) == [(0, False), (3, True), (6, False)]


@pytest.mark.parametrize("load", [None, LOAD], ids=["no load", "gravity"])
def test_on_a_slow_sine_requests_turn_where_the_path_does(load):
    """With noise, too; without the rules against it they turn 80 to 110 times."""
    for path in (SINE, noisy(SINE, 0), noisy(SINE, 1)):
        plan = invert_optimal(SERVO, path, load=load)
        assert reversals(plan.requests) == reversals(path) == 1 + 1
        assert plan.rms < (ENCODER_STEP if path is SINE else 0.1 * SERVO.dead_band)


@pytest.mark.parametrize("load", [None, LOAD], ids=["no load", "gravity"])
def test_at_holds_requests_return_to_the_middle_of_the_dead_band_and_the_joint_rests(load):
    """With noise on the path they turn back for it, within the dead band."""
    sag = SERVO.sag(0.0 if load is None else load)
    for path in (HOLDS, noisy(HOLDS, 0), noisy(HOLDS, 1)):
        plan = invert_optimal(SERVO, path, load=load)
        assert reversals(plan.requests) <= 12
        assert plan.rms < (ENCODER_STEP if path is SINE else 0.1 * SERVO.dead_band)
        middle = plan.requests + sag - plan.predicted
        held = slice(SAMPLES // 4 - 8, SAMPLES // 4 + 8)  # in the middle of the hold
        assert np.max(np.abs(middle[held][2:-2])) < SERVO.dead_band
        if path is HOLDS:
            assert np.max(np.abs(middle[held][4:-4])) < 0.25 * SERVO.dead_band
        assert np.ptp(plan.predicted[held]) < (1e-9 if load is None else 0.02 * SERVO.dead_band)


def test_without_dry_friction_every_reversal_is_followed():
    path = SINE + 5.0 * (noisy(SINE, 0) - SINE)  # beyond an encoder's step
    plan = invert_optimal(replace(SERVO, dead_band=0.0), path)
    assert plan.rms < 5.0 * NOISE / 2.0


def test_a_rough_path_is_followed_as_well_as_by_the_closed_form_whatever_the_dead_band():
    """Reversals of a fifth of the dead band are those of the path, not noise."""
    servo = replace(SERVO, dead_band=np.radians(7.1))
    path = SINE[::3] + 0.15 * servo.dead_band * np.sin(9.0 * PHASE[::3] + 0.5)
    other = invert_closed_form(servo, path, rule="exact")
    exact, plan = (invert_optimal(servo, path, smoothness=share) for share in (0.0, 0.005))
    assert exact.rms <= other.rms
    assert plan.rms <= max(1.005 * exact.rms, ENCODER_STEP)
