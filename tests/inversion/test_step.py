"""The banded Gauss-Newton step against a dense solution of the same problem."""

from __future__ import annotations

import numpy as np
import pytest

from planner.inversion.step import Stencil, gauss_newton_step
from planner.model.transition import Linearised, reach
from tests.instances import random_model

AGREEMENT = 1e-8
"""Two routes through a matrix of condition 1e6 or so [relative]."""


def dense_step(stencil, run, residuals, *, weights, pull, toward, damping, free):
    """Normal equations of the step, with d angles = J d requests spelled out."""
    n = len(residuals)
    B, H = np.eye(n), np.zeros((n, n))
    for k in range(n):
        if k > 0 or stencil.cyclic:
            B[k, k - 1] -= run.by_angle[k]
        for j, request in enumerate(stencil.acting[k]):
            if request >= 0:
                H[k, request] += run.by_request[k, j]
    J = np.linalg.solve(B, H)[:, free]
    quadratic = J.T @ (weights[:, None] * J) + np.diag((pull + damping)[free])
    right = -J.T @ (weights * residuals) + (pull * toward)[free]
    change = np.zeros(n)
    change[free] = np.linalg.solve(quadratic, right)
    return change, J @ change[free]


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("hold", [1, 2, 3, 4])
@pytest.mark.parametrize("samples", [2, 3, 4, 5, 8, 13, 30, 90])
def test_the_step_is_the_dense_solution(samples, hold, cyclic):
    rng = np.random.default_rng([samples, hold, cyclic])
    for _ in range(4):
        problem = _random_problem(rng, samples, hold, cyclic)
        stencil, run, residuals, options = problem
        step = gauss_newton_step(stencil, run, residuals, **options)
        requests, angles = dense_step(stencil, run, residuals, **options)
        scale = max(1.0, float(np.max(np.abs(requests))))
        np.testing.assert_allclose(step.requests, requests, rtol=0.0, atol=AGREEMENT * scale)
        np.testing.assert_allclose(step.angles, angles, rtol=0.0, atol=AGREEMENT * scale)


@pytest.mark.parametrize("cyclic", [True, False])
def test_a_request_that_is_not_free_does_not_move(cyclic):
    rng = np.random.default_rng(3)
    stencil, run, residuals, options = _random_problem(rng, 30, 1, cyclic)
    step = gauss_newton_step(stencil, run, residuals, **options)
    assert not options["free"].all()
    assert np.all(step.requests[~options["free"]] == 0.0)


def test_the_step_lowers_the_cost_that_it_was_made_for():
    rng = np.random.default_rng(5)
    stencil, run, residuals, options = _random_problem(rng, 40, 2, True)
    step = gauss_newton_step(stencil, run, residuals, **options)

    def cost(change, angles):
        away = change - options["toward"]
        return (
            options["weights"] @ (residuals + angles) ** 2
            + options["pull"] @ away**2
            + options["damping"] * change @ change
        )

    nothing = cost(np.zeros(40), np.zeros(40))
    least = cost(step.requests, step.angles)
    assert least < nothing
    assert cost(0.9 * step.requests, 0.9 * step.angles) > least
    assert cost(1.1 * step.requests, 1.1 * step.angles) > least


def test_the_band_of_a_long_cycle_is_no_wider_than_twice_the_reach():
    model = random_model(np.random.default_rng(1))
    stencil = Stencil(reach(model), 500, cyclic=True)
    assert stencil.bandwidth <= 2 * max(reach(model).width, 2)
    assert Stencil(reach(model), 500, cyclic=False).bandwidth < max(reach(model).width, 2)


def test_backward_is_the_transpose_of_forward():
    rng = np.random.default_rng(8)
    for cyclic in (True, False):
        for samples in (2, 5, 40):
            stencil, run, residuals, _ = _random_problem(rng, samples, 1, cyclic)
            change = rng.normal(size=samples)
            there = residuals @ stencil.forward(run.by_request, change)
            back = stencil.backward(run.by_request, residuals) @ change
            assert there == pytest.approx(back, rel=1e-9, abs=1e-12)


def _random_problem(rng, samples, hold, cyclic):
    model = random_model(rng, whole=bool(rng.integers(2)), hold=hold)
    stencil = Stencil(reach(model), samples, cyclic=cyclic)
    width = reach(model).width
    run = Linearised(
        angles=rng.normal(size=samples),
        by_angle=rng.uniform(-0.2, 1.0, size=samples),
        by_request=rng.uniform(0.0, 1.0 / width, size=(samples, width)),
    )
    free = rng.random(samples) < 0.8
    if not cyclic:
        run.by_angle[0] = 0.0  # nothing before the first sample can change
        run.by_request[stencil.acting < 0] = 0.0
        free[0] = False
    free[-1] = True
    options = {
        "weights": rng.uniform(0.1, 3.0, size=samples),
        "pull": rng.uniform(0.0, 1e-2, size=samples),
        "toward": rng.normal(size=samples),
        "damping": float(10.0 ** rng.uniform(-4, 0)),
        "free": free,
    }
    return stencil, run, rng.normal(size=samples), options
