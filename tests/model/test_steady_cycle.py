"""The steady cycle: what its Newton step solves; cycles themselves are in test_response.py."""

from __future__ import annotations

import numpy as np
import pytest

from planner.model import steady_cycle
from planner.model.steady_cycle import SINGULAR
from tests.from_python import from_python

shortest_solution = from_python(steady_cycle.shortest_solution)

SAME = 1e-9
"""Two ways to solve two equations whose matrix has a condition of up to 1 / SINGULAR."""


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("ratio", [1.0, 0.1, 1e-4, 0.1 * SINGULAR, 0.0])
def test_the_shortest_solution_is_that_of_a_singular_value_decomposition(ratio, seed):
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(2, 2)))[0] for _ in range(2))
    matrix = left @ np.diag([2.0, 2.0 * ratio]) @ right
    target = rng.normal(size=2)
    expected = np.linalg.lstsq(matrix, target, rcond=SINGULAR)[0]
    np.testing.assert_allclose(shortest_solution(*matrix.ravel(), *target), expected, rtol=SAME)


@pytest.mark.parametrize("matrix", [np.diag([0.0, 3.0]), np.diag([3.0, 0.0]), np.zeros((2, 2))])
def test_an_unknown_that_does_nothing_is_left_alone(matrix):
    solution = shortest_solution(*matrix.ravel(), 1.0, 6.0)
    np.testing.assert_allclose(solution, np.linalg.pinv(matrix) @ [1.0, 6.0])
