"""Equation 3 in CasADi symbols against the kernel's and the paper's, and the kernel in threads."""

from __future__ import annotations

import casadi
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.model.joint import acting_requests
from planner.model.response import simulate
from planner.model.symbolic import period_function
from tests.strategies import models


@given(models(), st.integers(0, 2**32 - 1))
def test_every_request_said_to_act_acts_and_no_younger_one_does(model, seed):
    at = acting_requests(model)
    rng = np.random.default_rng(seed)
    # Small errors leave every term of the window unsaturated, so that each of them counts.
    windows = rng.uniform(-0.01, 0.01, size=(1, at.width)) * model.theta_0 - model.offset
    symbols = casadi.SX.sym("state", model.law.states), casadi.SX.sym("requests", at.width)
    reached = period_function(model)(*symbols, 0.0, 1e-9)
    by_request = casadi.jacobian(reached[0], symbols[1])
    slopes = casadi.Function("slopes", symbols, [by_request])(0.0, windows)
    assert np.all(np.asarray(slopes) != 0.0)

    k = at.oldest + 1
    requests = rng.uniform(-1.0, 1.0, size=k + 1)
    changed = requests.copy()
    changed[k - at.youngest + 1 :] += 1.0
    before = simulate(model, requests, cyclic=False)[k]
    assert simulate(model, changed, cyclic=False)[k] == before
