"""Reference identifications: made logs, and the recordings where they are."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

import planner
from benchmark.parts.identify import AMPLITUDES, made, recorded
from benchmark.reference.record import Case, Numbers
from tests.instances import random_model

MADE = 20

UNSEEN = 3000
"""First seed of the random joints."""

NEGLIGIBLE = math.radians(1e-3)
"""Errors below this [rad] are compared as if they were it."""


def identifications() -> Iterator[Case]:
    """Step tests of the ERS-210A and of random joints, and the recorded servos."""
    for seed in range(MADE):
        model = planner.JointModel.ers210a()
        if seed % 2:
            model = random_model(np.random.default_rng(UNSEEN + seed), whole=seed % 4 == 1)
        logs = made(model, AMPLITUDES[seed % len(AMPLITUDES)], UNSEEN + seed)
        yield f"made {seed}", partial(identified, logs)
    folder = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if folder and Path(folder).is_dir():
        for name, logs in recorded(Path(folder)).items():
            yield name, partial(identified, logs)


def identified(logs: list[planner.Log]) -> Numbers:
    """The numbers of an identification."""
    found = planner.identify(logs)
    names = list(found.intervals)
    return {
        "error": found.rms,
        "floor": NEGLIGIBLE,
        "held out": math.nan if found.held_out_rms is None else found.held_out_rms,
        "noise": found.noise,
        "accepted": int(found.accepted),
        "parameters": [float(getattr(found.model, name)) for name in names],
        "ends": [end for name in names for end in found.intervals[name]],
        "gain ends": [*found.gain_interval],
    }
