"""Walks of legs, and how fast they can be walked, in numbers for machines and as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kinematics.leg import Leg
from planner.gait.stride import Stride
from planner.model.evidence import untested_words
from planner.planning.plan import FootInversion
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


def shortest_answer(cycle: FootInversion, tolerance: float) -> tuple[dict[str, Any], str]:
    """The shortest cycle that keeps a tolerance [cm], for machines and for people."""
    plan = cycle.plan
    pairs = zip(plan.names, plan.expected, strict=True)
    document = {
        "tolerance_cm": tolerance,
        "samples": len(plan.requests),
        "cycle_s": len(plan.requests) * plan.period,
        "max_cm": 100.0 * cycle.max_error,
        "untested": {name: list(each.untested) for name, each in pairs},
    }
    beyond = untested_words(plan.names, plan.expected)
    return document, phrase("gait.txt", "shortest", **document, beyond=beyond)
