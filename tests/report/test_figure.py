"""A figure is one description, which Plotly and Matplotlib draw."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from planner.report.figure import (
    DESIRED,
    DIRECT,
    MUTED,
    REQUESTED,
    Axis,
    Curve,
    Figure,
    Panel,
    Span,
    Timeline,
    Words,
    around,
    joint_figure,
)
from planner.report.page import Page
from planner.report.paper_figures import draw, with_cycles
from planner.report.wording import UNITS

X = np.array([0.0, 1.0, 2.0])


def figure_of(*panels, **more):
    words = ("title", "caption")
    return Figure("name", *words, Axis("time", "ms"), panels, **{"over_time": True, **more})


def everything():
    curves = (
        Curve(DESIRED, X, np.array([1.0, math.nan, 3.0])),
        Curve(REQUESTED, X, np.array([0.0, 4.0, 2.0]), held=True),
        Curve(DIRECT, X, X, "at rest", hidden=True),
        Curve(DIRECT, X, X, "knots", marks="rings", notes=("a", "b", "c")),
        Curve(DIRECT, X, X, "cloud", marks="dots", opacity=0.5),
        Curve(MUTED, X, X, legend=False),
    )
    spans = (Span(0.5, 1.0, DIRECT, 0.2), Span(-0.5, 0.5, DIRECT, 0.2, along="y"))
    first = Panel(
        Axis("angle", "deg"), curves, "<hip>", spans=spans, words=(Words("v_max", 1.0, 2.0),)
    )
    return first, Panel(Axis("distance", "cm", from_zero=True), curves[:1], "foot", height=2.0)


def test_the_curves_and_shades_of_a_file_are_those_of_the_figure():
    first, second = everything()
    picture = draw(figure_of(first, second))
    (legend,), (above, below) = picture.legends, picture.axes
    entries = [text.get_text() for text in legend.get_texts()]
    assert entries == ["desired", "requested", "knots", "cloud"]
    shown = [curve for curve in first.curves if not curve.hidden]
    for curve, line in zip(shown, above.lines, strict=True):
        assert line.get_label() == curve.name
        assert (line.get_color(), line.get_drawstyle()) == (
            curve.role.light,
            "steps-post" if curve.held else "default",
        )
        np.testing.assert_array_equal(line.get_ydata(), curve.y)
    desired, _, rings, dots, _ = above.lines
    assert (desired.get_linewidth(), desired.get_marker()) == (DESIRED.width, "None")
    assert (rings.get_markerfacecolor(), rings.get_alpha()) == ("none", None)
    assert (dots.get_markerfacecolor(), dots.get_alpha()) == (DIRECT.light, 0.5)
    assert (dots.get_linestyle(), dots.get_marker()) == ("None", "o")
    assert [line.zorder for line in above.lines] == sorted({line.zorder for line in above.lines})
    across, along = above.patches
    assert (across.get_x(), across.get_width()) == (0.5, 0.5)
    assert (along.get_y(), along.get_height()) == (-0.5, 1.0)
    assert across.get_facecolor()[3] == 0.2
    assert len(below.lines) == 1
    assert (below.get_xlim(), above.get_ylim()[0] < 0.0) == ((0.0, 2.0), True)
    assert (below.get_ylim()[0], below.get_xlabel()) == (0.0, "time [ms]")
    assert (above.get_title(loc="left"), above.get_ylabel()) == ("<hip>", "angle [deg]")
    assert [text.get_text() for text in above.texts] == [r"$v_\mathrm{max}$"]


def page_of(*figures):
    return Page("fit", joints={"": figures}, errors="", worst="", rms={}, most={}, proof="").html()


def test_names_are_text_and_nothing_else():
    element = page_of(figure_of(*everything()))
    assert "<hip>" not in element
    assert 'aria-label="title. axes: angle [deg], ' in element
    assert "panels: &lt;hip&gt;, foot; curves: desired, requested, knots, cloud" in element


def test_plotly_takes_every_part_of_a_figure(browser, tmp_path):
    names = Axis("", range=(2.5, -0.5), names={0.0: "<hip>", 1.0: "knee"})
    in_space = Panel(Axis("y", "deg", decimals=1), (Curve(DIRECT, X, X, notes=("a", "b", "c")),))
    figures = (
        figure_of(*everything(), clock=1000.0, views={"first": (0.0, 1.0)}),
        figure_of(in_space, over_time=False, equal=True),
        figure_of(Panel(names, (Curve(DIRECT, X, X),)), over_time=False),
    )
    file = tmp_path / "page.html"
    file.write_text(page_of(*(replace(each, name=f"_{k}") for k, each in enumerate(figures))))
    assert browser.read_through(file) == ["_0", "_1", "_2"]
    drawn = "[...document.querySelectorAll('.canvas')]"
    traces = f"{drawn}.map((plot) => plot.data.map((trace) => [trace.name, trace.visible]))"
    shown = [["desired", True], ["requested", True], ["at rest", "legendonly"], ["knots", True]]
    whole, _, _ = browser.ask(traces)
    assert whole[:4] == shown
    titles = f"{drawn}[0].layout.annotations.map((each) => each.text)"
    assert browser.ask(titles) == ["<b>&lt;hip&gt;</b>", "v<sub>max</sub>", "<b>foot</b>"]


def test_a_cycle_ends_where_it_begins_and_cycles_do_not_touch():
    timeline = Timeline(0.008, 2)
    one = timeline.curve(np.array([10.0, 20.0]), DIRECT)
    np.testing.assert_array_equal(one.y, [10.0, 20.0, 10.0])
    np.testing.assert_array_equal(one.x, [0.0, 8.0, 16.0])
    draw = partial(timeline.curve, role=DIRECT)
    mean, two = with_cycles(draw, np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(mean.y, [2.0, 3.0, 2.0])
    assert mean.role == DIRECT
    assert (two.name, two.role.dashes) == (DIRECT.label, "-")
    np.testing.assert_array_equal(two.y, [1.0, 2.0, 1.0, math.nan, 3.0, 4.0, 3.0])
    np.testing.assert_array_equal(two.x, [0.0, 8.0, 16.0, math.nan, 0.0, 8.0, 16.0])
    once = Timeline(0.008, 2, cyclic=False)
    np.testing.assert_array_equal(once.curve(np.array([1.0, 2.0]), DIRECT).x, [0.0, 8.0])
    assert (timeline.axis.range, once.axis.range) == ((0.0, 16.0), (0.0, 8.0))


def test_limits_are_drawn_where_the_requests_come_near():
    timeline, requests = Timeline(0.5, 3, cyclic=False), [(np.array([0.0, 10.0, 5.0]), REQUESTED)]

    def lines(limits):
        about = {"requests": requests, "unit": UNITS["rad"]._replace(factor=1.0), "limits": limits}
        *drawn, _ = joint_figure(timeline, "name", ("title", "caption"), **about).panels[0].curves
        return [(curve.y.tolist(), curve.x.tolist()) for curve in drawn]

    end = [0.0, 1000.0]
    assert lines((-5.0, 100.0)) == [([-5.0, -5.0], end)]
    assert lines((-5.9, 15.9)) == [([-5.9, -5.9], end), ([15.9, 15.9], end)]
    assert lines((-6.1, 16.1)) == lines(None) == []
    low, high = around([X, X - 5.0])
    assert low < -5.0
    assert high > 2.0
