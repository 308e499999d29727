"""The step of a stream solves the normal equations of the cost that the exact models have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.model.joint import acting_requests
from planner.model.law import State
from planner.planning import tick
from planner.planning.tick import EXCEEDING, JOINT, RESTING, SAMPLE, Problem
from tests.from_python import from_python
from tests.instances import random_model
from tests.model.rounded_periods import rounded_periods

cost, gauss_newton_step = from_python(tick.cost), from_python(tick.gauss_newton_step)

SAMPLES, RADIUS, DAMPING = 30, 0.2, 1e-3
LOWER, UPPER, RATE, SMOOTHING = -0.3, 0.4, 0.4, 2e-3


def joint(number):
    """A joint: plain, with friction, with inertia; the fifth with one request between samples."""
    rng = np.random.default_rng(number)
    model = random_model(rng, whole=False, offset=True)
    if number == 4:
        return replace(model, lag=0.0, acceleration_time=0.004)
    if number % 2:
        model = replace(model, dead_band=0.1 * model.theta_0, compliance=0.02, hold=3)
    if number > 1:
        model = replace(model, time_constant=0.02)
    return replace(model, max_acceleration=40.0 * model.v_max) if number == 3 else model


class Plan:
    """A plan that reaches limits and the largest step, at angles that its goal is not at."""

    def __init__(self, model, seed, *, begins=False):
        rng = np.random.default_rng(seed)
        self.model, self.begins = model, begins
        self.past = max(acting_requests(model).width - 1, 1)
        self.angle, self.speed = rng.normal(0.0, 0.1), rng.normal(0.0, 0.005)
        self.load = rng.uniform(-0.5, 0.5, SAMPLES)
        self.samples = np.zeros(SAMPLES, dtype=SAMPLE)
        self.samples["load_sag"] = model.compliance * self.load
        self.samples["faster"] = model.faster_per_tick(self.load)
        self.samples["goal"] = 2.0 * np.cos(0.2 * np.arange(SAMPLES))
        self.samples["count"] = np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.0, 0.3)
        self.samples["rounded"] = (model.law.gain * RADIUS * model.theta_0) ** 2
        self.resting = self.samples["goal"] - model.sag(self.load)
        self.samples["resting"] = self.resting
        self.requests = np.clip(rng.normal(0.0, 0.4, self.past + SAMPLES), LOWER, UPPER)
        joints = np.zeros(1, dtype=JOINT)
        joints["lower"], joints["upper"] = LOWER, UPPER
        joints["max_step"], joints["smoothing"] = RATE, SMOOTHING
        before, weights = State(self.angle, self.speed), acting_requests(model).weights[0]
        problem = Problem(joints[0], model.law, weights, self.samples, before, begins)
        self.step = np.zeros(SAMPLES)
        self.cost = gauss_newton_step(problem, self.requests, DAMPING, self.step)
        self.exact_cost = cost(problem, self.requests, np.inf)


def linearised(plan):
    """Exact angles under its requests, and their derivatives by those of the plan."""
    ages = acting_requests(plan.model)
    acting = np.arange(SAMPLES)[:, np.newaxis] - np.arange(ages.width)
    windows = plan.requests[plan.past + acting]

    def period(i, state, radius):
        at, during = slice(i, i + 1), plan.load[i : i + 1]
        angle, speed = state[np.newaxis].T
        return rounded_periods(plan.model, angle, windows[at], radius, moving=speed, load=during)

    state, slope = np.array([plan.angle, plan.speed]), np.zeros((2, SAMPLES))
    angles, slopes = np.empty(SAMPLES), np.empty((SAMPLES, SAMPLES))
    for i in range(SAMPLES):
        rounded = period(i, state, RADIUS)
        slope = rounded.by_state[0] @ slope
        for j in range(ages.width):
            if acting[i, j] >= 0:
                slope[:, acting[i, j]] += rounded.by_request[0, :, j]
        state = period(i, state, 0.0).states[0]
        angles[i], slopes[i] = state[0], slope[0]
    return angles, slopes


def normal_equations(plan, angles, slopes):
    """Cost, gradient and damped Gauss-Newton matrix, dense."""
    requests, weights = plan.requests[plan.past :], plan.samples["count"]
    difference = np.eye(SAMPLES) - np.eye(SAMPLES, k=-1)
    changes = np.diff(plan.requests[plan.past - 1 :])
    excess = changes - np.clip(changes, -RATE, RATE)
    errors, away = angles - plan.samples["goal"], requests - plan.resting
    cost = np.sum(weights * errors**2) + SMOOTHING * np.sum(changes**2)
    cost += EXCEEDING * np.sum(excess**2) + RESTING * np.sum(away**2)
    forces = SMOOTHING * changes + EXCEEDING * excess
    gradient = slopes.T @ (weights * errors) + difference.T @ forces + RESTING * away
    per_change = SMOOTHING + EXCEEDING * (excess != 0.0)
    matrix = slopes.T @ (weights[:, np.newaxis] * slopes)
    matrix += difference.T @ (per_change[:, np.newaxis] * difference)
    matrix += (RESTING + DAMPING) * np.eye(SAMPLES)
    return cost, gradient, matrix


@pytest.mark.parametrize("begins", [False, True])
@pytest.mark.parametrize("number", range(5))
def test_the_step_solves_the_normal_equations_of_the_requests_that_limits_leave_free(
    number, begins
):
    fixed = 0
    for seed in range(3):
        plan = Plan(joint(number), seed, begins=begins)
        cost, gradient, matrix = normal_equations(plan, *linearised(plan))
        assert plan.cost == pytest.approx(cost, rel=1e-10)
        assert plan.exact_cost == plan.cost  # to the last bit: equal plans are equally good
        requests = plan.requests[plan.past :]
        free = ~((requests == LOWER) & (gradient > 0.0) | (requests == UPPER) & (gradient < 0.0))
        fixed += np.count_nonzero(~free)
        free[0] &= not begins
        step = np.zeros(SAMPLES)
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
        assert np.max(np.abs(plan.step - step)) <= 1e-9 * np.max(np.abs(step))
    assert fixed
