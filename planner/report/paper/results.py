"""``results.json`` of the paper's experiment, on its model and on the virtual robot.

Every figure stands beside the paper's own.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner._version import __version__
from planner.evaluation.reproduction import (
    REFINE,
    RULE,
    SOURCE,
    JointOutcome,
    PlannedWalk,
    Published,
    Reproduction,
    approximation,
    deviations,
    published,
    published_foot,
)
from planner.evaluation.virtual_experiment import (
    AMPLITUDES,
    MEASURED_CYCLES,
    STEP_CYCLES,
    OverCycles,
    VirtualOutcome,
)
from planner.identification.result import Identification
from planner.model.joint import JointModel
from planner.report.page import versions
from planner.report.paper.tables import COMPARISONS, METHODS
from planner.trajectory import Array, Distance

PAPER_NOTE = (
    "The joint here is the paper's model with the parameters of its Table 1; "
    "the paper's figures were measured on a robot, over 20 steps of the walk."
)

VIRTUAL_NOTE = (
    "The joints here are physical servos simulated in MuJoCo, not the paper's model: the models "
    "were identified from step tests that their sensors recorded, and they executed the walks. "
    "The paper's figures were measured on a robot, over 20 steps of the walk."
)


def paper_results(reproduction: Reproduction) -> dict[str, Any]:
    """The document that ``reproduce`` writes and prints, in degrees, centimetres and seconds.

    Every distance is a pair of plain numbers with the paper's own beside it, or None where the
    paper has none: ``table2[joint]["Des,Dir"]["L2"]`` beside ``[...]["paper"]["L2"]``, and
    ``foot[method]["Linf"]`` beside ``[...]["paper"]["Linf"]``. Comparisons are spelt as the paper
    spells them, without parentheses and blanks; ``comparisons`` and ``methods`` explain them.
    The paper's closed form stands beside both of ours: ``closed_form_plain`` (``Plain`` in Table 2)
    is its method, ``closed_form`` (``MB``) has its knots refined by simulating the joint.
    """
    return {
        **_heads("reproduce", PAPER_NOTE),
        "table2": {
            joint: {
                comparison: distance_entry(distance, published(joint, comparison))
                for comparison, distance in comparisons.items()
            }
            for joint, comparisons in reproduction.table2.items()
        },
        "foot": {
            method: distance_entry(distance, published_foot(method))
            for method, distance in reproduction.foot_table.items()
        },
        "best_shift_samples": reproduction.lead,
        "baseline_deviation": reproduction.baseline_deviation,
        **_bounds(reproduction),
        "step_tests": {
            f"{amplitude:g}": {
                "lag_ticks": response.lag,
                "acceleration_ticks": response.acceleration,
                "v_max_deg_per_tick": math.degrees(response.v_max) * reproduction.model.period,
            }
            for amplitude, response in reproduction.steps.items()
        },
        "parameters": {
            "model": reproduction.model.parameters(),
            **_plan_parameters(reproduction),
        },
        "versions": versions(),
        "seconds": {**reproduction.seconds, "total": sum(reproduction.seconds.values())},
    }


def distance_entry(distance: Distance, published: Published | None) -> dict[str, Any]:
    """A distance beside the paper's own, if it has one."""
    paper = None
    if published is not None:
        paper = {
            "L2": published.L2.mean,
            "Linf": published.Linf.mean,
            "L2_deviation": published.L2.deviation,
            "Linf_deviation": published.Linf.deviation,
        }
    return {"L2": distance.rms, "Linf": distance.max, "paper": paper}


def _heads(command: str, note: str, **units: str) -> dict[str, Any]:
    """Origin of the document, its units, and names of its keys."""
    return {
        "made_by": f"request-planner {__version__} {command}",
        "note": note,
        "source": SOURCE,
        "units": {
            "table2": "deg",
            "foot": "cm",
            "bounds": "deg",
            "foot_bound": "cm",
            "gap": "1",
            "limits": "deg",
            **units,
            "seconds": "s",
        },
        "comparisons": dict(COMPARISONS),
        "methods": dict(METHODS),
    }


def _plan_parameters(planned: PlannedWalk) -> dict[str, Any]:
    return {
        "segments": planned.segments,
        "rule": RULE,
        "refine": dict(REFINE),
        "samples": len(planned.walk.desired),
        "clamped_samples": int((~planned.walk.reachable).sum()),
    }


def _bounds(planned: PlannedWalk) -> dict[str, Any]:
    """Lower bounds with the plans' gaps, and limits with the excess of requests over them."""
    return {
        "bounds": {joint.name: _bound(joint) for joint in planned.joints},
        "foot_bound": {
            "L2": 100.0 * planned.foot_plan.lower_bound,
            "gap": planned.foot_plan.gap,
            "level": "envelope",
        },
        "limits": {joint.name: _limits(joint) for joint in planned.joints},
    }


def _bound(joint: JointOutcome) -> dict[str, Any]:
    return {
        "rms": math.degrees(joint.optimal.lower_bound),
        "gap": joint.optimal.gap,
        "closed_form_plain_gap": joint.closed_form_plain.gap,
        "closed_form_gap": joint.closed_form.gap,
        "level": "envelope",
    }


def _limits(joint: JointOutcome) -> dict[str, Any]:
    lower, upper = joint.limits
    return {
        "lower": math.degrees(lower),
        "upper": math.degrees(upper),
        "excess": {method: math.degrees(excess) for method, excess in joint.excesses.items()},
    }


def virtual_results(outcome: VirtualOutcome) -> dict[str, Any]:
    """The document that ``reproduce --robot virtual`` writes and prints.

    Every distance is the mean over the cycles by the true angles, in degrees or centimetres, with
    its standard deviation (``std``), the same by the sensors (``sensed``), the plan's
    prediction on the identified models (``predicted``), the relative excess of the mean over it
    (``loss``), and the paper's own.
    """
    planned = outcome.planned
    return {
        **_heads(
            "reproduce --robot virtual",
            VIRTUAL_NOTE,
            loss="1",
            identified="SI, but for names that end in _deg and _ticks",
        ),
        "robot": _robot(outcome),
        "identified": {
            joint.name: _identification_entry(identification, outcome.unseen_rms[joint.name])
            for joint, identification in zip(planned.joints, outcome.identifications, strict=True)
        },
        "table2": _table2(outcome),
        "foot": _foot(outcome),
        "learning": _learning(outcome),
        "best_shift_samples": outcome.shift_samples,
        "baseline_deviation": _baseline_deviation(outcome),
        **_bounds(planned),
        "parameters": {
            "models": {
                joint.name: model.parameters()
                for joint, model in zip(planned.joints, planned.models, strict=True)
            },
            "step_amplitudes_deg": list(AMPLITUDES),
            "step_cycles": STEP_CYCLES,
            **_plan_parameters(planned),
        },
        "versions": versions("mujoco"),
        "seconds": {**outcome.seconds, "total": sum(outcome.seconds.values())},
    }


def _learning(outcome: VirtualOutcome) -> dict[str, Any]:
    """Foot errors of the trials of learning [cm], and how it ended."""
    return {
        "trials": [
            {"L2": each.mean.rms, "Linf": each.mean.max, "std": {"L2": each.deviation.rms}}
            for each in outcome.learnt_foot
        ],
        "cycles_of_each": MEASURED_CYCLES,
        "noise": 100.0 * outcome.learning.floor[1],
        "stopped": outcome.learning.stopped or None,
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


def _identification_entry(identification: Identification, unseen: float) -> dict[str, Any]:
    """The identification, and the same in the paper's units beside its Table 1."""
    period = identification.model.period
    paper = _in_paper_units(JointModel.ers210a().parameters(), period)
    ours = _in_paper_units(identification.model.parameters(), period)
    ends = [
        _in_paper_units({name: of[end] for name, of in identification.intervals.items()}, period)
        for end in (0, 1)
    ]
    return {
        **identification.to_dict(),
        "rms_deg": math.degrees(identification.rms),
        "held_out_rms_deg": None
        if identification.held_out_rms is None
        else math.degrees(identification.held_out_rms),
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
    values = deviations(table2, foot)
    return sum(values) / len(values)


def joint_paths(reproduction: Reproduction) -> dict[str, Array]:
    """Angles and requests of all joints [rad], each (n, k), by the name of their file."""
    plain = [approximation(joint.closed_form_plain) for joint in reproduction.joints]
    refined = [approximation(joint.closed_form) for joint in reproduction.joints]
    requests, angles = reproduction.requests, reproduction.angles
    return {
        "desired": reproduction.walk.desired,
        "approximation_plain": np.column_stack(plain),
        "approximation": np.column_stack(refined),
        **{f"requests_{name}": each for name, each in requests.items() if name != "direct"},
        **{f"angles_{name}": each for name, each in angles.items()},
    }
