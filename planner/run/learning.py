"""From executed requests and measured cycles to the next requests."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.exceptions import ANGLE_UNIT, InvalidFile, InvalidTrajectory
from planner.files.learning_history import LearningState, read_history, write_history
from planner.files.paths import JOINT_UNITS, JointPath, joint_path, read_joint_path
from planner.files.table import read_table
from planner.files.units import split_unit
from planner.inversion.arguments import checked_smoothness
from planner.inversion.foot.result import FootInversion
from planner.inversion.result import Inversion
from planner.inversion.trials import Learning
from planner.learning.refine import refine
from planner.model.joint import JointModel
from planner.model.load import load_columns
from planner.report.learning import LearningOutcome, Progress, learning_page
from planner.report.page import linked_files
from planner.report.table import NOTHING, text_table
from planner.run.desired import Desired, leg_title
from planner.run.faults import BadSetting, Key
from planner.run.models import model_words
from planner.run.plan import max_step_of
from planner.validation import freeze

if TYPE_CHECKING:
    from planner.run.run import Prepared
    from planner.trajectory import Array

Plans = Mapping[str, Inversion | FootInversion]
"""The plan of each joint, or of the foot under the name "foot"."""

FOOT = "foot"
"""What the plan of a foot is called."""


@dataclass(frozen=True)
class Refined:
    """The next plans, with what they were made from.

    Attributes:
        prepared: What the joints or the foot should do.
        executed: The requests that were executed [rad], (n, k).
        measured: What was measured of them [rad], (cycles, n, k).
        plans: The next plans.
    """

    prepared: Prepared
    executed: Array
    measured: Array
    plans: Plans

    @property
    def requests(self) -> Array:
        """The next requests [rad], shape (n, k)."""
        return _columns(self.plans, "requests")

    @property
    def predicted(self) -> Array:
        """What the joints will do, as far as it was learnt [rad], shape (n, k)."""
        return _columns(self.plans, "predicted")

    @property
    def disturbance(self) -> Array:
        """What was learnt [rad], shape (n, k)."""
        return _columns(self.plans, "disturbance")

    @property
    def loads(self) -> Array | None:
        """Torques on the joints [N m], shape (n, k); None for none."""
        loads: list[Array | None] = []
        for plan in self.plans.values():
            loads += plan.loads if isinstance(plan, FootInversion) else [plan.load]
        return load_columns(loads, len(self.executed))


def read_executed(path: str, prepared: Prepared) -> Array:
    """The requests that were executed [rad], (n, k): a file that ``plan`` or ``refine`` wrote.

    Raises:
        InvalidFile: They are not those of the desired path.
    """
    desired = prepared.desired
    given = read_joint_path(path, joints=desired.names)
    _check_rate(given, desired.period)
    given.check_samples(len(desired.angles))
    return given.angles


def _check_rate(given: JointPath, period: float) -> None:
    """Raise InvalidFile if the rows of a file are not ``period`` [s] apart."""
    try:
        given.check_period(period)
    except InvalidFile as error:
        assert given.times is not None, "they are what was checked"
        step = float(given.times[-1] - given.times[0]) / (len(given.times) - 1)
        raise InvalidFile(
            given.path,
            f"one row every {step:.6g} s, expected one every {period:.6g} s, the time between "
            f"requests; refine with --rate-hz {1.0 / step:.6g} if that is the rate at which they "
            "were planned and sent, else record a row for each request",
        ) from error


def read_measured(
    paths: Sequence[str], prepared: Prepared, *, cycles: int | None
) -> tuple[Array, int]:
    """Measured angles [rad], (cycles, n, k), from one file or several, and rows left over.

    Args:
        paths: Joint paths; each begins where a cycle does.
        prepared: What the joints should do.
        cycles: Cycles in all files together; None for as many as there are.

    Raises:
        InvalidFile: Rows are missing, or at another rate.
    """
    desired, found, left = prepared.desired, [], 0
    samples = len(desired.angles)
    for path in paths:
        given = _measured_joints(path, desired.names)
        _check_rate(given, desired.period)
        if desired.units is not None and given.units != desired.units:
            pairs = zip(desired.names, given.units, desired.units, strict=True)
            name, got, expected = next(each for each in pairs if each[1] != each[2])
            if {got, expected} - {"deg", "rad"}:
                raise InvalidFile(
                    path, f"'{name}' is in {got}, expected {expected} as in the path", line=1
                )
        many, over = divmod(len(given.angles), samples)
        if not many:
            raise InvalidFile(
                path,
                f"got {len(given.angles)} rows, expected {samples} a cycle, one for each request; "
                "record whole cycles, or cut the file where a cycle begins",
            )
        if over and (cycles is None or not desired.cyclic):
            raise InvalidFile(
                path,
                f"got {len(given.angles)} rows, {over} more than {many} cycles of {samples}: cut "
                "the file where cycles begin and end, or say with --cycles how many to take",
            )
        left += over
        found.append(given.angles[: many * samples].reshape(many, samples, -1))
    all_of_them = np.concatenate(found)
    if cycles is not None and cycles > len(all_of_them):
        raise InvalidFile(
            paths[0], f"got {len(all_of_them)} of {samples} rows, expected {cycles} cycles"
        )
    return all_of_them[: cycles or len(all_of_them)], left


def _measured_joints(path: str, names: Sequence[str]) -> JointPath:
    """The measured angles of these joints.

    Raises:
        InvalidFile: Some of them were not measured.
    """
    table = read_table(path)
    measured = {parts[0] for each in table.names if (parts := split_unit(each, JOINT_UNITS))}
    missing = [name for name in names if name not in measured]
    if missing and len(missing) < len(names):
        raise InvalidFile(
            path,
            f"no measured angles of {', '.join(missing)}, expected a column for each of "
            f"{', '.join(names)}: record them too; of a path of joints, --joint chooses which to "
            "learn",
            line=1,
        )
    return joint_path(table, joints=names)


def executed_plans(prepared: Prepared, requests: Array) -> dict[str, Inversion | FootInversion]:
    """The plans whose requests were executed, by whichever method they were planned."""
    run, desired = prepared.settings, prepared.desired
    load, of_pose = prepared.load, callable(prepared.load)
    torques = load(desired.angles) if callable(load) else load
    norm = run.plan.norm or "rms"
    step = max_step_of(run.plan, desired.period)
    smoothness = checked_smoothness(run.plan.smoothness)
    columns = requests.T.copy()
    freeze(columns)
    each = [None if torques is None else torques[:, j].copy() for j in range(len(columns))]
    loads = [
        load if model.feels_load else None for load, model in zip(each, desired.models, strict=True)
    ]
    if run.plan.method == "foot-optimal":
        if desired.leg is None or desired.foot is None:
            raise BadSetting(Key("plan.method", "foot-optimal"), " plans for a foot path of a leg")
        lower, upper = zip(*(prepared.limits[name] for name in desired.names), strict=True)
        return {
            FOOT: FootInversion(
                models=desired.models,
                leg=desired.leg,
                desired_foot=desired.foot,
                requests=requests,
                cyclic=desired.cyclic,
                norm=norm,
                weights=np.array(run.plan.weights or (1.0, 1.0, 1.0)),
                limits=(np.array(lower), np.array(upper)),
                max_step=None if step is None else np.full(len(lower), step),
                smoothness=smoothness,
                reachable=np.ones(len(requests), dtype=np.bool_),
                start=None if desired.cyclic else desired.angles[0].copy(),
                loads=tuple(loads),
                load_of_pose=of_pose and any(load is not None for load in loads),
            )
        }
    return {
        name: Inversion(
            model=desired.models[j],
            desired=desired.angles[:, j].copy(),
            requests=columns[j],
            method="optimal",
            solver=run.plan.solver or "gauss-newton",
            cyclic=desired.cyclic,
            norm=norm,
            limits=prepared.limits.get(name),
            max_step=step,
            smoothness=smoothness,
            start=None
            if desired.cyclic
            else prepared.starts.get(name, float(desired.angles[0, j])),
            load=loads[j],
            load_of_pose=of_pose and loads[j] is not None,
        )
        for j, name in enumerate(desired.names)
    }


def refined(
    prepared: Prepared,
    executed: Array,
    measured: Array,
    *,
    history: str | None,
    sensor_delay: float | None,
    reidentify: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> Refined:
    """The next requests.

    Args:
        prepared: What the joints or the foot should do.
        executed: Requests [rad], (n, k).
        measured: What was measured of them [rad], (cycles, n, k).
        history: The file with the earlier trials; None for none, and it need not exist.
        sensor_delay: How late the sensors are [s]; None to look for it.
        reidentify: Whether models may be identified anew.
        progress: Called with the name of each joint.
    """
    plans = executed_plans(prepared, executed)
    if history is not None and Path(history).is_file():
        states = read_history(history, plans.keys(), prepared.desired.angles)
        plans = {name: _resumed(plan, states[name]) for name, plan in plans.items()}
    answer: dict[str, Inversion | FootInversion] = {}
    names = prepared.desired.names
    for name, plan in plans.items():
        progress(name if name == FOOT else f"the {name}")
        options: dict[str, Any] = {"sensor_delay": sensor_delay, "reidentify": reidentify}
        if isinstance(plan, FootInversion):
            with _speaking_of(names):
                answer[name] = refine(plan, measured, **options)
            continue
        j = names.index(name)
        token = ANGLE_UNIT.set(prepared.desired.unit(j))
        try:
            with _speaking_of((name,)):
                answer[name] = refine(plan, measured[:, :, j], **options)
        finally:
            ANGLE_UNIT.reset(token)
    return Refined(prepared, executed, measured, answer)


def _resumed(plan: Inversion | FootInversion, state: LearningState) -> Inversion | FootInversion:
    """The plan, with what the history says that it has learnt."""
    models, learning = state
    if isinstance(plan, FootInversion):
        return replace(plan, learning=learning, models=models)
    return replace(plan, learning=learning, model=models[0])


@contextmanager
def _speaking_of(names: Sequence[str]) -> Iterator[None]:
    try:
        yield
    except InvalidTrajectory as error:
        error.args = (f"{', '.join(names)}: {error}",)
        raise


def write_states(path: str, answer: Refined) -> None:
    """Write the history that the next call reads."""
    states = {
        name: LearningState(_models(plan), _learning_of(plan))
        for name, plan in answer.plans.items()
    }
    write_history(path, answer.prepared.desired.angles, states)


def document(answer: Refined) -> dict[str, Any]:
    """The answer for machines."""
    desired = answer.prepared.desired
    rows = progress_of(answer)
    return {
        "cyclic": desired.cyclic,
        "period_s": desired.period,
        "learning": {
            each.name: {
                "trials": len(each.errors),
                f"errors_{each.unit}": each.errors.tolist(),
                f"predicted_{each.unit}": each.predicted,
                f"lower_bound_{each.unit}": None if math.isnan(each.bound) else each.bound,
                f"noise_{each.unit}": each.noise,
                "gain": each.gain,
                "best_trial": each.best + 1,
                "stopped": each.stopped or None,
                "remarks": list(each.remarks),
                "sensor_delay_ms": [
                    1e3 * delay.removed for delay in _learning_of(answer.plans[each.name]).delays
                ],
            }
            for each in rows
        },
        "joints": {
            name: {
                f"requests_{desired.unit(j)}": np.degrees(answer.requests[:, j]).tolist(),
                f"predicted_{desired.unit(j)}": np.degrees(answer.predicted[:, j]).tolist(),
                f"learnt_{desired.unit(j)}": np.degrees(answer.disturbance[:, j]).tolist(),
            }
            for j, name in enumerate(desired.names)
        },
    }


def summary(answer: Refined) -> str:
    """The answer for people."""
    rows = progress_of(answer)
    measured = len(answer.measured)
    cycles = "cycle" if measured == 1 else "cycles"
    first = f"{measured} measured {cycles} of {len(answer.executed)} requests"
    lines = [f"{first}; {model_words(answer.prepared.settings.model)}"]
    cells = []
    for each in rows:
        bound = NOTHING if math.isnan(each.bound) else f"{each.bound:.3f}"
        errors = [each.errors[0], each.errors[-1], np.min(each.errors), each.predicted]
        texts = [f"{error:.3f}" for error in errors]
        cells.append([f"{each.name} [{each.unit}]", *texts, bound, f"{each.noise:.3f}"])
    titles = ["rms error", "first", "last", "best", "predicted next", "lower bound", "noise"]
    lines.append(text_table(titles, cells))
    for each in rows:
        lines += [f"{each.name}: {text}" for text in each.remarks]
        if each.stopped:
            lines.append(f"{each.name}: learning has ended: {each.stopped}")
    return "\n".join(lines)


def progress_of(answer: Refined) -> list[Progress]:
    """The errors of each joint, or of the foot, in the user's units."""
    desired, found = answer.prepared.desired, []
    for name, plan in answer.plans.items():
        learning = _learning_of(plan)
        foot = isinstance(plan, FootInversion)
        unit = "cm" if foot else desired.unit(desired.names.index(name))
        factor = 100.0 if foot else math.degrees(1.0)
        bound, noise = learning.floor
        remarks = [as_options(text, desired.names) for text in learning.remarks]
        if not any("identified anew" in text for text in remarks):
            remarks += _other_models(plan, name, desired)
        found.append(
            Progress(
                name=name,
                unit=unit,
                errors=factor * learning.errors,
                cycles=tuple(trial.cycles for trial in learning.trials),
                predicted=factor * learning.next_error,
                bound=factor * bound,
                noise=factor * noise,
                gain=learning.gain,
                best=learning.best,
                stopped=learning.stopped,
                remarks=tuple(remarks),
            )
        )
    return found


def _other_models(plan: Inversion | FootInversion, name: str, desired: Desired) -> list[str]:
    """Which models are no longer those of the model file: they were identified anew before."""
    names = desired.names if name == FOOT else (name,)
    given = dict(zip(desired.names, desired.models, strict=True))
    changed = [
        joint for joint, model in zip(names, _models(plan), strict=True) if model != given[joint]
    ]
    if not changed:
        return []
    whose = f" of {', '.join(changed)}" if name == FOOT else ""
    return [f"the model{whose} is not that of the file: earlier trials identified it anew"]


def as_options(text: str, names: Sequence[str]) -> str:
    """A remark of the library, with options for arguments and names for numbers of joints."""
    text = re.sub(
        r"sensor_delay=([-+.\de]+\d|\d)",
        lambda found: f"--sensor-delay-ms {1e3 * float(found[1]):g}",
        text,
    )
    return re.sub(r"\bjoint (\d+)\b", lambda found: names[int(found[1]) - 1], text)


def learning_report(
    answer: Refined, *, page: Path | str, written: Sequence[tuple[str, Path | str | None]] = ()
) -> str:
    """The page about what was learnt, as HTML."""
    prepared = answer.prepared
    desired, run = prepared.desired, prepared.settings
    outcome = LearningOutcome(
        names=desired.names,
        period=desired.period,
        cyclic=desired.cyclic,
        desired=desired.angles,
        executed=answer.executed,
        measured=answer.measured.mean(axis=0),
        requests=answer.requests,
        predicted=answer.predicted,
        disturbance=answer.disturbance,
        progress=tuple(progress_of(answer)),
    )
    return learning_page(
        outcome,
        title=leg_title(run.leg) or ", ".join(desired.names),
        origins=[("path", run.path.file or ""), ("model", run.model.file)],
        files=linked_files(page, written),
    )


def _columns(plans: Plans, name: str) -> Array:
    return np.column_stack([getattr(plan, name) for plan in plans.values()])


def _models(plan: Inversion | FootInversion) -> tuple[JointModel, ...]:
    return plan.models if isinstance(plan, FootInversion) else (plan.model,)


def _learning_of(plan: Inversion | FootInversion) -> Learning:
    assert plan.learning is not None, "refine returned it"
    return plan.learning
