"""The ways to make a joint follow, compared by errors that are known here."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from planner import JointModel
from planner.calibration.candidates import RUN_IN, WORDS, compare
from planner.calibration.candidates import test_motion as motion_for
from planner.model.evidence import Evidence

LIMITS = (-0.4, 0.6)
MODEL = JointModel(
    v_max=5.0,
    theta_0=0.3,
    lag=0.02,
    acceleration_time=0.02,
    tick=0.001,
    hold=20,
    dead_band=0.02,
    v_offset=0.1,
    sag_sin=0.01,
).with_evidence(Evidence(error=0.003, speed=6.0))


def compared(errors):
    """What is recommended where each way has this error after the run-in; and what was asked."""
    asked, desired = {}, motion_for(MODEL, LIMITS)
    begin = round(RUN_IN / MODEL.period)

    def measure(way, requests):
        asked[way] = requests
        off = np.full(len(desired), errors[way])
        off[begin::2] *= -1.0
        off[:begin] = 1.0  # the run-in does not count
        off[begin + 7 :: 11] = np.nan  # rows that were not read
        return desired + off

    return compare(SimpleNamespace(model=MODEL), LIMITS, measure), asked


@pytest.mark.parametrize("best", WORDS)
def test_the_way_of_the_least_measured_error_is_recommended_with_its_model(best):
    errors = {way: 0.01 if way == best else 0.02 for way in WORDS}
    answer, asked = compared(errors)
    assert [each.way for each in answer.candidates] == list(WORDS)
    assert answer.recommended.way == best
    for each in answer.candidates:
        assert each.error == pytest.approx(errors[each.way])
        assert each.max_error == pytest.approx(errors[each.way])
        assert each.largest_step == np.max(np.abs(np.diff(asked[each.way])))
    plain = answer.model.dead_band == answer.model.v_offset == answer.model.sag_sin == 0.0
    assert plain == (best == "optimal")
    assert plain or answer.model == MODEL
    lost = best in ("direct", "shift")
    assert answer.model.evidence.verdict == ("worse than a delay" if lost else None)
    assert (f"'{WORDS[best]}' was closer" in answer.model.evidence.reason) == lost


def test_a_simpler_way_is_preferred_to_one_that_is_hardly_better():
    errors = dict.fromkeys(WORDS, 0.01) | {"direct": 0.0103, "shift": 0.0101}
    assert compared(errors)[0].recommended.way == "shift"


def test_all_ways_stay_within_the_limits_and_follow_what_the_joint_can():
    desired = motion_for(MODEL, LIMITS)
    assert np.max(np.abs(np.diff(desired))) <= 0.6 * MODEL.v_max_per_period * (1.0 + 1e-9)
    for end in (0, -1):
        assert desired[end] == pytest.approx(np.mean(LIMITS), abs=0.02)
    for requests in compared(dict.fromkeys(WORDS, 0.01))[1].values():
        assert LIMITS[0] <= np.min(requests) <= np.max(requests) <= LIMITS[1]
