"""The page about many replayed recordings."""

from __future__ import annotations

import re

from planner.report.replay import MOST_ROWS, episodes_page


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


def test_of_very_many_recordings_the_page_has_those_that_are_farthest_off():
    rows = [row(number, planned=1.0 + number % 7) for number in range(MOST_ROWS + 70)]
    page = episodes_page(document(rows), title="walks", words="follows the state")
    numbers = [int(number) for number in re.findall(r'<th scope="row">\D*(\d+)</th>', page)]
    assert len(numbers) == MOST_ROWS
    assert numbers == sorted(numbers)
    kept = [rows[number]["planned_rms"] for number in numbers]
    assert min(kept) == 1.0
    assert sum(error == 1.0 for error in kept) < 30
    assert "70 recordings with smaller errors are not in the table" in page
    whole = episodes_page(document(rows[:MOST_ROWS]), title="walks", words="follows the state")
    assert "are not in the table" not in whole
