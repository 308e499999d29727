"""Curves, axes and words in Plotly's own words, as plain dictionaries.

Nothing of Plotly's Python package is needed to make them. Colours are written as the page's own,
``var(--direct)``; the script in the page looks them up, so that a plot is light or dark with the
page.
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve
from planner.report.style import INK, MUTED, ROLES, Role

if TYPE_CHECKING:
    from planner.trajectory import Array

BOLDER = 1.2
"""Pixels for a point of a line: a screen is farther away than paper."""

SMALL = 4.5
"""Diameter of a dot of many [px]."""

NOWHERE = "rgba(0,0,0,0)"
"""The colour of what is not filled."""


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


def trace(curve: Curve, *, hover: str, scale: float = 1.0) -> dict[str, Any]:
    """A curve.

    Args:
        curve: The curve.
        hover: What is told of a point under the pointer; where the curve has notes, they follow.
        scale: How many of the axis's unit one unit of the curve's times is.
    """
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
        marker: dict[str, Any] = {
            "color": NOWHERE,
            "size": 7,
            "line": {"color": colour, "width": 1.6},
        }
        if curve.filled:
            marker |= {
                "color": colour,
                "size": SMALL if curve.filled < 1.0 else 7,
                "opacity": curve.filled,
            }
            marker["line"]["width"] = 0
        looks = {"mode": "markers", "marker": marker}
    if curve.notes:
        hover = (
            hover.replace("<extra>", " · %{text}<extra>")
            if "<extra>" in hover
            else f"{hover} · %{{text}}"
        )
        looks["text"] = list(curve.notes)
    return {
        "type": "scatter",
        "name": curve.name,
        "x": packed(curve.times * scale),
        "y": packed(curve.values),
        "visible": "legendonly" if curve.hidden else True,
        "hovertemplate": hover,
        "connectgaps": False,
        **looks,
    }


def lines() -> dict[str, Any]:
    """How every axis looks."""
    return {"gridcolor": "var(--grid)", "linecolor": variable(MUTED), "zeroline": False}


def heading(text: str, top: float) -> dict[str, Any]:
    """The title of a panel, whose upper end is at a share of the height."""
    return {
        "text": f"<b>{escaped(text)}</b>" if text else "",
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": top,
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
    }


def label(
    text: str, x: float, y: float, *, yref: str = "y", bold: bool = False, **more: Any
) -> dict[str, Any]:
    """Words in a panel, at a place in its units."""
    return {
        "text": f"<b>{escaped(text)}</b>" if bold else escaped(text),
        "x": x,
        "y": y,
        "xref": "x",
        "yref": yref,
        "showarrow": False,
        "font": {"color": variable(INK), "size": 12},
        **more,
    }


def escaped(text: str) -> str:
    """Text that Plotly takes for nothing but text."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def box(
    x: tuple[float, float], y: tuple[float, float], role: Role, opacity: float, **references: str
) -> dict[str, Any]:
    """A rectangle behind the curves."""
    return {"type": "rect", "x0": x[0], "x1": x[1], "y0": y[0], "y1": y[1], **references,
            "fillcolor": variable(role), "opacity": opacity, "line": {"width": 0},
            "layer": "below"}  # fmt: skip


def stroke(
    x: tuple[float, float],
    y: tuple[float, float],
    role: Role = MUTED,
    *,
    width: float = 1.0,
    dash: str = "solid",
    **references: str,
) -> dict[str, Any]:
    """A straight line behind the curves."""
    return {
        "type": "line",
        "x0": x[0],
        "x1": x[1],
        "y0": y[0],
        "y1": y[1],
        "xref": "x",
        "yref": "y",
        **references,
        "line": {"color": variable(role), "width": width, "dash": dash},
        "layer": "below",
    }
