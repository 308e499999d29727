"""Recording: every case run once or more, its numbers and its processor time kept as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import planner
from benchmark.machine import circumstances, kept_run

Numbers = dict[str, Any]
"""Floats, whole numbers and lists of floats by name, or ``{"failed": exception}``."""

Case = tuple[str, Callable[[], Numbers]]
Section = Callable[[], Iterator[Case]]

QUICK = 0.05  # cases below this are run a second time, and the shorter time counts [s]


def record(path: Path, sections: dict[str, Section], every: int = 1) -> None:
    """Run the sections and keep their results."""
    run = {
        "circumstances": circumstances(),
        "planner": str(Path(planner.__file__).parent),
        "sections": recorded(sections, every),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(run) + "\n", encoding="utf-8")


def recorded(sections: dict[str, Section], every: int = 1) -> dict[str, Any]:
    """The numbers of every case, or of one in ``every``."""
    results = {}
    for name, section in sections.items():
        began, pace = process_time(), measured_pace()
        cases = [*section()][::every]
        results[name] = {"cases": {case: run(call) for case, call in cases}}
        results[name]["pace"] = min(pace, measured_pace())
        print(f"{name}: {len(cases)} in {process_time() - began:.0f} s", file=sys.stderr)
    return results


def run(call: Callable[[], Numbers]) -> Numbers:
    """The case's numbers with its processor time [s]; a failure is a result too."""
    began = process_time()
    try:
        numbers = call()
    except Exception as error:  # as a user would see it, also an error of another package
        numbers = {"failed": type(error).__name__}
    seconds = process_time() - began
    if seconds < QUICK and "failed" not in numbers:
        began = process_time()
        call()
        seconds = min(seconds, process_time() - began)
    return numbers | {"seconds": seconds}


def measured_pace() -> float:
    """Processor time of a fixed piece of work [s], least of several: how fast this machine is."""
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(60, 60)) + 60.0 * np.eye(60)
    seconds = []
    for _ in range(7):
        began = process_time()
        vector = np.ones(60)
        for _ in range(200):
            vector = np.linalg.solve(matrix, vector + np.cumsum(vector))
            vector /= float(np.max(np.abs(vector)))
        sum(i * i for i in range(100_000))
        seconds.append(process_time() - began)
    return min(seconds)


def load(path: Path, only: Sequence[str] = ()) -> dict[str, Any]:
    """The sections of a kept run; ValueError where the file is none."""
    sections = kept_run(path, "sections")["sections"]
    return {name: section for name, section in sections.items() if not only or name in only}
