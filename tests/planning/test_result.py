"""A plan judges itself: every figure follows from its requests and the exact model."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from planner.model.evidence import Evidence
from planner.model.joint import JointModel
from planner.planning.bounds.certify import lower_bound
from planner.planning.inversion import invert_optimal
from tests.instances import saturating
from tests.plans import inversion

ERS210A = JointModel.ers210a()


def plan_of(desired, requests, **options):
    return inversion(ERS210A, desired, requests, method="closed_form", **options)


@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("start", [None, 0.3])
def test_the_gap_is_the_error_over_the_bound_in_the_plans_own_norm(norm, start):
    cyclic = start is None
    desired = saturating(np.random.default_rng(1), ERS210A)
    requests = desired.copy()
    requests[0] = desired[0] if start is None else start
    plan = plan_of(desired, requests, norm=norm, cyclic=cyclic, start=start)
    bound = lower_bound(ERS210A, desired, cyclic=cyclic, norm=norm, start=start)
    assert plan.lower_bound == bound
    error = plan.rms if norm == "rms" else plan.max_error
    assert plan.gap == pytest.approx(error / bound - 1.0, rel=1e-12)
    assert plan.gap >= 0.0


def test_a_perfect_plan_has_no_gap():
    plan = plan_of(np.full(9, 0.2), np.full(9, 0.2))
    assert (plan.rms, plan.lower_bound, plan.gap) == (0.0, 0.0, 0.0)


def test_a_plan_that_misses_what_has_no_bound_has_an_infinite_gap():
    plan = plan_of(np.full(9, 0.2), np.full(9, 0.3))
    assert plan.lower_bound == 0.0
    assert plan.gap == math.inf


@pytest.mark.parametrize(
    ("requests", "excess"),
    [([0.0, 1.0, 0.5], 0.0), ([-0.2, 1.1, 0.5], 0.2), ([0.2, 1.3, 0.5], 0.3), ([0.5] * 3, 0.0)],
)
def test_the_excess_is_the_distance_beyond_the_desired_range(requests, excess):
    plan = plan_of([0.0, 1.0, 0.5], requests, cyclic=False, start=0.0)
    assert plan.excess == pytest.approx(excess)


def test_what_cycles_have_added_counts_in_the_bound_and_ends_what_the_model_promised():
    desired = saturating(np.random.default_rng(2), ERS210A)
    disturbance = 0.1 * np.roll(desired, 5)
    added = disturbance[:, np.newaxis]
    plan = replace(plan_of(desired, desired), disturbance=added)
    assert plan.lower_bound == lower_bound(ERS210A, desired - disturbance)
    tested = inversion(ERS210A.with_evidence(Evidence(0.01)), desired, desired)
    assert tested.expected.error > 0.01
    assert math.isnan(replace(tested, disturbance=added).expected.error)


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda plan: pickle.loads(pickle.dumps(plan))]
)
def test_a_copy_of_a_plan_is_read_only_too(copied):
    plan = invert_optimal(ERS210A, 0.3 * np.sin(np.linspace(0.0, 6.0, 30)), cyclic=False)
    assert plan.predicted.size
    again = copied(plan)
    for name in ("desired", "requests", "predicted"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name))
        with pytest.raises(ValueError, match="read-only"):
            getattr(again, name)[0] = 1.0
