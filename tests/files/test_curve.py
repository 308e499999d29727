"""Curves in files: what is written is read again."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.curve import PiecewiseLinear
from planner.exceptions import InvalidFile, InvalidInput
from planner.files.curve import read_curve, write_curve

CURVE = PiecewiseLinear(
    knots=[2.0, 5.5, 8.0 + 1 / 3], values=[1.0, -1.0, 0.5], samples=10, tick=0.008, cyclic=True
)


def test_json_gives_a_curve_back_to_the_last_digit(tmp_path):
    write_curve(tmp_path / "curve.json", CURVE)
    again = read_curve(tmp_path / "curve.json")
    assert again.to_dict() == CURVE.to_dict()
    assert (again.tick, again.samples, again.cyclic) == (0.008, 10, True)


def test_csv_gives_the_knots_back_in_seconds_and_degrees(tmp_path):
    write_curve(tmp_path / "curve.csv", CURVE)
    lines = (tmp_path / "curve.csv").read_text().splitlines()
    assert lines[0] == "knot_s,value_deg"
    assert float(lines[2].split(",")[0]) == pytest.approx(0.044)
    again = read_curve(tmp_path / "curve.csv", tick=0.008, samples=10)
    np.testing.assert_allclose(again.knots, CURVE.knots, atol=1e-9)
    np.testing.assert_allclose(again.values, CURVE.values, atol=1e-12)


def test_a_csv_of_knots_needs_the_tick_and_the_number_of_samples(tmp_path):
    write_curve(tmp_path / "curve.csv", CURVE)
    with pytest.raises(InvalidInput, match="give tick and samples, or use JSON"):
        read_curve(tmp_path / "curve.csv")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{", "not JSON"),
        ("a.json", "[1]", "got list, expected an object"),
        ("a.json", '{"knots": [1]}', "no 'values'"),
        ("a.json", "[" * 100_000, "not JSON"),
        ("a.csv", "knot_s,value_deg\n0.02,1\n0.01,2\n", "must increase"),
        ("a.csv", "knot_s,angle\n0.02,1\n0.01,2\n", "no column 'value_deg'"),
    ],
)
def test_a_file_of_no_curve_is_refused_by_name(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InvalidFile, match=message) as caught:
        read_curve(tmp_path / name, tick=0.008, samples=10)
    assert str(tmp_path / name) in str(caught.value)
