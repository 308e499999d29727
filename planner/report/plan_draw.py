"""Pictures of a plan for any joints: the foot in space, and every joint with its requests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.style import (
    DESIRED,
    DIRECT,
    GRID,
    INK,
    MUTED,
    REQUESTED,
    SURFACE,
    WIDTH,
    Role,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.evaluation.plan_outcome import PlanOutcome
    from planner.trajectory import Array

VIEWS = {"side": (0, "x"), "front": (1, "y")}
"""What a view has across [index and name of the axis]; upward it has z."""

POSES = 5
"""Moments at which the leg is sketched."""


def draw_view(outcome: PlanOutcome, role: Role, view: str) -> Figure:
    """The paths of the foot seen from the side or from the front, with the leg at some moments."""
    from matplotlib.figure import Figure

    assert outcome.leg is not None, "only a leg has a foot"
    across, name = VIEWS[view]
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.add_subplot()
    chosen = np.linspace(0, len(outcome.desired), POSES, endpoint=not outcome.cyclic)
    sketched = outcome.predicted[np.minimum(chosen.astype(int), len(outcome.desired) - 1)]
    for number, points in enumerate(outcome.leg.joint_positions(sketched)):
        draw_sketch(axes, 100.0 * points[:, [across, 2]], first=number == 0)
    for positions, looks in zip(outcome.feet.values(), (DESIRED, DIRECT, role), strict=True):
        seen = 100.0 * (np.vstack([positions, positions[:1]]) if outcome.cyclic else positions)
        axes.plot(seen[:, across], seen[:, 2], zorder=6 if looks is DESIRED else 4, **looks.line)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.07)
    axes.set_xlabel(f"{name} in the frame {outcome.leg.base} [cm]")
    axes.set_ylabel("z [cm]")
    _legend(figure, axes, 3)
    return figure


def draw_distances(outcome: PlanOutcome, role: Role) -> Figure:
    """How far the foot is from where it should be, at each time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    axes = figure.add_subplot()
    for distances, looks in zip(outcome.distances.values(), (DIRECT, role), strict=True):
        _draw_line(axes, 100.0 * distances, looks, outcome)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("distance [cm]")
    _set_time(axes, outcome)
    _legend(figure, axes, 3)
    return figure


def draw_joint(outcome: PlanOutcome, role: Role, joint: int) -> Figure:
    """A joint: above its angles, below its requests against the limits."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 3.9), layout="constrained")
    angles, requests = figure.subplots(2, 1, sharex=True)
    for values, looks in (
        (outcome.desired, DESIRED),
        (outcome.direct, DIRECT),
        (outcome.predicted, role),
    ):
        _draw_line(angles, np.degrees(values[:, joint]), looks, outcome)
    _draw_line(requests, np.degrees(outcome.desired[:, joint]), DESIRED, outcome)
    _draw_line(requests, np.degrees(outcome.requests[:, joint]), REQUESTED, outcome)
    angles.set_ylabel("angle [deg]")
    requests.set_ylabel("request [deg]")
    for axes in (angles, requests):
        axes.margins(y=0.12)
        _widen(axes)
    _draw_limits(requests, outcome.limits.get(outcome.names[joint]))
    _set_time(requests, outcome)
    figure.align_ylabels()
    shown = {**_entries(angles), **_entries(requests)}
    figure.legend(list(shown.values()), list(shown), loc="outside upper left", ncols=3)
    return figure


def draw_sketch(axes: Axes, points: Array, *, first: bool) -> None:
    """Sketch a leg's links and joints [cm], shape (k, 2); the first of several stands out."""
    style: dict[str, Any] = {"solid_joinstyle": "round", "zorder": 1.5 if first else 1.0}
    axes.plot(*points.T, color=GRID.light, lw=8 if first else 2.5, **style)
    if first:
        axes.plot(*points.T, "o", color=SURFACE.light, ms=5.5, mec=MUTED.light, mew=1.2, zorder=2)


def _draw_line(axes: Axes, values: Array, role: Role, outcome: PlanOutcome) -> None:
    """A curve over time; a cycle up to where it begins again."""
    drawn = np.append(values, values[0]) if outcome.cyclic else values
    times = 1000.0 * outcome.period * np.arange(len(drawn))
    axes.plot(times, drawn, zorder=6 if role is DESIRED else 4, **role.line)


def _draw_limits(axes: Axes, limits: tuple[float, float] | None) -> None:
    """The limits, in a picture that is not made small for their sake."""
    low, high = axes.get_ylim()
    reach = 0.6 * (high - low)
    for limit in limits or ():
        angle = math.degrees(limit)
        if low - reach <= angle <= high + reach:
            axes.axhline(angle, color=INK.light, lw=1.1, ls=(0, (1, 1.5)), label="limit")


def _widen(axes: Axes) -> None:
    """Show at least a degree, so that rounding does not look like a movement."""
    low, high = axes.get_ylim()
    if high - low < 1.0:
        axes.set_ylim(0.5 * (low + high - 1.0), 0.5 * (low + high + 1.0))


def _set_time(axes: Axes, outcome: PlanOutcome) -> None:
    steps = len(outcome.desired) if outcome.cyclic else len(outcome.desired) - 1
    axes.set_xlim(0.0, 1000.0 * outcome.period * steps)
    axes.set_xlabel("time [ms]; it repeats" if outcome.cyclic else "time [ms]")


def _entries(axes: Axes) -> dict[str, Any]:
    """What stands in the legend, by its name."""
    handles, labels = axes.get_legend_handles_labels()
    return dict(zip(labels, handles, strict=True))


def _legend(figure: Figure, axes: Axes, columns: int) -> None:
    shown = _entries(axes)
    figure.legend(list(shown.values()), list(shown), loc="outside upper left", ncols=columns)
