"""The page about many replayed recordings."""

from __future__ import annotations

from planner.report.episodes import MOST_ROWS, episodes_page, episodes_table


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


def test_of_very_many_recordings_the_table_has_those_that_are_farthest_off():
    rows = [row(number, planned=1.0 + number % 7) for number in range(MOST_ROWS + 70)]
    table = episodes_table(document(rows))
    assert len(table.rows) == MOST_ROWS
    kept = [float(each.cells[5]) for each in table.rows]
    numbers = [int(each.about.rpartition(" ")[2]) for each in table.rows]
    assert numbers == sorted(numbers)
    assert len(episodes_table(document(rows[:MOST_ROWS])).rows) == MOST_ROWS
    assert min(kept) == 1.0
    assert sum(error == 1.0 for error in kept) < 30
    page = episodes_page(document(rows), title="walks", words="follows the state")
    assert "70 recordings with smaller errors are not in the table" in page
