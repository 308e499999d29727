"""The banded Gauss-Newton step against a dense solution of the same problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import block_diag

from planner.model.joint import RequestAges, request_ages
from planner.model.sensitivity import Response
from planner.planning.kkt_step import (
    Damping,
    Iterate,
    Quadratic,
    Regularisation,
    kkt_step,
    schur_band,
)
from planner.planning.tracking_problem import Windows, windows_of
from planner.trajectory import Array
from tests.instances import random_model

AGREEMENT = 1e-8
"""Two routes through a matrix of condition 1e6 or so [relative]."""

ROUNDING = 1e-11
"""Sums of a few hundred products, taken in two orders [relative]."""


@dataclass(frozen=True)
class Problem:
    """One random step, its arguments by name."""

    ages: RequestAges
    windows: Windows
    response: Response
    cost: Quadratic
    regularisation: Regularisation
    defects: Array
    damping: Damping
    free: np.ndarray

    def solve(self):
        nowhere = np.zeros_like(self.defects)
        current = Iterate(
            nowhere, nowhere, self.response, self.defects, self.cost, self.regularisation, 0.0
        )
        return kkt_step(self.windows, current, self.damping, free=self.free)

    def value(self, requests: Array, angles: Array) -> float:
        """The cost after a change, without the damping: term by term."""
        total = self.cost.value
        for k, change in enumerate(angles):
            total += 2.0 * self.cost.gradient[k] @ change
            total += change @ self.cost.curvature[k] @ change
        penalty = self.regularisation.weight * np.sum((self.regularisation.away + requests) ** 2)
        return float(total + penalty)


def random_problem(rng, samples, joints, *, hold=1, cyclic=True):
    """A step for joints of different request ages: zeros where a joint does not feel a request."""
    models = [
        random_model(rng, whole=bool(rng.integers(2)), hold=1 + (hold - 1) * (joint == 0))
        for joint in range(joints)
    ]
    ages = [request_ages(model) for model in models]
    union = RequestAges(min(r.youngest for r in ages), max(r.oldest for r in ages))
    by_angle = rng.uniform(-0.2, 1.0, size=(samples, joints))
    by_request = np.zeros((union.width, samples, joints))
    for joint, own in enumerate(ages):
        felt = slice(own.youngest - union.youngest, own.oldest + 1 - union.youngest)
        by_request[felt, :, joint] = rng.uniform(0.0, 1.0 / own.width, (own.width, samples))
    free = rng.random((samples, joints)) < 0.8
    free[-1] = True
    if not cyclic:
        by_angle[0] = 0.0  # nothing before the first sample can change
        free[0] = False
    roots = rng.normal(size=(samples, joints, joints))
    definite = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(joints)
    return Problem(
        ages=union,
        windows=Windows(union, samples, joints, cyclic=cyclic),
        response=Response(np.empty(0), by_angle, None, by_request, np.empty(0)),
        cost=Quadratic(float(rng.uniform(1.0, 9.0)), rng.normal(size=(samples, joints)), definite),
        regularisation=Regularisation(
            float(10.0 ** rng.uniform(-5, -2)), rng.normal(size=(samples, joints)), rng.normal()
        ),
        defects=rng.normal(size=(samples, joints)),
        damping=Damping(
            10.0 ** rng.uniform(-4, 0, (samples, joints)), rng.uniform(0.0, 1.0, (samples, joints))
        ),
        free=free,
    )


def dense_matrices(problem):
    """B and H of ``B d angles = H d requests``, the joints of one sample side by side."""
    width, samples, joints = problem.response.by_request.shape
    B, H = np.eye(samples * joints), np.zeros((samples * joints, samples * joints))
    for k in range(samples):
        for i in range(joints):
            row = k * joints + i
            if k > 0 or problem.windows.cyclic:
                B[row, (k - 1) % samples * joints + i] -= problem.response.by_own[k, i]
            for j in range(width):
                request = problem.windows.acting[j, k]
                if request >= 0:
                    H[row, request * joints + i] += problem.response.by_request[j, k, i]
    return B, H


def dense_step(problem):
    """Normal equations of the step, with d angles = J d requests + c spelled out."""
    B, H = dense_matrices(problem)
    free = problem.free.ravel()
    J = np.linalg.solve(B, H)[:, free]
    caught_up = np.linalg.solve(B, problem.defects.ravel())
    C = block_diag(*problem.cost.curvature) + np.diag(problem.damping.angles.ravel())
    weight, away, _ = problem.regularisation
    quadratic = J.T @ C @ J + np.diag(weight + problem.damping.requests.ravel()[free])
    gradient = problem.cost.gradient.ravel() + C @ caught_up
    right = -J.T @ gradient - weight * away.ravel()[free]
    change = np.zeros(len(free))
    change[free] = np.linalg.solve(quadratic, right)
    return change.reshape(away.shape), (J @ change[free] + caught_up).reshape(away.shape)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("hold", [1, 2, 3, 4])
@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.parametrize("samples", [2, 3, 4, 5, 8, 13, 30, 60])
def test_the_step_is_the_dense_solution(samples, joints, hold, cyclic):
    rng = np.random.default_rng([samples, joints, hold, cyclic])
    for _ in range(2):
        problem = random_problem(rng, samples, joints, hold=hold, cyclic=cyclic)
        step = problem.solve()
        requests, angles = dense_step(problem)
        scale = max(1.0, float(np.max(np.abs(requests))))
        np.testing.assert_allclose(step.requests, requests, rtol=0.0, atol=AGREEMENT * scale)
        np.testing.assert_allclose(step.angles, angles, rtol=0.0, atol=AGREEMENT * scale)


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("joints", [1, 3])
@pytest.mark.parametrize("samples", [2, 5, 40])
def test_the_predicted_cost_is_that_of_the_proposed_change(samples, joints, cyclic):
    rng = np.random.default_rng([samples, joints, cyclic])
    problem = random_problem(rng, samples, joints, cyclic=cyclic)
    step = problem.solve()
    assert step.predicted == pytest.approx(problem.value(step.requests, step.angles), rel=1e-12)


@pytest.mark.parametrize("joints", [1, 3])
def test_without_defects_a_step_is_predicted_to_help(joints):
    problem = random_problem(np.random.default_rng(joints), 40, joints)
    problem.defects[:] = 0.0
    nothing = np.zeros((40, joints))
    assert problem.solve().predicted < problem.value(nothing, nothing)


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_no_shorter_or_longer_step_is_better(joints):
    problem = random_problem(np.random.default_rng(joints), 40, joints, hold=2)
    problem.defects[:] = 0.0
    step = problem.solve()

    def damped(share):
        requests, angles = share * step.requests, share * step.angles
        held_back = np.sum(problem.damping.requests * requests**2)
        held_back += np.sum(problem.damping.angles * angles**2)
        return problem.value(requests, angles) + held_back

    assert damped(1.0) < min(damped(0.9), damped(1.1), damped(0.0))


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_a_request_that_is_not_free_does_not_move(cyclic):
    problem = random_problem(np.random.default_rng(3), 30, 3, cyclic=cyclic)
    assert not problem.free.all()
    step = problem.solve()
    assert np.all(step.requests[~problem.free] == 0.0)
    assert np.all(step.reduced_gradient[~problem.free] != 0.0)


def test_a_request_that_may_move_goes_where_it_is_pushed():
    problem = random_problem(np.random.default_rng(5), 30, 2)
    step, free = problem.solve(), problem.free
    weights = problem.regularisation.weight + problem.damping.requests
    np.testing.assert_allclose(
        (step.requests * weights)[free], -step.reduced_gradient[free], rtol=ROUNDING
    )


def test_a_step_with_nothing_free_goes_nowhere():
    problem = random_problem(np.random.default_rng(4), 12, 2)
    problem.free[:] = False
    problem.defects[:] = 0.0
    step = problem.solve()
    assert np.all(step.requests == 0.0)
    np.testing.assert_allclose(step.angles, 0.0, rtol=0.0, atol=ROUNDING)


def test_joints_that_the_cost_does_not_couple_are_solved_one_by_one():
    problem = random_problem(np.random.default_rng(6), 25, 3)
    for own, other in ((0, 1), (0, 2), (1, 2)):
        problem.cost.curvature[:, [own, other], [other, own]] = 0.0
    together = problem.solve()
    for joint in range(3):
        only = slice(joint, joint + 1)
        response, cost, term = problem.response, problem.cost, problem.regularisation
        alone = Problem(
            ages=problem.ages,
            windows=Windows(problem.ages, 25, 1, cyclic=True),
            response=response._replace(
                by_own=response.by_own[:, only], by_request=response.by_request[..., only]
            ),
            cost=Quadratic(0.0, cost.gradient[:, only], cost.curvature[:, only, only]),
            regularisation=term._replace(away=term.away[:, only]),
            defects=problem.defects[:, only],
            damping=Damping(*(weights[:, only] for weights in problem.damping)),
            free=problem.free[:, only],
        ).solve()
        np.testing.assert_allclose(together.requests[:, only], alone.requests, atol=AGREEMENT)


def test_a_cost_that_curves_downward_is_refused():
    problem = random_problem(np.random.default_rng(7), 20, 2)
    problem.cost.curvature[:] *= -1.0
    with pytest.raises(np.linalg.LinAlgError, match="definite"):
        problem.solve()


@pytest.mark.parametrize("joints", [1, 3])
def test_the_band_of_a_cycle_is_no_wider_than_twice_that_from_rest(joints):
    at = request_ages(random_model(np.random.default_rng(1)))
    assert at.width > 2
    straight = schur_band(Windows(at, 500, joints, cyclic=False)).bandwidth
    assert straight == (at.width - 1) * joints
    assert (
        straight
        < schur_band(Windows(at, 500, joints, cyclic=True)).bandwidth
        < 2 * at.width * joints
    )
    # Angles follow one another even where only one request acts.
    assert (
        schur_band(Windows(RequestAges(3, 3), 500, joints, cyclic=False)).bandwidth
        == 2 * joints - 1
    )


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("samples", [2, 5, 40])
def test_what_is_gathered_is_the_transpose_of_what_is_felt(samples, cyclic):
    rng = np.random.default_rng([8, samples, cyclic])
    for joints in (1, 2, 3):
        problem = random_problem(rng, samples, joints, cyclic=cyclic)
        _, H = dense_matrices(problem)
        change, multipliers = rng.normal(size=(2, samples, joints))
        by_request = problem.response.by_request
        forward = (by_request * problem.windows.spread(change)).sum(axis=0)
        backward = problem.windows.gathered(by_request * multipliers)
        np.testing.assert_allclose(forward.ravel(), H @ change.ravel(), atol=ROUNDING)
        np.testing.assert_allclose(backward.ravel(), H.T @ multipliers.ravel(), atol=ROUNDING)


def test_windows_hold_the_requests_that_act_youngest_first():
    requests = np.arange(12.0).reshape(6, 2)
    cycle = Windows(RequestAges(1, 3), 6, 2, cyclic=True).of(requests)
    np.testing.assert_array_equal(cycle[:, 0, 0], requests[[5, 4, 3], 0])
    np.testing.assert_array_equal(cycle[:, 4, 1], requests[[3, 2, 1], 1])
    resting = Windows(RequestAges(1, 3), 6, 2, cyclic=False).of(requests)
    np.testing.assert_array_equal(resting[:, 1, 0], requests[[0, 0, 0], 0])
    np.testing.assert_array_equal(resting[:, 4, 1], requests[[3, 2, 1], 1])


def test_windows_and_their_band_are_worked_out_once():
    windows = windows_of(RequestAges(2, 5), 30, 3, cyclic=True)
    assert windows is windows_of(RequestAges(2, 5), 30, 3, cyclic=True)
    assert windows is not windows_of(RequestAges(2, 5), 30, 3, cyclic=False)
    assert schur_band(windows) is schur_band(windows)
