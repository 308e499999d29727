"""The figures of the paper's experiment, in its order, and some beyond it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

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
    step_tests = zip(
        (3, 4),
        STEP_AMPLITUDES,
        (
            "From rest to top speed: lag, acceleration time, plateau.",
            "From top speed to top speed the other way: twice the change of speed in the same "
            "acceleration time, where a limit on the acceleration would take twice as long.",
        ),
        strict=True,
    )
    direct, approximation, trajectories, *others = _joint_figures(reproduction)
    return (
        direct_foot_figure(reproduction),
        direct,
        *(_step_test(reproduction, *each) for each in step_tests),
        _speed(reproduction),
        approximation,
        trajectories,
        _foot_paths(reproduction),
        *others,
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
        "Figure 1: the foot, desired and actual",
        "Request the desired angles as they are, and the foot lags: it cuts the swing short. Thin "
        "lines join the two paths at the same instants.",
        ACROSS,
        (Panel(UPWARD, curves, height=1.8),),
        equal=True,
    )


def _foot_paths(reproduction: Reproduction) -> Figure:
    """Figure 8."""
    paths = [
        timeline_of(reproduction).path(reproduction.foot[method], role)
        for method, role in ROLES.items()
        if method not in HIDDEN
    ]
    return foot_paths_figure(
        "figure8_foot_paths",
        (
            "Figure 8: the foot under the methods",
            "The desired path, what the direct method makes of it, the closed form as in the "
            "paper, and requests optimised for the foot. The best time shift runs along the "
            "direct method's path, only earlier; requests optimised joint by joint run nearly "
            "along the closed form's.",
        ),
        reproduction,
        paths,
        reproduction.legs,
    )


def foot_paths_figure(
    name: str,
    words: tuple[str, str],
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
    return Figure(name, *words, ACROSS, (panel,), equal=True, movie=movie)


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
    words: tuple[str, str],
    drawn: Sequence[Drawn],
    *below: Panel,
    more: Callable[[int], Sequence[Curve]] = lambda _: (),
) -> Figure:
    """A panel per joint over one step of the walk, with ``more`` curves by its index.

    With panels below it follows the moving leg.
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
    return timeline.figure(name, [*panels, *below], words, clock=bool(below))


def _joint_figures(reproduction: Reproduction) -> list[Figure]:
    """Figures 2, 6 and 7, the joints under all methods, and figures beyond the paper."""
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

    return [
        joints_figure(
            reproduction,
            "figure2_joints_direct",
            (
                "Figure 2: the joints under the direct method",
                "Every joint starts late and then moves at its top speed at most. The paper shows "
                "the rotator.",
            ),
            [
                desired._replace(label="requested = desired"),
                Drawn(angles["direct"], style.DIRECT, "actual"),
            ],
        ),
        joints_figure(
            reproduction,
            "figure6_approximation",
            (
                "Figure 6: piecewise linear approximations",
                "Six lines per joint, none steeper than the top speed, with knots chosen "
                "automatically; in the paper they were drawn by hand. Where the desired angles are "
                "faster than the joint, the lines must leave them.",
            ),
            [desired],
            more=lines,
        ),
        joints_figure(
            reproduction,
            "figure7_trajectories",
            (
                "Figure 7: the four trajectories of the paper's method",
                "The requests run ahead of the approximation, the joint stays approximately on it. "
                "They know no limits: where the joint has some, a robot would clip them.",
            ),
            [
                desired,
                Drawn(requests[plain], style.REQUESTED),
                Drawn(reproduction.approximations[plain], style.APPROXIMATION),
                Drawn(angles[plain], style.CLOSED_FORM, "actual"),
            ],
        ),
        joints_figure(
            reproduction,
            "joints_by_method",
            (
                "The joints under the methods",
                "What the joints do while the foot goes as in Figure 8.",
            ),
            [
                desired,
                Drawn(angles["direct"], style.DIRECT),
                Drawn(angles[plain], style.PLAIN),
                Drawn(angles["optimal"], style.OPTIMAL, hidden=True),
                Drawn(angles["foot_optimal"], style.FOOT_OPTIMAL),
                Drawn(requests["foot_optimal"], style.REQUESTED, "requests, foot-optimised", True),
            ],
            distance_panel(reproduction, reproduction.foot),
        ),
        joints_figure(
            reproduction,
            "optimised_trajectories",
            (
                "Beyond the paper: optimised requests",
                "Found on the full nonlinear model, inside the joint's limits, and within a "
                "fraction of a percent of the lower bound.",
            ),
            [
                desired,
                Drawn(requests["optimal"], style.REQUESTED),
                Drawn(angles["optimal"], style.OPTIMAL, "actual"),
            ],
        ),
        joints_figure(
            reproduction,
            "foot_optimised_trajectories",
            (
                "Beyond the paper: requests for the foot",
                "All joints are planned at once for the foot: single joints have larger errors, "
                "which compensate for one another.",
            ),
            [
                desired,
                Drawn(requests["foot_optimal"], style.REQUESTED),
                Drawn(angles["foot_optimal"], style.FOOT_OPTIMAL, "actual"),
            ],
        ),
    ]


# The model.


def _step_test(reproduction: Reproduction, number: int, amplitude: float, caption: str) -> Figure:
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
    words = (f"Figure {number}: step test, {amplitude:g} degrees", caption)
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
        "Figure 5: the function f",
        "The speed that an error calls for: proportional up to θ₀, top speed beyond.",
        Axis("request minus angle, x", "deg", (-far, far)),
        (panel,),
    )
