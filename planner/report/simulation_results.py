"""Simulated joints in numbers for machines and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.model.evidence import expectation, untested_words
from planner.model.joint import JointModel
from planner.report.plan_results import verdict_results
from planner.trajectory import Array, angle_distance


def simulation_answer(
    names: Sequence[str],
    models: Sequence[JointModel],
    predicted: Array,
    *,
    units: Sequence[str],
    desired: Array | None,
    cyclic: bool,
    loads: Array | None,
) -> tuple[dict[str, Any], str]:
    """Angles [rad], (n, k), beside the desired ones if there are any, for machines and people.

    ``units`` are "deg" or "percent" of each joint; the text begins with a new line.
    """
    joints: dict[str, dict[str, Any]] = {}
    expected, text = [], ""
    for j, (name, model, unit) in enumerate(zip(names, models, units, strict=True)):
        angles, load, joints[name] = predicted[:, j], None if loads is None else loads[:, j], {}
        if desired is not None:
            each = expectation(
                model.evidence,
                desired[:, j],
                angles,
                period=model.period,
                cyclic=cyclic,
                load=load,
            )
            expected.append(each)
            distances = angle_distance(angles, desired[:, j])
            rms, largest, robot = np.degrees([*distances, each.error])
            joints[name] = {
                f"rms_{unit}": float(rms),
                f"max_{unit}": float(largest),
                f"expected_rms_{unit}": float(robot),
                "untested": list(each.untested),
            }
            text += f"\n{name}: {rms:.3f} {unit} rms from the desired angles"
            text += f", {largest:.3f} {unit} at most"
            if np.isfinite(robot):
                text += f"; on the robot expect about {robot:.3f} {unit} rms"
        joints[name] |= verdict_results(model)
        joints[name][f"angles_{unit}"] = np.degrees(angles).tolist()
    words = untested_words(names, expected) if expected else ""
    return joints, f"{text}\n{words}" if words else text
