"""Executed requests, the cycles measured meanwhile, and the history of learning from them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from planner.arrays import Array, as_path, excess
from planner.exceptions import InvalidFile
from planner.files.columns import JOINT_UNITS, SHARES, pairs, split_unit, with_unit
from planner.files.paths import SampledPath, check_step, joint_path, path_table
from planner.files.table import Table, read_table
from planner.files.text import read_json, to_json, write_text
from planner.identification.grid import mean_period
from planner.learning.trials import Learning, SensorDelay, Trial
from planner.model.joint import JointModel

MOST_LOST = 3  # measured rows in sequence that may be missing, and are interpolated


def read_executed(path: str, names: Sequence[str], samples: int, period: float) -> SampledPath:
    """The requests to joints that were executed, so many, one every ``period`` [s]."""
    table = path_table(path)
    if not _joints_of(table).issuperset(names) and any(pair.actual for pair in pairs(table.names)):
        raise table.fault(
            "a log of measured cycles, expected requests; REQUESTS come first, MEASURED second"
        )
    executed = joint_path(table, joints=names)
    _check_rate(path, executed.step, period)
    executed.check_samples(samples)
    return executed


def _check_rate(path: str, step: float, period: float) -> None:
    advice = (
        f"refine with --rate-hz {1.0 / step:.6g} if that is the rate at which they were planned "
        "and sent, else record a row for each request"
    )
    check_step(path, step, period, advice, "one row")


def read_measured(
    paths: Sequence[str],
    executed: SampledPath,
    *,
    period: float,
    cyclic: bool,
    units: Sequence[str],
    cycles: int | None,
) -> tuple[tuple[str, ...], Array, int]:
    """The joints that are in all files, their angles, and how many rows are unused.

    The angles [rad], (cycles, n, joints), begin at the start of a cycle, and may end within one if
    the path is ``cyclic`` and the ``cycles`` to take are known.
    """
    blocks, unused_rows = [], 0
    joints, samples = executed.names, len(executed.values)
    tables = [_of_a_path(read_table(path), joints) for path in paths]
    columns = [_joints_of(table) for table in tables]
    names = tuple(name for name in joints if all(name in each for each in columns))
    for path, table in zip(paths, tables, strict=True):
        log = joint_path(table, joints=names or joints, even=False)
        angles = rows_by_request(table, log, period)
        for name, got in zip(log.names, log.units, strict=True):
            expected = units[joints.index(name)]
            if (got in SHARES) != (expected in SHARES):
                words = f"'{name}' is in {got}, expected {expected} as in the path"
                raise InvalidFile(path, words, line=1)
        (count, extra), words = divmod(len(angles), samples), ""
        if not count:
            words = (
                f"expected {samples} a cycle, one for each request; record whole cycles, or cut "
                "the file where a cycle begins"
            )
        elif extra and (cycles is None or not cyclic):
            lost = ", or give the times in t_s if rows were lost" if log.times is None else ""
            words = (
                f"{extra} more than {count} cycles of {samples}: cut the file where cycles begin "
                f"and end, or say with --cycles how many to take{lost}"
            )
        if words:
            raise InvalidFile(path, f"got {len(angles)} rows, {words}")
        _check_requests(table, log, executed, period)
        unused_rows += extra
        blocks.append(angles[: count * samples].reshape(count, samples, -1))
    angles = np.concatenate(blocks)
    if cycles is not None and cycles > len(angles):
        words = f"got {len(angles)} of {samples} rows, expected {cycles} cycles"
        raise InvalidFile(paths[0], words)
    return names or joints, angles[: cycles or len(angles)], unused_rows


def _check_requests(table: Table, log: SampledPath, executed: SampledPath, period: float) -> None:
    """Refuse a log of other requests than those executed; they may be two rows early or late."""
    for pair in pairs(table.names):
        joint = pair.joint or (log.names[0] if len(log.names) == 1 else "")
        parts = split_unit(pair.requested[0], JOINT_UNITS) if len(pair.requested) == 1 else None
        if joint not in log.names or parts is None or parts[0] in log.names:
            continue
        k = executed.names.index(joint)
        if (parts[1] in SHARES) != (executed.units[k] in SHARES):
            continue
        column = pair.requested[0]
        values = with_unit(table, [column], JOINT_UNITS)[2]
        got = rows_by_request(table, replace(log, values=values), period)[:, 0]
        sent = np.resize(executed.values[:, k], len(got))  # repeats the cycle
        low, high = minimum_filter1d(sent, 5), maximum_filter1d(sent, 5)
        beyond = np.maximum(excess(got, low, high), 0.0)
        if np.sqrt(np.mean(beyond**2)) > max(math.radians(1.0), 0.05 * np.std(sent)):
            worst, factor = int(np.argmax(beyond)), JOINT_UNITS[parts[1]]
            cycle, request = divmod(worst, len(executed.values))
            raise InvalidFile(
                table.path,
                f"column '{column}' has {got[worst] / factor:.4g} at request {request + 1} of "
                f"cycle {cycle + 1}, expected {sent[worst] / factor:.4g} as in {executed.path}: "
                "this is a log of other requests, or does not begin with a cycle; give the "
                "requests that were played, and cut the log where a cycle begins",
            )


def _joints_of(table: Table) -> set[str]:
    """The joints that have a column as in a path."""
    return {parts[0] for each in table.names if (parts := split_unit(each, JOINT_UNITS))}


def _of_a_path(table: Table, joints: Sequence[str]) -> Table:
    """The table, where it is a log with its actual angles in columns as a path has them."""
    names = list(table.names)
    for pair in pairs(table.names):
        joint = pair.joint or (joints[0] if len(joints) == 1 else "")
        parts = split_unit(pair.actual[0], JOINT_UNITS) if len(pair.actual) == 1 else None
        if pair.requested and joint in joints and parts and f"{joint}_{parts[1]}" not in names:
            names[names.index(pair.actual[0])] = f"{joint}_{parts[1]}"
    return replace(table, names=tuple(names))


def rows_by_request(table: Table, log: SampledPath, period: float) -> Array:
    """Measured angles [rad], (n, k), a row for each request; rows may come early or late, or miss.

    A row belongs to the request that is whole periods after that of the row before, at the mean
    time of the rows around: a clock's jitter is not learnt, and a late loop keeps its rows.
    """
    if log.times is None:
        return log.values
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
    return np.column_stack([np.interp(due, log.times, column) for column in log.values.T])


FORMAT = "request-planner refine 2"  # the value of `format` that identifies such a file

# State of learning of one plan, whose joints may have been identified anew.
LearningState = tuple[tuple[JointModel, ...], Learning]


def read_history(path: str, names: Collection[str], desired: Array) -> dict[str, LearningState]:
    """States of learning of these plans, for a path ``desired`` [rad], (n, k)."""
    content = read_json(path, what="a file that request-planner refine wrote")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidFile(
            path, "not a file that 'request-planner refine --history' of this version wrote"
        )
    try:
        angles, plans = np.array(content["desired"], dtype=np.float64), content["plans"]
        if not set(plans) <= set(names) or len(angles) != len(desired):
            expected = f"{len(desired)} of {', '.join(names)}; begin another file for another path"
            problem = f"{len(angles)} requests of {', '.join(plans)}, expected {expected}"
        # files carry rounded angles
        elif angles.shape != desired.shape or not np.allclose(angles, desired, rtol=0.0, atol=1e-6):
            problem = "another desired path; begin another file for this one"
        else:
            return {name: _state(name, state, desired.shape) for name, state in plans.items()}
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidFile(path, f"damaged ({error}); begin another file") from error
    raise InvalidFile(path, f"got the trials of {problem}")


def write_history(path: str, desired: Array, states: Mapping[str, LearningState]) -> None:
    """Write the state that the next call needs, for a path ``desired`` [rad], (n, k)."""
    plans = {
        name: {"models": [model.parameters() for model in models], "learning": asdict(learning)}
        for name, (models, learning) in states.items()
    }
    write_text(path, to_json({"format": FORMAT, "desired": desired, "plans": plans}))


def _state(name: str, content: Mapping[str, Any], shape: tuple[int, ...]) -> LearningState:
    models = tuple(JointModel(**model) for model in content["models"])
    fields, columns = content["learning"], shape[1] if len(models) > 1 else 1

    def number(value: Any) -> float:
        return math.nan if value is None else float(value)  # NaN is null

    def rows(values: Any, number: int) -> Array:
        trial, numbers = f"trial {number} of {name}", np.array(values, dtype=np.float64)
        array = as_path(numbers, name=trial, columns=columns, unit="rad")
        if len(array) != shape[0]:
            raise ValueError(f"{trial}: got {len(array)} rows, expected {shape[0]}")
        return array

    speed, noise = map(number, fields["floor"])
    known = {
        "trials": tuple(
            Trial(
                requests=rows(each["requests"], k),
                measured=np.stack([rows(cycle, k) for cycle in each["measured"]]),
                error=float(each["error"]),
            )
            for k, each in enumerate(fields["trials"], start=1)
        ),
        "noise": np.array(fields["noise"], dtype=np.float64),
        "gain": float(fields["gain"]),
        "reidentified": tuple(fields["reidentified"]),
        "delays": tuple(SensorDelay(**each) for each in fields["delays"]),
        "best": int(fields["best"]),
        "floor": (speed, noise),
        "next_error": number(fields["next_error"]),
        "remarks": tuple(fields["remarks"]),
    }
    return models, Learning(**fields | known)
