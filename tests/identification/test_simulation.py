"""The joint on the ticks of a log is the joint of the planner, and its derivatives are slopes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.identification.grid import glitches, resampled
from planner.identification.least_squares import respond
from planner.identification.log import GAP
from planner.identification.parameters import Parameters
from tests.identification.made import changed, rich_log
from tests.strategies import models, trajectories

SAME_RUN = 1e-11
"""Two simulations of some hundred ticks of angles within 3 rad differ by rounding [rad]."""

PLAIN = planner.JointModel(
    v_max=4.0, theta_0=0.2, lag=0.0133, acceleration_time=0.0371, hold=2, offset=0.03
)

STICKY = replace(PLAIN, dead_band=0.03, v_offset=0.4, compliance=0.05, speed_per_torque=0.3)


def log_of(model, requests):
    angles = planner.simulate(model, requests, cyclic=False)
    times = np.arange(len(requests)) * model.period
    return planner.Log(times=times, requests=requests, angles=angles)


@given(models(), trajectories(least=4, most=40))
def test_even_rows_are_simulated_as_the_planner_simulates_them(model, requests):
    log = log_of(model, requests)
    window = model.lag + model.acceleration_time
    grid = resampled([log], tick=model.tick, reach=2.0 * window + model.period, burn_in=0.0)
    predicted = respond(grid, Parameters.of(model), log.angles[:1]).predicted
    assert np.max(np.abs(predicted - log.angles[grid.places[0]])) <= SAME_RUN


def test_a_joint_with_dry_friction_and_a_load_is_simulated_as_the_planner_simulates_it():
    load = np.cumsum(np.random.default_rng(1).normal(scale=0.1, size=400))
    log = replace(rich_log(STICKY, load=load), load=load)
    grid = resampled([log], tick=STICKY.tick, reach=0.5, burn_in=0.0)
    predicted = respond(grid, Parameters.of(STICKY), log.angles[:1]).predicted
    assert np.max(np.abs(predicted - log.angles)) <= SAME_RUN


def test_what_friction_takes_of_the_acceleration_is_added_in_the_model():
    motor = replace(STICKY, time_constant=0.03, max_acceleration=40.0)
    at = Parameters.of(motor)
    gain = motor.v_max / motor.theta_0
    share = -math.expm1(-motor.tick / 0.03)
    assert at.acceleration == pytest.approx(40.0 - share * gain * motor.dead_band / motor.tick)
    assert at.model(tick=motor.tick, hold=motor.hold) == motor


def test_torque_that_returns_starts_anew_with_the_requests_that_came_before():
    model = planner.JointModel.ers210a()
    log = rich_log(model, rows=300)
    torque = np.ones(300, dtype=bool)
    torque[100:130] = False
    angles = np.where(torque, log.angles, 7.0)  # whatever the joint does without torque
    grid = resampled(
        [changed(log, angles=angles, torque_on=torque)], tick=model.tick, reach=0.5, burn_in=0.0
    )
    assert [first for _, first in grid.firsts] == [0, 130]
    predicted = respond(grid, Parameters.of(model), grid.measured_starts).predicted
    assert np.max(np.abs(predicted - log.angles[torque])) <= SAME_RUN


def test_after_a_gap_nothing_is_assumed_of_the_requests_before():
    log = rich_log(rows=300)
    times = np.where(np.arange(300) < 150, log.times, log.times + 2.0 * GAP * log.period)
    grid = resampled([changed(log, times=times)], tick=0.008, reach=0.5, burn_in=0.1)
    rows = np.ceil(0.1 / 0.008)
    assert [first for _, first in grid.firsts] == [rows, 150 + rows]


@given(st.integers(5, 94), st.floats(2.0, 50.0), st.integers(0, 9))
def test_a_jump_away_and_back_is_a_glitch_and_motion_is_none(row, size, seed):
    log = rich_log(seed=seed, rows=100)
    assert not glitches(log.angles).any()
    for way in (size, -size):
        angles = log.angles + way * (np.arange(100) == row)
        assert np.flatnonzero(glitches(angles)).tolist() == [row]
