"""A figure, described once: panels of curves over one axis. Pages and Matplotlib draw it.

Its looks are a colour and a line for each role, distinct without colours too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from planner.arrays import Array, rms
from planner.report.wording import UNITS, Unit, words_of

if TYPE_CHECKING:
    from planner.planning.plan import Plan


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

MARGIN = 0.06
"""Room beside the values of an axis, as a share of their span."""

MOST_FRAMES = 1500
"""Most samples of a motion that are shown; of longer motions every second one, or every third."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A line, or marks, through points."""

    role: Role  # meaning, with its looks
    x: Array  # horizontal values in the unit of the figure's axis, shape (n,)
    y: Array  # vertical values in the unit of the panel's axis, shape (n,); NaN leaves a gap

    # its name in legends; the role's own by default. Equal names are hidden together
    label: str = ""
    legend: bool = True  # whether legends have it; a line for reference is not in them
    marks: Literal["", "rings", "dots"] = ""  # instead of a line
    opacity: float = 1.0  # of dots
    held: bool = False  # whether each value holds until the next
    hidden: bool = False  # whether only a page shows it, and only on demand

    # words that a page adds to each value under the pointer, n of them or none
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Its name in legends."""
        return self.label or self.role.label


Traces = Iterable[tuple[Array, Role] | tuple[Array, Role, bool]]
"""Values of each sample [rad], shape (n,), how they are drawn, and whether they are hidden."""


@dataclass(frozen=True)
class Span:
    """A shaded part of one axis of a panel."""

    start: float  # in the unit of the axis
    end: float
    role: Role  # gives its colour
    opacity: float
    along: Literal["x", "y"] = "x"  # the axis


@dataclass(frozen=True)
class Words:
    """Words at ``x`` and ``y`` of a panel, in the units of its axes; v_max has an index."""

    text: str
    x: float
    y: float
    across: Literal["left", "center", "right"] = "center"
    upward: Literal["top", "middle", "bottom"] = "middle"


@dataclass(frozen=True)
class Axis:
    """One side of a panel."""

    title: str  # the quantity; its unit is added
    unit: str = ""  # unit of the values; "" where the axis has names

    # least and largest value shown; chosen by the curves where it is None
    range: tuple[float, float] | None = None
    names: Mapping[float, str] | None = None  # words at some values, instead of numbers
    decimals: int = 2  # decimals of a value under the pointer
    from_zero: bool = False  # whether zero is at the bottom
    note: str = ""  # text after the title and its unit

    @property
    def words(self) -> str:
        """The title with the unit."""
        return (f"{self.title} [{self.unit}]" if self.unit else self.title) + self.note


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves of one quantity."""

    y: Axis  # the vertical axis
    curves: Sequence[Curve]  # later ones lie over earlier ones
    title: str = ""  # its subject, such as the name of a joint
    spans: Sequence[Span] = ()  # shades behind the curves
    words: Sequence[Words] = ()  # words between them
    height: float = 1.0  # height beside that of a usual panel


@dataclass(frozen=True, eq=False)
class Figure:
    """A column of panels over one axis."""

    name: str  # name of its files, and its identifier on a page
    title: str  # its subject, in a few words
    caption: str  # what to see in it
    x: Axis  # the horizontal axis
    panels: Sequence[Panel] = ()  # from the top
    over_time: bool = False  # whether that axis is time
    equal: bool = False  # whether a unit is as long along both axes

    # how many units of the axis a second is, where the figure follows the moving leg of its page
    # and is zoomed in time with the others that do; or None
    clock: float | None = None

    # parts of the axis that a button of that name brings into view; it takes the whole page's width
    views: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # data of a moving leg or of numbers at a moment, which a page shows in place of the panels
    live: Mapping[str, Any] | None = None

    @property
    def description(self) -> str:
        """A description for screen readers: its axes, panels and curves."""
        curves = [curve for panel in self.panels for curve in panel.curves]
        parts = {
            "axes": [*(panel.y.words for panel in self.panels), self.x.words],
            "panels": [panel.title for panel in self.panels],
            "curves": [each.name for each in curves if each.legend and not each.hidden],
        }
        named = {kind: dict.fromkeys(filter(None, names)) for kind, names in parts.items()}
        phrases = (f"{kind}: {', '.join(names)}" for kind, names in named.items() if names)
        return f"{self.title}. {'; '.join(phrases)}"

    @property
    def x_range(self) -> tuple[float, float]:
        """Ends of the horizontal axis."""
        values = [curve.x for panel in self.panels for curve in panel.curves]
        return self.x.range or around(values, margin=0.0 if self.over_time else MARGIN)


class Timeline:
    """The samples of a motion, ``period`` [s] apart, on an axis of time."""

    def __init__(self, period: float, samples: int, cyclic: bool = True) -> None:
        """Measure in milliseconds, or a long motion in seconds."""
        self.period, self.samples, self.cyclic = period, samples, cyclic
        self.last = samples if cyclic else samples - 1  # the sample at the end of the axis
        self.stride = -(-samples // MOST_FRAMES)  # from one sample that is shown to the next
        self.unit = "ms" if 1000.0 * period * samples <= 5000.0 else "s"
        self.per_second = 1000.0 if self.unit == "ms" else 1.0  # units of the axis in a second
        self.step = period * self.per_second  # units from a sample to the next
        decimals = (k for k in range(3) if abs(round(self.step, k) - self.step) < 1e-9)
        ends, note = (0.0, self.step * self.last), "; it repeats" if cyclic else ""
        self.axis = Axis("time", self.unit, ends, decimals=next(decimals, 3), note=note)

    @classmethod
    def of(cls, plan: Plan) -> Timeline:
        """The times of a plan."""
        return cls(plan.period, len(plan.desired), plan.cyclic)

    def curve(self, values: Array, role: Role, label: str = "", **more: Any) -> Curve:
        """A value per sample, shape (n,); of a cycle up to where it begins again."""
        heights = np.append(values, values[0]) if self.cyclic else values
        return Curve(role, self.step * np.arange(float(len(heights))), heights, label, **more)

    def leg(
        self,
        name: str,
        words: tuple[str, str],
        desired: Array,
        others: Iterable[tuple[Role, Array]],
        *,
        ground: float | None = None,
        hidden: Collection[str] = (),
    ) -> Figure:
        """A leg that moves as desired and by role in other ways; points [m], (n, joints + 1, 3)."""
        motions = []
        for role, points in ((DESIRED, desired), *others):
            far = np.linalg.norm(points[:: self.stride, -1] - desired[:: self.stride, -1], axis=1)
            known = role is not DESIRED
            motions.append(
                {
                    "name": role.label,
                    "colour": role.colour,
                    "width": role.pixels,
                    "dashes": role.strokes.replace("solid", "none").replace("px", ""),
                    "hidden": role.label in hidden,
                    "points": rounded(points[:: self.stride], 100.0),
                    "distances": rounded(far, 100.0) if known else None,
                    "rms": rounded(rms(far), 100.0) if known else None,
                }
            )
        live = {
            "kind": "leg",
            "period": self.stride * self.period,
            "cyclic": self.cyclic,
            "ground": None if ground is None else rounded(ground, 100.0),
            "motions": motions,
        }
        return Figure(name, *words, self.axis, live=live)

    def path(self, positions: Array, role: Role) -> Curve:
        """A path of the foot [m], shape (n, 3): x and z in cm, with the time at its points."""
        points = 100.0 * (np.vstack([positions, positions[:1]]) if self.cyclic else positions)
        times = tuple(f"{self.step * k:g} {self.unit}" for k in range(len(points)))
        return Curve(role, points[:, 0], points[:, 2], notes=times)

    def figure(
        self, name: str, panels: Sequence[Panel], words: tuple[str, str], *, clock: bool = False
    ) -> Figure:
        """Panels over time, with title and caption; ``clock``: whether they follow a moving leg."""
        per_second = self.per_second if clock else None
        return Figure(name, *words, self.axis, panels, over_time=True, clock=per_second)


def joint_figure(
    timeline: Timeline,
    name: str,
    words: tuple[str, str],
    *,
    angles: Traces = (),
    errors: Traces = (),
    requests: Traces = (),
    unit: Unit = UNITS["rad"],
    limits: tuple[float, float] | None = None,
    spans: Sequence[Span] = (),
    below: Sequence[Panel] = (),
    clock: bool = True,
    title: str = "predicted",
) -> Figure:
    """A joint's angles, errors and requests; those given."""
    sign, factor = unit.sign, unit.factor

    def curves(drawn: Traces, *, held: bool = False) -> list[Curve]:
        of_path = DESIRED.light  # nothing holds what is desired
        return [
            timeline.curve(
                factor * values, role, held=held and role.light != of_path, hidden=any(hidden)
            )
            for values, role, *hidden in drawn
        ]

    requested = curves(requests, held=True)
    # one far away would flatten the curves
    low, high = around([curve.y for curve in requested[-1:]], margin=0.6)
    lines = [
        Curve(LIMIT, np.array([0.0, timeline.step * timeline.last]), np.full(2, factor * limit))
        for limit in limits or ()
        if low <= factor * limit <= high
    ]
    panels = []
    for quantity, least, drawn, about, shades in (
        ("angle", 1.0, curves(angles), title, spans),
        ("error", 0.05, curves(errors), "errors", ()),
        ("request", 1.0, [*lines, *requested], "requested", ()),
    ):
        low, high = around([curve.y for curve in drawn], margin=0.0)
        middle = 0.5 * (low + high)
        # so that rounding does not look like a motion
        ends = (middle - 0.5 * least, middle + 0.5 * least) if high - low < least else None
        if drawn:
            panels.append(Panel(Axis(quantity, sign, ends), drawn, about, shades))
    return timeline.figure(name, [*panels, *below], words, clock=clock)


def foot_figure(timeline: Timeline, feet: Mapping[str, Sequence[tuple[Role, Plan]]]) -> Figure:
    """How far feet are from where they should be over time [cm], by leg; "" for the only one."""
    only, panels, axis = "" in feet, [], Axis("distance", "cm", from_zero=True)
    for name, plans in feet.items():
        curves = [timeline.curve(100.0 * plan.distances, role) for role, plan in plans]
        panels.append(Panel(axis, curves, name, height=1.8 if only else 1.0))
    name = "foot_distances" if only else "feet_distances"
    return timeline.figure(name, panels, words_of("feet", several=not only), clock=True)


def around(values: Iterable[Array], *, margin: float = MARGIN) -> tuple[float, float]:
    """The ends of an axis on which all values lie, with room on both sides."""
    finite = [each[np.isfinite(each)] for each in values]
    every = np.concatenate([*finite, np.empty(0)])
    if not len(every):
        return -1.0, 1.0
    low, high = float(every.min()), float(every.max())
    room = margin * (high - low)
    return low - room, high + room


def joined(parts: Iterable[Array]) -> Array:
    """Several curves as one, with gaps between them."""
    return np.concatenate([np.append(part, np.nan) for part in parts])[:-1]


def line(x: Sequence[float], y: Sequence[float], role: Role = MUTED) -> Curve:
    """A line for reference, which no legend has."""
    return Curve(role._replace(width=0.9), np.asarray(x, float), np.asarray(y, float), legend=False)


def rounded(values: Any, factor: float = 1.0) -> Any:
    """Plain numbers with two decimals, less than a pixel, times a factor: 100 for centimetres."""
    return (np.round(factor * np.asarray(values), 2) + 0.0).tolist()  # no minus before zero
