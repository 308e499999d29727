"""All periods at once against the compiled run, and their derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.model.joint import JointModel
from planner.model.periods import Periods, periods, reach_of
from planner.model.transition import reach, transitions
from tests.instances import TICK, random_model

ERS210A = JointModel.ers210a()

SAME = 1e-13
"""Two routes through one period [rad]."""

STEP = 1e-5
"""Step of the central differences [rad]."""

SLOPES = 1e-6
"""Central differences on corners of radius 0.3 theta_0 are right to this."""

HELD = pytest.mark.parametrize("hold", [1, 2, 3])


def stacked(seed, *, joints=3, samples=9, hold=1):
    """Joints of different reach, sag and tick, but of one period, and angles and requests."""
    rng = np.random.default_rng([seed, hold])
    models = [random_model(rng, whole=False, hold=hold, offset=True) for _ in range(joints)]
    models[0] = replace(models[0], tick=TICK / 2.0, hold=2 * hold)
    shape = (reach_of(models).width, samples, joints)
    errors = rng.uniform(-1.5, 1.5, shape) * [model.theta_0 for model in models]
    before = rng.uniform(-1.0, 1.0, (samples, joints))
    return models, before, before + errors - [model.offset for model in models]


@HELD
@pytest.mark.parametrize("smoothing", [0.0, 0.01, 0.4])
def test_every_period_is_that_of_the_compiled_run(smoothing, hold):
    models, before, windows = stacked(1, hold=hold)
    together = Periods(models, len(before))(before, windows, smoothing)
    for joint, model in enumerate(models):
        own, union = reach(model), reach_of(models)
        felt = slice(own.youngest - union.youngest, own.oldest + 1 - union.youngest)
        for k in range(len(before)):
            window = windows[felt, k, joint]
            # A corner that is not rounded at all has no derivative; none is met here.
            run = transitions(model, 1).run(
                before[k, joint], window[np.newaxis], smoothing * model.theta_0
            )
            assert together.reached[k, joint] == pytest.approx(run.angles[0], abs=SAME)
            assert together.by_angle[k, joint] == pytest.approx(run.by_angle[0], abs=SAME)
            np.testing.assert_allclose(
                together.by_request[felt, k, joint], run.by_request[0], rtol=0.0, atol=SAME
            )


@HELD
def test_requests_beyond_a_joints_own_reach_do_not_move_it(hold):
    models, before, windows = stacked(2, hold=hold)
    response = Periods(models, len(before))(before, windows, 0.1)
    reaches = [reach(model) for model in models]
    assert len(set(reaches)) > 1
    ages = reach_of(models).youngest + np.arange(len(windows))
    for joint, own in enumerate(reaches):
        beyond = (ages < own.youngest) | (ages > own.oldest)
        assert np.all(response.by_request[beyond, :, joint] == 0.0)
        assert np.all(response.bending[beyond, :, joint] == 0.0)


def test_the_bending_is_the_slope_of_the_slopes():
    models, before, windows = stacked(3)
    models[0] = ERS210A  # the bending by requests that are held is an estimate
    windows = windows[: reach_of(models).width]
    every = Periods(models, len(before))
    response = every(before, windows, 0.3)
    for j in range(len(windows)):
        push = np.zeros_like(windows)
        push[j] = STEP
        above, below = (every(before, windows + s * push, 0.3).by_request[j] for s in (1.0, -1.0))
        expected = (above - below) / (2.0 * STEP)
        np.testing.assert_allclose(response.bending[j], expected, rtol=0.0, atol=SLOPES)


def test_smoothing_is_measured_in_each_joints_own_errors():
    small = replace(ERS210A, v_max=ERS210A.v_max / 4.0, theta_0=ERS210A.theta_0 / 4.0)
    rng = np.random.default_rng(4)
    column, windows = rng.normal(size=(30, 1)), rng.normal(size=(6, 30, 1))
    scale = np.array([1.0, 0.25])
    response = Periods([ERS210A, small], 30)(column * scale, windows * scale, 0.5)
    np.testing.assert_allclose(
        response.reached[:, 1], response.reached[:, 0] / 4.0, rtol=0.0, atol=SAME
    )


def test_the_same_joints_and_length_are_worked_out_once():
    assert periods((ERS210A,), 12) is periods((ERS210A,), 12)
    assert periods((ERS210A,), 12) is not periods((ERS210A, ERS210A), 12)
