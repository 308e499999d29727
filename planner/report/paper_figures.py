"""The figures of the paper's experiment, on its model and on the virtual robot, and some more."""

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
    Panel,
    Span,
    Timeline,
    Words,
    around,
    joined,
    line,
    moving_leg,
    thin,
)
from planner.report.style import Role
from planner.report.wording import words_of
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.evaluation.reproduction import PlannedWalk
    from planner.evaluation.virtual_experiment import VirtualOutcome

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

ACROSS, UPWARD = Axis("forward of the hip, x", "cm"), Axis("above the hip, z", "cm")


def paper_figures(planned: PlannedWalk) -> tuple[Figure, ...]:
    """Every figure, in the order of the paper's."""
    timeline, plans, plain = timeline_of(planned), planned.plans, "closed_form_plain"

    def lines(j: int) -> list[Curve]:
        fit = plans[plain].approximations[j]
        fine = np.linspace(0.0, fit.samples, 20 * fit.samples + 1)  # knots lie between samples
        knots, values = np.mod(fit.knots, fit.samples), np.degrees(fit.values)
        role = style.APPROXIMATION
        return [
            Curve(role, timeline.step * fine, np.degrees(fit(fine))),
            Curve(role, timeline.step * knots, values, "knots", marks="rings"),
        ]

    def beyond(name: str, method: str) -> Figure:
        requested = Drawn(plans[method].requests, style.REQUESTED)
        actual = Drawn(plans[method].predicted, ROLES[method], "actual")
        return joints_figure(planned, name, requested, actual)

    paths = [
        timeline.path(plans[method].foot, role)
        for method, role in ROLES.items()
        if method not in HIDDEN
    ]
    return (
        direct_foot_figure(planned),
        joints_figure(
            planned,
            "figure2_joints_direct",
            Drawn(plans["direct"].predicted, style.DIRECT, "actual"),
            desired="requested = desired",
        ),
        *(_step_test(planned, k, each) for k, each in enumerate(STEP_AMPLITUDES, 3)),
        _speed(planned),
        joints_figure(planned, "figure6_approximation", more=lines),
        joints_figure(
            planned,
            "figure7_trajectories",
            Drawn(plans[plain].requests, style.REQUESTED),
            Drawn(planned.approximations[plain], style.APPROXIMATION),
            Drawn(plans[plain].predicted, style.CLOSED_FORM, "actual"),
        ),
        foot_paths_figure("figure8_foot_paths", planned, paths, planned.legs),
        joints_figure(
            planned,
            "joints_by_method",
            *by_method({method: plan.predicted for method, plan in plans.items()}),
            Drawn(
                plans["foot_optimal"].requests, style.REQUESTED, "requests, foot-optimised", True
            ),
            below=[distance_panel(planned, {method: plan.foot for method, plan in plans.items()})],
        ),
        beyond("optimised_trajectories", "optimal"),
        beyond("foot_optimised_trajectories", "foot_optimal"),
    )


# The foot.


def direct_foot_figure(planned: PlannedWalk) -> Figure:
    """Figure 1: the foot's paths from the side, joined at the same instants by thin lines."""
    desired, actual = planned.walk.desired_foot, planned.plans["direct"].foot
    pairs = 100.0 * np.stack([desired[::8], actual[::8]], axis=1)
    ties = style.GRID._replace(label="the same instants", width=1.2)
    draw = timeline_of(planned).path
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
    name: str, planned: PlannedWalk, paths: Sequence[Curve], legs: Mapping[str, Array]
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
    live = moving_leg(
        planned.legs["desired"],
        [(role, legs[method]) for method, role in ROLES.items()],
        planned.models[0].period,
        cyclic=True,
        ground=ground,
        hidden=[ROLES[method].label for method in HIDDEN],
    )
    return Figure(name, *words_of(name), ACROSS, (panel,), equal=True, live=live)


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


def by_method(angles: Mapping[str, Array]) -> list[Drawn]:
    """The joints under the methods; the best time shift is left out."""
    return [
        Drawn(angles[method], role, hidden=method == "optimal")
        for method, role in ROLES.items()
        if method != "shift"
    ]


def joints_figure(
    planned: PlannedWalk,
    name: str,
    *drawn: Drawn,
    desired: str = "",
    words: str = "",
    below: Sequence[Panel] = (),
    more: Callable[[int], Sequence[Curve]] = lambda _: (),
) -> Figure:
    """A panel per joint over one step of the walk, as ``desired`` and as drawn.

    There are ``more`` curves by its index. With panels ``below`` it follows the moving leg.
    ``words``: the block of its caption, its name by default.
    """
    timeline, panels = timeline_of(planned), list[Panel]()
    for j, joint in enumerate(planned.walk.joint_names):
        curves: list[Curve] = []
        wanted = Drawn(planned.walk.desired, style.DESIRED, desired)
        for values, role, label, hidden in (wanted, *drawn):
            own = np.degrees(values[..., j])
            if own.ndim > 1:
                curves += timeline.cycles(own, role, label, hidden=hidden)
            else:
                held = role is style.REQUESTED
                curves.append(timeline.curve(own, role, label, held=held, hidden=hidden))
        panels.append(Panel(Axis("angle", "deg"), (*curves, *more(j)), joint))
    return timeline.figure(name, [*panels, *below], words_of(words or name), clock=bool(below))


# The model.


def _step_test(planned: PlannedWalk, number: int, amplitude: float) -> Figure:
    """Figures 3 and 4: the answer to a step test, its lag and its acceleration time shaded."""
    response = planned.steps[amplitude]
    timeline = Timeline(planned.models[0].period, len(response.angles))
    begun = response.step + response.lag
    full = begun + response.acceleration
    start, middle, end = (timeline.step * sample for sample in (response.step, begun, full))
    speed = math.degrees(response.v_max) * planned.models[0].period
    top = 1.24 * amplitude
    panel = Panel(
        Axis("angle", "deg", (-0.12 * amplitude, top)),
        (
            timeline.degrees(response.requests, style.REQUESTED, held=True),
            timeline.degrees(response.angles, style.CLOSED_FORM, "actual"),
        ),
        f"top speed {speed:.3g} deg per tick",
        spans=(
            Span(start, middle, style.MUTED, 0.16),
            Span(middle, end, style.CLOSED_FORM, 0.16),
        ),
        words=(
            Words(f"lag {response.lag} ticks", start, top, "right", "top"),
            Words(f"acceleration {response.acceleration} ticks", end, top, "left", "top"),
        ),
        height=1.6,
    )
    words = words_of("step_test", number=number, amplitude=amplitude)
    return timeline.figure(f"figure{number}_step_{amplitude:g}", [panel], words)


def _speed(planned: PlannedWalk) -> Figure:
    """Figure 5."""
    model = planned.models[0]
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


# The experiment on the virtual robot, every cycle of it drawn.

PREDICTED = Role("predicted", style.INK.light, style.INK.dark, width=1.1, dashes=(0, (1, 1.6)))


def virtual_figures(outcome: VirtualOutcome) -> tuple[Figure, ...]:
    """Every figure, in the order of the paper's."""
    figures = _virtual_paths(outcome), _step_tests(outcome), *_virtual_joints(outcome)
    return (*figures, _learning(outcome))


def _virtual_paths(outcome: VirtualOutcome) -> Figure:
    """Figure 8: the path of the foot in every cycle; on the page the first of them walks."""
    paths = []
    for method in [method for method in ROLES if method not in HIDDEN]:
        draw, cycles = timeline_of(outcome.planned).path, outcome.foot_paths[method]
        mean, *each = (draw(path, ROLES[method]) for path in (cycles.mean(axis=0), *cycles))
        paths += [mean, thin(mean, each)]
    return foot_paths_figure(
        "foot_paths", outcome.planned, paths, {method: outcome.legs[method][0] for method in ROLES}
    )


def _step_tests(outcome: VirtualOutcome) -> Figure:
    """Figures 3 and 4: the sensors' records of each step test's last cycle, and the model's."""
    timeline, last = timeline_of(outcome.planned), slice(-len(outcome.planned.walk.desired), None)
    once = Timeline(timeline.period, timeline.samples, cyclic=False)
    panels = []
    names = outcome.planned.walk.joint_names
    for identification, joint in zip(outcome.identifications, names, strict=True):
        measured, predicted = [], []
        for fit in identification.fits:
            middle = float(np.mean(fit.log.requests[last]))
            measured.append(once.degrees(fit.log.angles[last] - middle, style.INK))
            predicted.append(once.degrees(fit.predicted[last] - middle, style.CLOSED_FORM))
        times = joined(curve.x for curve in measured)
        angles, model = (joined(curve.y for curve in each) for each in (measured, predicted))
        curves = (
            Curve(style.CLOSED_FORM._replace(width=1.4), times, model, "identified model"),
            Curve(style.INK, times, angles, "measured by the sensor", marks="dots", opacity=0.55),
        )
        panels.append(Panel(Axis("angle", "deg"), curves, joint))
        rest = Curve(style.MUTED._replace(width=0.9), times, angles - model, "residual")
        title = f"{joint}, residual, {np.degrees(identification.rms):.2f} deg rms"
        panels.append(Panel(Axis("residual", "deg"), (rest,), title, height=0.6))
    return once.figure("step_tests", panels, words_of("step_tests"))


def _virtual_joints(outcome: VirtualOutcome) -> list[Figure]:
    """Figures 2 and 7, the joints under requests for the foot, and under all methods."""
    planned, plain = outcome.planned, "closed_form_plain"
    walked = outcome.walks
    return [
        joints_figure(
            planned,
            "joints_direct",
            Drawn(walked["direct"], style.DIRECT, f"actual, {len(walked['direct'])} cycles"),
            Drawn(planned.plans["direct"].predicted, PREDICTED),
            desired="requested = desired",
        ),
        joints_figure(
            planned,
            "trajectories",
            Drawn(planned.plans[plain].requests, style.REQUESTED),
            Drawn(planned.approximations[plain], style.APPROXIMATION),
            Drawn(walked[plain], style.PLAIN, "actual"),
        ),
        joints_figure(
            planned,
            "foot_optimised_trajectories",
            Drawn(outcome.runs["foot_optimal"].requests, style.REQUESTED),
            Drawn(walked["foot_optimal"], style.FOOT_OPTIMAL, "actual"),
            Drawn(planned.plans["foot_optimal"].predicted, PREDICTED),
            words="virtual_foot_optimised_trajectories",
        ),
        joints_figure(
            planned,
            "joints_by_method",
            *by_method(walked),
            words="virtual_joints_by_method",
            below=[distance_panel(planned, outcome.foot_paths)],
        ),
    ]


def _learning(outcome: VirtualOutcome) -> Figure:
    """The foot's error in each trial of learning, and the lower bound of the models."""
    errors = np.array([each.mean.rms for each in outcome.learnt_foot])
    trials = np.arange(1.0, len(errors) + 1.0)
    ends = (0.8, len(errors) + 0.2)
    bound = 100.0 * float(outcome.planned.plans["foot_optimal"].lower_bounds[0])
    deviations = np.array([each.deviation.rms for each in outcome.learnt_foot])
    low, high = min(bound, float(np.min(errors - deviations))), float(np.max(errors + deviations))
    room = 0.2 * (high - low)
    bound_role = style.APPROXIMATION._replace(label="lower bound of the models")
    curves = (
        Curve(bound_role, np.array(ends), np.full(2, bound)),
        Curve(style.FOOT_OPTIMAL._replace(label="mean of the cycles"), trials, errors),
        Curve(style.INK, trials, errors, "trials", legend=False, marks="dots"),
    )
    axis = Axis("rms distance", "cm", (low - room, high + room), decimals=3)
    return Figure(
        "learning",
        *words_of("virtual_learning"),
        Axis("trial", names={trial: f"{trial:.0f}" for trial in trials}, range=ends),
        (Panel(axis, curves, "foot, from its desired path"),),
    )
