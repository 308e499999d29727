"""The looks of every figure: a colour and a line for each role, distinct without colours too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Role(NamedTuple):
    """A curve's meaning and looks: a colour of Okabe and Ito's or darker, its width in points."""

    label: str
    light: str
    dark: str
    width: float = 1.8
    dashes: Any = "-"

    @property
    def colour(self) -> str:
        """Its colour on a page, which is light or dark with the page."""
        return f"var(--{next(name for name, role in ROLES.items() if role.light == self.light)})"

    @property
    def strokes(self) -> str:
        """The pattern of its line on a page, as Plotly and SVG spell it."""
        if self.dashes == "-":
            return "solid"
        return ",".join(f"{part * self.width * BOLDER:.1f}px" for part in self.dashes[1])

    @property
    def pixels(self) -> float:
        """The width of its line on a page."""
        return round(self.width * BOLDER, 2)


BOLDER = 1.2
"""Pixels for a point of a line: a screen is farther away than paper."""


INK = Role("ink", "#1f2328", "#e8eaed")
MUTED = Role("muted", "#6b7280", "#9aa3ad")
GRID = Role("grid", "#dfe3e8", "#32383f", width=0.7)
SURFACE = Role("surface", "#fefefe", "#16191d")

DESIRED = Role("desired", "#b4becb", "#66717e", width=5.0)
"""Wide and pale: the curves that should lie on it are drawn over it, and both are seen."""

REQUESTED = Role("requested", "#d18b00", "#f2b441", width=1.4)
DIRECT = Role("direct", "#c8501a", "#f28a54", dashes=(0, (4, 2.4)))
SHIFT = Role("best time shift", "#8a4b9f", "#cc96dd", width=1.4, dashes=(0, (1.2, 1.2)))
APPROXIMATION = Role(
    "approximation", "#8a5a2b", "#cfa274", width=1.4, dashes=(0, (6, 1.5, 1.2, 1.5))
)
CLOSED_FORM = Role("closed form", "#0067a8", "#58b4f0", width=1.5)
PLAIN = CLOSED_FORM._replace(label="closed form, as in the paper")
OPTIMAL = Role("optimised", "#00805f", "#3ecb9c", width=1.6, dashes=(0, (8, 1.4)))
FOOT_OPTIMAL = Role("foot-optimised", "#b3126b", "#ff7ab8", width=3.0)
LOWER_BOUND = APPROXIMATION._replace(label="lower bound", dashes=(0, (5, 2)))
LIMIT = MUTED._replace(label="limit", width=1.0, dashes=(0, (1.5, 2.0)))

ROLES: Mapping[str, Role] = {
    "ink": INK,
    "muted": MUTED,
    "grid": GRID,
    "surface": SURFACE,
    "desired": DESIRED,
    "requested": REQUESTED,
    "direct": DIRECT,
    "shift": SHIFT,
    "approximation": APPROXIMATION,
    "closed-form": CLOSED_FORM,
    "optimal": OPTIMAL,
    "foot-optimal": FOOT_OPTIMAL,
}
"""Every role by the name of its CSS variable; plans by their method."""
