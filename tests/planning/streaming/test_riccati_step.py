"""The step of a stream solves the normal equations of the cost that the exact models have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.model.joint import request_ages
from planner.model.sensitivity import Periods, request_ages_of_all
from planner.planning.streaming.riccati_step import Plans, Terms
from tests.instances import random_model

SAMPLES, TRIALS, RADIUS = 30, 2, 0.2
LOWER, UPPER, RATE, SMOOTHING = -0.3, 0.4, 0.4, 2e-3
TERMS = Terms(exceeding=10.0, resting=1e-4, radii=(RADIUS,) * SAMPLES)


def joints(seed):
    """Joints with windows of different lengths, the second with friction and a load."""
    rng = np.random.default_rng(seed)
    one, two = (random_model(rng, whole=False, offset=True) for _ in range(2))
    if seed == 2:  # one request acts between two samples
        return [replace(one, lag=0.0, acceleration_time=0.004)]
    if seed == 1:
        one, two = (replace(each, hold=3) for each in (one, two))
    two = replace(two, dead_band=0.1 * two.theta_0, compliance=0.02)
    if seed == 3:
        one = replace(one, time_constant=0.02, max_acceleration=40.0 * one.v_max)
        two = replace(two, time_constant=0.03)
    return [one, two]


def filled(models, seed, *, begins=False):
    """Plans that reach limits and the largest step, at angles that their goals are not at."""
    rng = np.random.default_rng(seed)
    plans = Plans(models, request_ages_of_all(models), TERMS, trials=TRIALS)
    plans.starts[:] = rng.normal(0.0, 0.1, plans.starts.shape)
    plans.speeds[:] = rng.normal(0.0, 0.005, plans.speeds.shape)
    plans.loads[:] = rng.uniform(-0.5, 0.5, plans.loads.shape)
    plans.goal[:] = 2.0 * np.cos(0.2 * np.arange(SAMPLES))
    plans.weights[:, SAMPLES // 2 :] = 0.3
    plans.resting[:] = plans.goal
    plans.settings[:] = SMOOTHING, RATE, LOWER, UPPER
    plans.damping[:] = 1e-3, begins
    for requests in (plans.plan, plans.trials):
        requests[:] = np.clip(rng.normal(0.0, 0.4, requests.shape), LOWER, UPPER)
    every = np.arange(len(models))
    plans.step(every)
    plans.judge(every)
    return plans


def linearised(plans, models, joint, requests):
    """Exact angles under these requests, and their derivatives by those of the plan."""
    model, ages = models[joint], request_ages(models[joint])
    later = ages.youngest - request_ages_of_all(models).youngest
    youngest = np.arange(SAMPLES) - later  # of the plan's requests, that acts before each sample
    acting = youngest - np.arange(ages.width)[:, np.newaxis]
    windows = requests[plans.past + acting][:, :, np.newaxis]
    evaluate = Periods((model,), SAMPLES, (plans.loads[joint],))
    begin = np.array([[plans.starts[joint]]])
    begin = evaluate.states(begin, np.array([[plans.speeds[joint]]]))
    before = np.repeat(begin, SAMPLES + 1, axis=0)
    for i in range(SAMPLES):
        before[i + 1] = evaluate(before[:-1], windows, 0.0).reached[i]
    rounded = evaluate(before[:-1], windows, RADIUS)
    slopes = np.zeros((SAMPLES, before.shape[1], SAMPLES))
    for i in range(SAMPLES):
        slopes[i] = rounded.by_own[i][:, np.newaxis] * slopes[i - 1]
        if rounded.by_other is not None:
            slopes[i] += rounded.by_other[i][:, np.newaxis] * slopes[i - 1][::-1]
        for j in range(ages.width):
            if acting[j, i] >= 0:
                slopes[i, :, acting[j, i]] += rounded.by_request[j, i]
    return before[1:, 0], slopes[:, 0]


def normal_equations(plans, joint, requests, angles, slopes):
    """Cost, gradient and damped Gauss-Newton matrix, dense."""
    plan, weights = requests[plans.past :], plans.weights[joint]
    difference = np.eye(SAMPLES) - np.eye(SAMPLES, k=-1)
    changes = np.diff(requests[plans.past - 1 :])
    excess = changes - np.clip(changes, -RATE, RATE)
    errors, away = angles - plans.goal[joint], plan - plans.resting[joint]
    cost = np.sum(weights * errors**2) + SMOOTHING * np.sum(changes**2)
    cost += TERMS.exceeding * np.sum(excess**2) + TERMS.resting * np.sum(away**2)
    forces = SMOOTHING * changes + TERMS.exceeding * excess
    gradient = slopes.T @ (weights * errors) + difference.T @ forces + TERMS.resting * away
    per_change = SMOOTHING + TERMS.exceeding * (excess != 0.0)
    matrix = slopes.T @ (weights[:, np.newaxis] * slopes)
    matrix += difference.T @ (per_change[:, np.newaxis] * difference)
    matrix += (TERMS.resting + plans.damping[joint, 0]) * np.eye(SAMPLES)
    return cost, gradient, matrix


@pytest.mark.parametrize("begins", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_step_solves_the_normal_equations_of_the_requests_that_limits_leave_free(seed, begins):
    models = joints(seed)
    plans, fixed = filled(models, seed, begins=begins), 0
    for joint in range(len(models)):
        requests = plans.plan[joint]
        cost, gradient, matrix = normal_equations(
            plans, joint, requests, *linearised(plans, models, joint, requests)
        )
        plan = requests[plans.past :]
        free = ~((plan == LOWER) & (gradient > 0.0) | (plan == UPPER) & (gradient < 0.0))
        fixed += np.count_nonzero(~free)
        free[0] &= not begins
        step = np.zeros(SAMPLES)
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
        assert np.max(np.abs(plans.steps[joint] - step)) <= 1e-9 * np.max(np.abs(step))
        assert plans.costs[joint, 0] == pytest.approx(cost, rel=1e-10)
    assert fixed


def test_other_plans_are_judged_by_the_same_cost():
    models = joints(0)
    plans = filled(models, 0)
    for joint in range(len(models)):
        for number, requests in enumerate(plans.trials[joint], 1):
            angles, slopes = linearised(plans, models, joint, requests)
            cost, _, _ = normal_equations(plans, joint, requests, angles, slopes)
            assert plans.costs[joint, number] == pytest.approx(cost, rel=1e-10)


def test_joints_that_are_not_searched_are_left_alone():
    plans = filled(joints(0), 0)
    steps, costs = plans.steps.copy(), plans.costs.copy()
    plans.goal += 0.1
    plans.step(np.array([1]))
    plans.judge(np.array([1]))
    assert np.array_equal(plans.steps[0], steps[0])
    assert np.array_equal(plans.costs[0], costs[0])
    assert not np.array_equal(plans.steps[1], steps[1])
