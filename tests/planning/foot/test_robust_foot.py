"""Plans for a foot whose joints may have any of several models."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planner import invert_foot, reference_walk
from planner.arrays import error_norm
from planner.model.evidence import Evidence
from planner.planning.candidate_models import drawn_models
from planner.planning.task import models_of_joints
from tests.instances import ERS210A
from tests.plans import foot_distances

LEG = reference_walk().leg

SLOWER = ERS210A.with_evidence(Evidence(intervals={"v_max": (4.0, 5.6), "lag": (0.03, 0.034)}))

OTHERS = tuple(
    replace(ERS210A, lag=lag, v_max=speed * ERS210A.v_max)
    for lag, speed in ((0.04, 1.0), (0.04, 0.85))
)

MODELS = [(ERS210A, *OTHERS), (ERS210A,), (ERS210A, *OTHERS[::-1])]
"""Three models of the rotator and of the knee; the abductor is known."""


@cache
def path():
    """A foot path that saturates no joint of the ERS-210A, but some of the slower ones [m]."""
    phase = 2.0 * np.pi * np.arange(30) / 30
    swing = np.column_stack([np.sin(phase), 0.0 * phase, np.cos(phase)])
    return LEG.foot_positions(np.radians([0.0, 20.0, 60.0]) + 0.15 * swing)


def errors(scenarios, plan, **options):
    """Errors of the foot in each scenario, by simulation joint by joint [m], (scenarios,)."""
    away = (foot_distances(plan, models=models, **options) for models in scenarios)
    return np.array([error_norm(each, plan.norm) for each in away])


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("norm", ["rms", "max"])
def test_the_foots_errors_over_several_models_are_smaller_than_under_a_plan_for_one(norm, cyclic):
    options = {"norm": norm, "cyclic": cyclic}
    alone = invert_foot(ERS210A, LEG, path(), **options)
    mean, worst = (
        invert_foot(MODELS, LEG, path(), robust=which, **options) for which in ("mean", "worst")
    )
    scenarios = tuple(zip(MODELS[0], [ERS210A] * 3, MODELS[2], strict=True))
    before = errors(scenarios, alone)
    for made, which in ((mean, "mean"), (worst, "worst")):
        assert made.plan.task.scenarios == scenarios
        assert made.plan.task.robust == which
        np.testing.assert_array_equal(made.nominal.requests, alone.requests)
        np.testing.assert_allclose(made.nominal.errors_of_models, before, rtol=0.0, atol=1e-11)
        expected = errors(scenarios, made)
        np.testing.assert_allclose(made.errors_of_models, expected, rtol=0.0, atol=1e-11)
        after = made.errors_of_models
        assert made.error == after[0]
        assert made.over_models == (after[0], np.sqrt(np.mean(after**2)), np.max(after))
        # The lesser of the two at least: from rest the largest error is that of the start.
        assert getattr(made.over_models, which) <= getattr(made.nominal.over_models, which)
    if cyclic:
        assert mean.over_models.mean <= 0.95 * mean.nominal.over_models.mean
        assert worst.over_models.worst <= 0.85 * worst.nominal.over_models.worst


def test_every_model_is_judged_under_the_load_that_it_feels():
    soft = replace(ERS210A, compliance=0.05)
    load = np.array([0.3, 0.2, -0.4])
    made = invert_foot([(ERS210A, soft), (ERS210A,), (soft, ERS210A)], LEG, path(), load=load)
    scenarios = ((ERS210A, ERS210A, soft), (soft, ERS210A, ERS210A))
    under = type(made)(made.plan.under(np.tile(load, (30, 1))))
    for plan in (made, made.nominal, under):
        expected = errors(scenarios, plan, loads=load)
        np.testing.assert_allclose(plan.errors_of_models, expected, rtol=0.0, atol=1e-11)
    assert made.plan.task.loads[1] is None  # no model of the abductor feels it


def test_joints_with_the_same_model_share_what_is_not_known_of_it_and_others_do_not():
    other = replace(SLOWER, lag=0.033).with_evidence(SLOWER.evidence)
    one, two, three = models_of_joints([SLOWER, other, SLOWER], "abc", "worst", independent=True)
    assert one == three == drawn_models(SLOWER)
    assert two[0] == other
    assert two == drawn_models(other, seed=1)
    speeds = np.array([[each.v_max for each in models] for models in (one, two)])
    assert not np.allclose(np.sort(speeds[0]), np.sort(speeds[1]))
    for pair in range(4):  # on either side of the nominal models, of all joints at once
        lags = [[models[1 + 2 * pair + side].lag for side in (0, 1)] for models in (one, two)]
        for (below, above), middle in zip(lags, (SLOWER.lag, 0.033), strict=True):
            assert (below - middle) * (above - middle) < 0.0
