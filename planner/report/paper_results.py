"""``results.json`` of the paper's experiment, on its model and on the virtual robot; its tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from planner._version import __version__
from planner.arrays import Array, Distance, excess
from planner.evaluation.reproduction import (
    REFINE,
    RULE,
    SOURCE,
    OverCycles,
    PlannedWalk,
    published,
)
from planner.evaluation.virtual_experiment import (
    AMPLITUDES,
    MEASURED_CYCLES,
    STEP_CYCLES,
    VirtualOutcome,
)
from planner.identification.result import Identification
from planner.model.joint import JointModel
from planner.report.figure import Figure
from planner.report.page import Page, file_link, models_table, versions
from planner.report.wording import (
    phrase,
    rendered_text,
)

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

TABLE_1 = {
    "v_max_deg_per_tick": ("v_max", math.degrees(1.0), 1),
    "theta_0_deg": ("theta_0", math.degrees(1.0), 0),
    "lag_ticks": ("lag", 1.0, -1),
    "acceleration_ticks": ("acceleration_time", 1.0, -1),
    "offset_deg": ("offset", math.degrees(1.0), 0),
}
"""Rows of Table 1: parameter, and a number times a power of the period, the factor to its unit."""


def paper_results(planned: PlannedWalk) -> dict[str, Any]:
    """The document that ``reproduce`` writes and prints, in degrees, centimetres and seconds.

    The paper's closed form stands beside both of ours: ``closed_form_plain`` (``Plain`` in Table 2)
    is its method, ``closed_form`` (``MB``) has its knots refined by simulating the joint.
    """
    steps = {
        f"{amplitude:g}": {
            "lag_ticks": response.lag,
            "acceleration_ticks": response.acceleration,
            "v_max_deg_per_tick": math.degrees(response.v_max) * planned.models[0].period,
        }
        for amplitude, response in planned.steps.items()
    }
    return _document(
        planned,
        phrase("paper.txt", "note"),
        {"step_tests": steps, "best_shift_samples": planned.lead},
        {"model": planned.models[0].parameters()},
        planned.seconds,
    )


def _document(
    planned: PlannedWalk,
    note: str,
    own: Mapping[str, Any],
    parameters: Mapping[str, Any],
    seconds: Mapping[str, float],
    *,
    walked: Sequence[Mapping[str, Array]] = (),
) -> dict[str, Any]:
    """What both experiments have; ``walked`` by a robot: the true angles and the sensed ones."""
    on_robot = bool(walked)
    joints = [planned.table2(angles) for angles in (*walked, None)]
    feet = [planned.foot_table(angles) for angles in (*walked, None)]
    plans, foot, limits = planned.plans, planned.plans["foot_optimal"], planned.walk.leg.limits
    beyond = {
        method: excess(plan.requests, limits.lower, limits.upper).max(axis=0)
        for method, plan in plans.items()
        if method not in ("direct", "shift")
    }
    robot = {"loss": "1", "identified": "SI, but for names that end in _deg and _ticks"}
    units = {"table2": "deg", "foot": "cm", "bounds": "deg", "foot_bound": "cm", "gap": "1"}
    command = "reproduce --robot virtual" if on_robot else "reproduce"
    return {
        "made_by": f"request-planner {__version__} {command}",
        "note": note,
        "source": SOURCE,
        "units": {**units, "limits": "deg", **(robot if on_robot else {}), "seconds": "s"},
        "comparisons": dict(COMPARISONS),
        "methods": dict(METHODS),
        **own,
        "table2": {
            joint: {
                pair: _entry(published(pair, joint), *(table[joint][pair] for table in joints))
                for pair in pairs
            }
            for joint, pairs in joints[0].items()
        },
        "foot": {
            method: _entry(published(method), *(table[method] for table in feet))
            for method in feet[0]
        },
        "baseline_deviation": planned.baseline_deviation(*walked[:1]),
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
        "parameters": {
            **parameters,
            "segments": planned.segments,
            "rule": RULE,
            "refine": dict(REFINE),
            "samples": len(planned.walk.desired),
            "clamped_samples": int((~planned.walk.reachable).sum()),
        },
        "versions": versions(*["mujoco"] * on_robot),
        "seconds": {**seconds, "total": sum(seconds.values())},
    }


def _entry(published: OverCycles | None, over: OverCycles, *robot: OverCycles) -> dict[str, Any]:
    """A distance beside the paper's own; of a walk by a ``robot`` also as sensed and planned."""
    entry = {
        **_norms(over.mean),
        "paper": published
        and {
            **_norms(published.mean),
            "L2_deviation": published.deviation.rms,
            "Linf_deviation": published.deviation.max,
        },
    }
    if not robot:
        return entry
    sensed, plan = robot
    return entry | {
        "std": _norms(over.deviation),
        "sensed": {**_norms(sensed.mean), "std": _norms(sensed.deviation)},
        "predicted": _norms(plan.mean),
        "loss": over.mean.rms / plan.mean.rms - 1.0,
    }


def virtual_results(outcome: VirtualOutcome) -> dict[str, Any]:
    """The document that ``reproduce --robot virtual`` writes and prints.

    Every distance is the mean over the cycles by the true angles, beside its standard deviation
    (``std``), the same by the sensors (``sensed``) and by the plan on the identified models
    (``predicted``), the relative excess over that (``loss``), and the paper's own.
    """
    planned, constants = outcome.planned, outcome.constants
    identified = zip(planned.walk.joint_names, outcome.identifications, strict=True)
    models = zip(planned.walk.joint_names, planned.models, strict=True)
    learnt = outcome.learnt_foot
    trials = [{**_norms(each.mean), "std": {"L2": each.deviation.rms}} for each in learnt]
    own = {
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
            for name, identification in identified
        },
        "learning": {
            "trials": trials,
            "cycles_of_each": MEASURED_CYCLES,
            "noise": 100.0 * outcome.learning.floor[1],
            "stopped": outcome.learning.stopped or None,
        },
        "best_shift_samples": outcome.shift_samples,
    }
    parameters = {
        "models": {name: model.parameters() for name, model in models},
        "step_amplitudes_deg": list(AMPLITUDES),
        "step_cycles": STEP_CYCLES,
    }
    sensed = {method: run.sensed for method, run in outcome.runs.items()}
    walked = (outcome.walks, sensed)
    note = phrase("virtual.txt", "note")
    return _document(planned, note, own, parameters, outcome.seconds, walked=walked)


def _norms(distance: Distance) -> dict[str, float]:
    return {"L2": distance.rms, "Linf": distance.max}


def _identification_entry(identification: Identification, unseen: float) -> dict[str, Any]:
    """The identification, and the same in the paper's units beside its Table 1."""
    period, held_out = identification.model.period, identification.held_out_rms
    paper, ours = JointModel.ers210a().parameters(), identification.model.parameters()
    table = {}
    for key, (name, scale, power) in TABLE_1.items():
        factor, interval = scale * period**power, identification.intervals[name]
        table[key] = {
            "value": factor * ours[name],
            "lower": factor * interval.lower,
            "upper": factor * interval.upper,
            "paper": factor * paper[name] if name != "offset" else None,
        }
    return {
        **identification.to_dict(),
        "rms_deg": math.degrees(identification.rms),
        "held_out_rms_deg": None if held_out is None else math.degrees(held_out),
        "unseen_walk_rms_deg": math.degrees(unseen),
        "table1": table,
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


# For people.


def experiment_text(results: Results) -> str:
    """All tables as plain text, for the terminal."""
    return rendered_text("virtual.txt" if "robot" in results else "paper.txt", **_values(results))


def experiment_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page, with links to files beside it."""
    featured = ("figure8_foot_paths", "foot_paths", "joints_by_method")  # the moving leg's
    alone = [figure for figure in figures if figure.name == "learning"]
    return Page(
        "virtual" if "robot" in results else "paper",
        **_values(results),
        featured=[figure for figure in figures if figure.name in featured],
        learning=alone,
        others=[each for each in figures if each not in alone and each.name not in featured],
        files=[(file_link(file), "") for file in files],
        seconds=[(part.replace("_", " "), f"{s:.2f}") for part, s in results["seconds"].items()],
    ).html()


def _values(results: Results) -> dict[str, Any]:
    """What the tables and the sentences say."""
    if "robot" in results:
        return {"results": results}
    model = models_table({"": JointModel(**results["parameters"]["model"])})
    titles, cells = (each.title for each in model.columns), model.rows[0].cells
    return {"results": results, "parameters": list(zip(titles, cells, strict=True))}
