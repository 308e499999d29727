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


IN_RADIANS = ("requests", "measured", "noise")
"""Fields that are called ``…_rad`` in the file."""


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
        expected = (len(desired), desired.shape[1] if len(state.models) > 1 else 1)
        for number, trial in enumerate(state.learning.trials, start=1):
            requests, measured = trial.requests, trial.measured
            problem = ""
            if requests.shape != expected or measured.shape[1:] != expected:
                problem = (
                    f": got requests and angles of shapes {requests.shape} and {measured.shape}, "
                    f"expected {expected[0]} rows of {expected[1]}"
                )
            elif not all(np.all(np.abs(each) <= LARGEST) for each in (requests, measured)):
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
            "learning": _renamed(asdict(learning), {key: f"{key}_rad" for key in IN_RADIANS}),
        }
        for name, (models, learning) in states.items()
    }
    content = {"format": FORMAT, "desired_rad": desired.tolist(), "plans": plans}
    write_text(path, to_json(content))  # NaN is null


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    """The same data with other keys."""
    if isinstance(value, dict):
        return {names.get(key, key): _renamed(each, names) for key, each in value.items()}
    return [_renamed(each, names) for each in value] if isinstance(value, list | tuple) else value


def _learning(content: Mapping[str, Any]) -> Learning:
    fields = _renamed(content, {f"{key}_rad": key for key in IN_RADIANS})
    numbers = (*fields["floor"], fields.get("next_error"))
    speed, noise, next_error = (math.nan if each is None else float(each) for each in numbers)
    return Learning(
        trials=tuple(
            Trial(
                requests=np.array(each["requests"], dtype=np.float64),
                measured=np.array(each["measured"], dtype=np.float64),
                error=float(each["error"]),
            )
            for each in fields["trials"]
        ),
        noise=np.array(fields["noise"], dtype=np.float64),
        gain=float(fields["gain"]),
        reidentified=tuple(fields["reidentified"]),
        delays=tuple(SensorDelay(**each) for each in fields["delays"]),
        best=int(fields["best"]),
        floor=(speed, noise),
        next_error=next_error,
        stopped=str(fields["stopped"]),
        remarks=tuple(fields["remarks"]),
    )
