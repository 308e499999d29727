"""Walks of legs, and how fast they can be walked, in numbers for machines and as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kinematics.leg import Leg
from planner.gait.stride import ShortestCycle, Stride
from planner.model.evidence import OPEN_TOP_SPEED, untested_words
from planner.model.joint import JointModel
from planner.report.wording import phrase


def stride_results(leg: Leg, stride: Stride, period: float) -> dict[str, Any]:
    """The walk of a leg for machines."""
    closed = np.vstack([stride.angles, stride.angles[:1]])
    speeds = np.abs(np.diff(closed, axis=0)).max(axis=0) / period
    return {
        "length_m": stride.length,
        "height_m": stride.height,
        "centre_m": stride.centre.tolist(),
        "pose_deg": dict(zip(leg.joint_names, np.degrees(stride.pose).tolist(), strict=True)),
        "speeds_deg_s": dict(zip(leg.joint_names, np.degrees(speeds).tolist(), strict=True)),
    }


def stride_text(results: Mapping[str, Any]) -> str:
    """The walk of a leg for people."""
    x, y, z = results["centre_m"]
    pose = " ".join(f"--near {name}={angle:g}" for name, angle in results["pose_deg"].items())
    speeds = ", ".join(f"{name} {speed:.0f}" for name, speed in results["speeds_deg_s"].items())
    return (
        f"half stroke {results['length_m']:.4g} m, height {results['height_m']:.4g} m, "
        f"around ({x:.4g}, {y:.4g}, {z:.4g}) m, the foot of {pose}\n"
        f"fastest on the way [deg/s]: {speeds}"
    )


def shortest_answer(
    cycle: ShortestCycle, tolerance: float, models: Sequence[JointModel]
) -> tuple[dict[str, Any], str]:
    """The shortest cycle that keeps a tolerance [cm], for machines and for people."""
    too_short, plan = None, cycle.plan.plan
    if cycle.too_short is not None:
        samples, bound = cycle.too_short
        too_short = {
            "samples": samples,
            "cycle_s": samples * models[0].period,
            "lower_bound_cm": 100.0 * bound,
            "of_model_only": any(
                each.evidence and each.evidence.leaves_top_speed_open for each in models
            ),
        }
    pairs = zip(plan.names, plan.expected, strict=True)
    document = {
        "tolerance_cm": tolerance,
        "samples": cycle.samples,
        "cycle_s": cycle.period,
        "max_cm": 100.0 * cycle.plan.max_error,
        "untested": {name: list(each.untested) for name, each in pairs},
        "too_short": too_short,
    }
    beyond = untested_words(plan.names, plan.expected)
    more = {"open": OPEN_TOP_SPEED, "beyond": beyond}
    return document, phrase("gait.txt", "shortest", **document, **more)
