"""Reference identifications: simulated logs, and the recordings where available."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

import planner
from benchmark.parts import recordings
from benchmark.parts.identify import AMPLITUDES
from benchmark.parts.pairs import pendulums, so101
from benchmark.reference.record import Case, Numbers
from tests.identification.made import step_logs
from tests.instances import random_model

SIMULATED = 20

UNSEEN = 3000  # first seed of the random joints
NEGLIGIBLE = math.radians(1e-3)  # errors below this [rad] are compared as if they were it


def identifications() -> Iterator[Case]:
    """Step tests of the ERS-210A and of random joints, and the recorded servos."""
    for seed in range(SIMULATED):
        model = planner.JointModel.ers210a()
        if seed % 2:
            model = random_model(np.random.default_rng(UNSEEN + seed), whole=seed % 4 == 1)
        amplitudes = np.radians(AMPLITUDES[seed % len(AMPLITUDES)])
        logs = step_logs(model, seed=UNSEEN + seed, amplitudes=amplitudes)
        yield f"made {seed}", partial(identified, logs)
    folder = recordings()
    if folder:
        for name, logs in (so101(folder) | pendulums(folder)).items():
            yield name, partial(identified, logs[:1])


def identified(logs: list[planner.Log]) -> Numbers:
    """The numbers of an identification."""
    result = planner.identify(logs)
    names = list(result.intervals)
    return {
        "error": result.rms,
        "floor": NEGLIGIBLE,
        "held out": math.nan if result.held_out_rms is None else result.held_out_rms,
        "noise": result.noise,
        "accepted": int(result.accepted),
        "parameters": [float(getattr(result.model, name)) for name in names],
        "ends": [end for name in names for end in result.intervals[name]],
        "gain ends": [*result.gain_interval],
    }
