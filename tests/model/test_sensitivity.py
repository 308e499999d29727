"""Derivatives: of the periods against CasADi's, of the angles against central differences."""

from __future__ import annotations

from dataclasses import replace

import casadi
import numpy as np
import pytest

from planner.exceptions import InvalidInput, InvalidTrajectory, NoSteadyCycle
from planner.model.joint import JointModel, request_ages
from planner.model.response import Motion, simulate
from planner.model.sensitivity import Periods, periods, request_ages_of_all, sensitivities
from planner.model.symbolic import period
from tests.instances import TICK, random_model, random_model_outside_equation_13

ERS210A = JointModel.ers210a()

SAME = 1e-13
"""Two routes through one period [rad]."""

STEP = 1e-5
"""Step of the central differences of slopes [rad]."""

SLOPES = 1e-6
"""Central differences on corners of radius 0.3 theta_0 are right to this."""

HALF_STEP = 1e-6
"""Half the distance of the central differences of angles [rad]."""

AGREEMENT = 1e-5
"""What is left of a cycle's 1e-12 rad after division by HALF_STEP, and room for amplification."""

HELD = pytest.mark.parametrize("hold", [1, 2, 3])


def stacked(seed, *, joints=3, samples=9, hold=1):
    """Joints of different lag, sag and tick, but of one period, and angles and requests."""
    rng = np.random.default_rng([seed, hold])
    models = [random_model(rng, whole=False, hold=hold, offset=True) for _ in range(joints)]
    models[0] = replace(models[0], tick=TICK / 2.0, hold=2 * hold)
    shape = (request_ages_of_all(models).width, samples, joints)
    errors = rng.uniform(-1.5, 1.5, shape) * [model.theta_0 for model in models]
    before = rng.uniform(-1.0, 1.0, (samples, joints))
    return models, before, before + errors - [model.offset for model in models]


def symbolic_period(model):
    """The period and its derivatives, written by CasADi, of angle, requests and radius."""
    angle, radius = casadi.SX.sym("angle"), casadi.SX.sym("radius")
    requests = casadi.SX.sym("requests", request_ages(model).width)
    after = period(model, angle, requests, radius=radius).angle
    slopes = [casadi.jacobian(after, angle), casadi.jacobian(after, requests)]
    return casadi.Function("period", [angle, requests, radius], [after, *slopes])


@HELD
@pytest.mark.parametrize("smoothing", [0.0, 0.01, 0.4])
def test_every_period_and_its_derivatives_are_those_that_casadi_writes(smoothing, hold):
    models, before, windows = stacked(1, hold=hold)
    together = Periods(models, len(before))(before, windows, smoothing)
    for joint, model in enumerate(models):
        own, union = request_ages(model), request_ages_of_all(models)
        felt = slice(own.youngest - union.youngest, own.oldest + 1 - union.youngest)
        written = symbolic_period(model)
        for k in range(len(before)):
            window = windows[felt, k, joint]
            # A corner that is not rounded at all has no derivative; none is met here.
            radius = max(smoothing * model.theta_0, 1e-150)
            answers = written(before[k, joint], window, radius)
            after, by_angle, by_request = (np.asarray(a).ravel() for a in answers)
            assert together.reached[k, joint] == pytest.approx(after[0], abs=SAME)
            assert together.by_own[k, joint] == pytest.approx(by_angle[0], abs=SAME)
            np.testing.assert_allclose(
                together.by_request[felt, k, joint], by_request, rtol=0.0, atol=SAME
            )


@HELD
def test_requests_of_ages_that_do_not_act_on_a_joint_do_not_move_it(hold):
    models, before, windows = stacked(2, hold=hold)
    response = Periods(models, len(before))(before, windows, 0.1)
    each = [request_ages(model) for model in models]
    assert len(set(each)) > 1
    ages = request_ages_of_all(models).youngest + np.arange(len(windows))
    for joint, own in enumerate(each):
        beyond = (ages < own.youngest) | (ages > own.oldest)
        assert np.all(response.by_request[beyond, :, joint] == 0.0)
        assert np.all(response.bending[beyond, :, joint] == 0.0)


def test_the_bending_is_the_slope_of_the_slopes():
    models, before, windows = stacked(3)
    models[0] = ERS210A  # the bending by requests that are held is an estimate
    windows = windows[: request_ages_of_all(models).width]
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


def differences(model, requests, **options):
    """Central differences of the angles, shape (n, n)."""
    columns = []
    for j in range(len(requests)):
        ahead, behind = requests.copy(), requests.copy()
        ahead[j] += HALF_STEP
        behind[j] -= HALF_STEP
        change = simulate(model, ahead, **options) - simulate(model, behind, **options)
        columns.append(change / (2.0 * HALF_STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("hold", [1, 3])
@pytest.mark.parametrize("samples", [2, 3, 24, 60])
@pytest.mark.parametrize(
    "options",
    [{"cyclic": True}, {"cyclic": False}, {"cyclic": False, "start": 0.05}],
    ids=["cyclic", "from rest", "from a start"],
)
def test_sensitivities_are_the_slopes_of_the_simulation(options, samples, hold):
    rng = np.random.default_rng([samples, hold])
    model = random_model(rng, whole=False, hold=hold, offset=True)
    requests = rng.uniform(-1.5, 1.5, size=samples) * model.theta_0
    np.testing.assert_allclose(
        sensitivities(model, requests, **options),
        differences(model, requests, **options),
        rtol=0.0,
        atol=AGREEMENT,
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cyclic", [True, False])
def test_sensitivities_hold_for_joints_outside_equation_13(cyclic, seed):
    rng = np.random.default_rng(seed)
    model = random_model_outside_equation_13(rng)
    requests = rng.uniform(-1.0, 1.0, size=20) * model.theta_0
    np.testing.assert_allclose(
        sensitivities(model, requests, cyclic=cyclic),
        differences(model, requests, cyclic=cyclic),
        rtol=0.0,
        atol=AGREEMENT,
    )


@pytest.mark.parametrize("error", [0.015, 0.04, 0.062, 0.066, 0.068, 0.08])
def test_the_first_speed_from_rest_is_limited_by_the_drive_and_not_by_the_steady_speed(error):
    model = JointModel(
        v_max=5.0,
        theta_0=0.1,
        lag=0.016,
        acceleration_time=0.024,
        dead_band=0.01,
        max_acceleration=400.0,  # of a drive whose error is 0.064 rad
    )
    options = {"cyclic": False, "start": 0.0}
    requests = np.full(6, error)
    np.testing.assert_allclose(
        sensitivities(model, requests, **options),
        differences(model, requests, **options),
        rtol=0.0,
        atol=AGREEMENT,
    )


@pytest.mark.parametrize("cyclic", [True, False])
def test_raising_every_request_raises_every_angle_by_as_much(cyclic):
    rng = np.random.default_rng(11)
    requests = rng.uniform(-0.3, 0.3, size=30)
    derivatives = sensitivities(JointModel.ers210a(), requests, cyclic=cyclic)
    np.testing.assert_allclose(derivatives.sum(axis=1), 1.0, rtol=0.0, atol=1e-12)


def test_at_a_corner_the_derivative_is_the_mean_of_both_sides():
    model = JointModel(v_max=3.125, theta_0=0.125, lag=0.0, acceleration_time=0.008, tick=0.008)
    inside = model.v_max_per_tick / model.theta_0  # slope of f below the corner; 0 above it
    # The second request acts on the third sample from exactly theta_0 away.
    requests = np.array([0.0, 0.125, 0.0])
    derivatives = sensitivities(model, requests, cyclic=False)
    assert derivatives[2, 1] == pytest.approx(inside / 2.0, rel=1e-12)


def test_a_cycle_without_a_derivative_is_an_error(monkeypatch):
    # Between saturated requests the joint may rest anywhere in a range; put it in its middle.
    monkeypatch.setattr(
        "planner.model.sensitivity.motion_under",
        lambda *_arguments, **_options: Motion(np.zeros(2), np.zeros(2)),
    )
    with pytest.raises(NoSteadyCycle):
        sensitivities(JointModel.ers210a(), [5.0, -5.0])


def test_bad_requests_and_starts_are_refused_as_by_the_simulation():
    with pytest.raises(InvalidTrajectory, match="requests"):
        sensitivities(JointModel.ers210a(), [0.0, np.nan])
    with pytest.raises(InvalidInput, match="start"):
        sensitivities(JointModel.ers210a(), [0.0, 0.1], start=0.0)
