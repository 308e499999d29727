"""Steps whose requests are coupled: limits as an active set, and as conditions."""

from __future__ import annotations

import numpy as np
import pytest

from planner.planning import qp_step as module
from planner.planning.gauss_newton import Stage, iterate
from planner.planning.kkt_step import Damping
from planner.planning.qp_step import qp_step
from planner.planning.tracking_problem import track
from tests.instances import random_model, saturating

SAME = 1e-6
"""Relative difference of two costs: with conditions they are met to a tolerance of 1e-8, which the
multipliers turn into a few 1e-7 of the cost."""

DAMPING = 1e-3
"""Levenberg-Marquardt weight, which counts in the cost of a step."""


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("seed", range(8))
def test_requests_held_at_limits_cost_what_limits_as_conditions_do(seed, cyclic, monkeypatch):
    rng = np.random.default_rng([47, seed])
    model = random_model(rng, whole=True)
    desired = saturating(rng, model, samples=40)
    limits = tuple(np.quantile(desired, [0.4, 0.6]))
    start = None if cyclic else float(np.clip(desired[0], *limits))
    weight = 10.0 ** rng.uniform(-3.0, 1.0)
    steps, costs = [], []
    for rounds in (module.ACTIVE_SET_ROUNDS, 0):
        monkeypatch.setattr(module, "ACTIVE_SET_ROUNDS", rounds)
        problem = track(model, desired, cyclic=cyclic, limits=limits, start=start)
        requests = problem.admissible(desired[:, np.newaxis])
        stage = Stage(0.05, weight, smoothing=True)
        current = iterate(problem, requests, desired[:, np.newaxis], stage)
        damping = Damping(np.full_like(requests, DAMPING), np.zeros_like(requests))
        step = qp_step(problem, current, damping)
        after = requests + step.requests
        assert np.all(after >= limits[0] - module.TOLERANCE)
        assert np.all(after <= limits[1] + module.TOLERANCE)
        steps.append(step.requests)
        costs.append(step.predicted + DAMPING * float(np.sum(step.requests**2)))
    at_limits = [np.isclose(requests + steps[0], limit, rtol=0.0, atol=1e-12) for limit in limits]
    assert np.any(at_limits)
    assert costs[0] == pytest.approx(costs[1], rel=SAME)
