"""Interactive plots of curves over time: panels with one time axis, for Plotly in the page.

A plot is described in Plotly's own words, as plain dictionaries: nothing of its Python package is
needed to make one. Colours are written as the page's own, ``var(--direct)``; the script in the page
looks them up, so that a plot is light or dark with the page.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve, Panel
from planner.report.style import DESIRED, MUTED, ROLES, Role

if TYPE_CHECKING:
    from planner.trajectory import Array

ROW = 150
"""Height of a panel of height 1 [px]."""

ABOVE, BELOW, LEFT = 30, 46, 58
"""Margins: for the first title and the buttons, for the time axis, and for numbers [px]."""

GAP = 34
"""Between panels, room for a title [px]."""

BOLDER = 1.2
"""Pixels for a point of a line: a screen is farther away than paper."""

BAND = 0.16
"""Opacity of a band."""


def time_plot(
    panels: Sequence[Panel],
    *,
    unit: str,
    scale: float = 1.0,
    decimals: int = 0,
    clock: float | None = None,
    shaded: Sequence[tuple[float, float]] = (),
    views: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, Any]:
    """Panels below one another over one time axis: zoom one, and all follow.

    Args:
        panels: The panels, from the top.
        unit: Unit of time on the axis, such as "ms".
        scale: How many of it one unit of the curves' times is.
        decimals: Of times where the pointer is.
        clock: How many of it a second is, where the plot follows the moving leg of its page; such
            plots of a page are zoomed in time together.
        shaded: Spans of time to shade, in the curves' unit.
        views: Spans of time, in the curves' unit, that a button of that name brings into view.

    Returns:
        ``data`` and ``layout`` for Plotly, ``height`` [px], ``clock``, and ``views``.
    """
    spans, height = _domains(panels)
    data, axes, titles, shapes = list[Any](), dict[str, Any](), list[Any](), list[Any]()
    for number, (panel, span) in enumerate(zip(panels, spans, strict=True), 1):
        suffix = "" if number == 1 else str(number)
        axes[f"yaxis{suffix}"] = _y_axis(panel, span)
        titles.append(_title(panel.title, span[1]))
        data += [_trace(curve, f"y{suffix}", panel.unit, scale) for curve in panel.curves]
        if panel.band is not None:
            shapes.append(_band(panel.band, f"y{suffix}"))
    shapes += [_shade(start * scale, end * scale) for start, end in shaded]
    layout = {
        "xaxis": {**_x_axis(panels, unit, scale, decimals), "showspikes": clock is None},
        **axes,
        "annotations": [title for title in titles if title["text"]],
        "shapes": [_cursor(), *shapes] if clock is not None else shapes,
        "hovermode": "x unified",
        "showlegend": False,  # the page has its own, of buttons
        "margin": {"l": LEFT, "r": 12, "t": ABOVE, "b": BELOW},
        "uirevision": "kept",
    }
    return {
        "kind": "plot",
        "data": data,
        "layout": layout,
        "height": height,
        "clock": clock,
        "views": {
            name: [scale * start, scale * end] for name, (start, end) in (views or {}).items()
        },
    }


def packed(values: Array) -> dict[str, str]:
    """Numbers as Plotly takes them in the fewest bytes: single precision, little-endian."""
    content = np.asarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(content).decode()}


def variable(role: Role) -> str:
    """The colour of a role as the page names it."""
    for name, known in ROLES.items():
        if known.light == role.light:
            return f"var(--{name})"
    raise KeyError(f"no colour of the page is {role.light}: give the role one of ROLES")


def dashes(role: Role) -> str:
    """The pattern of a role's line, as Plotly and SVG spell it."""
    if role.dashes == "-":
        return "solid"
    return ",".join(f"{part * role.width * BOLDER:.1f}px" for part in role.dashes[1])


def _domains(panels: Sequence[Panel]) -> tuple[list[tuple[float, float]], float]:
    """Where each panel stands, as shares of the height from below, and the whole height [px]."""
    heights = [ROW * panel.height for panel in panels]
    inner = sum(heights) + GAP * (len(panels) - 1)
    spans, top = [], inner
    for height in heights:
        spans.append((round(max(top - height, 0.0) / inner, 6), round(top / inner, 6)))
        top -= height + GAP
    return spans, inner + ABOVE + BELOW


def _trace(curve: Curve, axis: str, unit: str, scale: float) -> dict[str, Any]:
    colour = variable(curve.role)
    looks: dict[str, Any] = {
        "mode": "lines",
        "line": {
            "color": colour,
            "width": round(curve.role.width * BOLDER, 2),
            "dash": dashes(curve.role),
            "shape": "hv" if curve.held else "linear",
        },
    }
    if curve.dots:
        marker = {"color": "rgba(0,0,0,0)", "size": 7, "line": {"color": colour, "width": 1.6}}
        looks = {"mode": "markers", "marker": marker}
    return {
        "type": "scatter",
        "name": curve.name,
        "x": packed(curve.times * scale),
        "y": packed(curve.values),
        "yaxis": axis,
        "visible": "legendonly" if curve.hidden else True,
        "hovertemplate": f"%{{y:.2f}} {unit}",
        "connectgaps": False,
        **looks,
    }


def _x_axis(panels: Sequence[Panel], unit: str, scale: float, decimals: int) -> dict[str, Any]:
    times = [curve.times for panel in panels for curve in panel.curves]
    start = scale * min(float(np.nanmin(each)) for each in times)
    end = scale * max(float(np.nanmax(each)) for each in times)
    return {
        **_lines(),
        "title": {"text": f"time [{unit}]", "standoff": 8},
        "anchor": f"y{len(panels)}" if len(panels) > 1 else "y",
        "range": [start, end],
        "minallowed": start,
        "maxallowed": end,
        "unifiedhovertitle": {"text": f"%{{x:.{decimals}f}} {unit}"},
        "spikemode": "across",
        "spikesnap": "cursor",
        "spikethickness": 1,
        "spikedash": "solid",
        "spikecolor": variable(MUTED),
    }


def _y_axis(panel: Panel, span: tuple[float, float]) -> dict[str, Any]:
    return {
        **_lines(),
        "title": {"text": f"{panel.quantity} [{panel.unit}]", "standoff": 6},
        "domain": list(span),
        "nticks": 6,
        "rangemode": "tozero" if panel.floor else "normal",
    }


def _lines() -> dict[str, Any]:
    return {"gridcolor": "var(--grid)", "linecolor": variable(MUTED), "zeroline": False}


def _title(text: str, top: float) -> dict[str, Any]:
    return {
        "text": f"<b>{_escaped(text)}</b>" if text else "",
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": top,
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
    }


def _escaped(text: str) -> str:
    """Text that Plotly takes for nothing but text."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _cursor() -> dict[str, Any]:
    """The line at the moment that the moving leg shows; the script moves it."""
    line = {"color": variable(DESIRED), "width": 1.2}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": 0, "x1": 0, "y0": 0, "y1": 1,
            "line": line, "layer": "above"}  # fmt: skip


def _band(half: float, axis: str) -> dict[str, Any]:
    return {"type": "rect", "xref": "paper", "yref": axis, "x0": 0, "x1": 1, "y0": -half,
            "y1": half, "fillcolor": "var(--closed-form)", "opacity": BAND, "line": {"width": 0},
            "layer": "below"}  # fmt: skip


def _shade(start: float, end: float) -> dict[str, Any]:
    return {"type": "rect", "xref": "x", "yref": "paper", "x0": start, "x1": end, "y0": 0, "y1": 1,
            "fillcolor": "var(--grid)", "opacity": 0.45, "line": {"width": 0},
            "layer": "below"}  # fmt: skip
