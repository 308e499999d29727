"""The joint on the ticks of a log is the joint of the planner, and its derivatives are slopes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.arrays import rms
from planner.identification import grid
from planner.identification.grid import MOST_ROWS, glitches, measured_speed, resampled, thinned
from planner.identification.least_squares import USUAL, least_squares, respond
from planner.identification.log import GAP
from planner.identification.parameters import Parameters, only
from tests.identification.made import AIBO, NOISE, QUANTUM, measured, rich_log, step_logs
from tests.instances import joint_of
from tests.strategies import models, trajectories

SAME_RUN = 1e-11
"""Two simulations of some hundred ticks of angles within 3 rad differ by rounding [rad]."""

PLAIN = joint_of(4.0, 0.2, 0.0133, 0.0371, hold=2, offset=0.03)
STICKY = replace(PLAIN, dead_band=0.03, v_offset=0.4, compliance=0.05, speed_per_torque=0.3)
ROWS = 2 * MOST_ROWS + 1  # the fewest rows of which some are chosen, and one


@given(
    models(friction=True, inertia=True, poses=True),
    trajectories(least=4, most=40),
    st.integers(0, 9),
)
def test_even_rows_are_simulated_as_the_planner_simulates_them(model, requests, seed):
    load = np.random.default_rng(seed).uniform(-1.0, 1.0, len(requests))
    start = float(model.rest(requests[0], load[0]))
    angles = planner.simulate(model, requests, cyclic=False, start=start, load=load)
    times = np.arange(len(requests)) * model.period
    log = planner.Log(times=times, requests=requests, angles=angles, load=load)
    window = model.lag + model.acceleration_time
    grid = resampled([log], tick=model.tick, reach=2.0 * window + model.period, burn_in=0.0)
    predicted = respond(grid, Parameters.of(model), log.angles[:1]).predicted
    assert np.max(np.abs(predicted - log.angles[grid.places[0]])) <= SAME_RUN


def test_what_friction_takes_of_the_acceleration_is_added_in_the_model():
    motor = replace(STICKY, time_constant=0.03, max_acceleration=40.0)
    at = Parameters.of(motor)
    gain = motor.gain
    share = -math.expm1(-motor.tick / 0.03)
    assert at.acceleration == pytest.approx(40.0 - share * gain * motor.dead_band / motor.tick)
    assert at.model(tick=motor.tick, hold=motor.hold) == motor


def test_torque_that_returns_starts_anew_with_the_requests_that_came_before():
    model = planner.JointModel.ers210a()
    log = rich_log(model, rows=300)
    torque = np.ones(300, dtype=bool)
    torque[100:130] = False
    angles = np.where(torque, log.angles, 7.0)  # whatever the joint does without torque
    off = replace(log, angles=angles, torque_on=torque)
    grid = resampled([off], tick=model.tick, reach=0.5, burn_in=0.0)
    assert [first for _, first in grid.firsts] == [0, 130]
    predicted = respond(grid, Parameters.of(model), grid.measured_starts).predicted
    assert np.max(np.abs(predicted - log.angles[torque])) <= SAME_RUN


def test_a_joint_that_falls_without_torque_shows_no_speed():
    log = rich_log(rows=300)
    falling = 20.0 * (log.times - log.times[250]).clip(0.0)
    fallen = replace(log, angles=log.angles + falling, torque_on=falling == 0.0)
    assert measured_speed(fallen) <= measured_speed(log)


def test_after_a_gap_nothing_is_assumed_of_the_requests_before():
    log = rich_log(rows=300)
    times = np.where(np.arange(300) < 150, log.times, log.times + 2.0 * GAP * log.period)
    grid = resampled([replace(log, times=times)], tick=0.008, reach=0.5, burn_in=0.1)
    rows = np.ceil(0.1 / 0.008)
    assert [first for _, first in grid.firsts] == [rows, 150 + rows]


@given(st.integers(5, 94), st.floats(2.0, 50.0), st.integers(0, 9))
def test_a_jump_away_and_back_is_a_glitch_and_motion_is_none(row, size, seed):
    log = rich_log(seed=seed, rows=100)
    assert not glitches(log.angles).any()
    for way in (size, -size):
        angles = log.angles + way * (np.arange(100) == row)
        assert np.flatnonzero(glitches(angles)).tolist() == [row]


def grid_of(logs):
    return resampled(logs, tick=AIBO.tick, reach=0.5, burn_in=0.1)


def test_a_parameter_at_its_bound_leaves_the_others_free():
    grid = grid_of([rich_log(noise=NOISE, rows=600)])
    begin = Parameters.of(AIBO)._replace(gain=20.0, lag=0.0, dead_band=0.03)
    fit = least_squares(grid, begin, free=USUAL | only("dead_band"))
    free = least_squares(grid, Parameters.of(AIBO))
    assert fit.parameters.dead_band >= 0.0
    assert fit.rms <= free.rms * (1.0 + 1e-6)
    assert fit.parameters.gain == pytest.approx(free.parameters.gain, rel=0.05)


def test_rows_count_by_their_weights():
    """Rows of weight 0 may be anything, and equal weights change nothing but the scale."""
    logs = step_logs()
    at = Parameters.of(AIBO)._replace(gain=30.0, lag=0.02)
    plain = least_squares(grid_of(logs), at)
    halves = [replace(log, weights=np.full(len(log.times), 0.5)) for log in logs]
    even = least_squares(grid_of(halves), at)
    np.testing.assert_allclose(even.parameters, plain.parameters, rtol=1e-6)
    assert even.scale == pytest.approx(0.5 * plain.scale, rel=1e-6)
    assert even.rms == pytest.approx(plain.rms, rel=1e-9)
    some = np.arange(len(logs[1].times)) > 150
    wrong = replace(logs[1], angles=logs[1].angles * np.where(some, 1.1, 1.0))
    unseen = replace(wrong, weights=(~some).astype(float))
    known = replace(logs[1], measured=~some)
    found, bare, far = (
        np.array(least_squares(grid_of([logs[0], log]), at).parameters)[USUAL]
        for log in (unseen, known, wrong)
    )
    np.testing.assert_allclose(found[:4], bare[:4], rtol=2e-3)
    assert np.max(np.abs(far / bare - 1.0)[:4]) > 0.01


def burst_log(model=AIBO, *, rows=ROWS, at=28_000):
    """Steps too small to saturate the joint, and 400 rows of large ones."""
    requests = 0.1 * rich_log(rows=rows).requests
    requests[at : at + 400] = np.repeat([0.8, -0.8, 0.8, -0.8], 100)
    angles = planner.simulate(model, requests, cyclic=False)
    angles = measured(angles, np.random.default_rng(1), noise=NOISE, quantum=QUANTUM)
    return planner.Log(times=model.period * np.arange(rows), requests=requests, angles=angles)


def test_the_largest_steps_are_kept():
    log = burst_log()
    (some,) = thinned([log])
    assert some.torque_on[28_000:28_400].all()
    assert np.sum(some.torque_on) <= 1.1 * MOST_ROWS


def test_a_joint_with_inertia_moves_in_a_stretch_as_in_the_whole_log():
    model = replace(AIBO, time_constant=0.04)
    (some,) = thinned([rich_log(model, rows=ROWS)])
    errors = []
    for each in (some, replace(some, measured=None)):
        rows = resampled([each], tick=model.tick, reach=0.75, burn_in=0.0)
        predicted = respond(rows, Parameters.of(model), rows.measured_starts).predicted
        errors.append(rms(predicted - rows.angles))
        assert len(rows.starts) >= 10
    assert errors[0] <= 0.5 * NOISE
    assert errors[1] >= 2.0 * NOISE  # with the rows in which the speed at its start matters


def test_a_long_log_has_the_model_of_all_its_rows(monkeypatch):
    log = burst_log(rows=12_000, at=9_100)
    whole = planner.identify(log)
    monkeypatch.setattr(grid, "MOST_ROWS", 3_000)
    found = planner.identify(log)
    assert found.fits[0].used.all()
    assert found.verdict == whole.verdict
    assert [term.kept for term in found.terms] == [term.kept for term in whole.terms]
    assert found.intervals["v_max"].bounded
    for name, (low, high) in whole.intervals.items():
        change = getattr(found.model, name) - getattr(whole.model, name)
        assert abs(change) <= 0.05 * (high - low), name
