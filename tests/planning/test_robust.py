"""Plans for several models of one joint."""

from dataclasses import replace

import numpy as np
import pytest

from planner import InvalidInput, Log, identify, invert_optimal, plan, simulate
from planner.arrays import error_norm
from planner.model.evidence import Evidence
from planner.planning.candidate_models import drawn_models
from tests.instances import ERS210A

SINE = 0.3 * np.sin(2.0 * np.pi * np.arange(60) / 60)

OTHERS = tuple(
    replace(ERS210A, lag=lag, acceleration_time=acceleration, v_max=speed * ERS210A.v_max)
    for lag, acceleration, speed in ((0.04, 0.048, 1.0), (0.04, 0.056, 0.9), (0.048, 0.06, 1.0))
)

MODELS = (ERS210A, *OTHERS)

SLOWER = ERS210A.with_evidence(
    Evidence(
        intervals={
            "v_max": (4.2, ERS210A.v_max),
            "gain": (-np.inf, np.inf),
            "lag": (0.029, 0.035),
            "acceleration_time": (0.04, 0.056),
        },
        correlations=tuple(
            map(tuple, [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, -0.9], [0, 0, -0.9, 1.0]])
        ),
    )
)
"""A joint that may be slower than its model, with a gain, v_max / theta_0, that is known."""


@pytest.fixture(scope="module")
def identified():
    """What a noisy log of the joint tells."""
    rng = np.random.default_rng(3)
    requests = np.repeat(rng.uniform(-0.6, 0.6, 12), 25)
    angles = simulate(ERS210A, requests, cyclic=False, start=float(requests[0]))
    noisy = angles + rng.normal(scale=0.01, size=len(angles))
    times = ERS210A.tick * np.arange(len(angles))
    return identify(Log(times=times, requests=requests, angles=noisy))


def errors(models, requests, desired, *, norm="rms", **options):
    """Errors of the models under requests [rad]."""
    off = (simulate(each, requests, **options) - desired for each in models)
    return np.array([error_norm(each, norm) for each in off])


@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
@pytest.mark.parametrize("norm", ["rms", "max"])
def test_the_mean_and_the_worst_of_several_models_are_better_than_under_a_plan_for_one(
    norm, cyclic
):
    options = {"cyclic": cyclic, "norm": norm}
    alone = invert_optimal(ERS210A, SINE, **options)
    start = {} if cyclic else {"start": float(SINE[0])}
    before = errors(MODELS, alone.requests, SINE, norm=norm, cyclic=cyclic, **start)
    mean, worst = (
        invert_optimal(MODELS, SINE, robust=robust, **options) for robust in ("mean", "worst")
    )
    for made in (mean, worst):
        expected = errors(MODELS, made.requests, SINE, norm=norm, cyclic=cyclic, **start)
        np.testing.assert_allclose(made.errors_of_models, expected, rtol=0.0, atol=1e-12)
        assert made.error == made.errors_of_models[0]
        assert made.plan.task.models == (MODELS,)
        assert made.error >= made.lower_bound - 1e-9
    assert np.sum(mean.errors_of_models**2) <= np.sum(before**2)
    # From rest the largest error is that of the start, which no requests can lessen.
    assert worst.over_models.worst <= (0.8 if cyclic else 1.0) * np.max(before)
    assert worst.over_models.worst <= 1.01 * mean.over_models.worst
    assert (mean.plan.task.robust, worst.plan.task.robust) == ("mean", "worst")


def test_a_plan_for_an_identification_is_good_for_the_models_that_it_allows(identified):
    both = (identified.model, identified)
    alone, made = (invert_optimal(each, SINE, smoothness=0.0) for each in both)
    fresh = drawn_models(identified.model, pairs=12)[9:]
    before, after = (errors(fresh, each.requests, SINE) for each in (alone, made))
    # Either side of the nominal model is as likely, so that there is nothing to win: eight drawn
    # models stand for all of them up to 1 % of the error.
    assert np.max(after) <= 1.02 * np.max(before)
    assert np.sqrt(np.mean(after**2)) <= 1.01 * np.sqrt(np.mean(before**2))


def test_models_are_drawn_as_their_intervals_and_correlations_say():
    models = drawn_models(SLOWER, pairs=2000)
    speeds, lags, times = (
        np.array([getattr(each, name) for each in models])
        for name in ("v_max", "lag", "acceleration_time")
    )
    gains = np.array([each.gain for each in models])
    for values, (least, most) in ((lags, (0.029, 0.035)), (times, (0.04, 0.056))):
        assert least <= np.min(values) <= 0.95 * least + 0.05 * most
        assert most >= np.max(values) >= 0.05 * least + 0.95 * most
        # Of a normal distribution that is cut off at its 95 %, half lie within 0.642 deviations.
        half = np.abs(values - values[0]) <= 0.642 / 1.96 * np.where(
            values > values[0], most - values[0], values[0] - least
        )
        assert np.mean(half) == pytest.approx(0.5, abs=0.03)
    assert np.corrcoef(lags, times)[0, 1] == pytest.approx(-0.9, abs=0.05)
    assert 4.2 <= np.min(speeds) <= 4.3
    assert np.max(speeds) == SLOWER.v_max
    assert np.ptp(gains) <= 1e-12 * gains[0]  # theta_0 follows v_max
    assert {each.offset for each in models} == {0.0}


def test_what_cannot_be_below_0_leaves_the_others_drawn_as_their_correlations_say():
    """A lag and half a window whose sum is known to 0.3 ms, though each may be 0 to 20 ms."""
    late = replace(ERS210A, lag=0.001, acceleration_time=0.02)
    seen = Evidence(
        intervals={"lag": (0.0, 0.011), "acceleration_time": (0.0, 0.04)},
        correlations=((1.0, -0.9996), (-0.9996, 1.0)),
    )
    models = drawn_models(late.with_evidence(seen), pairs=200)
    delays = np.array([each.lag + each.acceleration_time / 2.0 for each in models])
    assert len(models) == 401
    assert np.ptp([each.lag for each in models]) > 0.009
    assert np.max(np.abs(delays - delays[0])) < 6e-4


@pytest.mark.parametrize("name", ["time_constant", "max_acceleration"])
def test_nothing_is_drawn_from_an_interval_that_tells_nothing(name):
    intervals = {name: (0.0, 0.01) if name == "time_constant" else (0.0, np.inf)}
    model = ERS210A.with_evidence(Evidence(intervals=intervals))
    with pytest.raises(InvalidInput, match="without intervals of its parameters"):
        drawn_models(model)


def test_no_model_is_drawn_that_hardly_accelerates():
    for least, slower in ((0.0, False), (60.0, True)):
        evidence = Evidence(intervals={"max_acceleration": (least, 335.0)})
        servo = replace(ERS210A, max_acceleration=156.0).with_evidence(evidence)
        accelerations = [each.max_acceleration for each in drawn_models(servo, pairs=20)]
        assert (min(accelerations) < 156.0) == slower
        assert 250.0 < max(accelerations) <= 335.0


def open_above(**others):
    """A joint of which a log tells that it is no slower than 4.2 rad/s, and how it begins."""
    return ERS210A.with_evidence(Evidence(intervals={"v_max": (4.2, np.inf), **others}))


@pytest.mark.parametrize("robust", ["mean", "worst"])
def test_a_plan_for_an_open_top_speed_bears_joints_that_are_faster_than_the_model(robust):
    """The desired angles are too fast for the model, and would be overshot by a faster joint."""
    model = open_above(gain=(44.0, 45.3), lag=(0.031, 0.033))
    too_fast = 0.55 * np.sin(2.0 * np.pi * np.arange(60) / 60)
    made = invert_optimal(model, too_fast, robust=robust)
    others = [
        replace(model, v_max=factor * model.v_max, theta_0=factor * model.theta_0)
        for factor in (0.85, 1.3, 2.0, 10.0)
    ]
    before, after = (errors(others, each.requests, too_fast) for each in (made.nominal, made))
    assert np.max(after) <= 0.6 * np.max(before)


def test_plan_takes_several_models_of_one_joint_or_of_each(identified):
    one = plan(MODELS, SINE, robust="worst")
    alone = invert_optimal(MODELS, SINE, robust="worst")
    np.testing.assert_array_equal(one.requests[:, 0], alone.requests)
    both = np.column_stack([SINE, 0.5 * SINE])
    made = plan([MODELS[:2], identified], both)
    assert [len(each) for each in made.task.models] == [2, 9]
    for j, errors in enumerate(made.errors_of_models):
        np.testing.assert_array_equal(errors, made.joint(j).errors_of_models[0])
    for method, other in (("closed_form", MODELS[:3]), ("shift", ERS210A)):
        with pytest.raises(InvalidInput, match="got several of a joint, which need method 'optim"):
            plan([MODELS[:2], other], both, method=method)
