"""Descriptions of a joint on recordings: a delay, a first-order lag, this project's model."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

import planner
from benchmark.parts import Options
from benchmark.parts.identify import JOINTS, PENDULUMS, recorded
from benchmark.table import Table
from planner.trajectory import rms

Array = npt.NDArray[np.float64]

FITTED = ("prbs_excitation", "static_holding", "random_waypoints")
"""Recordings of the arm that are fitted; the others are predicted."""

UNSEEN = ("multisine", "triangle_wave", "gripper_cycles")

TERMS = ("dead band, mrad", "time constant, ms", "acceleration, rad/s^2")
"""Terms of a motor that a model may have."""

SETTLING = 25
"""First rows of a recording that do not count: what was requested before is not in it."""


def measure(_: Options) -> list[Table]:
    """The arm's joints on recordings that were not fitted, every recording on its second half."""
    folder = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if not folder or not Path(folder).is_dir():
        return []
    return [halves(recorded(Path(folder))), arm(Path(folder) / "so101")]


def halves(logs: Mapping[str, Sequence[planner.Log]]) -> Table:
    """One row for each recording."""
    table = Table(
        "Models of joints on the second half of recordings, fitted to the first",
        ("as it is", "delay", "first order", "model", "over a delay", *TERMS),
        note="Root mean square errors in milliradians (Jaw: thousandths of its range): of the "
        "request itself, the best pure delay, a delay with a first-order lag, and the model of "
        f"this project. {', '.join(PENDULUMS)}: pendulums; the others are joints of an SO-101.",
        stub="recording",
    )
    for name, each in logs.items():
        found = planner.identify(list(each))
        errors = [other.held_out_rms for other in found.alternatives] + [found.held_out_rms]
        known = [1e3 * error if error else float("nan") for error in errors]
        table.add(name, *known, known[3] / known[1], *terms(found))
    return table


def arm(folder: Path) -> Table:
    """One row for each joint: models of three recordings on the others."""
    table = Table(
        "Models of the SO-101's joints on recordings that were not fitted",
        (*UNSEEN, "delay", "over a delay", *TERMS),
        note="Root mean square errors in milliradians of the model on each of the recordings that "
        f"were not fitted, and of a pure delay of the best time on all of them; fitted are "
        f"{', '.join(FITTED)}.",
        stub="joint",
    )
    for joint in JOINTS[:5]:
        found = planner.identify([log_of(folder, name, joint) for name in FITTED])
        (delay,) = [one.parameters["delay"] for one in found.alternatives if one.name == "delay"]
        errors, delayed = [], []
        for name in UNSEEN:
            log = log_of(folder, name, joint)
            start = float(log.angles[0])
            predicted = planner.simulate(found.model, log.requests, cyclic=False, start=start)
            late = np.interp(log.times - delay, log.times, log.requests)
            errors.append(1e3 * rms((predicted - log.angles)[SETTLING:]))
            delayed.append(1e3 * rms((late - log.angles)[SETTLING:]))
        late_error = rms(np.array(delayed))
        table.add(joint, *errors, late_error, rms(np.array(errors)) / late_error, *terms(found))
    return table


def log_of(folder: Path, name: str, joint: str) -> planner.Log:
    """A joint's columns of a recording of the arm."""
    table = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
    return planner.Log(
        times=table["t_s"], requests=table[f"req_{joint}"], angles=table[f"act_{joint}"], name=name
    )


def terms(found: planner.Identification) -> tuple[float, ...]:
    """The terms of a motor, in the units of :data:`TERMS`; NaN where the model has none."""
    at = found.model
    limit = at.max_acceleration if np.isfinite(at.max_acceleration) else 0.0
    return tuple(
        each or float("nan") for each in (1e3 * at.dead_band, 1e3 * at.time_constant, limit)
    )
