"""A sensor's delay, to a fraction of a sample."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import planner
from planner.learning import sensor_delay
from planner.learning.sensor_delay import (
    delays_to_remove,
    earlier,
    later,
    pure_delay,
    remarks_on_delays,
)
from planner.planning.trials import SensorDelay

PERIOD = 0.02


def motion(time):
    return 0.3 * np.sin(2.0 * np.pi * time / 4.0) + 0.1 * np.cos(2.0 * np.pi * time / 1.0)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("samples", [0.0, 0.4, -1.3, 22.7])
def test_a_delay_is_found_to_a_tenth_of_a_sample(samples, cyclic):
    time = PERIOD * np.arange(200)
    before = time - samples * PERIOD
    measured = motion(before if cyclic else np.maximum(before, 0.0)) + 0.05  # from rest or not
    delay, share = pure_delay(measured, motion(time), PERIOD, cyclic=cyclic)
    assert delay == pytest.approx(samples * PERIOD, abs=0.1 * PERIOD)
    assert share == (pytest.approx(1.0, abs=0.05) if samples else 0.0)


@pytest.mark.parametrize(
    ("share", "latencies", "removed"),
    [(0.91, 0.51, True), (0.89, 0.51, False), (0.91, 0.49, False), (0.91, -2.0, False)],
)
def test_a_delay_is_the_sensors_where_it_explains_nine_tenths_and_is_half_the_models_latency(
    share, latencies, removed, monkeypatch
):
    model = planner.JointModel.ers210a()
    plan = SimpleNamespace(models=[model, replace(model, lag=0.1)])
    seconds = [latencies * each.latency for each in plan.models]
    found = tuple(SensorDelay(seconds=each, share=share, removed=0.0) for each in seconds)
    monkeypatch.setattr(sensor_delay, "delays_of", lambda *_: found)
    cycles = np.zeros((1, 1, 2))
    assert delays_to_remove(plan, cycles, cycles[0]) == (seconds if removed else [0.0, 0.0])


@pytest.mark.parametrize("samples", [2.0, -3.0, 0.5])
def test_rows_that_are_later_are_those_of_the_moments_before(samples):
    time = PERIOD * np.arange(200)
    rows = np.column_stack([motion(time), motion(time + 1.0)])
    moved = later(rows, samples * PERIOD, PERIOD, cyclic=True)
    before = time - samples * PERIOD
    expected = np.column_stack([motion(before), motion(before + 1.0)])
    np.testing.assert_allclose(moved, expected, rtol=0.0, atol=1e-3)  # straight lines in between


def test_the_delay_of_one_of_several_joints_is_taken_off_its_angles_alone():
    time = PERIOD * np.arange(200)
    measured = np.stack([np.column_stack([motion(time), motion(time + 1.0)])] * 2)
    moved = earlier(measured, [2 * PERIOD, 0.0], SimpleNamespace(period=PERIOD, cyclic=True))
    expected = np.column_stack([motion(time + 2 * PERIOD), measured[0, :, 1]])
    np.testing.assert_allclose(moved, np.stack([expected] * 2), rtol=0.0, atol=1e-12)


def test_the_joint_whose_angles_are_late_is_named_where_that_is_clear():
    """Where a delay makes more than twice the noise, and is a quarter of a period at least."""
    moves = SimpleNamespace(
        requests=PERIOD * np.outer(np.arange(9), [1.0, 1.0, 1.0]), period=PERIOD
    )
    found = [
        SensorDelay(seconds=0.0051, share=0.81, removed=0.0),
        SensorDelay(seconds=0.0049, share=0.9, removed=0.0),
        SensorDelay(seconds=0.0051, share=0.79, removed=0.03),
    ]
    first, third = remarks_on_delays(moves, found, np.full(3, 0.0025))
    assert first == (
        "81 % of what the model misses of joint 1 is a delay of 5.1 ms: it is learnt as the "
        "joint's. If the sensor or the log is late by it: sensor_delay=0.0051"
    )
    assert third.startswith("the measured angles of joint 3 are taken to be 30 ms late, by their s")
    assert remarks_on_delays(moves, found[:2], np.full(2, 0.0026)) == []
