"""Replays in numbers for machines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.recording.recorded_path import WHY
from planner.recording.replaying import Replay
from planner.recording.retiming import Fastest
from planner.report.plan_results import errors_results
from planner.report.replay_page import LOG_UNITS
from planner.trajectory import error_norm


def replay_results(replay: Replay, models: str, remarks: Sequence[str]) -> dict[str, Any]:
    """A replay with ``models`` for machines, in degrees or percent; missing values are null."""
    joints = {}
    for joint in replay.joints:
        unit, factor = LOG_UNITS[joint.path.unit]
        plan = joint.inversion
        entry: dict[str, Any] = {
            "planned": plan is not None,
            "reason": joint.path.reason or None,
            "unit": unit,
            "recorded": errors_results(joint.recorded_errors, unit, factor),
            f"requests_{unit}": (factor * joint.requests).tolist(),
        }
        if plan is not None:
            assert joint.predicted is not None, "a planned joint is simulated"
            entry |= {
                **{kind: errors_results(each, unit, factor) for kind, each in joint.errors.items()},
                "best_shift_s": joint.lead,
                f"expected_on_robot_rms_{unit}": factor * joint.expected,
                "norm": plan.norm,
                f"lower_bound_{unit}": factor * joint.lower_bound,
                f"largest_step_{unit}": factor * plan.largest_step,
                "recorded_requests_may_serve": joint in replay.resent_may_serve,
                "untested": list(joint.untested),
                "top_speed_known": joint.name not in replay.path.open_top_speeds,
                "faster_than_the_joint_s": [list(span) for span in joint.too_fast],
                f"desired_{unit}": (factor * joint.desired).tolist(),
                f"predicted_{unit}": (factor * joint.predicted).tolist(),
            }
        joints[joint.name] = entry
    return {
        "recording": replay.path.name,
        "track": replay.path.track,
        "why": WHY[replay.path.track],
        "models": models,
        "speed": replay.speed,
        "period_s": replay.period,
        "requests": len(replay.moments),
        "recorded_s": replay.path.duration,
        "joints": joints,
        "remarks": [*replay.path.remarks, *remarks],
    }


def fastest_results(fastest: Fastest) -> dict[str, Any]:
    """The fastest replay for machines; errors over speed are the largest, times the tolerance."""
    factor = 100.0 if fastest.foot else math.degrees(1.0)
    unit = "cm" if fastest.foot else "deg"
    allowed = factor * fastest.tolerance
    impossible = fastest.impossible and {
        "speed": fastest.impossible.speed,
        "joint": fastest.impossible.joint,
        f"lower_bound_{unit}": allowed * fastest.impossible.bound,
        "of_model_only": fastest.impossible.of_model_only,
    }
    curve = [
        {
            "speed": each.speed,
            **{
                f"{kind}_max_{unit}": allowed * ratio
                for kind, ratio in zip(each._fields[1:], each[1:], strict=True)
            },
        }
        for each in fastest.curve
    ]
    return {
        f"tolerance_{unit}": allowed,
        "retime": fastest.retime,
        "speed": fastest.speed,
        "constant_speed": fastest.constant,
        "least_factor": float(np.min(fastest.factors)),
        "largest_factor": float(np.max(fastest.factors)),
        f"largest_error_{unit}": allowed * fastest.largest,
        "impossible": impossible,
        "contradicted": list(fastest.contradicted),
        "errors_by_speed": curve,
    }


def episode_results(replay: Replay) -> dict[str, Any]:
    """The row of a recording in a table of many: the joint with the largest error of its plan."""
    worst = max(
        replay.planned,
        key=lambda each: LOG_UNITS[each.path.unit][1] * error_norm(each.errors["planned"], "rms"),
    )
    unit, factor = LOG_UNITS[worst.path.unit]
    return {
        "recording": replay.path.name,
        "requests": len(replay.moments),
        "duration_s": (len(replay.moments) - 1) * replay.period,
        "speed": replay.speed,
        "worst_joint": worst.name,
        "unit": unit,
        **{f"{kind}_rms": factor * error_norm(each, "rms") for kind, each in worst.errors.items()},
        "expected_on_robot_rms": factor * worst.expected,
        "lower_bound": factor * worst.lower_bound,
        "recorded_requests_may_serve": worst in replay.resent_may_serve,
        "remarks": list(replay.path.remarks),
    }
