"""The figures of the paper's experiment, in its order, and some beyond it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.evaluation.reproduction import STEP_AMPLITUDES
from planner.report import style
from planner.report.figure import (
    Axis,
    Curve,
    Figure,
    Motion,
    Movie,
    Panel,
    Span,
    Timeline,
    Words,
    around,
    joined,
    line,
)
from planner.report.style import Role
from planner.report.wording import words_of
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.evaluation.reproduction import PlannedWalk, Reproduction

ROLES = {
    "direct": style.DIRECT,
    "shift": style.SHIFT,
    "closed_form_plain": style.PLAIN,
    "optimal": style.OPTIMAL,
    "foot_optimal": style.FOOT_OPTIMAL,
}
"""The methods that are drawn, in order; the closed form with knots refined is not the paper's."""

HIDDEN = ("shift", "optimal")
"""Methods that are hidden at first: in space they are the direct method's path, and nearly the
closed form's."""

FEATURED = ("figure8_foot_paths", "foot_paths", "joints_by_method")
"""The figures after the key figures: the moving leg and its joints."""

TIED = 8
"""Every so many samples, desired and actual positions are joined by a line."""

SHADE = 0.16
"""Opacity of the shades of lag and acceleration time."""

ACROSS, UPWARD = Axis("forward of the hip, x", "cm"), Axis("above the hip, z", "cm")


def paper_figures(reproduction: Reproduction) -> tuple[Figure, ...]:
    """Every figure, in the order of the paper's."""
    timeline, desired = timeline_of(reproduction), Drawn(reproduction.walk.desired, style.DESIRED)
    requests, angles, plain = reproduction.requests, reproduction.angles, "closed_form_plain"

    def lines(j: int) -> list[Curve]:
        fit = reproduction.plans[plain][j].approximation
        assert fit is not None, "a closed form has an approximation"
        fine = np.linspace(0.0, fit.samples, 20 * fit.samples + 1)  # knots lie between samples
        knots, values = np.mod(fit.knots, fit.samples), np.degrees(fit.values)
        role = style.APPROXIMATION
        return [
            Curve(role, timeline.step * fine, np.degrees(fit(fine))),
            Curve(role, timeline.step * knots, values, "knots", marks="rings"),
        ]

    def joints(name: str, *drawn: Drawn, **more: Any) -> Figure:
        return joints_figure(reproduction, name, [desired, *drawn], **more)

    def beyond(name: str, method: str) -> Figure:
        requested = Drawn(requests[method], style.REQUESTED)
        return joints(name, requested, Drawn(angles[method], ROLES[method], "actual"))

    paths = [
        timeline.path(reproduction.foot[method], role)
        for method, role in ROLES.items()
        if method not in HIDDEN
    ]
    return (
        direct_foot_figure(reproduction),
        joints_figure(
            reproduction,
            "figure2_joints_direct",
            [
                desired._replace(label="requested = desired"),
                Drawn(angles["direct"], style.DIRECT, "actual"),
            ],
        ),
        *(_step_test(reproduction, k, each) for k, each in enumerate(STEP_AMPLITUDES, 3)),
        _speed(reproduction),
        joints("figure6_approximation", more=lines),
        joints(
            "figure7_trajectories",
            Drawn(requests[plain], style.REQUESTED),
            Drawn(reproduction.approximations[plain], style.APPROXIMATION),
            Drawn(angles[plain], style.CLOSED_FORM, "actual"),
        ),
        foot_paths_figure("figure8_foot_paths", reproduction, paths, reproduction.legs),
        joints(
            "joints_by_method",
            *(
                Drawn(angles[method], role, hidden=method == "optimal")
                for method, role in ROLES.items()
                if method != "shift"
            ),
            Drawn(requests["foot_optimal"], style.REQUESTED, "requests, foot-optimised", True),
            below=[distance_panel(reproduction, reproduction.foot)],
        ),
        beyond("optimised_trajectories", "optimal"),
        beyond("foot_optimised_trajectories", "foot_optimal"),
    )


# The foot.


def direct_foot_figure(reproduction: Reproduction) -> Figure:
    """Figure 1: the foot's paths from the side, joined at the same instants by thin lines."""
    desired, actual = reproduction.walk.desired_foot, reproduction.foot["direct"]
    pairs = 100.0 * np.stack([desired[::TIED], actual[::TIED]], axis=1)
    ties = style.GRID._replace(label="the same instants", width=1.2)
    draw = timeline_of(reproduction).path
    curves = (
        Curve(ties, joined(pairs[:, :, 0]), joined(pairs[:, :, 2])),
        draw(desired, style.DESIRED),
        draw(actual, style.DIRECT),
    )
    return Figure(
        "figure1_foot_direct",
        *words_of("figure1_foot_direct"),
        ACROSS,
        (Panel(UPWARD, curves, height=1.8),),
        equal=True,
    )


def foot_paths_figure(
    name: str,
    planned: PlannedWalk,
    paths: Sequence[Curve],
    legs: Mapping[str, Array],
) -> Figure:
    """The foot's paths, with the leg at one instant; on the page the leg moves.

    ``legs``: joints and foot under each method [m], each of shape (n, joints + 1, 3).
    """
    # The leg is drawn in files in the middle of the time on the ground, at sample 22.
    foot, pose = planned.walk.desired_foot, planned.legs["desired"][22]
    ground = float(foot[:, 2].min())
    ends = around([100.0 * foot[:, 0]])
    joints = 100.0 * pose
    panel = Panel(
        UPWARD,
        (
            line(ends, (100.0 * ground,) * 2),
            Curve(style.GRID._replace(width=9.0), joints[:, 0], joints[:, 2], "leg", legend=False),
            timeline_of(planned).path(foot, style.DESIRED),
            *paths,
        ),
        words=(
            Words("hip", joints[0, 0], joints[0, 2], across="left", upward="bottom"),
            Words("knee", joints[2, 0], joints[2, 2], across="right", upward="bottom"),
            Words("ground", ends[1], 100.0 * ground, across="right", upward="top"),
        ),
        height=2.5,
    )
    motions = [Motion(style.DESIRED, planned.legs["desired"])]
    for method, role in ROLES.items():
        distances = np.linalg.norm(legs[method][:, -1] - foot, axis=1)
        motions.append(Motion(role, legs[method], distances, hidden=method in HIDDEN))
    movie = Movie(tuple(motions), planned.models[0].period, cyclic=True, ground=ground)
    return Figure(name, *words_of(name), ACROSS, (panel,), equal=True, movie=movie)


def distance_panel(planned: PlannedWalk, paths: Mapping[str, Array]) -> Panel:
    """The foot's distances, some methods hidden at first; ``paths`` [m]: (n, 3) or of cycles."""
    timeline, curves = timeline_of(planned), list[Curve]()
    for method, role in ROLES.items():
        distances = 100.0 * np.linalg.norm(paths[method] - planned.walk.desired_foot, axis=-1)
        cycles = np.atleast_2d(distances)
        curves += timeline.cycles(cycles, role, hidden=method in HIDDEN)[: distances.ndim]
    axis = Axis("distance", "cm", from_zero=True)
    return Panel(axis, tuple(curves), "foot, from its desired path")


# The joints.


def timeline_of(planned: PlannedWalk) -> Timeline:
    """The samples of a step of the walk."""
    return Timeline(planned.models[0].period, len(planned.walk.desired))


class Drawn(NamedTuple):
    """A curve of every joint, with its looks; a method may be hidden at first."""

    values: Array  # angles or requests [rad], shape (n, k), or of several cycles, (cycles, n, k)
    role: Role
    label: str = ""
    hidden: bool = False


def joints_figure(
    planned: PlannedWalk,
    name: str,
    drawn: Sequence[Drawn],
    *,
    words: str = "",
    below: Sequence[Panel] = (),
    more: Callable[[int], Sequence[Curve]] = lambda _: (),
) -> Figure:
    """A panel per joint over one step of the walk, with ``more`` curves by its index.

    With panels ``below`` it follows the moving leg. ``words``: the block of its caption, its name
    by default.
    """
    timeline, panels = timeline_of(planned), list[Panel]()
    for j, joint in enumerate(planned.walk.joint_names):
        curves: list[Curve] = []
        for values, role, label, hidden in drawn:
            own = np.degrees(values[..., j])
            if own.ndim > 1:
                curves += timeline.cycles(own, role, label, hidden=hidden)
            else:
                held = role is style.REQUESTED
                curves.append(timeline.curve(own, role, label, held=held, hidden=hidden))
        panels.append(Panel(Axis("angle", "deg"), (*curves, *more(j)), joint))
    return timeline.figure(name, [*panels, *below], words_of(words or name), clock=bool(below))


# The model.


def _step_test(reproduction: Reproduction, number: int, amplitude: float) -> Figure:
    """Figures 3 and 4: the answer to a step test, its lag and its acceleration time shaded."""
    response = reproduction.steps[amplitude]
    timeline = Timeline(reproduction.model.period, len(response.angles))
    begun = response.step + response.lag
    full = begun + response.acceleration
    start, middle, end = (timeline.step * sample for sample in (response.step, begun, full))
    speed = math.degrees(response.v_max) * reproduction.model.period
    top = 1.24 * amplitude
    panel = Panel(
        Axis("angle", "deg", (-0.12 * amplitude, top)),
        (
            timeline.degrees(response.requests, style.REQUESTED, held=True),
            timeline.degrees(response.angles, style.CLOSED_FORM, "actual"),
        ),
        f"top speed {speed:.3g} deg per tick",
        spans=(
            Span(start, middle, style.MUTED, SHADE),
            Span(middle, end, style.CLOSED_FORM, SHADE),
        ),
        words=(
            Words(f"lag {response.lag} ticks", start, top, "right", "top"),
            Words(f"acceleration {response.acceleration} ticks", end, top, "left", "top"),
        ),
        height=1.6,
    )
    words = words_of("step_test", number=number, amplitude=amplitude)
    return timeline.figure(f"figure{number}_step_{amplitude:g}", [panel], words)


def _speed(reproduction: Reproduction) -> Figure:
    """Figure 5."""
    model = reproduction.model
    theta_0, v_max = math.degrees(model.theta_0), math.degrees(model.v_max_per_tick)
    errors = np.linspace(-2.2, 2.2, 89) * theta_0
    speeds = model.tick * np.degrees(model.speed(np.radians(errors)))
    far, high = float(errors[-1]), 1.35 * v_max
    dotted = style.MUTED._replace(dashes=(0, (1.0, 1.5)))
    panel = Panel(
        Axis("f(x)", "deg per tick", (-high, high)),
        (
            line((-far, far), (0.0, 0.0)),
            line((0.0, 0.0), (-high, high)),
            line((theta_0, theta_0), (0.0, v_max), dotted),
            line((-theta_0, -theta_0), (0.0, -v_max), dotted),
            Curve(style.CLOSED_FORM, errors, speeds, "f"),
        ),
        words=(
            Words("θ₀", theta_0, 0.0, upward="top"),
            Words("−θ₀", -theta_0, 0.0, upward="bottom"),
            Words("v_max", 1.6 * theta_0, v_max, upward="bottom"),
            Words("−v_max", -1.6 * theta_0, -v_max, upward="top"),
        ),
        height=1.7,
    )
    return Figure(
        "figure5_speed",
        *words_of("figure5_speed"),
        Axis("request minus angle, x", "deg", (-far, far)),
        (panel,),
    )
