"""The report of an identification: one page that needs nothing else, whatever was found."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from planner.identification.parameters import PARAMETERS
from planner.identification.result import Alternative, Interval
from planner.report.identification.figures import (
    APART,
    MOST_POINTS,
    _windows,
    close_up,
    cloud_figure,
    cloud_of,
    intervals_figure,
    log_figure,
    speed_against_error,
    thinned,
)
from planner.report.identification.page import identification_page
from planner.report.identification.words import joints_table
from planner.report.page import sources_of
from planner.report.plotly_figure import plot
from tests.report.made_up import made_up, made_up_log, never_saturated
from tests.report.test_figure import check_words

PHONE = 390
"""Width of a phone's screen [px]."""

WIDTH, HEIGHT = 420, 900
"""Of the screenshot [pixels]: a phone's."""


@pytest.fixture(scope="module")
def several():
    refused = replace(never_saturated(), verdict="refused", held_out_rms=None)
    gripper = made_up(made_up_log(unit="1", joint="<gripper> & co", name="<img src=x>.csv"))
    return identification_page({"hip": made_up(), "knee": refused, "<gripper> & co": gripper})


def test_a_model_that_a_pure_delay_beats_looks_like_one_that_does_not_fit():
    late = Alternative(name="delay", rms=0.003, held_out_rms=0.003, parameters={"delay": 0.1})
    page = identification_page({"": made_up(alternatives=(late,), verdict="worse than a delay")})
    assert '<p class="verdict no"><strong>A pure delay serves better' in page


def test_where_the_top_speed_is_open_it_is_not_said_to_be_reached():
    right = made_up()
    found = made_up(intervals={**right.intervals, "v_max": Interval(2.0, math.inf)})
    for identification, told in ((found, False), (right, True)):
        page = identification_page({"": identification})
        assert ("reached in" in page) == told
        assert ("was at its top speed in" in page) == told


def test_rows_that_were_left_out_are_counted_with_the_reason():
    found = made_up()
    log, used = found.fits[0].log, found.fits[0].used.copy()
    torque_on = log.torque_on.copy()
    torque_on[500:507] = used[500:507] = False
    fit = replace(found.fits[0], log=replace(log, torque_on=torque_on), used=used)
    page = identification_page({"": replace(found, fits=(fit,))})
    assert "rows left out, and why" in page
    assert "7 without torque" in page


def test_a_page_on_data_that_says_nothing_can_still_be_drawn():
    nothing = Interval(-math.inf, math.inf)
    unknown = made_up(
        intervals=dict.fromkeys(PARAMETERS, nothing),
        gain_interval=nothing,
        covariance=None,
        held_out_rms=None,
        alternatives=(),
        verdict="refused",
    )
    assert identification_page({"": unknown}).count("not determined") >= 5


def test_every_log_is_drawn_row_by_row_and_zoomed_by_its_button(browser, several, tmp_path):
    page = tmp_path / "report.html"
    page.write_text(several)
    figures = browser.read_through(page, width=WIDTH, height=HEIGHT, dark=True)
    assert len(figures) == 3 * (2 + 1)  # of each joint the cloud, intervals and log
    log = next(name for name in figures if "log" in name)
    plot = f"document.querySelector('[id=\"{log}\"] .canvas')"
    measured = f"{plot}.data.find((trace) => trace.name === 'measured')"
    assert browser.ask(f"atob({measured}.y.bdata).length") == 4 * 1000  # bytes of every row
    assert browser.ask(f"{plot}.data.map((trace) => trace.yaxis).join()").endswith("y,y2,y2")
    browser.ask(f"[...{plot}.parentElement.querySelectorAll('.views button')].at(-1).click()")
    browser.wait_for(f"{plot}.layout.xaxis.range[1] - {plot}.layout.xaxis.range[0] <= 3.001")
    assert browser.complaints == []
    assert browser.asked_of_others == []
    picture = browser.screenshot()
    assert struct.unpack(">II", picture[16:24]) == (WIDTH, HEIGHT)
    assert len(picture) > 20_000  # an empty page of this size takes a few thousand bytes


def test_long_names_of_files_do_not_make_the_page_wider_than_a_phone(browser, tmp_path):
    long = f"{'folder_' * 12}/log.csv"
    page = tmp_path / "report.html"
    sources = sources_of(page, files=[("log", tmp_path / long)])
    page.write_text(identification_page({"": made_up()}, sources=sources), encoding="utf-8")
    browser.open(page, width=PHONE)
    assert browser.ask(f"document.querySelector('a[href=\"{long}\"]').textContent") == long
    assert browser.ask("document.documentElement.scrollWidth") <= PHONE
    assert browser.complaints == []


@pytest.mark.parametrize("found_by", [made_up, never_saturated], ids=["saturated", "never"])
def test_plotly_takes_every_figure(found_by):
    found = found_by()
    check_words(plot(cloud_figure(found)))
    check_words(plot(intervals_figure(found)))
    check_words(plot(log_figure(found, found.fits[0], "")))


def test_the_strip_of_a_short_lag_is_as_long_as_the_time_between_requests():
    short = replace(made_up(), model=replace(made_up().model, lag=0.0))
    (panel,) = intervals_figure(short).panels
    assert f"{1e3 * short.model.period:.2f}" in [words.text for words in panel.words]


def test_what_is_not_drawn_has_no_words():
    right = made_up(made_up_log(duration=4.0))
    (fit,) = right.fits
    plain = replace(fit, weights=np.ones(len(fit.weights)))
    assert "outliers" in log_figure(right, fit, "").caption
    assert "outliers" not in log_figure(right, plain, "").caption
    gentle = replace(right, intervals={**right.intervals, "v_max": Interval(3.0, math.inf)})
    for found in (right, gentle):
        drawn = {curve.name for curve in cloud_figure(found).panels[0].curves}
        assert ("are pale" in cloud_figure(found).caption) == (APART in drawn)
        assert ("level ends" in cloud_figure(found).caption) == (not found.saturates)
    wide = replace(gentle, model=replace(right.model, theta_0=9.0))
    assert "level ends" not in cloud_figure(wide).caption
    assert "are pale" not in cloud_figure(wide).caption


def test_the_interval_of_a_sag_below_zero_is_drawn_around_it():
    ends = {"sag_sin": Interval(-0.5, -0.3), "sag_cos": Interval(-0.1, 0.2)}
    model = replace(made_up().model, sag_sin=-0.4, sag_cos=0.1)
    sagging = made_up(model=model, intervals={**made_up().intervals, **ends})
    (panel,) = intervals_figure(sagging).panels
    bars, marks = (
        [c for c in panel.curves if c.label == text] for text in ("95 % interval", "estimate")
    )
    for bar, mark in zip(bars[-2:], marks[-2:], strict=True):
        assert 0.0 < bar.x[0] < mark.x[0] < bar.x[1] < 100.0


@pytest.mark.parametrize("found_by", [made_up, never_saturated], ids=["saturated", "never"])
def test_the_cloud_shows_points_about_the_identified_line(found_by):
    found = found_by()
    figure, (_, reach, _) = cloud_figure(found), cloud_of(found)
    curves = {curve.name: curve for curve in figure.panels[0].curves if curve.legend}
    assert 0 < len(curves["measured"].x) <= MOST_POINTS
    line = curves["f, identified"]
    slope = found.model.v_max / found.model.theta_0
    assert line.y[4] / line.x[4] == pytest.approx(slope)
    assert figure.x.range[1] == pytest.approx(np.degrees(reach))
    if found.saturates:
        assert line.y[5] == pytest.approx(np.degrees(found.model.v_max))


def test_of_many_points_every_so_manieth_is_drawn(monkeypatch):
    def measured():
        curves = cloud_figure(made_up()).panels[0].curves
        return next(curve for curve in curves if curve.name == "measured")

    whole = measured()
    monkeypatch.setattr("planner.report.identification.figures.MOST_POINTS", 100)
    np.testing.assert_array_equal(measured().x, whole.x[:: -(-len(whole.x) // 100)])


def test_points_across_an_edge_of_the_dead_band_stand_apart():
    found = made_up()
    without, with_it = (
        speed_against_error(replace(found.model, dead_band=band), found.fits[0]).apart
        for band in (0.0, 0.05)
    )
    assert np.count_nonzero(without) < np.count_nonzero(with_it)


def test_the_line_of_a_joint_with_dry_friction_is_its_speed_law_everywhere():
    found = with_dead_band(made_up())
    (line,) = (
        each for each in cloud_figure(found).panels[0].curves if each.name == "f, identified"
    )
    errors = np.linspace(line.x[0], line.x[-1], 101)
    speeds = np.degrees(found.model.speed(np.radians(errors)))
    assert np.interp(errors, line.x, line.y) == pytest.approx(speeds)


def test_the_table_of_joints_has_each_number_under_its_own_title():
    table = joints_table({"hip": made_up(), "knee": with_dead_band(made_up())})
    titles = [column.title for column in table.columns]
    hip, knee = (dict(zip(titles, row.cells, strict=True)) for row in table.rows)
    assert (hip["dead band"], knee["dead band"]) == ("–", "0.573 deg")
    late = replace(made_up(), verdict="worse than a delay")
    (row,) = joints_table({"hip": late}).rows
    assert (row.cells[0], row.kind) == ("worse than a delay", "broken")
    for joint in hip, knee:
        assert joint["held out"] == "0.219 deg"
        assert joint["best delay"] == hip["best delay"] != "–"


def with_dead_band(found):
    """The same identification of a joint with dry friction."""
    model = replace(found.model, dead_band=0.01)
    intervals = {**found.intervals, "dead_band": Interval(0.009, 0.011)}
    return replace(found, model=model, intervals=intervals)


def test_a_log_without_a_single_interval_has_an_empty_cloud():
    found = made_up()
    none = [replace(fit, used=np.zeros_like(fit.used)) for fit in found.fits]
    figure = cloud_figure(replace(found, fits=tuple(none)))
    assert [curve.name for curve in figure.panels[0].curves if curve.legend] == ["f, identified"]
    reach = 2.0 * np.degrees(found.model.corners()[-1])
    assert figure.x.range == pytest.approx((-reach, reach))
    check_words(plot(figure))


def test_the_close_up_has_the_largest_errors_of_the_rows_held_out_if_there_are_any():
    (fit,) = made_up().fits
    angles = fit.log.angles.copy()
    angles[100:110] += 2.0
    far_off = replace(fit, log=replace(fit.log, angles=angles))
    rows = close_up(far_off)
    assert len(rows) == 151  # three seconds of 20 ms, with both ends
    assert np.mean(fit.held_out[rows]) > 0.9
    rows = close_up(replace(far_off, held_out=np.zeros_like(fit.held_out)))
    assert {*range(100, 110)} <= {*rows.tolist()}


@pytest.mark.parametrize("shift", [-0.05, 0.0, 0.003, 0.02])
def test_the_mean_of_a_constant_request_is_the_request_also_beside_the_log(shift):
    log = made_up_log()
    log = replace(log, requests=np.ones(len(log.times)))
    ends = log.times[[0, 5, -1]] + shift
    mean, least, most = _windows(log, ends - 0.01, ends)
    np.testing.assert_allclose([mean, least, most], 1.0, rtol=1e-12)


def test_a_long_log_is_drawn_by_the_extremes_of_its_parts():
    times, values = np.arange(20.0), np.sin(np.arange(20.0))
    values[5:10] = math.nan
    assert all(map(np.array_equal, thinned(times, values, bins=10), (times, values), (True, True)))
    x, y = thinned(times, values, bins=4)
    np.testing.assert_array_equal(x, [2, 4, 5, 11, 14, 15, 17])
    np.testing.assert_array_equal(y, values[x.astype(int)])


def test_the_time_of_a_log_begins_where_the_log_does():
    found = made_up()
    fit = found.fits[0]
    later = replace(fit, log=replace(fit.log, times=fit.log.times + 100.0))
    own, shifted = (log_figure(replace(found, fits=(each,)), each, "a_") for each in (fit, later))
    assert shifted.x_range == pytest.approx(own.x_range)
    for panel, other in zip(own.panels, shifted.panels, strict=True):
        for curve, same in zip(panel.curves, other.curves, strict=True):
            np.testing.assert_allclose(same.x, curve.x, atol=1e-9)


def test_the_table_of_six_joints_is_as_wide_as_the_page(browser, tmp_path):
    names = ("ShoulderPitch", "ShoulderRoll", "ShoulderYaw", "Elbow", "WristRoll", "WristPitch")
    joints = {
        f"kRight{name}": with_dead_band(never_saturated() if k % 2 else made_up())
        for k, name in enumerate(names)
    }
    joints["kRightElbow"] = replace(joints["kRightElbow"], verdict="worse than a delay")
    page = tmp_path / "page.html"
    page.write_text(identification_page(joints), encoding="utf-8")
    browser.open(page, width=1280)
    frame = "document.querySelector('[aria-label=Joints]')"
    assert browser.ask(f"{frame}.scrollWidth") <= browser.ask(f"{frame}.clientWidth")
    assert browser.ask("document.documentElement.scrollWidth") <= 1280
