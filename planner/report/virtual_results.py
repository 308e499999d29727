"""``results.json`` of the experiment on the virtual robot, with the keys of the paper's."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from planner._version import __version__
from planner.evaluation.metrics import Distance
from planner.evaluation.paper import SOURCE, Published, deviations, published, published_foot
from planner.evaluation.planned_walk import REFINE, RULE
from planner.evaluation.virtual_experiment import AMPLITUDES, STEP_CYCLES
from planner.evaluation.virtual_outcome import OverCycles, VirtualOutcome
from planner.identification.result import Identification
from planner.model.joint import JointModel
from planner.report.paper_tables import COMPARISONS, METHODS
from planner.report.results import (
    bound_entry,
    distance_entry,
    foot_bound_entry,
    limits_entry,
    versions,
)

NOTE = (
    "The joints here are physical servos simulated in MuJoCo, not the paper's model: the models "
    "were identified from step tests that their sensors recorded, and they executed the walks. "
    "The paper's figures were measured on a robot, over 20 steps of the walk."
)


def virtual_results(outcome: VirtualOutcome) -> dict[str, Any]:
    """The document that ``reproduce --robot virtual`` writes and prints.

    Every distance is the mean over the cycles by the true angles, in degrees or centimetres, with
    its standard deviation (``std``), the same by the sensors (``sensed``), what the plan had
    predicted on the identified models (``predicted``), by how much the mean is above that
    (``loss``), and the paper's own.
    """
    planned = outcome.planned
    return {
        "made_by": f"request-planner {__version__} reproduce --robot virtual",
        "note": NOTE,
        "source": SOURCE,
        "robot": _robot(outcome),
        "units": {
            "table2": "deg",
            "foot": "cm",
            "bounds": "deg",
            "foot_bound": "cm",
            "gap": "1",
            "loss": "1",
            "limits": "deg",
            "identified": "SI, but for names that end in _deg and _ticks",
            "seconds": "s",
        },
        "comparisons": dict(COMPARISONS),
        "methods": dict(METHODS),
        "identified": {
            joint.name: _identified(found, outcome.unseen_rms[joint.name])
            for joint, found in zip(planned.joints, outcome.identifications, strict=True)
        },
        "table2": _table2(outcome),
        "foot": _foot(outcome),
        "best_shift_samples": outcome.shift_samples,
        "baseline_deviation": _baseline_deviation(outcome),
        "bounds": {joint.name: bound_entry(joint) for joint in planned.joints},
        "foot_bound": foot_bound_entry(planned),
        "limits": {joint.name: limits_entry(joint) for joint in planned.joints},
        "parameters": {
            "models": {
                joint.name: asdict(model)
                for joint, model in zip(planned.joints, planned.models, strict=True)
            },
            "step_amplitudes_deg": list(AMPLITUDES),
            "step_cycles": STEP_CYCLES,
            "segments": planned.segments,
            "rule": RULE,
            "refine": dict(REFINE),
            "samples": len(planned.walk.desired),
            "clamped_samples": int((~planned.walk.reachable).sum()),
        },
        "versions": versions("mujoco"),
        "seconds": {**outcome.seconds, "total": sum(outcome.seconds.values())},
    }


def _robot(outcome: VirtualOutcome) -> dict[str, Any]:
    constants = outcome.constants
    return {
        "name": "virtual",
        "seed": outcome.seed,
        "cycles": len(outcome.runs["direct"].angles),
        "dropped_cycles": {method: run.dropped for method, run in outcome.runs.items()},
        "constants": constants.to_dict(),
        "top_speed_deg_per_tick": math.degrees(constants.top_speed) * constants.request_period,
        "stall_torque_newton_metre": constants.stall_torque,
    }


def _table2(outcome: VirtualOutcome) -> dict[str, Any]:
    sensed, predicted = outcome.sensed_table2, outcome.planned.table2
    return {
        joint: {
            pair: _entry(over, sensed[joint][pair], predicted[joint][pair], published(joint, pair))
            for pair, over in pairs.items()
        }
        for joint, pairs in outcome.table2.items()
    }


def _foot(outcome: VirtualOutcome) -> dict[str, Any]:
    sensed, predicted = outcome.sensed_foot_table, outcome.planned.foot_table
    return {
        method: _entry(over, sensed[method], predicted[method], published_foot(method))
        for method, over in outcome.foot_table.items()
    }


def _entry(
    over: OverCycles, sensed: OverCycles, predicted: Distance, published: Published | None
) -> dict[str, Any]:
    return {
        **distance_entry(over.mean, published),
        "std": {"L2": over.deviation.rms, "Linf": over.deviation.max},
        "sensed": {
            "L2": sensed.mean.rms,
            "Linf": sensed.mean.max,
            "std": {"L2": sensed.deviation.rms, "Linf": sensed.deviation.max},
        },
        "predicted": {"L2": predicted.rms, "Linf": predicted.max},
        "loss": over.mean.rms / predicted.rms - 1.0,
    }


def _identified(found: Identification, unseen: float) -> dict[str, Any]:
    """The identification, and the same in the paper's units beside its Table 1."""
    period = found.model.period
    paper = _in_paper_units(asdict(JointModel.ers210a()), period)
    ours = _in_paper_units(asdict(found.model), period)
    ends = [
        _in_paper_units({name: of[end] for name, of in found.intervals.items()}, period)
        for end in (0, 1)
    ]
    return {
        **found.to_dict(),
        "rms_deg": math.degrees(found.rms),
        "held_out_rms_deg": None
        if found.held_out_rms is None
        else math.degrees(found.held_out_rms),
        "unseen_walk_rms_deg": math.degrees(unseen),
        "table1": {
            name: {
                "value": ours[name],
                "lower": ends[0][name],
                "upper": ends[1][name],
                "paper": paper[name] if name != "offset_deg" else None,
            }
            for name in ours
        },
    }


def _in_paper_units(values: dict[str, float], period: float) -> dict[str, float]:
    """Parameters in degrees and ticks of this period [s], as the paper's Table 1 has them."""
    return {
        "v_max_deg_per_tick": math.degrees(values["v_max"]) * period,
        "theta_0_deg": math.degrees(values["theta_0"]),
        "lag_ticks": values["lag"] / period,
        "acceleration_ticks": values["acceleration_time"] / period,
        "offset_deg": math.degrees(values["offset"]),
    }


def _baseline_deviation(outcome: VirtualOutcome) -> float:
    """Mean relative deviation of the ten baseline figures from the paper's."""
    table2 = {
        joint: {pair: over.mean for pair, over in pairs.items()}
        for joint, pairs in outcome.table2.items()
    }
    foot = {method: over.mean for method, over in outcome.foot_table.items()}
    found = deviations(table2, foot)
    return sum(found) / len(found)
