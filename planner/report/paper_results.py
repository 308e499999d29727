"""``results.json`` of the paper's experiment, on its model and on the virtual robot; its tables.

Every figure stands beside the paper's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from planner._version import __version__
from planner.evaluation.reproduction import (
    REFINE,
    RULE,
    SOURCE,
    OverCycles,
    PlannedWalk,
    published,
    published_foot,
)
from planner.evaluation.virtual_experiment import (
    AMPLITUDES,
    MEASURED_CYCLES,
    STEP_CYCLES,
    VirtualOutcome,
)
from planner.identification.result import Identification
from planner.model.joint import JointModel
from planner.report.page import versions
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


def paper_results(planned: PlannedWalk) -> dict[str, Any]:
    """The document that ``reproduce`` writes and prints, in degrees, centimetres and seconds.

    Every distance is a pair of plain numbers with the paper's own beside it, or None where the
    paper has none. ``comparisons`` and ``methods`` explain the keys, spelt as the paper does it.
    The paper's closed form stands beside both of ours: ``closed_form_plain`` (``Plain`` in Table 2)
    is its method, ``closed_form`` (``MB``) has its knots refined by simulating the joint.
    """
    return {
        **_heads("reproduce", PAPER_NOTE),
        "table2": {
            joint: {pair: _entry(over, published(joint, pair)) for pair, over in pairs.items()}
            for joint, pairs in planned.table2().items()
        },
        "foot": {
            method: _entry(over, published_foot(method))
            for method, over in planned.foot_table().items()
        },
        "best_shift_samples": planned.lead,
        "baseline_deviation": planned.baseline_deviation(),
        **_bounds(planned),
        "step_tests": {
            f"{amplitude:g}": {
                "lag_ticks": response.lag,
                "acceleration_ticks": response.acceleration,
                "v_max_deg_per_tick": math.degrees(response.v_max) * planned.models[0].period,
            }
            for amplitude, response in planned.steps.items()
        },
        "parameters": {
            "model": planned.models[0].parameters(),
            **_plan_parameters(planned),
        },
        "versions": versions(),
        "seconds": {**planned.seconds, "total": sum(planned.seconds.values())},
    }


def _entry(over: OverCycles, published: OverCycles | None, **more: Any) -> dict[str, Any]:
    """A distance beside the paper's own, if it has one."""
    paper = published and {
        **_norms(published.mean),
        "L2_deviation": published.deviation.rms,
        "Linf_deviation": published.deviation.max,
    }
    return {**_norms(over.mean), "paper": paper, **more}


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
    plans, foot, limits = planned.plans, planned.plans["foot_optimal"], planned.walk.leg.limits
    beyond = {
        method: np.maximum(limits.lower - plan.requests, plan.requests - limits.upper).max(axis=0)
        for method, plan in plans.items()
        if method not in ("direct", "shift")
    }
    return {
        "bounds": {
            name: {
                "rms": math.degrees(plans["optimal"].lower_bounds[j]),
                "gap": float(plans["optimal"].gaps[j]),
                "closed_form_plain_gap": float(plans["closed_form_plain"].gaps[j]),
                "closed_form_gap": float(plans["closed_form"].gaps[j]),
                "level": "envelope",
            }
            for j, name in enumerate(planned.walk.joint_names)
        },
        "foot_bound": {
            "L2": 100.0 * float(foot.lower_bounds[0]),
            "gap": float(foot.gaps[0]),
            "level": "envelope",
        },
        "limits": {
            name: {
                "lower": math.degrees(limits.lower[j]),
                "upper": math.degrees(limits.upper[j]),
                "excess": {
                    method: math.degrees(max(most[j], 0.0)) for method, most in beyond.items()
                },
            }
            for j, name in enumerate(planned.walk.joint_names)
        },
    }


def virtual_results(outcome: VirtualOutcome) -> dict[str, Any]:
    """The document that ``reproduce --robot virtual`` writes and prints.

    Every distance is the mean over the cycles by the true angles, in degrees or centimetres; beside
    it stand the figures of :func:`_executed`, and the paper's own.
    """
    planned, constants = outcome.planned, outcome.constants
    sensed = {method: run.sensed for method, run in outcome.runs.items()}
    executed = outcome.walks
    joints = planned.table2(executed), planned.table2(sensed), planned.table2()
    feet = planned.foot_table(executed), planned.foot_table(sensed), planned.foot_table()
    return {
        **_heads(
            "reproduce --robot virtual",
            VIRTUAL_NOTE,
            loss="1",
            identified="SI, but for names that end in _deg and _ticks",
        ),
        "robot": {
            "name": "virtual",
            "seed": outcome.seed,
            "cycles": len(outcome.runs["direct"].angles),
            "dropped_cycles": {method: run.dropped for method, run in outcome.runs.items()},
            "constants": constants.to_dict(),
            "top_speed_deg_per_tick": math.degrees(constants.top_speed) * constants.request_period,
            "stall_torque_newton_metre": constants.stall_torque,
        },
        "identified": {
            name: _identification_entry(identification, outcome.unseen_rms[name])
            for name, identification in zip(
                planned.walk.joint_names, outcome.identifications, strict=True
            )
        },
        "table2": {
            joint: {
                pair: _executed(published(joint, pair), *(table[joint][pair] for table in joints))
                for pair in pairs
            }
            for joint, pairs in joints[0].items()
        },
        "foot": {
            method: _executed(published_foot(method), *(table[method] for table in feet))
            for method in outcome.runs
        },
        "learning": {
            "trials": [
                {**_norms(each.mean), "std": {"L2": each.deviation.rms}}
                for each in outcome.learnt_foot
            ],
            "cycles_of_each": MEASURED_CYCLES,
            "noise": 100.0 * outcome.learning.floor[1],
            "stopped": outcome.learning.stopped or None,
        },
        "best_shift_samples": outcome.shift_samples,
        "baseline_deviation": planned.baseline_deviation(executed),
        **_bounds(planned),
        "parameters": {
            "models": {
                name: model.parameters()
                for name, model in zip(planned.walk.joint_names, planned.models, strict=True)
            },
            "step_amplitudes_deg": list(AMPLITUDES),
            "step_cycles": STEP_CYCLES,
            **_plan_parameters(planned),
        },
        "versions": versions("mujoco"),
        "seconds": {**outcome.seconds, "total": sum(outcome.seconds.values())},
    }


def _executed(published: OverCycles | None, *distances: OverCycles) -> dict[str, Any]:
    """A distance when the walk is executed, with its standard deviation (``std``).

    The same by the sensors (``sensed``), and by the plan on the identified models (``predicted``),
    and the relative excess of the mean over that (``loss``).
    """
    over, sensed, predicted = distances
    return _entry(
        over,
        published,
        std=_norms(over.deviation),
        sensed={**_norms(sensed.mean), "std": _norms(sensed.deviation)},
        predicted=_norms(predicted.mean),
        loss=over.mean.rms / predicted.mean.rms - 1.0,
    )


def _norms(distance: Distance) -> dict[str, float]:
    return {"L2": distance.rms, "Linf": distance.max}


def _identification_entry(identification: Identification, unseen: float) -> dict[str, Any]:
    """The identification, and the same in the paper's units beside its Table 1."""
    period, held_out = identification.model.period, identification.held_out_rms
    lower, upper = (
        {name: of[end] for name, of in identification.intervals.items()} for end in (0, 1)
    )
    of_paper, of_ours = JointModel.ers210a().parameters(), identification.model.parameters()
    paper, ours, least, most = (
        _in_paper_units(values, period) for values in (of_paper, of_ours, lower, upper)
    )
    return {
        **identification.to_dict(),
        "rms_deg": math.degrees(identification.rms),
        "held_out_rms_deg": None if held_out is None else math.degrees(held_out),
        "unseen_walk_rms_deg": math.degrees(unseen),
        "table1": {
            name: {
                "value": value,
                "lower": least[name],
                "upper": most[name],
                "paper": paper[name] if name != "offset_deg" else None,
            }
            for name, value in ours.items()
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


def joint_paths(planned: PlannedWalk) -> dict[str, Array]:
    """Angles and requests of all joints [rad], each (n, k), by the name of their file."""
    plans = planned.plans
    return {
        "desired": planned.walk.desired,
        "approximation_plain": planned.approximations["closed_form_plain"],
        "approximation": planned.approximations["closed_form"],
        **{f"requests_{name}": plan.requests for name, plan in plans.items() if name != "direct"},
        **{f"angles_{name}": plan.predicted for name, plan in plans.items()},
    }


Results = Mapping[str, Any]

COMPARISONS = {
    "Des,Dir": "desired to direct",
    "Des,Plain": "desired to closed form, as in the paper",
    "Pwl,Plain": "approximation to closed form, as in the paper",
    "Des,MB": "desired to closed form, knots refined",
    "Pwl,MB": "approximation to closed form, knots refined",
    "Des,Opt": "desired to optimised",
    "Des,Foot": "desired to foot-optimised",
}
"""Names of pairs of trajectories; Plain and MB are the paper's MB."""

METHODS = {
    "direct": "direct: request the desired angles",
    "shift": "best time shift of them",
    "closed_form_plain": "closed form, as in the paper",
    "closed_form": "closed form, knots refined",
    "optimal": "optimised joint by joint",
    "foot_optimal": "foot-optimised: all joints at once",
}
