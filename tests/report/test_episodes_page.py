"""The page about many replayed recordings."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from planner.report.episodes import MOST_ROWS, episodes_page, episodes_table
from tests.corpus.page_text import numbers_of


def row(number, planned=0.2, unit="deg", **others):
    """What ``replay --json`` says of a recording."""
    errors = {"resent_rms": 3.0, "direct_rms": 2.0, "shifted_rms": 1.0, "planned_rms": planned}
    return {
        "recording": f"data/walks, episode {number}",
        "requests": 100,
        "duration_s": 2.0,
        "speed": 1.5,
        "worst_joint": "elbow",
        "unit": unit,
        **errors,
        "expected_on_robot_rms": None,
        "lower_bound": 0.1,
        "remarks": [],
        **others,
    }


def document(rows, *, speed=1.5, left_out=()):
    failed = dict.fromkeys(left_out, "is the file cut short?")
    return {"track": "state", "speed": speed, "recordings": rows, "left_out": failed, "remarks": []}


def page(made):
    return episodes_page(made, title="walks", words="follows the state")


def live(made):
    return json.loads(re.search(r'id="live-figures">(.*?)</script>', made, re.DOTALL)[1])


def test_the_page_has_every_recording_and_what_is_left_out():
    rows = [row(0), row(1, planned=0.4), row(3, planned=0.3)]
    made = page(document(rows, left_out=["data/walks, episode 2"]))
    assert "<strong>3 of 4 recordings have a plan</strong>, in the median 0.3 deg rms off" in made
    assert "the plan that is farthest off, of elbow in walks, episode 1; lower bound 0.100" in made
    for number in (0, 1, 3):
        assert f'<th scope="row">walks, episode {number}</th>' in made
    assert "is the file cut short?" in made
    (figure,) = live(made).values()
    curves = {each["name"]: each for each in figure["data"]}
    assert list(curves) == ["direct", "best time shift", "optimised", "lower bound"]
    bounds = numbers_of(curves["lower bound"]["y"])
    assert bounds[np.isfinite(bounds)] == pytest.approx(6 * [0.1])  # two ends of each
    assert page(document(rows)) == page(document(rows))
    assert "not in the table" not in made


def test_recordings_in_degrees_and_in_percent_have_a_figure_each():
    made = page(document([row(0), row(1, unit="percent", lower_bound=None)]))
    assert set(live(made)) == {"errors_deg", "errors_percent"}
    assert "elbow [%]" in made


def test_the_fastest_replays_have_their_speeds():
    columns = [each.title for each in episodes_table(document([row(0)], speed=None)).columns]
    assert columns[:3] == ["requests", "times the speed", "joint"]


def test_of_very_many_recordings_the_table_has_those_that_are_farthest_off():
    rows = [row(number, planned=1.0 + number % 7) for number in range(MOST_ROWS + 70)]
    table = episodes_table(document(rows))
    assert len(table.rows) == MOST_ROWS
    kept = [float(each.cells[5]) for each in table.rows]
    assert min(kept) == 1.0
    assert sum(error == 1.0 for error in kept) < 30
    assert "70 recordings with smaller errors are not in the table" in page(document(rows))
