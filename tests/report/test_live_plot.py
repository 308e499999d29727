"""What the page's scripts are told: plots in Plotly's own words, and a leg in centimetres."""

from __future__ import annotations

import base64
import json
import math
import re

import numpy as np
import plotly.graph_objects as go
import pytest

from planner.report.curves import Curve, Panel, cycle, cycles
from planner.report.live_leg import MOST_FRAMES, Motion, moving_leg
from planner.report.live_page import live_scripts
from planner.report.live_plot import time_plot
from planner.report.live_words import packed
from planner.report.style import DESIRED, DIRECT, REQUESTED, Role

PACKED = 1e-6
"""Single precision keeps numbers to this share of themselves."""

TIMES = np.array([0.0, 1.0, 2.0])


def _plot(**settings):
    curves = (
        Curve(DESIRED, TIMES, np.array([1.0, math.nan, 3.0])),
        Curve(REQUESTED, TIMES, np.array([0.0, 4.0, 2.0]), held=True, hidden=True),
        Curve(DIRECT, TIMES, np.array([0.0, 1.0, 2.0]), "knots", dots=True),
    )
    panels = [
        Panel("<hip>", "angle", "deg", curves),
        Panel("foot", "distance", "cm", curves[:1], band=0.5, height=2.0, floor=True),
    ]
    return time_plot(panels, **{"unit": "ms", "scale": 8.0, **settings})


def _unpacked(numbers):
    return np.frombuffer(base64.b64decode(numbers["bdata"]), dtype="<f4")


def test_plotly_knows_every_word_of_a_plot():
    plot = _plot(clock=1000.0, shaded=[(0.5, 1.0)])
    plain = json.loads(re.sub(r"var\(--[\w-]+\)", "#123456", json.dumps(plot)))
    go.Figure(data=plain["data"], layout=plain["layout"])  # raises at any word or value not its own


def test_numbers_come_through_with_gaps_and_in_their_units():
    desired, requested, dots, foot = _plot()["data"]
    np.testing.assert_allclose(_unpacked(desired["x"]), 8.0 * TIMES, rtol=PACKED)
    np.testing.assert_array_equal(_unpacked(desired["y"]), [1.0, math.nan, 3.0])
    assert desired["hovertemplate"].endswith(" deg")
    assert foot["hovertemplate"].endswith(" cm")
    assert requested["line"]["shape"] == "hv"
    assert requested["visible"] == "legendonly"
    assert dots["mode"] == "markers"


def test_all_panels_share_one_time_axis_which_ends_with_the_curves():
    plot = _plot(views={"first": (0.0, 1.0)})
    assert [trace["yaxis"] for trace in plot["data"]] == ["y", "y", "y", "y2"]
    assert {trace.get("xaxis", "x") for trace in plot["data"]} == {"x"}
    assert plot["layout"]["xaxis"]["range"] == [0.0, 16.0]
    assert plot["views"] == {"first": [0.0, 8.0]}
    above, below = (plot["layout"][f"yaxis{n}"]["domain"] for n in ("", "2"))
    assert above[1] == 1.0
    assert below[0] == 0.0
    assert above[0] > below[1]
    assert 2.0 * (above[1] - above[0]) == pytest.approx(below[1] - below[0], abs=1e-5)


def test_names_are_text_and_nothing_else():
    assert _plot()["layout"]["annotations"][0]["text"] == "<b>&lt;hip&gt;</b>"
    written = str(live_scripts({"a": {"kind": "leg", "name": "</script><b>"}}))
    assert "</script><b>" not in written
    assert "plotly" not in written.split("</script>", 1)[1].split("live.library")[0]


def test_a_colour_that_the_page_does_not_know_is_refused():
    with pytest.raises(KeyError, match="#123456"):
        time_plot([Panel("", "angle", "deg", (Curve(Role("x", "#123456", "#fff"), TIMES, TIMES),))],
                  unit="s")  # fmt: skip


def test_the_same_plot_is_the_same_bytes():
    first, second = (json.dumps(_plot(clock=1000.0)) for _ in "12")
    assert first == second
    assert packed(TIMES) == packed(TIMES.copy())
    figures = {"a": _plot()}
    assert live_scripts(figures) == live_scripts(figures)


def test_a_cycle_ends_where_it_begins_and_cycles_do_not_touch():
    one = cycle(np.radians([10.0, 20.0]), DIRECT)
    np.testing.assert_allclose(one.values, [10.0, 20.0, 10.0])
    np.testing.assert_array_equal(one.times, [0.0, 1.0, 2.0])
    two = cycles(np.array([[1.0, 2.0], [3.0, 4.0]]), DIRECT)
    np.testing.assert_array_equal(two.values, [1.0, 2.0, 1.0, math.nan, 3.0, 4.0, 3.0])
    np.testing.assert_array_equal(two.times, [0.0, 1.0, 2.0, math.nan, 0.0, 1.0, 2.0])


def _motion(samples):
    points = np.zeros((samples, 3, 3))
    points[:, 1:, 2] = -0.0501
    points[:, 2, 0] = np.linspace(0.0, 0.1, samples)
    return Motion(DIRECT, points, points[:, 2, 0])


def test_a_leg_is_told_in_centimetres_with_its_ground():
    leg = moving_leg([_motion(3)], period=0.008, cyclic=True, ground=True)
    (motion,) = leg["motions"]
    assert motion["points"][1] == [[0.0, 0.0, 0.0], [0.0, 0.0, -5.01], [5.0, 0.0, -5.01]]
    assert motion["distances"] == [0.0, 5.0, 10.0]
    assert leg["ground"] == -5.01
    assert motion["colour"] == "var(--direct)"


def test_a_long_motion_is_thinned_and_keeps_its_time():
    leg = moving_leg([_motion(2 * MOST_FRAMES + 1)], period=0.002, cyclic=False)
    assert len(leg["motions"][0]["points"]) <= MOST_FRAMES
    assert leg["period"] == pytest.approx(0.006)
    assert leg["ground"] is None
