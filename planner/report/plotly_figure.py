"""Figures on a page, in Plotly's terms: plain dictionaries that the page's scripts draw.

Nothing of Plotly's Python package is needed to make them. Colours are written as the page's own,
``var(--direct)``; the script looks them up, so that a plot is light or dark with the page.
"""

from __future__ import annotations

import base64
from html import escape
from typing import Any

import numpy as np

from planner.report.figure import Axis, Curve, Figure, Panel, around
from planner.report.style import INK, MUTED
from planner.trajectory import Array

GAP = 34
"""Between panels, room for a title [px]."""


def plot(figure: Figure) -> dict[str, Any]:
    """The figure as a plot, of ``data`` and ``layout``: zoom one panel along x, and all follow."""
    heights = [150 * panel.height for panel in figure.panels]  # [px]
    inner = top = sum(heights) + GAP * (len(heights) - 1)
    above = 30 + (18 if figure.panels[0].title else 0)  # for the buttons
    below = 8 if figure.x.names == {} else 46  # for the axis
    data, axes, words, shapes = list[Any](), dict[str, Any](), list[Any](), list[Any]()
    place: dict[str, Any]
    start, end = figure.x_range
    across = _axis(figure.x, standoff=8) | {"range": [start, end]}
    if figure.over_time:
        across |= {
            "anchor": f"y{len(heights)}" if len(heights) > 1 else "y",
            "minallowed": start,
            "maxallowed": end,
            "unifiedhovertitle": {"text": f"%{{x:.{figure.x.decimals}f}} {figure.x.unit}"},
            "showspikes": figure.clock is None,
            "spikemode": "across",
            "spikesnap": "cursor",
            "spikethickness": 1,
            "spikedash": "solid",
            "spikecolor": MUTED.colour,
        }
    if figure.clock is not None:  # the line at the moment of the moving leg; the script moves it
        place = {"xref": "x", "yref": "paper", "x0": 0, "x1": 0, "y0": 0, "y1": 1}
        look = {"line": {"color": INK.colour, "width": 1.2}, "layer": "above"}
        shapes.append({"type": "line", **place, **look})
    for number, (panel, height) in enumerate(zip(figure.panels, heights, strict=True), 1):
        axis = "y" if number == 1 else f"y{number}"
        domain = [round(max(top - height, 0.0) / inner, 6), round(top / inner, 6)]
        top -= height + GAP
        upward, ends = _axis(panel.y, standoff=6) | {"domain": domain}, panel.y.range
        if figure.equal:
            upward["scaleanchor"] = "x"
            ends = around([curve.y for curve in panel.curves])
        if panel.y.names is None:
            upward |= {"nticks": 6, "rangemode": "tozero" if panel.y.from_zero else "normal"}
        axes[axis.replace("y", "yaxis")] = upward if ends is None else upward | {"range": [*ends]}
        data += [{**_trace(curve, figure, panel), "yaxis": axis} for curve in panel.curves]
        if panel.title:
            title = {"text": f"<b>{escape(panel.title, False)}</b>", "x": 0, "y": domain[1]}
            corner = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
            words.append({**title, **corner, "showarrow": False})
        words += [
            {
                "text": escape(each.text, False).replace("v_max", "v<sub>max</sub>"),
                "x": each.x,
                "y": each.y,
                "xref": "x",
                "yref": axis,
                "xanchor": each.across,
                "yanchor": each.upward,
                "showarrow": False,
                "font": {"color": INK.colour, "size": 12},
            }
            for each in panel.words
        ]
        for span in panel.spans:  # across the panel
            place = {"xref": "x", "yref": f"{axis} domain", "x0": span.start, "x1": span.end}
            place |= {"y0": 0, "y1": 1}
            if span.along == "y":
                place = {"xref": "paper", "yref": axis, "x0": 0, "x1": 1}
                place |= {"y0": span.start, "y1": span.end}
            fill = {"fillcolor": span.role.colour, "opacity": span.opacity, "line": {"width": 0}}
            shapes.append({"type": "rect", **place, **fill, "layer": "below"})
    layout = {
        "xaxis": across,
        **axes,
        "annotations": words,
        "shapes": shapes,
        "hovermode": "x unified" if figure.over_time else "closest",
        "showlegend": False,  # the page has its own, of buttons
        "margin": {"l": 58, "r": 12, "t": above, "b": below},
        "uirevision": "kept",
    }
    return {
        "kind": "plot",
        "data": data,
        "layout": layout,
        "height": inner + above + below,
        "clock": figure.clock,
        "views": {name: list(ends) for name, ends in figure.views.items()},
    }


def _trace(curve: Curve, figure: Figure, panel: Panel) -> dict[str, Any]:
    """A curve with its looks, and with what is written beside the pointer."""

    def packed(values: Array) -> dict[str, str]:
        """Numbers as Plotly takes them in the fewest bytes: single precision, little-endian."""
        content = np.asarray(values, dtype="<f4").tobytes()
        return {"dtype": "f4", "bdata": base64.b64encode(content).decode()}

    colour = curve.role.colour
    trace: dict[str, Any] = {
        "type": "scatter",
        "name": curve.name,
        "x": packed(curve.x),
        "y": packed(curve.y),
        "visible": "legendonly" if curve.hidden else True,
        "connectgaps": False,
    }
    if not curve.marks:
        line = {
            "color": colour,
            "width": curve.role.pixels,
            "dash": curve.role.strokes,
            "shape": "hv" if curve.held else "linear",
            "simplify": False,  # which makes a polygon of a wide line
        }
        trace |= {"mode": "lines", "line": line}
    else:
        marker = {"color": colour, "opacity": curve.opacity, "line": {"color": colour, "width": 0}}
        if curve.marks == "rings":
            marker = {"color": "rgba(0,0,0,0)", "line": {"color": colour, "width": 1.6}}
        trace |= {"mode": "markers", "marker": marker | {"size": 4.5 if curve.opacity < 1.0 else 7}}
    if curve.notes:
        trace["text"] = list(curve.notes)
    if not curve.legend:
        return trace | {"hoverinfo": "skip", "showlegend": False}
    note = " · %{text}" if curve.notes else ""
    if figure.over_time:
        return trace | {"hovertemplate": f"%{{y:.{panel.y.decimals}f}} {panel.y.unit}{note}"}
    values = ", ".join(
        f"%{{{letter}:.{axis.decimals}f}} {axis.unit}".rstrip()
        for letter, axis in (("x", figure.x), ("y", panel.y))
        if axis.names is None
    )
    return trace | {"hovertemplate": f"{values}{note}<extra>%{{fullData.name}}</extra>"}


def _axis(axis: Axis, *, standoff: float) -> dict[str, Any]:
    layout: dict[str, Any] = {
        "gridcolor": "var(--grid)",
        "linecolor": MUTED.colour,
        "zeroline": False,
        "title": {"text": escape(axis.words, False), "standoff": standoff},
    }
    if axis.names is None:
        return layout
    words = [escape(name, False) for name in axis.names.values()]
    ticks = {"tickvals": list(axis.names), "ticktext": words}
    return layout | ticks | {"automargin": True, "showgrid": False}
