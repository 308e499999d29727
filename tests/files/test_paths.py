"""Paths: radians that are degrees are refused, and a path at another rate is resampled."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.exceptions import InvalidFile
from planner.files.paths import (
    SampledPath,
    joint_path,
    read_foot_path,
    read_joint_path,
    resampled,
    write_curve,
    write_joint_path,
)
from planner.files.table import read_table, write_table

PHASE = 2.0 * np.pi * np.arange(100) / 100


def _written(file, column, values, times=None):
    times = 0.01 * np.arange(len(values)) if times is None else times
    write_table(file, ["t_s", column], np.column_stack([times, values]))
    return file


@pytest.mark.parametrize(
    "degrees",
    [45.0 * np.sin(PHASE), 80.0 + np.sin(PHASE), 0.3 * np.arange(100) ** 2, 2.0 * np.arange(100)],
)
def test_a_column_of_radians_that_holds_degrees_is_refused(tmp_path, degrees):
    file = _written(tmp_path / "path.csv", "pan_rad", degrees)
    worst = int(np.argmax(np.abs(degrees)))
    with pytest.raises(InvalidFile, match="if these are degrees, rename it pan_deg") as caught:
        read_joint_path(file)
    assert caught.value.line == worst + 2
    assert f"got {degrees[worst]:g} rad" in str(caught.value)
    read_joint_path(_written(tmp_path / "deg.csv", "pan_deg", degrees))


def test_paths_name_units_as_logs_do(tmp_path):
    (tmp_path / "joints.csv").write_text("knee [deg],hip_degrees\n90,45\n180,0\n")
    path = read_joint_path(tmp_path / "joints.csv")
    assert (path.names, path.units) == (("knee", "hip"), ("deg", "deg"))
    np.testing.assert_allclose(path.values[0], [math.pi / 2.0, math.pi / 4.0])
    (tmp_path / "foot.csv").write_text("x (mm),y_mm,z_mm\n1000,0,0\n0,0,-1000\n")
    assert read_foot_path(tmp_path / "foot.csv").values[0, 0] == 1.0


@pytest.mark.parametrize("columns", ["requested_deg,actual_deg", "goal_hip_deg,present_hip_deg"])
def test_a_log_is_no_path_but_each_of_its_columns_is(tmp_path, columns):
    (tmp_path / "log.csv").write_text(f"t_s,{columns}\n0,1,0\n1,2,1\n")
    with pytest.raises(InvalidFile, match="columns of a log, expected a path"):
        read_joint_path(tmp_path / "log.csv")
    requested = columns.partition("_deg")[0]
    assert read_joint_path(tmp_path / "log.csv", joints=[requested]).names == (requested,)


def test_uneven_times_are_refused_unless_the_path_is_resampled(tmp_path):
    times = 0.01 * np.arange(100) + 0.002 * np.sin(7.0 * np.pi * np.arange(100) / 99)
    file = _written(tmp_path / "path.csv", "pan_deg", 20.0 * np.sin(2.0 * np.pi * times), times)
    with pytest.raises(InvalidFile, match="expected even steps; plan with --rate-hz to resample"):
        read_joint_path(file)
    path = joint_path(read_table(file), even=False).in_step(0.008, resample=True, cyclic=True)
    assert path.values.shape == (125, 1)
    np.testing.assert_allclose(path.times, 0.008 * np.arange(125), rtol=0.0, atol=1e-12)
    true = np.radians(20.0 * np.sin(2.0 * np.pi * path.times))
    chord = np.radians(20.0) * (2.0 * np.pi * 0.014) ** 2 / 8.0  # of a straight line of 14 ms
    np.testing.assert_allclose(path.values[:, 0], true, rtol=0.0, atol=chord)


@pytest.mark.parametrize("resample", [True, False])
def test_times_in_milliseconds_are_refused_before_they_are_resampled(resample):
    path = SampledPath("path.csv", ("knee",), ("deg",), np.zeros((100, 1)), 20.0 * np.arange(100))
    with pytest.raises(InvalidFile, match=r"one sample every 20 s, expected .* milliseconds t_ms"):
        path.in_step(0.02, resample=resample, cyclic=False)


@given(
    st.integers(3, 60), st.sampled_from([0.004, 0.01, 0.02]), st.sampled_from([0.005, 0.008, 0.01])
)
def test_a_resampled_cycle_has_the_nearest_whole_number_of_samples(count, step, period):
    rows = np.cos(2.0 * np.pi * np.arange(count) / count)[:, np.newaxis]
    cycle = resampled(step * np.arange(count), rows, period, cyclic=True)
    assert abs(len(cycle) - count * step / period) <= 0.5 + 1e-6
    assert cycle[0] == rows[0]
    once = resampled(step * np.arange(count), rows, period, cyclic=False)
    span = (count - 1) * step
    assert span - period < (len(once) - 1) * period <= span + 0.011 * period
    same = resampled(step * np.arange(count), rows, step, cyclic=True)
    np.testing.assert_allclose(same, rows, rtol=0.0, atol=1e-9)


def test_a_curves_json_gives_it_back_to_the_last_digit_and_its_csv_the_knots(tmp_path):
    curve = planner.PiecewiseLinear(
        knots=[2.0, 5.5, 8.0 + 1 / 3], values=[1.0, -1.0, 0.5], samples=10, tick=0.008, cyclic=True
    )
    write_curve(tmp_path / "curve.JSON", curve)
    again = planner.PiecewiseLinear.from_dict(json.loads((tmp_path / "curve.JSON").read_text()))
    assert again.to_dict() == curve.to_dict()
    assert (again.tick, again.samples, again.cyclic) == (0.008, 10, True)
    write_curve(tmp_path / "curve.csv", curve)
    table = read_table(tmp_path / "curve.csv")
    assert table.names == ("knot_s", "value_deg")
    knots, values = table.numbers(table.names).T
    np.testing.assert_allclose(knots, 0.008 * curve.knots, rtol=0.0, atol=1e-12)  # 12 decimals
    np.testing.assert_allclose(values, np.degrees(curve.values), rtol=0.0, atol=1e-12)


def test_torques_on_joints_are_read_written_and_resampled_with_them(tmp_path):
    file = tmp_path / "loaded.csv"
    angles = np.radians([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [2.0, 3.0]])
    loads = np.array([[0.1, -0.5], [0.2, -0.4], [0.3, -0.3], [0.2, -0.4]])
    write_joint_path(file, ["hip", "knee"], angles, period=0.02, loads=loads)
    path = read_joint_path(file)
    assert path.names == ("hip", "knee")
    np.testing.assert_allclose(path.loads, loads, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(read_joint_path(file, joints=["knee"]).loads, loads[:, 1:])
    finer = path.in_step(0.01, resample=True, cyclic=True)
    np.testing.assert_allclose(finer.loads[:3, 0], [0.1, 0.15, 0.2], rtol=0.0, atol=1e-12)
    assert len(finer.loads) == len(finer.values) == 8


@pytest.mark.parametrize("period", [0.008, 0.01, 0.1, 1.0 / 30.0])
def test_a_motion_at_its_own_rate_keeps_its_last_row(period):
    for count in range(3, 60):
        rows = np.arange(float(count))[:, np.newaxis]
        same = resampled(0.3 + period * np.arange(count), rows, period, cyclic=False)
        np.testing.assert_allclose(same, rows, atol=1e-9)
