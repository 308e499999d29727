"""What is learnt of a disturbance, frequency by frequency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.learning.disturbance import OPTIONS, averaged, learnt, noise_of
from planner.model.joint import JointModel

MODEL = JointModel(v_max=5.0, theta_0=0.3, lag=0.03, acceleration_time=0.04, tick=0.01)
LATE = 0.03 + 0.04 / 2.0 + 0.3 / 5.0
"""Lag, half the acceleration time and the time constant of the model's gain [s]."""

SAMPLES = 200


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("number", [0, 3, 10, 40, 80])
def test_of_one_frequency_the_cosine_of_its_phase_error_is_learnt(number, cyclic):
    k = np.arange(SAMPLES)
    if cyclic:
        hertz, rows = number / (SAMPLES * 0.01), np.cos(2.0 * np.pi * number * k / SAMPLES + 0.4)
    else:
        hertz, rows = number / (2.0 * SAMPLES * 0.01), np.cos(np.pi * number * (k + 0.5) / SAMPLES)
    trust = np.cos(min(2.0 * np.pi * hertz * OPTIONS.latency_error * LATE, np.pi / 2.0))
    slow = replace(MODEL, lag=0.0, acceleration_time=0.01)  # every joint has its own
    two = np.column_stack([rows, rows])
    nothing = np.zeros((SAMPLES // 2 + 1 if cyclic else SAMPLES, 2))
    answer = learnt(two, nothing, [MODEL, slow], cyclic=cyclic)
    np.testing.assert_allclose(answer[:, 0], trust * rows, rtol=0.0, atol=1e-9)
    if 0.0 < trust < 1.0:
        assert np.max(np.abs(answer[:, 1])) > np.max(np.abs(answer[:, 0]))


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("cycles", [2, 3, 8])
def test_noise_between_cycles_has_its_variance_however_few_there_are(cycles, cyclic):
    rng = np.random.default_rng(cycles)
    trials = [rng.normal(scale=[0.01, 0.02], size=(cycles, 400, 2)) for _ in range(4)]
    power = noise_of(trials, np.zeros((400, 2)), cyclic=cyclic)
    np.testing.assert_allclose(np.sqrt(power.mean(axis=0)), [0.01, 0.02], rtol=0.05)


def test_noise_at_one_frequency_is_spread_over_four_neighbours_to_either_side():
    line = np.cos(2.0 * np.pi * 20 * np.arange(SAMPLES) / SAMPLES)[:, np.newaxis]
    (power,) = noise_of([np.stack([line, -line])], np.zeros((SAMPLES, 1)), cyclic=True).T
    np.testing.assert_array_equal(np.flatnonzero(power > 1e-9), np.arange(16, 25))
    assert power[20] == pytest.approx(SAMPLES / 2.0 / 9.0)  # 2 |X|^2 over one degree of freedom


def test_twice_the_noise_is_taken_off_what_is_learnt_of_a_frequency():
    """Its power is averaged over five frequencies, of which the others have none."""
    rows = np.cos(2.0 * np.pi * 10 * np.arange(SAMPLES) / SAMPLES)[:, np.newaxis]
    known = replace(MODEL, lag=0.0, acceleration_time=0.01, theta_0=0.05, v_max=5.0)
    for share, left in ((0.1, 0.8), (0.45, 0.1), (0.55, 0.0)):
        noise = np.full((SAMPLES // 2 + 1, 1), share * SAMPLES / 4.0 / 5.0)
        answer = learnt(rows, noise, [known], cyclic=True)
        np.testing.assert_allclose(answer, left * rows, rtol=0.0, atol=0.01)


def test_a_power_is_averaged_over_the_neighbours_that_there_are():
    powers = np.arange(6.0)[:, np.newaxis] ** 2
    expected = [np.mean(powers[max(k - 2, 0) : k + 3]) for k in range(6)]
    np.testing.assert_allclose(averaged(powers, 2)[:, 0], expected)
