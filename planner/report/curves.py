"""Curves over time as data: what the still pictures and the interactive plots both draw."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.report.style import Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.trajectory import Array


class Curve(NamedTuple):
    """Values over time.

    Attributes:
        role: What it stands for, with its looks.
        times: Times of the values, in the unit of whoever draws it, shape (n,).
        values: The values, in the unit of their panel, shape (n,); NaN leaves a gap.
        label: Its name in legends; the role's own by default. Equal labels are hidden together.
        dots: Whether only the values themselves are drawn.
        held: Whether each value holds until the next.
        hidden: Whether an interactive plot shows it only when it is asked for.
        filled: Opacity of dots that an interactive plot fills; rings without.
        notes: What an interactive plot adds to each value under the pointer, n of them or none.
    """

    role: Role
    times: Array
    values: Array
    label: str = ""
    dots: bool = False
    held: bool = False
    hidden: bool = False
    filled: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """What legends call it."""
        return self.label or self.role.label


class Span(NamedTuple):
    """A span of time that an interactive plot shades in one panel.

    Attributes:
        start: Its beginning, in the curves' unit.
        end: Its end, likewise.
        role: Whose colour it has.
        opacity: How much of that colour.
        label: What it is, in a few words, if it is to be told.
        label_side: Beside which end that stands, "left" or "right".
    """

    start: float
    end: float
    role: Role
    opacity: float
    label: str = ""
    label_side: str = "right"


class Panel(NamedTuple):
    """Curves of one quantity.

    Attributes:
        title: What it is about, such as the name of a joint.
        quantity: What is drawn, such as "angle".
        unit: Its unit, such as "deg".
        curves: The curves; later ones lie over earlier ones.
        band: Half the height of a band about zero, or None.
        height: Height beside those of the other panels.
        floor: Whether zero is at the bottom.
        spans: Spans of time to shade.
        range: Least and largest value to show, where they are not to be chosen by the curves.
    """

    title: str
    quantity: str
    unit: str
    curves: tuple[Curve, ...]
    band: float | None = None
    height: float = 1.0
    floor: bool = False
    spans: tuple[Span, ...] = ()
    range: tuple[float, float] | None = None


def cycle(angles: Array, role: Role, label: str = "", *, hidden: bool = False) -> Curve:
    """One cycle of angles [rad], up to where it begins again, in degrees over samples."""
    return cycles(np.degrees(angles)[None], role, label)._replace(hidden=hidden)


def cycles(values: Array, role: Role, label: str = "") -> Curve:
    """Every cycle of some values, shape (cycles, n), over samples, with gaps between them."""
    count, samples = values.shape
    gap = np.full((count, 1), np.nan)
    closed = np.hstack([values, values[:, :1], gap]).ravel()[:-1]
    times = np.tile(np.append(np.arange(samples + 1.0), np.nan), count)[:-1]
    return Curve(role, times, closed, label)


def draw_curve(axes: Axes, curve: Curve) -> None:
    """Draw a curve into a still picture."""
    line = {**curve.role.line, "label": curve.name}
    if curve.dots:
        line |= {"linestyle": "", "marker": "o", "ms": 4.5, "mec": curve.role.light, "mew": 1.3}
        line |= {"color": "none", "zorder": 5, "clip_on": False}
    axes.plot(
        curve.times, curve.values, drawstyle="steps-post" if curve.held else "default", **line
    )
