"""A fit is a minimum within its bounds, and its normal equations are those of the derivatives."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import planner
from planner.identification.excitation import excite
from planner.identification.grid import resampled
from planner.identification.least_squares import (
    USUAL,
    huber,
    least_squares,
    respond,
    slopes_of,
)
from planner.identification.parameters import Parameters, coordinates_of, only, parameters_at
from planner.model import kernel
from tests.identification.made import AIBO, NOISE, hobby_servo, rich_log, step_logs


def grid_of(logs):
    return resampled(logs, tick=AIBO.tick, reach=0.5, burn_in=0.1)


def test_no_step_by_one_coordinate_improves_a_fit():
    grid = grid_of(step_logs())
    fit = least_squares(grid, Parameters.of(AIBO)._replace(gain=30.0, lag=0.02, offset=0.1))
    coordinates = coordinates_of(grid, fit.parameters)
    for index in np.flatnonzero(fit.free):
        for step in (-1e-3, 1e-3):
            beside = coordinates.copy()
            beside[index] += step
            at = parameters_at(grid, beside)
            residuals = respond(grid, at, fit.starts).predicted - grid.angles
            assert huber(residuals, fit.scale) >= fit.cost * (1.0 - 1e-6)


def test_a_parameter_at_its_bound_leaves_the_others_free():
    grid = grid_of([rich_log(noise=NOISE, rows=600)])
    begin = Parameters.of(AIBO)._replace(gain=20.0, lag=0.0, dead_band=0.03)
    fit = least_squares(grid, begin, free=USUAL | only("dead_band"))
    free = least_squares(grid, Parameters.of(AIBO))
    assert fit.parameters.dead_band >= 0.0
    assert fit.rms <= free.rms * (1.0 + 1e-6)
    assert fit.parameters.gain == pytest.approx(free.parameters.gain, rel=0.05)


def test_the_normal_equations_are_those_of_the_derivatives():
    """Two logs, so that each first angle acts on the rows of its own run alone."""
    grid = grid_of(step_logs())
    at = Parameters.of(AIBO)._replace(gain=30.0)
    slopes = slopes_of(grid, at, grid.measured_starts, USUAL)
    residuals = respond(grid, at, grid.measured_starts).predicted - grid.angles
    corner = float(np.median(np.abs(residuals)))  # half of them are outliers
    weights = corner / np.maximum(np.abs(residuals), corner)
    assert np.any(weights < 1.0)
    runs = len(grid.starts)
    own = (grid.run[:, np.newaxis] == np.arange(runs)) * slopes.by_start[:, np.newaxis]
    dense = np.column_stack([slopes.of_law[:, :-1], own])
    expected = dense.T @ (weights[:, np.newaxis] * dense)
    matrix, gradient, beside, squares, by_start = kernel.normal_equations(
        slopes.of_law, residuals, corner, grid.run, runs
    )
    found = np.block([[matrix, beside.T], [beside, np.diag(squares)]])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.max(np.abs(expected)))
    slope = dense.T @ (weights * residuals)
    both = np.append(gradient, by_start)
    np.testing.assert_allclose(both, slope, rtol=0.0, atol=1e-10 * np.max(np.abs(slope)))


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


@cache
def log():
    requests = excite("combined", limits=(-0.8, 0.8), period=0.02, duration=5.0).requests
    return hobby_servo(requests, 0.02)


@cache
def found():
    return planner.identify(log())
