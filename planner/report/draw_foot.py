"""Pictures of the foot, seen from the side of the robot: the paper's Figures 1 and 8."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.report.curves import Curve, Panel, draw_curve
from planner.report.style import (
    DESIRED,
    DIRECT,
    FOOT_OPTIMAL,
    GRID,
    INK,
    MUTED,
    OPTIMAL,
    PLAIN,
    SHIFT,
    SURFACE,
    WIDTH,
    Role,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import PlannedWalk, Reproduction
    from planner.trajectory import Array

ROLES = {
    "direct": DIRECT,
    "shift": SHIFT,
    "closed_form_plain": PLAIN,
    "optimal": OPTIMAL,
    "foot_optimal": FOOT_OPTIMAL,
}
"""The methods that are drawn, in order; the closed form with knots refined is not the paper's."""

UNSEEN = ("shift", "optimal")
"""Not in Figure 8: in space they are the direct method's path, and nearly the closed form's."""

SKETCHED = 22
"""Sample at which the leg is drawn: in the middle of the time on the ground."""


def draw_direct_foot(reproduction: Reproduction) -> Figure:
    """Figure 1: desired path of the foot, and what comes of requesting the desired angles."""
    figure, axes = side_view(height=2.75)
    desired = reproduction.walk.desired_foot
    actual = reproduction.foot["direct"].positions
    draw_path(axes, desired, DESIRED)
    draw_path(axes, actual, DIRECT)
    for k in range(0, len(desired), 8):
        axes.plot(*seen(np.array([desired[k], actual[k]])), color=GRID.light, lw=1.0, zorder=1)
    _mark_direction(axes, desired, 70, DESIRED)
    _mark_direction(axes, actual, 77, DIRECT)
    legend(axes, 2)
    return figure


def draw_foot_paths(reproduction: Reproduction) -> Figure:
    """Figure 8: the paths of the foot under the methods, with the leg at one instant."""
    figure, axes = side_view(height=4.1)
    draw_leg(axes, reproduction)
    draw_path(axes, reproduction.walk.desired_foot, DESIRED, zorder=6)
    for method, role in ROLES.items():
        if method not in UNSEEN:
            draw_path(axes, reproduction.foot[method].positions, role)
    legend(axes, 2)
    return figure


def draw_foot_distances(reproduction: Reproduction) -> Figure:
    """How far the foot is from where it should be, at each time, under every method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    axes = figure.add_subplot()
    for curve in distance_panel(reproduction).curves:
        draw_curve(axes, curve)
    samples = len(reproduction.walk.desired)
    axes.set_xlim(0, samples)
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(range(0, samples + 1, samples // 8))
    axes.set_xlabel(f"time [samples of {1000.0 * reproduction.model.period:g} ms]")
    axes.set_ylabel("distance [cm]")
    legend(axes, 2)
    return figure


def distance_panel(reproduction: Reproduction, *, hidden: Sequence[str] = ()) -> Panel:
    """The foot's distances over samples, those of some methods hidden at first."""
    curves = []
    for method, role in ROLES.items():
        distances = 100.0 * reproduction.foot[method].distances
        values = np.append(distances, distances[0])
        times = np.arange(float(len(values)))
        curves.append(Curve(role, times, values, hidden=method in hidden))
    return Panel("foot, from its desired path", "distance", "cm", tuple(curves), floor=True)


def side_view(height: float) -> tuple[Figure, Axes]:
    """Axes for paths of the foot, seen from the side, so high [inch]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.07)
    axes.set_xlabel("forward of the hip, x [cm]")
    axes.set_ylabel("above the hip, z [cm]")
    return figure, axes


def seen(positions: Array) -> tuple[Array, Array]:
    """What is seen of positions [m] from the side [cm]."""
    return 100.0 * positions[:, 0], 100.0 * positions[:, 2]


def draw_path(
    axes: Axes, positions: Array, role: Role, zorder: float = 4, *, closed: bool = True
) -> None:
    """A path of the foot [m], shape (n, 3), up to where it begins again if it is closed."""
    path = np.vstack([positions, positions[:1]]) if closed else positions
    axes.plot(*seen(path), zorder=zorder, **role.line)


def _mark_direction(axes: Axes, positions: Array, sample: int, role: Role) -> None:
    tail, tip = positions[sample], positions[sample + 2]
    axes.annotate(
        "",
        xy=(100.0 * tip[0], 100.0 * tip[2]),
        xytext=(100.0 * tail[0], 100.0 * tail[2]),
        arrowprops={"arrowstyle": "-|>", "color": role.light, "lw": 0.0, "mutation_scale": 15},
        zorder=7,
    )


def draw_leg(axes: Axes, planned: PlannedWalk) -> None:
    """The leg at one instant, and the ground."""
    hip = np.zeros(3)
    joints = np.vstack([hip, planned.knee[SKETCHED], planned.walk.desired_foot[SKETCHED]])
    across, up = seen(joints)
    axes.plot(across, up, color=GRID.light, lw=9, solid_joinstyle="round", zorder=1.5)
    axes.plot(across, up, "o", color=SURFACE.light, ms=6, mec=MUTED.light, mew=1.2, zorder=2)
    for name, x, z, shift in zip(("hip", "knee"), across, up, ((9, 2), (-9, 6)), strict=False):
        axes.annotate(
            name,
            (x, z),
            xytext=shift,
            textcoords="offset points",
            color=MUTED.light,
            fontsize=8.5,
            ha="left" if shift[0] > 0 else "right",
        )
    ground = 100.0 * float(planned.walk.desired_foot[:, 2].min())
    axes.axhline(ground, color=MUTED.light, lw=0.6, zorder=1)
    axes.annotate(
        "ground",
        (0.995, ground),
        xycoords=("axes fraction", "data"),
        xytext=(0, -3),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8.5,
        color=MUTED.light,
    )


def legend(axes: Axes, columns: int) -> None:
    """The legend above the axes."""
    figure = axes.figure
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, labelcolor=INK.light)
