"""When trials identify a model anew, and which one is then kept."""

import functools
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.arrays import rms
from planner.learning import refine as refining
from planner.learning.trials import Trial
from tests.instances import ERS210A

OTHER = replace(ERS210A, theta_0=1.5 * ERS210A.theta_0)
PHASE = 2.0 * np.pi * np.arange(88) / 88
REQUESTS = 0.3 * np.sin(PHASE), 0.25 * np.sin(PHASE + 0.2)


def angles(model, k):
    return planner.simulate(model, REQUESTS[k])


@functools.cache
def news():
    """The change of the angles that the other model predicts and the known one does not."""
    return (angles(OTHER, 1) - angles(OTHER, 0)) - (angles(ERS210A, 1) - angles(ERS210A, 0))


@pytest.fixture
def chosen(monkeypatch):
    """Which model follows from two trials of joint 2, with the last one as far off as given."""
    plan = planner.plan(ERS210A, np.column_stack([REQUESTS[0], REQUESTS[0]]))
    asked = []

    def identified(model, logs):
        asked.append((model, logs))
        return OTHER

    monkeypatch.setattr(refining, "_identified", identified)

    def run(off, *, noise=0.0, cycles=1, trials=2, before=1):
        made = [
            Trial(
                requests=np.column_stack([np.zeros(88), REQUESTS[k]]),
                measured=np.stack([np.column_stack([np.zeros(88), each])] * cycles),
                error=1.0,
            )
            for k, each in enumerate((angles(ERS210A, 0), angles(ERS210A, 1) + off))
        ]
        asked.clear()
        made = [*[made[0]] * before, made[1]][: trials + before - 1]
        found = refining.better_model(ERS210A, plan, made, 1, noise)
        return found, asked

    return run


@pytest.mark.parametrize(("share", "better"), [(0.62, True), (0.57, False)])
def test_another_model_must_save_three_tenths_of_the_error_of_a_trial_it_has_not_seen(
    share, better, chosen
):
    """Of a share s of the news the known model misses s, and the other one misses 1 - s."""
    found, asked = chosen(share * news())
    assert (found is OTHER) == better
    assert [len(logs) for _, logs in asked] == ([1, 2] if better else [1])
    chosen(news(), before=6)
    assert [len(logs) for _, logs in asked] == [4, 4]  # the last ones
    chosen(news())
    (log,) = asked[0][1]
    np.testing.assert_array_equal(log.requests, np.tile(REQUESTS[0], 2))
    np.testing.assert_array_equal(log.angles, np.tile(angles(ERS210A, 0), 2))
    np.testing.assert_allclose(np.diff(log.times), ERS210A.period)


@pytest.mark.parametrize(("factor", "asks"), [(0.95, False), (1.05, True)])
def test_errors_within_two_deviations_of_the_mean_or_a_five_hundredth_of_the_motion_do_not_ask(
    factor, asks, chosen
):
    size = rms(news())
    _, asked = chosen(news(), noise=size / factor, cycles=4)  # of whose mean it is a half
    assert bool(asked) == asks
    little = factor * 0.002 * np.ptp(angles(ERS210A, 1))
    _, asked = chosen(little / size * news())
    assert bool(asked) == asks
    assert chosen(news(), trials=1) == (None, [])


@pytest.mark.parametrize(("size", "v_max"), [(0.02, ERS210A.v_max), (0.3, 3.0)])
def test_a_top_speed_that_the_trials_do_not_show_stays_as_it_was(size, v_max):
    """And with it the ratio of top speed and threshold that they do show."""
    true = replace(ERS210A, v_max=3.0, theta_0=0.15)
    steps = size * np.sign(np.sin(2.0 * np.pi * np.arange(240) / 80 + 0.1))
    steps += 0.3 * size * np.sin(2.0 * np.pi * np.arange(240) / 21)
    answers = planner.simulate(true, steps)
    log = refining._log(ERS210A, steps, answers, cyclic=True, load=None)
    found = refining._identified(ERS210A, [log])
    assert found.v_max == pytest.approx(v_max, rel=0.02)
    assert found.gain == pytest.approx(20.0, rel=0.05)
    assert (found.tick, found.hold) == (ERS210A.tick, ERS210A.hold)


def test_a_motion_from_rest_is_identified_after_more_rest_than_any_lag():
    log = refining._log(ERS210A, 0.1 + PHASE, PHASE, cyclic=False, load=2.0 * PHASE)
    np.testing.assert_array_equal(log.requests, np.r_[np.full(20, 0.1), 0.1 + PHASE])
    np.testing.assert_array_equal(log.angles[20:], PHASE)
    np.testing.assert_array_equal(log.load[20:], 2.0 * PHASE)
