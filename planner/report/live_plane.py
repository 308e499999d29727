"""Interactive plots of one quantity over another: paths in space, speed over error, dots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.report.curves import Curve
from planner.report.live_words import escaped, lines, trace

if TYPE_CHECKING:
    from planner.trajectory import Array

HEIGHT = 330
"""Of a plot, unless it is told [px]."""

ABOVE, BELOW = 30, 46
"""Margins: for the buttons, and for the axis [px]."""

LEFT = 58
"""Margin for numbers [px]; names need more, and take it."""


ROOM = 0.06
"""Beside the values, as a share of what they span."""


class Axis(NamedTuple):
    """What is drawn along one side.

    Attributes:
        title: What it is, with its unit.
        unit: The unit beside a value under the pointer; "" where the axis has names.
        range: Its ends.
        names: What stands at some values, instead of numbers.
        decimals: Of a value under the pointer.
    """

    title: str
    unit: str = ""
    range: tuple[float, float] | None = None
    names: Mapping[float, str] | None = None
    decimals: int = 2


def plane_plot(
    curves: Sequence[Curve],
    across: Axis,
    up: Axis,
    *,
    equal: bool = False,
    height: float = HEIGHT,
    shapes: Sequence[Mapping[str, Any]] = (),
    words: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Curves and dots in a plane.

    Args:
        curves: What is drawn: what curves call times is what lies across.
        across: The axis below.
        up: The axis on the left.
        equal: Whether a unit is as long along both.
        height: Height of the plot [px].
        shapes: What lies behind the curves, from :mod:`planner.report.live_words`.
        words: What is written between them, likewise.

    Returns:
        ``data`` and ``layout`` for Plotly, ``height`` [px]; no ``clock`` and no ``views``.
    """
    hover = ", ".join(
        f"%{{{letter}:.{axis.decimals}f}} {axis.unit}".rstrip()
        for letter, axis in (("x", across), ("y", up))
        if axis.names is None
    )
    layout = {
        "xaxis": _axis(across, standoff=8),
        "yaxis": {**_axis(up, standoff=6), **({"scaleanchor": "x"} if equal else {})},
        "annotations": list(words),
        "shapes": list(shapes),
        "hovermode": "closest",
        "showlegend": False,  # the page has its own, of buttons
        "margin": {"l": LEFT, "r": 12, "t": ABOVE, "b": BELOW},
        "uirevision": "kept",
    }
    return {
        "kind": "plot",
        "data": [
            {**trace(curve, hover=f"{hover}<extra>%{{fullData.name}}</extra>"), "yaxis": "y"}
            for curve in curves
        ],
        "layout": layout,
        "height": height,
        "clock": None,
        "views": {},
    }


def around(*values: Array) -> tuple[float, float]:
    """The ends of an axis on which all values lie, with room on both sides."""
    low = min(float(np.min(each)) for each in values)
    high = max(float(np.max(each)) for each in values)
    room = ROOM * (high - low)
    return low - room, high + room


def _axis(axis: Axis, *, standoff: float) -> dict[str, Any]:
    made: dict[str, Any] = {**lines(), "title": {"text": escaped(axis.title), "standoff": standoff}}
    if axis.range is not None:
        made["range"] = list(axis.range)
    if axis.names is not None:
        words = [escaped(name) for name in axis.names.values()]
        made |= {"tickvals": list(axis.names), "ticktext": words}
        made |= {"automargin": True, "showgrid": False}
    return made
