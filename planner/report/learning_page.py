"""The page about learning: the error of each executed trial, and what the next requests change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report import figure, style
from planner.report.figure import Axis, Curve, Figure, Panel, Timeline
from planner.report.page import Page
from planner.report.wording import NOTHING, Row, Table, number, text_table, words_of
from planner.trajectory import Array

if TYPE_CHECKING:
    from planner.planning.plan import Plan

BOUND = style.LOWER_BOUND._replace(label="lower bound of the model")
EXECUTED = style.CLOSED_FORM._replace(label="measured, mean cycle")
BEFORE = style.DIRECT._replace(label="requests executed", width=1.2)
AFTER = style.REQUESTED._replace(label="next requests")
NEXT = style.OPTIMAL._replace(label="predicted next")
ERROR = style.INK._replace(label="error, measured", width=1.4)
LEARNT = style.SHIFT._replace(label="learnt: measured less modelled", width=1.8)


@dataclass(frozen=True, eq=False)
class Trials:
    """The errors of a joint or a foot that learns."""

    name: str  # the joint, or "foot"
    unit: str  # unit of the errors: deg, percent or cm
    errors: Array  # error of the mean cycle of each trial, shape (trials,)
    predicted: float  # error to expect of the next requests
    bound: float  # lower bound of the model on the error; NaN where there is none
    noise: float  # standard deviation of one cycle about the mean of many
    gain: float  # learning gain, 0 to 1: share of the disturbance that the next requests compensate
    best: int  # the trial that the next requests start from
    stopped: str  # why learning has ended; empty while it goes on
    remarks: tuple[str, ...]  # notes on the use of the measurements
    delays: tuple[float, ...] = ()  # how late the sensors of its joints are taken to be [s]


def learning_page(
    plan: Plan,
    *,
    executed: Array,
    measured: Array,
    progress: Sequence[Trials],
    about_others: str = "",
    title: str,
) -> Page:
    """The page about the next plan; the last requests and their mean cycle are (n, k) [rad]."""
    worst = max(progress, key=lambda each: float(np.min(each.errors)))
    rest = [each for each in progress if each is not worst]
    return Page(
        "learning",
        title=title,
        trials=len(progress[0].errors),
        ended=all(each.stopped for each in progress),
        progress=progress,
        about_others=about_others,
        worst=worst,
        errors=errors_figure(worst),
        table=trials_table(progress),
        more=[errors_figure(each, f"learning_{j}") for j, each in enumerate(rest, 2)],
        short=_short,
        joints=[joint_figure(plan, executed, measured, j) for j in range(len(plan.names))],
    )


def errors_figure(progress: Trials, name: str = "learning") -> Figure:
    """The error of each trial, with the lower bound."""
    count, bounded = len(progress.errors), not math.isnan(progress.bound)
    goes_on = not math.isnan(progress.predicted) and not progress.stopped
    last = count + goes_on
    trials, ends = np.arange(1.0, count + 1.0), (0.8, last + 0.2)
    error = style.OPTIMAL._replace(label="error", dashes="-")
    curves = [Curve(error, trials, progress.errors, marks=marks) for marks in ("", "dots")]
    if bounded:
        curves.insert(0, Curve(BOUND, np.array(ends), np.full(2, progress.bound)))
    if goes_on:
        at = np.array([count + 1.0])
        curves.append(Curve(NEXT, at, np.array([progress.predicted]), marks="rings"))
    top = 1.1 * float(np.nanmax([*progress.errors, progress.noise, progress.predicted]))
    names = {float(number): str(number) for number in range(1, last + 1)}
    words = words_of("trials", name=progress.name, bounded=bounded, goes_on=goes_on)
    panel = Panel(Axis("rms error", progress.unit, (0.0, top), decimals=3), curves)
    return Figure(name, *words, Axis("trial", names=names, range=ends), [panel])


def joint_figure(plan: Plan, executed: Array, measured: Array, j: int) -> Figure:
    """A joint's angles, its error with what was learnt of it, and its requests before and after."""
    disturbance = plan.task.disturbance
    assert disturbance is not None, "a learnt plan has a disturbance"
    desired, error = plan.desired[:, j], (measured - plan.desired)[:, j]
    return figure.joint_figure(
        Timeline.of(plan),
        f"learning_joint_{j + 1}",
        words_of("learning_joint", name=plan.names[j]),
        angles=[(desired, style.DESIRED), (measured[:, j], EXECUTED), (plan.predicted[:, j], NEXT)],
        errors=[(error, ERROR), (disturbance[:, j], LEARNT)],
        requests=[(executed[:, j], BEFORE), (plan.requests[:, j], AFTER)],
        clock=False,
        title="measured and predicted",
    )


def trials_table(progress: Sequence[Trials]) -> Table:
    """The errors of all trials."""
    rows = []
    for trial in range(max(len(each.errors) for each in progress)):
        errors = [each.errors[trial] if trial < len(each.errors) else math.nan for each in progress]
        best = ["\nbest" * (trial == each.best) for each in progress]
        cells = [f"{_short(error, 4)}{note}" for error, note in zip(errors, best, strict=True)]
        rows.append(Row(str(trial + 1), cells))
    names = {"predicted next": "predicted", "lower bound": "bound", "noise of a cycle": "noise"}
    for about, name in names.items():
        kind = "bound" if name == "bound" else ""
        rows.append(Row(about, [_short(getattr(each, name), 4) for each in progress], kind=kind))
    columns = (f"{each.name} [{each.unit}]" for each in progress)
    return Table("trial", columns, rows, "Errors of the trials, rms")


def _short(value: float, digits: int = 3) -> str:
    if math.isnan(value):
        return NOTHING
    return f"{value:.{digits}g}" if value >= 5e-4 else "0"  # rounding


# For machines, and as text.


def joint_results(plan: Plan, joint: int, unit: str) -> dict[str, Any]:
    """The next requests to a joint of a plan for machines, in "deg" or "percent"."""
    learnt = plan.task.disturbance
    return {
        f"requests_{unit}": np.degrees(plan.requests[:, joint]).tolist(),
        f"predicted_{unit}": np.degrees(plan.predicted[:, joint]).tolist(),
        f"learnt_{unit}": None if learnt is None else np.degrees(learnt[:, joint]).tolist(),
    }


def trials_results(trials: Trials) -> dict[str, Any]:
    """The trials of a joint, or of a foot, for machines."""
    return {
        "trials": len(trials.errors),
        f"errors_{trials.unit}": trials.errors.tolist(),
        f"predicted_{trials.unit}": trials.predicted,
        f"lower_bound_{trials.unit}": trials.bound,
        f"noise_{trials.unit}": trials.noise,
        "gain": trials.gain,
        "best_trial": trials.best + 1,
        "stopped": trials.stopped or None,
        "remarks": list(trials.remarks),
        "sensor_delay_ms": [1e3 * delay for delay in trials.delays],
    }


def trials_text(progress: Sequence[Trials]) -> str:
    """The trials of every joint, or of the foot, and remarks on them."""
    cells, lines = [], list[str]()
    for each in progress:
        errors = (each.errors[0], each.errors[-1], np.min(each.errors), each.predicted)
        bound, noise = number(each.bound, 3), f"{each.noise:.3f}"
        cells.append([f"{each.name} [{each.unit}]", *map("{:.3f}".format, errors), bound, noise])
        lines += [f"{each.name}: {text}" for text in each.remarks]
        if each.stopped:
            lines.append(f"{each.name}: learning has ended: {each.stopped}")
    titles = ["rms error", "first", "last", "best", "predicted next", "lower bound", "noise"]
    return "\n".join([text_table(titles, cells), *lines])
