"""The compiled law: without friction and inertia the paper's, and its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.identification.parameters import Parameters
from planner.identification.resampling import resampled
from planner.identification.sensitivities import sensitivities
from planner.identification.simulation import active_requests, respond
from planner.model import kernel
from planner.model.joint import Law
from tests.identification.made import rich_log
from tests.independent import of_whole_ticks

INERT = planner.JointModel(
    v_max=4.0,
    theta_0=0.2,
    lag=0.0133,
    acceleration_time=0.0371,
    hold=2,
    offset=0.03,
    dead_band=0.03,
    v_offset=0.4,
    compliance=0.05,
    speed_per_torque=0.3,
    time_constant=0.02,
)


def test_the_papers_joint_moves_by_equation_3():
    requests = np.random.default_rng(0).uniform(-1.0, 1.0, 300)
    model = planner.JointModel.ers210a()
    angles = planner.simulate(model, requests, cyclic=False, start=0.2)
    np.testing.assert_allclose(angles, of_whole_ticks(model, requests, 0.2), rtol=0.0, atol=1e-12)


def test_a_time_constant_far_below_a_tick_and_an_endless_acceleration_change_nothing():
    requests = np.random.default_rng(1).uniform(-1.0, 1.0, 80)
    model = replace(planner.JointModel.ers210a(), dead_band=0.02)
    slight = replace(model, time_constant=1e-4 * model.tick, max_acceleration=1e8)
    for cyclic in (True, False):
        np.testing.assert_allclose(
            planner.simulate(slight, requests, cyclic=cyclic),
            planner.simulate(model, requests, cyclic=cyclic),
            rtol=0.0,
            atol=1e-10,
        )


@pytest.mark.parametrize("field", Parameters._fields)
def test_derivatives_by_parameters_along_a_log_are_slopes_with_inertia(field):
    load = np.cumsum(np.random.default_rng(1).normal(scale=0.1, size=400))
    log = replace(rich_log(INERT, load=load), load=load)
    grid = resampled([log], tick=INERT.tick, reach=0.5, burn_in=0.0)
    at, starts = Parameters.of(INERT), log.angles[:1]
    states = respond(grid, at, starts)
    number = Parameters._fields.index(field)
    only = np.arange(len(at)) == number
    units = planner.identification.parameters.units(grid, at)[number]
    slopes = sensitivities(grid, at, states, active_requests(grid, at), free=only).by_parameter
    step = 1e-6 * max(getattr(at, field), 0.1)
    ahead, behind = (
        respond(grid, at._replace(**{field: getattr(at, field) + way}), starts)
        for way in (step, -step)
    )
    quotients = grid.at_rows(ahead - behind) / (2.0 * step)
    apart = np.abs(quotients - slopes[:, 0] / units)
    # A tick in which a difference meets a corner of the law is off; few are.
    assert np.quantile(apart, 0.9) <= 1e-5 * np.max(np.abs(quotients))


def test_the_derivative_by_the_acceleration_limit_is_a_slope():
    rng = np.random.default_rng(2)
    law = Law(gain=0.2, top=0.05, friction=0.002, share=0.5, acceleration=0.004)
    count = 200
    weights, targets = np.ones((1, count)), np.repeat(rng.uniform(-1.0, 1.0, 10), 20)[np.newaxis]
    states, zeros = np.arange(1, count + 1), np.zeros(count)

    def run(law):
        angles, speeds = np.zeros(count + 1), np.zeros(count + 1)
        kernel.follow(law, weights, targets, zeros, 0.0, states, angles, speeds)
        return angles, speeds

    slopes = kernel.slopes_along(
        law,
        weights,
        targets,
        zeros,
        zeros,
        np.repeat(targets, 4, axis=0),
        1.0,
        states,
        *run(law),
        states - 1,
        np.ones(count),
    )
    step = 1e-8
    ahead, behind = (run(law._replace(acceleration=0.004 + way))[0] for way in (step, -step))
    np.testing.assert_allclose(
        slopes[:, 10], (ahead - behind)[1:] / (2.0 * step), rtol=0.0, atol=1e-4
    )
    assert np.max(np.abs(slopes[:, 10])) > 1.0
