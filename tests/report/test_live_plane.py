"""Plots in a plane, and what the paper's figures and an identification become on a screen."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from planner.evaluation.paper import STEP_AMPLITUDES, published
from planner.report.curves import Curve
from planner.report.draw_agreement import DRAWN, agreement_plot, pairs
from planner.report.identification_cloud import MOST_POINTS, cloud_plot, cloud_view
from planner.report.live_figures import live_figures
from planner.report.live_plane import Axis, around, plane_plot
from planner.report.style import DESIRED, DIRECT
from tests.report.made_up import made_up, never_saturated

SINGLE = 1e-6
"""Single precision keeps numbers to this share of themselves."""

HERE = Axis("here [cm]", "cm")
THERE = Axis("there [deg]", "deg", decimals=1)
POINTS = np.array([0.0, 1.0, 3.0])


@pytest.fixture(scope="module")
def reproduction(reproduced):
    return reproduced.answer


def unpacked(numbers):
    return np.frombuffer(base64.b64decode(numbers["bdata"]), dtype="<f4")


def named(plot, name):
    return next(trace for trace in plot["data"] if trace["name"] == name)


def check_words(plot):
    """Plotly raises at any word or value that is not its own."""
    plain = json.loads(re.sub(r"var\(--[\w-]+\)", "#123456", json.dumps(plot, allow_nan=False)))
    go.Figure(data=plain["data"], layout=plain["layout"])


def test_a_point_tells_both_its_values_with_units_its_note_and_its_curve():
    curve = Curve(DESIRED, POINTS, POINTS, notes=("a", "b", "c"))
    (trace,) = plane_plot([curve], HERE, THERE)["data"]
    assert trace["hovertemplate"] == (
        "%{x:.2f} cm, %{y:.1f} deg · %{text}<extra>%{fullData.name}</extra>"
    )
    assert trace["text"] == ["a", "b", "c"]


def test_an_axis_of_names_has_them_for_numbers_and_tells_none():
    names = Axis("", names={0.0: "<hip>", 1.0: "knee"})
    plot = plane_plot([Curve(DESIRED, POINTS, POINTS)], HERE, names)
    assert plot["layout"]["yaxis"]["ticktext"] == ["&lt;hip&gt;", "knee"]
    assert plot["data"][0]["hovertemplate"].startswith("%{x:.2f} cm<extra>")
    check_words(plot)


def test_equal_axes_keep_shapes_and_what_is_around_holds_every_value():
    plot = plane_plot([Curve(DESIRED, POINTS, POINTS)], HERE, THERE, equal=True)
    assert plot["layout"]["yaxis"]["scaleanchor"] == "x"
    low, high = around(POINTS, POINTS - 5.0)
    assert low < -5.0
    assert high > 3.0


def test_filled_dots_are_filled_and_rings_are_not():
    rings, dots = (
        plane_plot([Curve(DIRECT, POINTS, POINTS, dots=True, filled=filled)], HERE, THERE)["data"]
        for filled in (0.0, 0.5)
    )
    assert rings[0]["marker"]["color"] == "rgba(0,0,0,0)"
    assert dots[0]["marker"]["color"] == "var(--direct)"
    assert dots[0]["marker"]["opacity"] == 0.5


def test_every_figure_of_the_paper_is_live_in_words_that_plotly_knows(reproduction):
    live = live_figures(reproduction)
    assert {name.split("_")[0] for name in live} >= {f"figure{k}" for k in range(1, 9)}
    for plot in live.values():
        if plot["kind"] == "plot":
            check_words(plot)


def test_the_step_tests_shade_lag_and_acceleration_time(reproduction):
    for number, amplitude in enumerate(STEP_AMPLITUDES, 3):
        plot = live_figures(reproduction)[f"figure{number}_step_{amplitude:g}"]
        response = reproduction.steps[amplitude]
        lag, acceleration = plot["layout"]["shapes"]
        assert (lag["x0"], lag["x1"]) == (response.step, response.step + response.lag)
        assert acceleration["x0"] == lag["x1"]
        assert acceleration["x1"] - acceleration["x0"] == response.acceleration
        words = [each["text"] for each in plot["layout"]["annotations"]]
        assert f"lag {response.lag}" in words
        angles = unpacked(named(plot, "actual")["y"])[:-1]
        np.testing.assert_allclose(angles, np.degrees(response.angles), atol=SINGLE * amplitude)


def test_every_figure_of_table_2_stands_beside_the_paper_s(reproduction):
    every = pairs(reproduction)
    assert len(every) == 18
    assert {pair.comparison for pair in every} == set(DRAWN)
    for pair in every:
        ours = reproduction.table2[pair.joint][pair.comparison]
        theirs = published(pair.joint, pair.comparison)
        distances = {"L₂": (ours.rms, theirs.L2.mean), "L∞": (ours.max, theirs.Linf.mean)}
        assert (pair.ours, pair.theirs) == distances[pair.norm]
    plot = agreement_plot(reproduction)
    np.testing.assert_allclose(
        unpacked(named(plot, "the paper's model, here")["x"]),
        [pair.ours for pair in every],
        rtol=SINGLE,
    )


@pytest.mark.parametrize("found", [made_up(), never_saturated()], ids=["saturated", "never"])
def test_the_cloud_shows_points_about_the_identified_line(found):
    plot, view = cloud_plot(found), cloud_view(found)
    check_words(plot)
    measured = named(plot, "measured")
    assert 0 < len(unpacked(measured["x"])) <= MOST_POINTS
    x, y = (unpacked(named(plot, "f, identified")[axis]) for axis in "xy")
    slope = found.model.v_max / found.model.theta_0
    np.testing.assert_allclose(y[2] / x[2], slope, rtol=SINGLE * 10)
    assert plot["layout"]["xaxis"]["range"][1] == pytest.approx(np.degrees(view.reach))
    if found.saturates:
        assert y[3] == pytest.approx(np.degrees(found.model.v_max), rel=SINGLE)


def test_a_log_without_a_single_interval_has_an_empty_cloud():
    found = made_up()
    none = [replace(fit, used=np.zeros_like(fit.used)) for fit in found.fits]
    plot = cloud_plot(replace(found, fits=tuple(none)))
    assert [trace["name"] for trace in plot["data"]] == ["f, identified"]
    check_words(plot)
