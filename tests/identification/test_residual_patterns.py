"""What the model does not have is named where it shows, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.identification.excitation import excite, expect
from planner.identification.grid import timing_of
from planner.identification.joint_fit import fit_joint
from planner.identification.residual_patterns import (
    _contradiction,
    _drift,
    contacts,
    patterns,
    stops,
)
from planner.identification.result import Interval, LogFit
from planner.identification.terms import with_calm_friction, with_terms
from tests.identification.made import (
    AIBO,
    STICKY,
    holds_log,
    identified_rich,
    identified_steps,
    step_logs,
)
from tests.instances import joint_of

NAMES = ("asymmetry:", "mechanical stop", "ringing:", "slow drift", "backlash:")
WAVE = np.sin(2.0 * np.pi * np.arange(300) / 100)


def named(found):
    return {name for name in NAMES if any(name in text for text in found.warnings)}


def test_what_the_model_or_its_rows_explain_is_not_named():
    heavy = replace(AIBO, theta_0=0.05, time_constant=0.04)
    (log,) = step_logs(heavy, amplitudes=(0.3,), quantum=0.0)
    found = planner.identify(log, hold_out=False)
    (fit,) = found.fits
    step = int(np.flatnonzero(np.diff(log.requests))[0]) + 1
    assert np.max(fit.predicted[step:]) > 1.05 * np.max(log.requests), "the model overshoots"
    assert "ringing:" not in named(found)
    signal = excite("combined", limits=(-0.8, 0.8), period=0.2, duration=60.0)
    assert "ringing:" not in named(expect(signal, AIBO))
    assert not named(identified_steps())
    assert not named(identified_rich())


@pytest.mark.parametrize(("ends", "said"), [((-1.2, -0.1), 1), ((-1.2, 0.1), 0)])
def test_top_speeds_that_may_be_alike_are_no_asymmetry(ends, said):
    model = joint_of(5.0, 0.2, 0.02, 0.01, v_offset=-0.6)
    fits = [seen(np.zeros(60), np.zeros(60))]
    found = patterns(model, fits, 1e-3, Interval(*ends))
    assert sum("asymmetry" in str(each) for each in found) == said


def seen(angles, predicted, requests=None, *, name="log", period=0.02):
    """What a model makes of a log in which every row is used."""
    times = period * np.arange(len(angles))
    log = planner.Log(
        times=times, requests=angles if requests is None else requests, angles=angles, name=name
    )
    none, ones = np.full(len(angles), np.nan), np.ones(len(angles))
    return LogFit(log=log, predicted=predicted, held_out_predicted=none, weights=ones)


@pytest.mark.parametrize(
    ("wave", "limit", "rows"),
    [
        (WAVE, 0.5, 99),
        (WAVE[:100], 0.5, 0),  # met once
        (WAVE, 0.97, 0),  # in less than twenty rows
        (np.sign(WAVE), 0.5, 0),  # always asked for the same
        (np.minimum(WAVE, 0.52), 0.5, 0),  # the model hardly goes beyond
    ],
    ids=["stop", "once", "brief", "one request", "within the noise"],
)
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_stop_is_met_twice_for_long_by_a_model_that_goes_beyond_it(wave, limit, rows, way):
    found = stops(seen(way * np.minimum(wave, limit), way * wave, way * wave), 0.005)
    assert [len(stop.rows) for stop in found] == ([rows] if rows else [])
    log = seen(wave, wave, name="arm").log
    for stop in found:
        first, last = np.flatnonzero(wave >= limit)[[0, -1]]
        assert stop.finding(log, "too many rows to leave out").words == (
            f"arm: a mechanical stop: in 99 rows between {first} and {last} the joint stays at its "
            f"{'largest' if way > 0.0 else 'least'} angle, {way * 28.6:g} deg, while it is "
            "requested to go on; too many rows to leave out"
        )


@pytest.mark.parametrize(
    ("count", "touching", "found"), [(12, 3, 3), (12, 4, 0), (12, 0, 0), (9, 2, 0), (10, 2, 2)]
)
def test_contact_is_where_a_joint_rests_beside_its_model_in_a_few_of_many_places(
    count, touching, found
):
    places = np.arange(count)
    levels, friction = 0.2 * places, 0.001 * (-1.0) ** places
    pushed = 0.05 * (places % 3 == 1) * (places < 3 * touching)
    angles, predicted = (np.repeat(each, 50) for each in (levels + friction + pushed, levels))
    (contact,) = contacts([seen(angles, predicted)], 0.001)
    assert [held.known["places"] for held in contact] == ([found] if found else [])
    for held in contact:
        assert held.rows.tolist() == np.flatnonzero(np.repeat(pushed, 50)).tolist()
        assert held.known["most"] == pytest.approx(0.05, abs=0.003)


def test_the_dead_band_is_that_of_calm_motion():
    """A log whose joint is shaken shows half of it."""
    shaken = replace(holds_log(replace(STICKY, dead_band=0.01), seed=1), name="shaken")
    found = planner.identify([replace(holds_log(), name="calm"), shaken], hold_out=False)
    assert found.model.dead_band == pytest.approx(STICKY.dead_band, rel=0.05)
    alike = [holds_log(), holds_log(seed=2)]  # of which one shows a little more, by chance
    fit = with_terms(*fit_joint(alike, timing_of(alike, tick=None, hold=None)))
    assert fit.parameters.dead_band == pytest.approx(STICKY.dead_band, rel=0.05)
    assert with_calm_friction(fit) is fit


@pytest.mark.parametrize(
    ("change", "rough", "said"), [(0.02, 0.001, 1), (0.004, 0.0005, 0), (0.02, 0.05, 0)]
)
def test_a_drift_is_more_than_the_noise_and_explains_a_part_of_the_residuals(change, rough, said):
    rows = np.arange(200)
    left = change * (rows / 199.0 - 0.5) + rough * (-1.0) ** rows
    assert len(_drift(seen(left, 0.0 * left), 0.001)) == said


def test_logs_contradict_each_other_from_twice_the_spread_of_their_errors_on():
    rough = 0.01 * np.where(np.arange(60) % 2, 1.0, -1.0)
    for apart, said in ((0.019, 0), (0.021, 1)):
        levels = {"low": 1.0, "high": 1.0 - apart}
        fits = [seen(rough, level + 0.0 * rough, name=name) for name, level in levels.items()]
        words = [each.words for each in _contradiction(fits)]
        assert len(words) == said
        assert all("higher in high than in low" in each for each in words)
