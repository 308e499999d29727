"""From executed requests and measured cycles to the next requests."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from planner.cli.console import BadSetting, Key, Remark
from planner.cli.desired import Desired, repeats
from planner.cli.models import leg_title, model_words
from planner.cli.planning import plan_of, task_of
from planner.exceptions import InvalidFile, NoSteadyCycle, about
from planner.files.columns import pairs, split_unit, with_unit
from planner.files.learning_history import LearningState, read_history, write_history
from planner.files.paths import JOINT_UNITS, UNEVEN, JointPath, joint_path, read_joint_path
from planner.files.table import Table, read_table
from planner.identification.grid import mean_period
from planner.learning.refine import refine
from planner.model.response import load_columns, simulate_joints
from planner.planning.plan import Plan, joined
from planner.planning.task import limits_of_each
from planner.report.learning_page import Trials, learning_page
from planner.report.plan_page import no_bound
from planner.report.table import number, text_table
from planner.trajectory import Array

FOOT = "foot"
"""Name of the plan of a foot."""

MOST_LOST = 3
"""Measured rows in sequence that may be missing, and are interpolated."""


class Measured(NamedTuple):
    """Measured angles of some joints [rad], (cycles, n, joints), and how many rows are unused."""

    names: tuple[str, ...]
    angles: Array
    unused: int


@dataclass(frozen=True)
class Refined:
    """The next plans, with their inputs; joints that were not measured keep the executed plan.

    ``states`` are of other plans in the history: of the foot if joints were learnt one by one, or
    the reverse.
    """

    desired: Desired
    executed: Array
    measured: Measured
    plans: Mapping[str, Plan]
    states: Mapping[str, LearningState]

    @property
    def learnt(self) -> Mapping[str, Plan]:
        """The plans of the measured joints."""
        return {name: self.plans[name] for name in self.plans if name not in self.not_measured}

    @property
    def not_measured(self) -> tuple[str, ...]:
        """The joints that were not measured: their requests are the executed ones."""
        names = self.desired.names
        return tuple(name for name in names if name not in self.measured.names)

    @property
    def about_not_measured(self) -> str:
        """A remark on the joints that were not measured; empty if all were measured."""
        if not self.not_measured:
            return ""
        words = f"no measured angles of {', '.join(self.not_measured)}: requests kept as they are"
        if self.desired.settings.plan.method == "foot-optimal":
            words += (
                f"; {', '.join(self.measured.names)} learnt by the angles of the plan for the "
                "foot, joint by joint"
            )
        return words

    @property
    def requests(self) -> Array:
        """The next requests [rad], shape (n, k)."""
        return np.hstack([plan.requests for plan in self.plans.values()])

    @property
    def loads(self) -> Array | None:
        """Torques on the joints [N m], shape (n, k); None for none."""
        loads = [load for plan in self.plans.values() for load in plan.task.loads]
        return load_columns(loads, len(self.executed))


def read_executed(path: str, desired: Desired) -> JointPath:
    """The requests that were executed: a file that ``plan`` or ``refine`` wrote."""
    request_path = read_joint_path(path, joints=desired.names)
    _check_rate(path, request_path.step, desired.period)
    request_path.check_samples(len(desired.angles))
    return request_path


def _check_rate(path: str, step: float, period: float) -> None:
    """Raise InvalidFile if the rows of a file, ``step`` [s] apart, are not ``period`` apart."""
    if abs(step - period) > UNEVEN * period:
        raise InvalidFile(
            path,
            f"one row every {step:.6g} s, expected one every {period:.6g} s, the time "
            f"between requests; refine with --rate-hz {1.0 / step:.6g} if that is the rate "
            "at which they were planned and sent, else record a row for each request",
        )


def read_measured(
    paths: Sequence[str],
    desired: Desired,
    executed: JointPath,
    *,
    cycles: int | None,
) -> Measured:
    """Measured angles of the joints that are in all files, which begin at the start of a cycle.

    Files that have requests, too, must have those that were executed.
    """
    blocks, unused_rows = [], 0
    samples = len(desired.angles)
    tables = [_of_a_path(read_table(path), desired.names) for path in paths]
    columns = [
        {parts[0] for each in table.names if (parts := split_unit(each, JOINT_UNITS))}
        for table in tables
    ]
    names = tuple(name for name in desired.names if all(name in each for each in columns))
    for path, table in zip(paths, tables, strict=True):
        log = joint_path(table, joints=names or desired.names, even=False)
        angles = _a_row_each(table, log, desired.period)
        for name, got in zip(log.names, log.units, strict=True):
            expected = got if desired.units is None else desired.units[desired.names.index(name)]
            if got != expected and {got, expected} - {"deg", "rad"}:
                raise InvalidFile(
                    path, f"'{name}' is in {got}, expected {expected} as in the path", line=1
                )
        count, extra = divmod(len(angles), samples)
        if not count:
            raise InvalidFile(
                path,
                f"got {len(angles)} rows, expected {samples} a cycle, one for each request; "
                "record whole cycles, or cut the file where a cycle begins",
            )
        if extra and (cycles is None or not desired.cyclic):
            raise InvalidFile(
                path,
                f"got {len(angles)} rows, {extra} more than {count} cycles of {samples}: cut "
                "the file where cycles begin and end, or say with --cycles how many to take"
                + (", or give the times in t_s if rows were lost" if log.times is None else ""),
            )
        _check_requests(table, log, executed, desired.period)
        unused_rows += extra
        blocks.append(angles[: count * samples].reshape(count, samples, -1))
    angles = np.concatenate(blocks)
    if cycles is not None and cycles > len(angles):
        raise InvalidFile(
            paths[0], f"got {len(angles)} of {samples} rows, expected {cycles} cycles"
        )
    return Measured(names or desired.names, angles[: cycles or len(angles)], unused_rows)


def recorded_in_a_cycle(desired: Desired, executed: Array, measured: Measured) -> Remark | None:
    """A remark where a motion is to begin at rest, and the joints were in their steady cycle."""
    columns = [desired.names.index(name) for name in measured.names]
    requests = executed[:, columns]
    if desired.cyclic or not repeats(requests, None)[0]:
        return None
    models = [desired.models[j] for j in columns]
    starts = [desired.starts.get(desired.names[j], desired.angles[0, j]) for j in columns]
    try:
        cycle = simulate_joints(models, requests, cyclic=True)
    except NoSteadyCycle:
        return None
    apart = cycle - simulate_joints(models, requests, cyclic=False, starts=starts)
    nearer = np.sum(apart * (measured.angles.mean(axis=0) - cycle + apart)) / np.sum(apart**2)
    if np.max(np.abs(apart)) < math.radians(0.5) or nearer < 0.5:
        return None
    return Remark(
        "the measured angles begin as in a cycle that repeats, and ",
        Key("plan.cyclic", False),
        " is for a motion from rest: if the requests were repeated, leave it out, here and in plan",
    )


def _check_requests(table: Table, log: JointPath, executed: JointPath, period: float) -> None:
    """Raise InvalidFile if a log has other requests than those executed.

    Its requests may be up to two rows early or late, and rounded or clamped a little: what counts
    is their distance from the range of the executed ones in five rows.
    """
    for pair in pairs(table.names):
        joint = pair.joint or (log.names[0] if len(log.names) == 1 else "")
        parts = split_unit(pair.requested[0], JOINT_UNITS) if len(pair.requested) == 1 else None
        if joint not in log.names or parts is None or parts[0] in log.names:
            continue
        k = executed.names.index(joint)
        if parts[1] != executed.units[k] and {parts[1], executed.units[k]} - {"deg", "rad"}:
            continue
        column = pair.requested[0]
        values = with_unit(table, [column], JOINT_UNITS)[2]
        got = _a_row_each(table, replace(log, angles=values), period)[:, 0]
        sent = np.resize(executed.angles[:, k], len(got))  # repeats the cycle
        low, high = minimum_filter1d(sent, 5), maximum_filter1d(sent, 5)
        beyond = np.maximum(np.maximum(low - got, got - high), 0.0)
        if np.sqrt(np.mean(beyond**2)) > max(math.radians(1.0), 0.05 * np.std(sent)):
            worst, factor = int(np.argmax(beyond)), JOINT_UNITS[parts[1]]
            cycle, request = divmod(worst, len(executed.angles))
            raise InvalidFile(
                table.path,
                f"column '{column}' has {got[worst] / factor:.4g} at request {request + 1} of "
                f"cycle {cycle + 1}, expected {sent[worst] / factor:.4g} as in {executed.path}: "
                "this is a log of other requests, or does not begin with a cycle; give the "
                "requests that were played, and cut the log where a cycle begins",
            )


def _of_a_path(table: Table, joints: Sequence[str]) -> Table:
    """The table, where it is a log with its actual angles in columns as a path has them."""
    names = list(table.names)
    for pair in pairs(table.names):
        joint = pair.joint or (joints[0] if len(joints) == 1 else "")
        parts = split_unit(pair.actual[0], JOINT_UNITS) if len(pair.actual) == 1 else None
        if pair.requested and joint in joints and parts and f"{joint}_{parts[1]}" not in names:
            names[table.place(pair.actual[0])] = f"{joint}_{parts[1]}"
    return replace(table, names=tuple(names))


def _a_row_each(table: Table, log: JointPath, period: float) -> Array:
    """Measured angles [rad], (n, k), a row for each request; rows may come early or late, or miss.

    A row belongs to the request that is whole periods after that of the row before. The time of a
    request is the mean of those of the rows around it: a clock's jitter is not learnt, and a loop
    that falls behind keeps its rows.
    """
    if log.times is None:
        return log.angles
    steps = np.diff(log.times)
    step = mean_period(steps, float(np.median(steps)))
    _check_rate(log.path, step, period)
    places = np.concatenate([[0.0], np.cumsum(np.rint(steps / step))])
    longest = int(np.argmax(steps))
    if places[longest + 1] - places[longest] > MOST_LOST + 1:
        raise table.fault(
            f"{steps[longest]:.3g} s after the row before, expected a row every {step:.3g} s, of "
            f"which at most {MOST_LOST} in sequence may be missing; leave out the cycle with the "
            "hole, such as by two files of whole cycles",
            longest + 1,
        )
    every = np.arange(places[-1] + 1.0)
    late = np.interp(every, places, log.times - step * places)
    due = step * every + uniform_filter1d(late, 21, mode="nearest")  # the mean of 21 rows
    return np.column_stack([np.interp(due, log.times, column) for column in log.angles.T])


def executed_plans(desired: Desired, requests: Array, *, by_joint: bool = False) -> dict[str, Plan]:
    """The plans whose requests [rad], (n, k), were executed, planned by any method.

    ``by_joint``: each joint of a plan for the foot is to follow its predicted angles in that plan.
    """
    plan_settings, load = desired.settings.plan, desired.load
    of_foot = plan_settings.method == "foot-optimal"
    if of_foot and (desired.leg is None or desired.foot is None):
        raise BadSetting(Key("plan.method", "foot-optimal"), " plans for a foot path of a leg")
    setup = replace(desired, load=load(desired.angles) if callable(load) else load)
    single = by_joint or not of_foot
    if single:
        plan_settings = replace(plan_settings, method="optimal")
        setup = replace(setup, settings=replace(desired.settings, plan=plan_settings), limits={})
    task = task_of(setup)
    task = replace(task, load_of_pose=callable(load) and task.load is not None)
    if not single:
        return {FOOT: Plan(task=task, requests=requests, method="foot_optimal")}
    lower, upper = limits_of_each(desired.limits, desired.names)
    angles = desired.angles
    if of_foot:
        angles = plan_of(desired, bounded=False).predicted  # not the executed requests
    task = replace(task, lower=lower, upper=upper, desired=angles)
    plan = Plan(task=task, requests=requests, solver=plan_settings.solver or "gauss-newton")
    return {name: plan.joint(j) for j, name in enumerate(desired.names)}


def refined(
    desired: Desired,
    executed: Array,
    measured: Measured,
    *,
    history: str | None,
    sensor_delay: float | None,
    reidentify: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> Refined:
    """The next requests; those of joints that were not measured stay as they are.

    A ``history`` need not exist yet; a ``sensor_delay`` [s] of None is estimated.
    """
    names = desired.names
    plans = executed_plans(desired, executed, by_joint=measured.names != names)
    states: dict[str, LearningState] = {}
    if history is not None and Path(history).is_file():
        plan_names = (FOOT, *names) if desired.settings.plan.method == "foot-optimal" else names
        states = read_history(history, plan_names, desired.angles)
        for name in plans.keys() & states.keys():
            models, learning = states.pop(name)
            task = plans[name].task.with_models(models)
            plans[name] = replace(plans[name], learning=(learning,), task=task)
    answer: dict[str, Plan] = {}
    for name, plan in plans.items():
        if name not in (FOOT, *measured.names):
            answer[name] = plan
            continue
        progress(name if name == FOOT else f"the {name}")
        foot = name == FOOT
        columns = slice(None) if foot else [measured.names.index(name)]
        with desired.units_in_messages(), about(", ".join(names) if foot else ""):
            answer[name] = refine(
                plan,
                measured.angles[:, :, columns],
                sensor_delay=sensor_delay,
                reidentify=reidentify,
            )
    return Refined(desired, executed, measured, answer, states)


def write_states(path: str, answer: Refined) -> None:
    """Write the history that the next call reads."""
    states = {
        name: LearningState(plan.models, plan.learning[0])
        for name, plan in answer.plans.items()
        if plan.learning
    }
    write_history(path, answer.desired.angles, {**answer.states, **states})


def document(answer: Refined) -> dict[str, Any]:
    """The answer for machines."""
    desired = answer.desired
    rows = progress_of(answer)
    joints = {}
    for plan in answer.plans.values():
        learnt = plan.task.disturbance
        for k, name in enumerate(plan.names):
            unit = desired.unit(desired.names.index(name))
            joints[name] = {
                f"requests_{unit}": np.degrees(plan.requests[:, k]).tolist(),
                f"predicted_{unit}": np.degrees(plan.predicted[:, k]).tolist(),
                f"learnt_{unit}": None if learnt is None else np.degrees(learnt[:, k]).tolist(),
            }
    return {
        "cyclic": desired.cyclic,
        "period_s": desired.period,
        "learning": {
            each.name: {
                "trials": len(each.errors),
                f"errors_{each.unit}": each.errors.tolist(),
                f"predicted_{each.unit}": each.predicted,
                f"lower_bound_{each.unit}": each.bound,
                f"noise_{each.unit}": each.noise,
                "gain": each.gain,
                "best_trial": each.best + 1,
                "stopped": each.stopped or None,
                "remarks": list(each.remarks),
                "sensor_delay_ms": [
                    1e3 * delay.removed for delay in answer.plans[each.name].learning[0].delays
                ],
            }
            for each in rows
        },
        "not_measured": list(answer.not_measured),
        "joints": joints,
    }


def summary(answer: Refined) -> str:
    """The answer for people."""
    rows, cells, measured = progress_of(answer), [], len(answer.measured.angles)
    for each in rows:
        errors = (each.errors[0], each.errors[-1], np.min(each.errors), each.predicted)
        bound, noise = number(each.bound, 3), f"{each.noise:.3f}"
        cells.append([f"{each.name} [{each.unit}]", *map("{:.3f}".format, errors), bound, noise])
    titles = ["rms error", "first", "last", "best", "predicted next", "lower bound", "noise"]
    lines = [
        f"{measured} measured {'cycle' if measured == 1 else 'cycles'} of {len(answer.executed)} "
        f"requests; {model_words(answer.desired.settings.model)}",
        text_table(titles, cells),
    ]
    for each in rows:
        lines += [f"{each.name}: {text}" for text in each.remarks]
        if each.stopped:
            lines.append(f"{each.name}: learning has ended: {each.stopped}")
    return "\n".join(lines)


def progress_of(answer: Refined) -> list[Trials]:
    """The errors of each joint, or of the foot, in the user's units."""
    desired, rows = answer.desired, []
    file_models = dict(zip(desired.names, desired.models, strict=True))
    for name, plan in answer.learnt.items():
        learning, foot = plan.learning[0], plan.task.goal == "foot"
        factor = 100.0 if foot else math.degrees(1.0)
        bound, noise = learning.floor
        remarks = [as_options(text, desired.names) for text in learning.remarks]
        names = desired.names if foot else (name,)
        pairs_of_models = zip(names, plan.models, strict=True)
        changed = [joint for joint, model in pairs_of_models if model != file_models[joint]]
        if changed and not any("identified anew" in text for text in remarks):
            whose = f" of {', '.join(changed)}" if foot else ""
            anew = "is not that of the file: earlier trials identified it anew"
            remarks.append(f"the model{whose} {anew}")
        rows.append(
            Trials(
                name=name,
                unit="cm" if foot else desired.unit(desired.names.index(name)),
                errors=factor * learning.errors,
                predicted=factor * learning.next_error,
                bound=math.nan if no_bound(plan) else factor * bound,
                noise=factor * noise,
                gain=learning.gain,
                best=learning.best,
                stopped=learning.stopped,
                remarks=tuple(remarks),
            )
        )
    return rows


def as_options(text: str, names: Sequence[str]) -> str:
    """A remark of the library, with options for arguments and names for numbers of joints."""
    text = re.sub(
        r"sensor_delay=([-+.\de]+\d|\d)",
        lambda match: f"--sensor-delay-ms {1e3 * float(match[1]):g}",
        text,
    )
    return re.sub(r"\bjoint (\d+)\b", lambda match: names[int(match[1]) - 1], text)


def learning_report(
    answer: Refined, *, page: Path | str, written: Sequence[tuple[str, Path | str | None]] = ()
) -> str:
    """The page about the learning, as HTML."""
    desired, run = answer.desired, answer.desired.settings
    columns = [desired.names.index(name) for name in answer.measured.names]
    plans = list(answer.learnt.values())
    about = learning_page(
        plans[0] if len(plans) == 1 else joined(plans),
        executed=answer.executed[:, columns],
        measured=answer.measured.angles.mean(axis=0),
        progress=progress_of(answer),
        about_others=answer.about_not_measured,
        title=leg_title(run.leg) or ", ".join(desired.names),
    )
    return about.html(page, [("path", run.path.file or ""), ("model", run.model.file)], written)
