"""How many functions and files a call passes, and under how many names its samples travel."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import numpy as np

import planner
from benchmark.instances import Instance, reference
from benchmark.table import Table

ROOT = str(Path(planner.__file__).parent)

DEPTH = 2  # attributes, fields and items that are followed from an argument on
LARGE = 20  # tuples, lists and mappings of more entries are not looked into
DEFINITION = (
    "One warm call each, for the reference rotator. Named functions and files of planner/ that are "
    "entered; those handed an array with an entry for every sample, as an argument or within "
    f"{DEPTH} steps (attributes, fields, items) from one; the paths by which they are handed it, "
    "such as problem.goal.angles, each counted once; and the same for the desired angles alone."
)


class Trace(NamedTuple):
    """The functions that a call enters, and by which names they are handed arrays."""

    entered: set[CodeType]
    samples: set[tuple[CodeType, str]]  # arrays with an entry for every sample
    desired: set[tuple[CodeType, str]]  # the desired angles themselves


def table() -> Table:
    """One row for each call."""
    instance = reference()[0]
    model, angles = instance.model, instance.desired
    calls: dict[str, Callable[[], object]] = {
        "invert_optimal": lambda: planner.invert_optimal(model, angles),
        "the same, not smoothed": lambda: planner.invert_optimal(model, angles, smoothness=0.0),
        "invert_closed_form": lambda: planner.invert_closed_form(model, angles),
        "fit_pwl, 6 segments": lambda: planner.fit_pwl(
            angles, v_max=model.v_max, tick=model.period, segments=6
        ),
    }
    columns = "functions | files | handed samples | in files | by names"
    columns += " | handed desired | by its names"
    result = Table("Trace", f"call | {columns}", DEFINITION)
    for name, call in calls.items():
        call()  # imports and caches of the first call are not counted
        trace = traced(call, instance)
        handed, given = ({code for code, _ in each} for each in (trace.samples, trace.desired))
        names, own = ({path for _, path in each} for each in (trace.samples, trace.desired))
        counted = trace.entered, _files(trace.entered), handed, _files(handed), names, given, own
        result.add(name, *map(len, counted))
    return result


def traced(call: Callable[[], object], instance: Instance) -> Trace:
    """Run the call and watch every function of ``planner`` that it enters."""
    trace = Trace(set(), set(), set())

    def watch(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(ROOT):
            return
        if code.co_name.startswith("<"):  # a comprehension or a lambda is part of its function
            return
        trace.entered.add(code)
        for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]:
            for path, array in _arrays(name, frame.f_locals.get(name), DEPTH):
                if instance.desired.size in array.shape:
                    trace.samples.add((code, path))
                if np.array_equal(array.ravel(), instance.desired):
                    trace.desired.add((code, path))

    sys.setprofile(watch)
    try:
        call()
    finally:
        sys.setprofile(None)
    return trace


def _arrays(path: str, value: Any, depth: int) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """The arrays of floats within so many steps, and the way to each."""
    if isinstance(value, np.ndarray):
        if value.dtype == float:
            yield path, value
    elif depth:
        for name, part in _parts(value):
            yield from _arrays(f"{path}.{name}", part, depth - 1)


def _parts(value: Any) -> list[tuple[Any, Any]]:
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return [*zip(value._fields, value, strict=True)]
    if isinstance(value, (tuple, list)):
        return [*enumerate(value)] if len(value) <= LARGE else []
    if isinstance(value, dict):
        return [*value.items()] if len(value) <= LARGE else []
    ours = type(value).__module__.partition(".")[0] == "planner"
    return [*vars(value).items()] if ours and hasattr(value, "__dict__") else []


def _files(codes: Any) -> set[str]:
    return {code.co_filename for code in codes}
