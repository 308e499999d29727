"""The figures of the paper's experiment on the virtual robot, every cycle of it drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.report import style
from planner.report.figure import Axis, Curve, Figure, Panel, Timeline, joined, thin
from planner.report.paper.figures import (
    ROLES,
    distance_panel,
    foot_paths_figure,
    joints_figure,
    timeline_of,
)
from planner.report.style import Role

if TYPE_CHECKING:
    from planner.evaluation.virtual_experiment import VirtualOutcome

VIRTUAL_FEATURED = ("foot_paths", "joints_by_method")
"""The figures after the key figures: the moving leg and its joints."""

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
        _joints_direct(outcome),
        _trajectories(outcome),
        _foot_optimised(outcome),
        _joints_by_method(outcome),
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
        (
            "The foot, every cycle (the paper's Figure 8)",
            "What the robot's foot does in each recorded cycle under three methods; the cycles "
            "nearly cover one another. On the page the leg walks the first of them, whose error is "
            "beside its name.",
        ),
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
        (
            "The step tests (Figures 3 and 4)",
            "Dots: what each joint's sensor recorded in the last cycle of each test, around the "
            "middle of the joint's range in the walk. Lines: the one model that was identified "
            "from all of them. Below, what it leaves unexplained.",
        ),
    )


def _joints_direct(outcome: VirtualOutcome) -> Figure:
    """Figure 2: the joints under the direct method, and the models' predictions."""
    draw, run = timeline_of(outcome.planned).degrees, outcome.runs["direct"]

    def curves(j: int) -> list[Curve]:
        return [
            draw(outcome.planned.walk.desired[:, j], style.DESIRED, "requested = desired"),
            *_walked(outcome, "direct", j, style.DIRECT, f"actual, {len(run.angles)} cycles"),
            draw(outcome.planned.direct[:, j], PREDICTED),
        ]

    words = (
        "The direct method (Figure 2), predicted before it was seen",
        "The models come from step tests alone; this walk is new to them. Dotted: what they "
        "predict.",
    )
    return joints_figure(outcome.planned, "joints_direct", words, curves)


def _trajectories(outcome: VirtualOutcome) -> Figure:
    """Figure 7: desired, approximation, requests, and the angles of every cycle."""
    planned, method = outcome.planned, "closed_form_plain"
    draw = timeline_of(planned).degrees
    return joints_figure(
        planned,
        "trajectories",
        (
            "The four trajectories of the paper's method (Figure 7)",
            "How close the actual angles stay to the approximation is the paper's measure of the "
            "model's fidelity. Requests beyond a joint's limits are cut off by the robot.",
        ),
        lambda j: [
            draw(planned.walk.desired[:, j], style.DESIRED),
            draw(planned.requests[method][:, j], style.REQUESTED, held=True),
            draw(planned.approximations[method][:, j], style.APPROXIMATION),
            *_walked(outcome, method, j, style.PLAIN, "actual"),
        ],
    )


def _foot_optimised(outcome: VirtualOutcome) -> Figure:
    draw, requests = timeline_of(outcome.planned).degrees, outcome.runs["foot_optimal"].requests
    return joints_figure(
        outcome.planned,
        "foot_optimised_trajectories",
        (
            "The joints under requests for the foot",
            "Dotted: what the plan predicted. Single joints leave their desired angles to bring "
            "the foot closer, as planned.",
        ),
        lambda j: [
            draw(outcome.planned.walk.desired[:, j], style.DESIRED),
            draw(requests[:, j], style.REQUESTED, held=True),
            *_walked(outcome, "foot_optimal", j, style.FOOT_OPTIMAL, "actual"),
            draw(outcome.planned.angles["foot_optimal"][:, j], PREDICTED),
        ],
    )


def _joints_by_method(outcome: VirtualOutcome) -> Figure:
    draw = timeline_of(outcome.planned).degrees
    return joints_figure(
        outcome.planned,
        "joints_by_method",
        (
            "The joints under the methods, every cycle",
            "What the joints do while the foot goes along its paths.",
        ),
        lambda j: [
            draw(outcome.planned.walk.desired[:, j], style.DESIRED),
            *(
                curve
                for method, role in ROLES.items()
                if method != "shift"
                for curve in _walked(outcome, method, j, role, hidden=method == "optimal")
            ),
        ],
        distance_panel(outcome.planned, outcome.foot_paths),
        clock=True,
    )


def _walked(
    outcome: VirtualOutcome,
    method: str,
    j: int,
    role: Role,
    label: str = "",
    *,
    hidden: bool = False,
) -> tuple[Curve, Curve]:
    angles = np.degrees(outcome.runs[method].angles[:, :, j])
    return timeline_of(outcome.planned).cycles(angles, role, label, hidden=hidden)


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
        "Ten trials of learning",
        "The foot's error from the foot-optimised plan on, each next trial with requests that are "
        "refined by what the sensors measured (the axis does not begin at zero).",
        Axis("trial", names={trial: f"{trial:.0f}" for trial in trials}, range=(0.8, ends[1])),
        (
            Panel(
                Axis("rms distance", "cm", (low - room, high + room), decimals=3),
                curves,
                "foot, from its desired path",
            ),
        ),
    )
