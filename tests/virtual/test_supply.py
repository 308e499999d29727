"""The battery: its voltage falls with the current, and wanders as much as is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.virtual.robot import Constants, Supply

CONSTANTS = Constants()


def voltages(constants, count, drawn=0.0, seed=0):
    supply = Supply(constants, np.random.default_rng(seed))
    return np.array([supply.voltage(drawn) for _ in range(count)])


def test_the_voltage_falls_with_the_current_drawn():
    quiet = replace(CONSTANTS, supply_noise=0.0)
    expected = CONSTANTS.battery_voltage - 2.0 * CONSTANTS.battery_resistance
    assert voltages(quiet, 1, drawn=2.0)[0] == pytest.approx(expected)


def test_the_noise_has_its_deviation_and_its_memory_and_repeats_for_a_seed():
    noise = voltages(CONSTANTS, 200_000) - CONSTANTS.battery_voltage
    assert np.std(noise) == pytest.approx(CONSTANTS.supply_noise, rel=0.1)
    late = round(CONSTANTS.supply_correlation_time / CONSTANTS.control_period)
    kept = np.mean(noise[late:] * noise[:-late]) / np.var(noise)
    assert kept == pytest.approx(np.exp(-1.0), abs=0.1)
    assert np.array_equal(voltages(CONSTANTS, 50), voltages(CONSTANTS, 50))
    assert not np.array_equal(voltages(CONSTANTS, 50), voltages(CONSTANTS, 50, seed=1))
