"""A fit is a minimum within its bounds, and its normal equations are those of the derivatives."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import planner
from planner.identification import identify as module
from planner.identification.excitation import excite
from planner.identification.grid import resampled
from planner.identification.least_squares import (
    USUAL,
    Fit,
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


@pytest.mark.parametrize("without", [0, 1])
def test_the_first_angle_of_a_run_without_rows_stays(without):
    """Chunks of a long log may hold too few rows to compare any."""
    whole = grid_of(step_logs())
    kept = whole.run != without
    columns = ("before", "share", "run", "angles", "weights")
    part = replace(whole, **{name: getattr(whole, name)[kept] for name in columns})
    begin = Parameters.of(AIBO)._replace(gain=30.0, lag=0.02)
    fit = least_squares(part, begin, starts=whole.measured_starts)
    assert fit.starts[without] == whole.measured_starts[without]
    assert fit.starts[1 - without] != whole.measured_starts[1 - without]
    assert fit.parameters.gain == pytest.approx(Parameters.of(AIBO).gain, rel=0.2)


WORSE = 1.02
"""How much more than the fit of a whole search misses one that began at a fit may."""


@cache
def log():
    requests = excite("combined", limits=(-0.8, 0.8), period=0.02, duration=5.0).requests
    return hobby_servo(requests, 0.02)


@cache
def found():
    return planner.identify(log())


def poor(fit: Fit) -> Fit:
    """The same joint but much weaker, as where a search has gone astray."""
    weak = fit.parameters._replace(gain=0.3 * fit.parameters.gain)
    return least_squares(fit.grid, weak, free=np.zeros_like(fit.free), starts=fit.starts)


def test_where_rows_are_weighed_the_joint_found_before_is_one_of_the_beginnings(monkeypatch):
    whole, searches, least = module._with_motor, [], found().rms

    def astray(logs, timing, joints):
        search = whole(logs, timing, joints)
        searches.append(logs)
        if len(searches) == 1:
            return search
        plain, joint = (each._replace(fit=poor(each.fit)) for each in (search.plain, search.joint))
        return search._replace(plain=plain, joint=joint)

    def uneven(fits, _):
        weights = np.where(np.arange(len(log().times)) % 2, 0.9, 1.0)
        return tuple(replace(fit.log, weights=weights) for fit in fits)

    monkeypatch.setattr(module, "_with_motor", astray)
    monkeypatch.setattr(module, "with_weights", uneven)
    assert planner.identify(log(), hold_out=False).rms <= WORSE * least
    assert len(searches) == 2


def test_rows_held_out_are_predicted_by_the_joint_of_all_rows_fitted_to_the_others(monkeypatch):
    whole, known = module.with_motor, found()

    def astray(fit, terms):
        fit, terms = whole(fit, terms)
        held = len(fit.grid.angles) < 0.7 * len(log().times)
        return (poor(fit), terms) if held else (fit, terms)

    monkeypatch.setattr(module, "with_motor", astray)
    again = planner.identify(log())
    assert again.rms == pytest.approx(known.rms, rel=0.1)
    assert again.held_out_rms <= 1.2 * known.held_out_rms
