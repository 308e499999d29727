"""The compiled law: without friction and inertia the paper's, and its derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.identification.grid import resampled
from planner.identification.least_squares import linearised, respond
from planner.identification.parameters import Parameters, units
from tests.identification.made import rich_log
from tests.instances import joint_of
from tests.model.rounded_periods import rounded_periods

FRICTION = {"dead_band": 0.03, "v_offset": 0.4, "compliance": 0.05, "speed_per_torque": 0.3}
INERT = joint_of(4.0, 0.2, 0.0133, 0.0371, hold=2, offset=0.03, time_constant=0.02, **FRICTION)
INTEGRALS = ({"integral_rate": 8.0}, {"position_integral_rate": 4.0})
SAG = {"sag_sin": -0.1, "sag_cos": 0.05}


def fields_of(integral):
    """The parameters of a joint with one of the integrals."""
    return [n for n in Parameters._fields if n in integral or not n.endswith("integral_rate")]


WITHOUT_INTEGRAL = fields_of({})


@pytest.mark.parametrize(
    ("field", "added"),
    [(field, at) for at in INTEGRALS for field in fields_of(at)[:-2]]
    + [(field, {"acceleration": 40.0}) for field in WITHOUT_INTEGRAL if field != "play"]
    + [(field, at | {"acceleration": 40.0}) for at in INTEGRALS for field in fields_of(at)[:-1]]
    + [(field, {"play": 0.02}) for field in WITHOUT_INTEGRAL if field != "acceleration"]
    + [(field, SAG) for field in WITHOUT_INTEGRAL[:-2]]
    + [(field, at | SAG) for at in INTEGRALS for field in fields_of(at)[:-2]],
)
def test_derivatives_by_parameters_along_a_log_are_slopes_with_inertia(field, added):
    at = Parameters.of(INERT)._replace(**added)
    load = np.cumsum(np.random.default_rng(1).normal(scale=0.1, size=400))
    log = replace(rich_log(INERT, load=load), load=load)
    grid = resampled([log], tick=INERT.tick, reach=0.5, burn_in=0.0)
    only = np.array([name == field for name in Parameters._fields])
    found = linearised(grid, at, log.angles[:1], only)[1].by_parameter[:, 0] / units(grid, at)[only]
    step = 1e-6 * max(getattr(at, field), 0.1)
    ahead, behind = (
        respond(grid, at._replace(**{field: getattr(at, field) + way}), log.angles[:1]).predicted
        for way in (step, -step)
    )
    quotients = (ahead - behind) / (2.0 * step)
    # A tick in which a difference meets a corner of the law is off; few are.
    assert np.quantile(np.abs(quotients - found), 0.9) <= 1e-5 * np.max(np.abs(quotients))


@pytest.mark.parametrize("added", [{}, *(at | SAG for at in INTEGRALS)])
def test_the_derivative_by_the_first_angle_is_a_slope(added):
    log = rich_log(INERT)
    grid = resampled([log], tick=INERT.tick, reach=0.5, burn_in=0.0)
    at = Parameters.of(INERT)._replace(**added)
    nothing = np.zeros(len(Parameters._fields), dtype=bool)
    found = linearised(grid, at, log.angles[:1], nothing)[1].by_start
    ahead, behind = (respond(grid, at, log.angles[:1] + way).predicted for way in (1e-6, -1e-6))
    assert np.max(np.abs((ahead - behind) / 2e-6 - found)) <= 1e-5


@pytest.mark.parametrize("friction", [0.0, 0.03])
@pytest.mark.parametrize("most", [math.inf, 100.0])
@pytest.mark.parametrize("motor", [0.0, 0.02])
def test_derivatives_by_a_request_of_one_tick_are_differences_to_second_order(
    motor, most, friction
):
    terms = {"dead_band": friction, "v_offset": 0.4, "time_constant": motor}
    joint = joint_of(4.0, 0.2, 0.0, 0.01, tick=0.01, max_acceleration=most, **terms)
    step, requests = 1e-5, np.linspace(-0.5, 0.7, 13)

    def after(requests):
        moving = np.full((1, len(requests)), 0.01)
        begin = np.full(len(requests), 0.1)
        made = rounded_periods(joint, begin, requests[:, np.newaxis], 0.5, moving=moving)
        return made.states, made.by_request[..., 0], made.bending[..., 0]

    behind, here, ahead = (after(requests + way) for way in (-step, 0.0, step))
    for k, rounding in ((0, 1e-7), (1, 1e-6)):
        np.testing.assert_allclose(here[k + 1], (ahead[k] - behind[k]) / (2 * step), atol=rounding)
