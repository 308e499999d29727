"""The figures of the paper's experiment on the virtual robot, every cycle of it drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.report import style
from planner.report.figure import Axis, Curve, Figure, Panel, Timeline, joined, thin
from planner.report.paper_figures import (
    ROLES,
    Drawn,
    distance_panel,
    foot_paths_figure,
    joints_figure,
    timeline_of,
)
from planner.report.style import Role
from planner.report.wording import words_of

if TYPE_CHECKING:
    from planner.evaluation.virtual_experiment import VirtualOutcome

PATHS = {
    "direct": style.DIRECT,
    "closed_form_plain": style.PLAIN,
    "foot_optimal": style.FOOT_OPTIMAL,
}
"""The methods whose foot paths are drawn, each over all its cycles."""

PREDICTED = Role("predicted", style.INK.light, style.INK.dark, width=1.1, dashes=(0, (1, 1.6)))


def virtual_figures(outcome: VirtualOutcome) -> tuple[Figure, ...]:
    """Every figure, in the order of the paper's."""
    return (
        _foot_paths(outcome),
        _step_tests(outcome),
        *_joint_figures(outcome),
        _learning(outcome),
    )


def _foot_paths(outcome: VirtualOutcome) -> Figure:
    """Figure 8: the path of the foot in every cycle; on the page the first of them walks."""
    paths = []
    for method, role in PATHS.items():
        draw, cycles = timeline_of(outcome.planned).path, outcome.foot_paths[method]
        mean = draw(cycles.mean(axis=0), role)
        paths += [mean, thin(mean, [draw(path, role) for path in cycles])]
    return foot_paths_figure(
        "foot_paths",
        outcome.planned,
        paths,
        {method: outcome.legs[method][0] for method in ROLES},
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
    return once.figure(
        "step_tests",
        panels,
        words_of("step_tests"),
    )


def _joint_figures(outcome: VirtualOutcome) -> list[Figure]:
    """Figures 2 and 7, the joints under requests for the foot, and under all methods."""
    planned, plain = outcome.planned, "closed_form_plain"
    desired = Drawn(planned.walk.desired, style.DESIRED)
    walked = {method: run.angles for method, run in outcome.runs.items()}
    count = len(walked["direct"])
    return [
        joints_figure(
            planned,
            "joints_direct",
            [
                desired._replace(label="requested = desired"),
                Drawn(walked["direct"], style.DIRECT, f"actual, {count} cycles"),
                Drawn(planned.direct, PREDICTED),
            ],
        ),
        joints_figure(
            planned,
            "trajectories",
            [
                desired,
                Drawn(planned.requests[plain], style.REQUESTED),
                Drawn(planned.approximations[plain], style.APPROXIMATION),
                Drawn(walked[plain], style.PLAIN, "actual"),
            ],
        ),
        joints_figure(
            planned,
            "foot_optimised_trajectories",
            [
                desired,
                Drawn(outcome.runs["foot_optimal"].requests, style.REQUESTED),
                Drawn(walked["foot_optimal"], style.FOOT_OPTIMAL, "actual"),
                Drawn(planned.angles["foot_optimal"], PREDICTED),
            ],
            words="virtual_foot_optimised_trajectories",
        ),
        joints_figure(
            planned,
            "joints_by_method",
            [
                desired,
                *(
                    Drawn(walked[method], role, hidden=method == "optimal")
                    for method, role in ROLES.items()
                    if method != "shift"
                ),
            ],
            words="virtual_joints_by_method",
            below=[distance_panel(planned, outcome.foot_paths)],
        ),
    ]


def _learning(outcome: VirtualOutcome) -> Figure:
    """The foot's error in each trial of learning, and the lower bound of the models."""
    errors = np.array([each.mean.rms for each in outcome.learnt_foot])
    trials = np.arange(1.0, len(errors) + 1.0)
    ends = np.array([0.8, len(errors) + 0.2])
    bound = 100.0 * outcome.planned.foot_plan.lower_bound
    deviations = np.array([each.deviation.rms for each in outcome.learnt_foot])
    low, high = min(bound, float(np.min(errors - deviations))), float(np.max(errors + deviations))
    room = 0.2 * (high - low)
    curves = (
        Curve(
            style.APPROXIMATION._replace(label="lower bound of the models"), ends, np.full(2, bound)
        ),
        Curve(style.FOOT_OPTIMAL._replace(label="mean of the cycles"), trials, errors),
        Curve(style.INK, trials, errors, "trials", legend=False, marks="dots"),
    )
    return Figure(
        "learning",
        *words_of("virtual_learning"),
        Axis("trial", names={trial: f"{trial:.0f}" for trial in trials}, range=(0.8, ends[1])),
        (
            Panel(
                Axis("rms distance", "cm", (low - room, high + room), decimals=3),
                curves,
                "foot, from its desired path",
            ),
        ),
    )
