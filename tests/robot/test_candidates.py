"""Which way to move a servo is recommended, and the model that goes with it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planner import JointModel, invert_optimal
from planner.files.joint_model import read_model_file
from planner.model.evidence import Evidence
from planner.report.calibration import WORDS, candidates_table
from planner.robot import candidates

LIMITS = (-0.7, 0.7)
INTERVALS = {"v_max": (4.9, 5.1), "dead_band": (0.008, 0.012), "v_offset": (0.01, 0.03)}
MODEL = JointModel(
    v_max=5.0,
    theta_0=0.5,
    lag=0.01,
    acceleration_time=0.02,
    tick=0.001,
    hold=10,
    dead_band=0.01,
    v_offset=0.02,
).with_evidence(
    Evidence(
        error=0.002,
        intervals=INTERVALS,
        correlations=tuple(map(tuple, np.eye(3).tolist())),
        by_acceleration=((1.0, 0.001), (2.0, 0.003)),
        spread=(0.5, 1.5),
    )
)


@pytest.mark.parametrize("best", ["direct", "shift", "closed_form", "optimal", "optimal_friction"])
def test_the_model_of_any_recommended_way_can_be_kept_and_read_again(best, tmp_path):
    desired = candidates.test_motion(MODEL, LIMITS)

    def measured(way, _):
        return desired + (0.001 if way == best else 0.01)

    found = candidates.compare(SimpleNamespace(model=MODEL), LIMITS, measured)
    assert found.recommended.way == best
    marked = [
        row for row in candidates_table({"knee": found}).text().splitlines() if "recommended" in row
    ]
    assert len(marked) == 1
    assert WORDS[best] in marked[0]
    found.model.to_toml(tmp_path / "arm.toml")
    kept = read_model_file(tmp_path / "arm.toml").one()
    plain = best == "optimal"
    assert (kept.dead_band, kept.v_offset) == ((0.0, 0.0) if plain else (0.01, 0.02))
    assert set(kept.evidence.intervals) == ({"v_max"} if plain else set(INTERVALS))
    assert kept.evidence.error == pytest.approx(0.001 if plain else 0.002)
    assert kept.evidence.spread == (Evidence().spread if plain else (0.5, 1.5))
    for each in (kept.evidence.by_acceleration, kept.evidence.correlations):
        assert bool(each) != plain
    assert kept.evidence.refused == (best in ("direct", "shift"))
    if kept.evidence.refused:
        assert kept.evidence.reason.endswith(f"its calibration '{WORDS[best]}' was closer")


def test_candidates_have_the_figures_of_what_was_played_after_the_run_in(monkeypatch):
    desired = candidates.test_motion(MODEL, LIMITS)
    skipped = round(0.5 / MODEL.period)
    played, plans = {}, []

    def inverted(*given, **options):
        plans.append(invert_optimal(*given, **options))
        return plans[-1]

    def measured(way, requests):
        played[way] = requests
        error = np.full(len(desired), 0.02)
        error[:skipped] = 5.0  # of the run-in
        error[-1] = -0.06
        error[-2] = np.nan  # not read
        return desired + error

    monkeypatch.setattr(candidates, "invert_optimal", inverted)
    found = candidates.compare(SimpleNamespace(model=MODEL), LIMITS, measured)
    assert [each.plan.task.limits[0] for each in plans] == [LIMITS, LIMITS]
    count = len(desired) - skipped - 1
    for each in found.candidates:
        assert each.error == pytest.approx(np.sqrt((0.02**2 * (count - 1) + 0.06**2) / count))
        assert each.max_error == pytest.approx(0.06)
        assert each.largest_step == np.max(np.abs(np.diff(played[each.way])))
        assert np.all((played[each.way] >= LIMITS[0]) & (played[each.way] <= LIMITS[1]))
        # Nothing was tested of the model without friction and load.
        assert np.isfinite(each.expected) == (each.way in ("closed_form", "optimal_friction"))
    assert found.recommended is found.named("direct")  # all are as good: the simplest


def test_the_simplest_of_ways_that_are_about_as_good_is_recommended():
    desired = candidates.test_motion(MODEL, LIMITS)
    errors = {"shift": 1.05e-3, "closed_form": 1.01e-3, "optimal": 1.0e-3}
    found = candidates.compare(
        SimpleNamespace(model=MODEL), LIMITS, lambda way, _: desired + errors.get(way, 0.01)
    )
    assert found.recommended.way == "closed_form"
    free = replace(MODEL, dead_band=0.0, v_offset=0.0)
    found = candidates.compare(SimpleNamespace(model=free), LIMITS, lambda *_: desired)
    assert [each.way for each in found.candidates] == list(WORDS)[:4]
