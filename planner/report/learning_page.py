"""The page about learning: the error of each executed trial, and what the next requests change."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.arrays import Array
from planner.report import figure
from planner.report.figure import Axis, Curve, Figure, Panel, Timeline
from planner.report.page import Page
from planner.report.plan_results import Numbers, in_unit
from planner.report.wording import CARRIED, NOTHING, UNITS, Unit, table_of, words_of

if TYPE_CHECKING:
    from planner.planning.plan import Plan

BOUND = figure.LOWER_BOUND._replace(label="lower bound of the model")
EXECUTED = figure.CLOSED_FORM._replace(label="measured, mean cycle")
BEFORE = figure.DIRECT._replace(label="requests executed", width=1.2)
AFTER = figure.REQUESTED._replace(label="next requests")
NEXT = figure.OPTIMAL._replace(label="predicted next")
ERROR = figure.INK._replace(label="error, measured", width=1.4)
LEARNT = figure.SHIFT._replace(label="learnt: measured less modelled", width=1.8)


def learning_page(
    plan: Plan,
    *,
    executed: Array,
    measured: Array,
    progress: Mapping[str, Numbers],
    about_others: str = "",
    title: str,
) -> Page:
    """The page about the next plan; the last requests and their mean cycle are (n, k) [rad]."""
    worst = max(progress, key=lambda name: min(progress[name]["errors"]))
    units = {name: each["unit"] for name, each in progress.items()}
    rest = {name: each for name, each in progress.items() if name != worst}
    return Page(
        "learning",
        title=title,
        trials=next(iter(progress.values()))["trials"],
        ended=all(each["stopped"] for each in progress.values()),
        progress=progress,
        about_others=about_others,
        worst=worst,
        errors=errors_figure(worst, progress[worst]),
        more=[errors_figure(*each, f"_{j}") for j, each in enumerate(rest.items(), 2)],
        short=_short,
        joints=[
            joint_figure(plan, executed, measured, j, CARRIED[units.get(name, "deg")])
            for j, name in enumerate(plan.names)
        ],
    )


def errors_figure(joint: str, numbers: Numbers, suffix: str = "") -> Figure:
    """The error of each trial, with the lower bound."""
    count, bound, predicted = numbers["trials"], numbers["lower_bound"], numbers["predicted"]
    goes_on = not math.isnan(predicted) and not numbers["stopped"]
    last = count + goes_on
    trials, ends = np.arange(1.0, count + 1.0), (0.8, last + 0.2)
    error, errors = figure.OPTIMAL._replace(label="error", dashes="-"), np.array(numbers["errors"])
    curves = [Curve(error, trials, errors, marks=marks) for marks in ("", "dots")]
    if not math.isnan(bound):
        curves.insert(0, Curve(BOUND, np.array(ends), np.full(2, bound)))
    if goes_on:
        curves.append(Curve(NEXT, np.array([count + 1.0]), np.array([predicted]), marks="rings"))
    top = 1.1 * float(np.nanmax([*errors, numbers["noise"], predicted]))
    names = {float(number): str(number) for number in range(1, last + 1)}
    words = words_of("trials", name=joint, bounded=not math.isnan(bound), goes_on=goes_on)
    panel = Panel(Axis("rms error", CARRIED[numbers["unit"]].sign, (0.0, top), decimals=3), curves)
    return Figure(f"learning{suffix}", *words, Axis("trial", names=names, range=ends), [panel])


def joint_figure(
    plan: Plan, executed: Array, measured: Array, j: int, unit: Unit = UNITS["rad"]
) -> Figure:
    """A joint's angles, its error with what was learnt of it, and its requests before and after."""
    disturbance = plan.task.disturbance
    assert disturbance is not None, "a learnt plan has a disturbance"
    desired, error = plan.desired[:, j], (measured - plan.desired)[:, j]
    return figure.joint_figure(
        Timeline.of(plan),
        f"learning_joint_{j + 1}",
        words_of("learning_joint", name=plan.names[j]),
        unit=unit,
        angles=[
            (desired, figure.DESIRED),
            (measured[:, j], EXECUTED),
            (plan.predicted[:, j], NEXT),
        ],
        errors=[(error, ERROR), (disturbance[:, j], LEARNT)],
        requests=[(executed[:, j], BEFORE), (plan.requests[:, j], AFTER)],
        clock=False,
        title="measured and predicted",
    )


def _short(value: float, digits: int = 3) -> str:
    if math.isnan(value):
        return NOTHING
    return f"{value:.{digits}g}" if value >= 5e-4 else "0"  # rounding


# For machines, and as text.


def joint_results(plan: Plan, joint: int, unit: str) -> dict[str, Any]:
    """The next requests to a joint of a plan for machines, in "deg" or "percent"."""
    learnt = plan.task.disturbance
    angles = {"requests": plan.requests, "predicted": plan.predicted, "learnt": learnt}
    numbers = {
        name: None if each is None else np.degrees(each[:, joint]).tolist()
        for name, each in angles.items()
    }
    return in_unit(numbers, unit)


def trials_text(progress: Mapping[str, Numbers]) -> str:
    """The trials of every joint, or of the foot, and remarks on them."""
    rows, lines = [], list[str]()
    for name, each in progress.items():
        first, *_, last = errors = [*each["errors"], each["errors"][-1]]
        ends = {"first": first, "last": last, "best": min(errors)}
        ends["predicted_next"] = each["predicted"]
        rows.append((f"{name} [{CARRIED[each['unit']].words}]", each | ends))
        lines += [f"{name}: {text}" for text in each["remarks"]]
        if each["stopped"]:
            lines.append(f"{name}: learning has ended: {each['stopped']}")
    names = ("first", "last", "best", "predicted_next", "lower_bound", "noise")
    columns = {name.replace("_", " "): f"{name} .3f" for name in names}
    return "\n".join([table_of("rms error", rows, columns).text(), *lines])
