"""Interactive plots of curves over time: panels with one time axis, for Plotly in the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.report.curves import Panel, Span
from planner.report.live_words import box, heading, label, lines, trace, variable
from planner.report.style import CLOSED_FORM, DESIRED, GRID, MUTED

ROW = 150
"""Height of a panel of height 1 [px]."""

ABOVE, BELOW, LEFT = 30, 46, 58
"""Margins: for the first title and the buttons, for the time axis, and for numbers [px]."""

GAP = 34
"""Between panels, room for a title [px]."""

BAND, SHADE = 0.16, 0.45
"""Opacity of a band, and of spans of time shaded in every panel."""


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
        titles.append(heading(panel.title, span[1]))
        hover = f"%{{y:.2f}} {panel.unit}"
        data += [
            {**trace(curve, hover=hover, scale=scale), "yaxis": f"y{suffix}"}
            for curve in panel.curves
        ]
        if panel.band is not None:
            ends = (-panel.band, panel.band)
            shapes.append(box((0, 1), ends, CLOSED_FORM, BAND, xref="paper", yref=f"y{suffix}"))
        for each in panel.spans:
            x = (each.start * scale, each.end * scale)
            place = {"xref": "x", "yref": f"y{suffix} domain"}
            shapes.append(box(x, (0, 1), each.role, each.opacity, **place))
            if each.label:
                titles.append(_span_label(each, scale, f"y{suffix} domain"))
    shapes += [
        box((start * scale, end * scale), (0, 1), GRID, SHADE, xref="x", yref="paper")
        for start, end in shaded
    ]
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


def _domains(panels: Sequence[Panel]) -> tuple[list[tuple[float, float]], float]:
    """Where each panel stands, as shares of the height from below, and the whole height [px]."""
    heights = [ROW * panel.height for panel in panels]
    inner = sum(heights) + GAP * (len(panels) - 1)
    spans, top = [], inner
    for height in heights:
        spans.append((round(max(top - height, 0.0) / inner, 6), round(top / inner, 6)))
        top -= height + GAP
    return spans, inner + ABOVE + BELOW


def _x_axis(panels: Sequence[Panel], unit: str, scale: float, decimals: int) -> dict[str, Any]:
    times = [curve.times for panel in panels for curve in panel.curves]
    start = scale * min(float(np.nanmin(each)) for each in times)
    end = scale * max(float(np.nanmax(each)) for each in times)
    return {
        **lines(),
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
        **lines(),
        "title": {"text": f"{panel.quantity} [{panel.unit}]", "standoff": 6},
        "domain": list(span),
        "nticks": 6,
        **({"range": list(panel.range)} if panel.range else {}),
        "rangemode": "tozero" if panel.floor else "normal",
    }


def _cursor() -> dict[str, Any]:
    """The line at the moment that the moving leg shows; the script moves it."""
    line = {"color": variable(DESIRED), "width": 1.2}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": 0, "x1": 0, "y0": 0, "y1": 1,
            "line": line, "layer": "above"}  # fmt: skip


def _span_label(span: Span, scale: float, yref: str) -> dict[str, Any]:
    """What a span is, beside its upper end: on that side where there is room."""
    left = span.label_side == "left"
    x = scale * (span.start if left else span.end)
    anchor = "right" if left else "left"
    return label(span.label, x, 1.0, yref=yref, xanchor=anchor, yanchor="top")
