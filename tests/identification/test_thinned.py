"""Long logs: some stretches choose ticks and terms, all rows are fitted."""

from dataclasses import replace

import numpy as np

import planner
from planner.identification import grid
from planner.identification.grid import MOST_ROWS, resampled, thinned
from planner.identification.least_squares import respond
from planner.identification.parameters import Parameters
from planner.trajectory import rms
from tests.identification.made import AIBO, NOISE, QUANTUM, measured, rich_log

ROWS = 2 * MOST_ROWS + 1
"""The fewest rows of which some are chosen, and one."""


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
