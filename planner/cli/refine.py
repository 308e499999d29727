"""``request-planner refine``: executed requests and measured angles in, the next requests out."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from planner.cli import options
from planner.cli.console import Answer, BadSetting, Progress, warn
from planner.cli.declared import Count, Source, argument, option
from planner.cli.settings import SMOOTHING, Run
from planner.exceptions import about

if TYPE_CHECKING:
    from planner.arrays import Array
    from planner.cli.desired import Desired
    from planner.files.executed import LearningState
    from planner.planning.plan import Plan
    from planner.report.page import Page
    from planner.report.plan_results import Numbers

FOOT = "foot"  # name of the plan of a foot


@options.command("Write a page (HTML) about what was learnt.")
def refine(
    *,
    requests: Annotated[str, options.Place("file", None)] = argument(),
    measured: tuple[Source, ...] = argument(),
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: joints rate_hz",
        "plan: cyclic",
        "start: deg",
        f"plan: method load norm solver weights {SMOOTHING}",
        "limits: deg",
        path=option(
            "The path that the requests were planned for: of joints, or of a foot with --leg.",
            option="--desired",
        ),
    ),
    history: options.Output | None = option(
        "File with the trials so far: read if it exists, then written."
    ),
    cycles: Count | None = option("Cycles to take from MEASURED; by default all."),
    sensor_delay_ms: float | None = option(
        "How late the measured angles are; 0 to take them as they are.", otherwise="estimated"
    ),
    reidentify: bool = option(
        "Whether the cycles may identify the models anew.",
        option="--reidentify/--no-reidentify",
        default=True,
        otherwise="reidentify",
    ),
    output: str = options.output,
) -> Answer:
    """Learn from executed REQUESTS and the angles MEASURED meanwhile: write the next requests.

    REQUESTS is what `plan` or `refine` wrote. MEASURED has the same columns, or those of a log, a
    row for each request, and as many cycles as were recorded; by its times single lost rows are
    filled. Several files are several recordings of the same requests. Joints that MEASURED has no
    column for keep their requests. Give the path, the leg, the models and the limits as to `plan`.
    After `plan --robust` what was measured takes the place of the drawn models: the next requests
    are for the nominal model and what was learnt.

    \b
    Example, the same line after every execution:
        request-planner plan path.csv --model arm.toml -o requests.csv
        request-planner refine requests.csv measured.csv --desired path.csv --model arm.toml \\
            --history learning.json -o requests.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli.desired import model_words, repeats, units_in_messages
    from planner.cli.planning import inputs_of, origins_of, prepare
    from planner.files.executed import read_executed, read_history, read_measured, write_history
    from planner.learning.measurements import EQUAL, settled
    from planner.learning.refine import in_a_cycle
    from planner.learning.refine import refine as learn
    from planner.model.response import load_columns
    from planner.planning.plan import joined
    from planner.report.learning_page import joint_results, learning_page, trials_text
    from planner.report.plan_results import in_unit

    desired = prepare(run)
    begun = history is not None and Path(history).is_file()
    if not begun:  # else the first trial has said it
        options.warn_of(desired.remarks)
    if desired.foot is not None and "method" not in run.plan.keys_set:
        warn(
            f"learning joint by joint, as --method is {run.plan.method}: after a plan for the foot "
            "give --method foot-optimal here too"
        )
    period = desired.period
    executed = read_executed(requests, desired.names, len(desired.angles), period)
    names, angles, unused = read_measured(
        measured, executed, period=period, cyclic=desired.cyclic, units=desired.units, cycles=cycles
    )
    columns = [desired.names.index(name) for name in names]
    sent = executed.values[:, columns]
    if not desired.cyclic and repeats(sent, None)[0]:
        starts = [desired.starts.get(desired.names[j], desired.angles[0, j]) for j in columns]
        if in_a_cycle([desired.models[j] for j in columns], sent, angles, starts):
            warn(
                "the measured angles begin as in a cycle that repeats, and --no-cyclic is for a "
                "motion from rest: if the requests were repeated, leave it out, here and in plan"
            )
    moves = np.max(np.ptp(desired.angles, axis=0)) > EQUAL
    if moves and np.max(np.abs(executed.values - desired.angles)) <= EQUAL:
        warn(
            "the requests are the desired path: if they were planned for another one, name that "
            "with --desired"
        )
    if unused:
        warn(f"{unused} measured rows after the last whole cycle are not used")
    every = executed_plans(desired, executed.values, by_joint=names != desired.names)
    states: dict[str, LearningState] = {}  # others stay in the history: of the foot, or of joints
    if history is not None and begun:
        of_foot = [FOOT] * (run.plan.method == "foot-optimal")
        states = read_history(history, [*of_foot, *desired.names], desired.angles)
        for name in every.keys() & states.keys():
            models, learning = states.pop(name)
            task = every[name].task.with_models(models)
            every[name] = replace(every[name], learning=(learning,), task=task)
    delay, mean = None if sensor_delay_ms is None else 1e-3 * sensor_delay_ms, angles.mean(axis=0)
    with Progress(len(desired.names)) as progress, units_in_messages(desired.shown_units):
        for name in [each for each in every if each in (FOOT, *names)]:
            progress(name if name == FOOT else f"the {name}")
            own = slice(None) if name == FOOT else [names.index(name)]
            cycles_of_plan = angles[:, :, own]
            if desired.cyclic:
                mean[:, own] = settled(cycles_of_plan).mean(axis=0)
            with about(", ".join(desired.names) if name == FOOT else ""):
                every[name] = learn(
                    every[name], cycles_of_plan, sensor_delay=delay, reidentify=reidentify
                )
    about_missing = ""
    if missing := [name for name in desired.names if name not in names]:
        about_missing = f"no measured angles of {', '.join(missing)}: requests kept as they are"
        if run.plan.method == "foot-optimal":
            learnt_by = "learnt by the angles of the plan for the foot, joint by joint"
            about_missing += f"; {', '.join(names)} {learnt_by}"
        warn(about_missing)
    if history is not None:
        states |= {
            name: (each.models, each.learning[0]) for name, each in every.items() if each.learning
        }
        write_history(history, desired.angles, states)
    learnt = {name: every[name] for name in every if name not in missing}
    trials = trials_of(desired, learnt)

    def page() -> Page:
        plans = list(learnt.values())
        return learning_page(
            plans[0] if len(plans) == 1 else joined(plans),
            executed=sent,
            measured=mean,
            progress=trials,
            about_others=about_missing,
            title=desired.title,
        )

    rows = np.hstack([plan.requests for plan in every.values()])
    loads = load_columns([load for plan in every.values() for load in plan.task.loads], len(rows))
    joints = {
        name: joint_results(plan, k, desired.shown_units[name])
        for plan in every.values()
        for k, name in enumerate(plan.names)
    }
    count = f"{len(angles)} measured cycle{'s' * (len(angles) > 1)}"
    return Answer(
        {
            "cyclic": desired.cyclic,
            "period_s": period,
            "learning": {name: in_unit(each, each["unit"]) for name, each in trials.items()},
            "not_measured": missing,
            "joints": joints,
        },
        f"{count} of {len(rows)} requests; {model_words(run.model)}\n{trials_text(trials)}",
        lambda file: desired.write(file, rows, loads),
        page,
        origins_of(run),
        [
            *inputs_of(desired),
            ("requests", output),
            ("executed", requests),  # where it is another file
            *(("measured", file) for file in measured),
            ("history", history),
        ],
    )


def executed_plans(desired: Desired, requests: Array, *, by_joint: bool) -> dict[str, Plan]:
    """The plans whose requests [rad], (n, k), were executed, planned by any method.

    ``by_joint``: each joint of a plan for the foot is to follow its predicted angles in that plan.
    """
    from planner.cli.planning import plan_of, task_of
    from planner.planning.plan import Plan

    chosen = desired.settings.plan
    of_foot = chosen.method == "foot-optimal"
    if of_foot and (desired.leg is None or desired.foot is None):
        raise BadSetting('‹plan.method = "foot-optimal"› plans for a foot path of a leg')
    task = task_of(replace(desired, load=desired.torques))
    task = replace(task, load_of_pose=callable(desired.load) and task.load is not None)
    if of_foot and not by_joint:
        return {FOOT: Plan(task=task, requests=requests, method="foot_optimal")}
    if of_foot:  # what its joints were to do there, not the executed requests
        task = replace(task, desired=plan_of(desired, bounded=False).predicted)
    plan = Plan(task=task, requests=requests, solver=chosen.solver)
    return {name: plan.joint(j) for j, name in enumerate(desired.names)}


def trials_of(desired: Desired, learnt: Mapping[str, Plan]) -> dict[str, Numbers]:
    """The errors of each joint, or of the foot, in the user's units."""
    from planner.report.plan_results import no_bound
    from planner.report.wording import CARRIED

    trials = {}
    file_models = dict(zip(desired.names, desired.models, strict=True))
    for name, plan in learnt.items():
        learning, foot = plan.learning[0], plan.task.goal == "foot"
        unit = "cm" if foot else desired.shown_units[name]
        factor = CARRIED[unit].factor
        bound, noise = learning.floor
        words = partial(as_options, names=desired.names, unit=CARRIED[unit].words)
        remarks = [words(text) for text in learning.remarks]
        models = zip(desired.names if foot else (name,), plan.models, strict=True)
        changed = [joint for joint, model in models if model != file_models[joint]]
        if changed and not any("identified anew" in text for text in remarks):
            whose = f" of {', '.join(changed)}" if foot else ""
            anew = "is not that of the file: earlier trials identified it anew"
            remarks.append(f"the model{whose} {anew}")
        trials[name] = {
            "unit": unit,
            "trials": len(learning.errors),
            "errors": (factor * learning.errors).tolist(),
            "predicted": factor * learning.next_error,
            "lower_bound": math.nan if no_bound(plan) else factor * bound,
            "noise": factor * noise,
            "gain": learning.gain,
            "best_trial": learning.best + 1,
            "stopped": words(learning.stopped) or None,
            "remarks": remarks,
            "sensor_delay_ms": [1e3 * each.removed for each in learning.delays],
        }
    return trials


def as_options(text: str, names: Sequence[str], unit: str) -> str:
    """A remark of the library, with options, names of joints and the ``unit`` of angles."""
    text = re.sub(
        r"sensor_delay=([-+.\de]+\d|\d)",
        lambda match: f"--sensor-delay-ms {1e3 * float(match[1]):g}",
        text.replace(" deg", f" {unit}"),
    )
    return re.sub(r"\bjoint (\d+)\b", lambda match: names[int(match[1]) - 1], text)
