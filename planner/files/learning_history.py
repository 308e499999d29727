"""The history of learning as a file: trials, models and state from call to call, in SI units."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import InvalidFile
from planner.files.text import read_json, to_json, write_text
from planner.model.joint import JointModel
from planner.planning.result import Learning, SensorDelay, Trial
from planner.trajectory import LARGEST, Array

FORMAT = "request-planner refine 1"
"""The value of ``format`` that identifies such a file."""


class LearningState(NamedTuple):
    """State of learning of one plan; its joints may have been identified anew."""

    models: tuple[JointModel, ...]
    learning: Learning


def read_history(path: str, names: Collection[str], desired: Array) -> dict[str, LearningState]:
    """States of learning of these plans, for a path ``desired`` [rad], (n, k)."""
    content = read_json(path, what="a file that request-planner refine wrote")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidFile(path, "not a file that 'request-planner refine --history' wrote")
    try:
        angles = np.array(content["desired_rad"], dtype=np.float64)
        states = {
            name: LearningState(
                tuple(JointModel(**model) for model in state["models"]),
                _learning(state["learning"]),
            )
            for name, state in content["plans"].items()
        }
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidFile(path, f"damaged ({error}); begin another file") from error
    if not set(states) <= set(names) or len(angles) != len(desired):
        raise InvalidFile(
            path,
            f"got the trials of {len(angles)} requests of {', '.join(states)}, expected "
            f"{len(desired)} of {', '.join(names)}; begin another file for another path",
        )
    # files carry rounded angles
    if angles.shape != desired.shape or not np.allclose(angles, desired, rtol=0.0, atol=1e-6):
        raise InvalidFile(
            path, "got the trials of another desired path; begin another file for this one"
        )
    for name, state in states.items():
        columns = desired.shape[1] if len(state.models) > 1 else 1
        for number, trial in enumerate(state.learning.trials, start=1):
            expected, shape = (len(desired), columns), trial.measured.shape
            sizes = np.concatenate([trial.requests.ravel(), trial.measured.ravel()])
            problem = ""
            if trial.requests.shape != expected or shape[1:] != expected:
                problem = (
                    f": got requests and angles of shapes {trial.requests.shape} and {shape}, "
                    f"expected {len(desired)} rows of {columns}"
                )
            elif not np.all(np.abs(sizes) <= LARGEST):
                problem = " has angles that are not finite"
            if problem:
                place = f"trial {number} of {name}{problem}"
                raise InvalidFile(path, f"damaged ({place}); begin another file")
    return states


def write_history(path: str, desired: Array, states: Mapping[str, LearningState]) -> None:
    """Write the state that the next call needs, for a path ``desired`` [rad], (n, k)."""
    plans = {
        name: {
            "models": [model.parameters() for model in models],
            "learning": {
                "trials": [
                    {
                        "requests_rad": trial.requests.tolist(),
                        "measured_rad": trial.measured.tolist(),
                        "error": trial.error,
                    }
                    for trial in learning.trials
                ],
                "noise_rad": learning.noise.tolist(),
                "gain": learning.gain,
                "reidentified": list(learning.reidentified),
                "delays": [asdict(delay) for delay in learning.delays],
                "best": learning.best,
                "floor": list(learning.floor),
                "next_error": learning.next_error,
                "stopped": learning.stopped,
                "remarks": list(learning.remarks),
            },
        }
        for name, (models, learning) in states.items()
    }
    content = {"format": FORMAT, "desired_rad": desired.tolist(), "plans": plans}
    write_text(path, to_json(content))  # NaN is null


def _learning(content: Mapping[str, Any]) -> Learning:
    speed, noise, next_error = (
        math.nan if value is None else float(value)
        for value in (*content["floor"], content.get("next_error"))
    )
    return Learning(
        trials=tuple(
            Trial(
                requests=np.array(trial["requests_rad"], dtype=np.float64),
                measured=np.array(trial["measured_rad"], dtype=np.float64),
                error=float(trial["error"]),
            )
            for trial in content["trials"]
        ),
        noise=np.array(content["noise_rad"], dtype=np.float64),
        gain=float(content["gain"]),
        reidentified=tuple(content["reidentified"]),
        delays=tuple(SensorDelay(**each) for each in content["delays"]),
        best=int(content["best"]),
        floor=(speed, noise),
        next_error=next_error,
        stopped=str(content["stopped"]),
        remarks=tuple(content["remarks"]),
    )
