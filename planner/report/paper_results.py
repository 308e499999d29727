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
    Reproduction,
    deviations,
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
from planner.report.table import NOTHING, Column, Row, Table, number, percent, signed
from planner.report.wording import rendered_text
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


def distance_entry(distance: Distance, published: OverCycles | None) -> dict[str, Any]:
    """A distance beside the paper's own, if it has one."""
    paper = published and {
        **_norms(published.mean),
        "L2_deviation": published.deviation.rms,
        "Linf_deviation": published.deviation.max,
    }
    return {**_norms(distance), "paper": paper}


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
    names, plans, limits = planned.walk.joint_names, planned.plans, planned.walk.leg.limits
    return {
        "bounds": {
            name: {
                "rms": math.degrees(plans["optimal"][j].lower_bound),
                "gap": plans["optimal"][j].gap,
                "closed_form_plain_gap": plans["closed_form_plain"][j].gap,
                "closed_form_gap": plans["closed_form"][j].gap,
                "level": "envelope",
            }
            for j, name in enumerate(names)
        },
        "foot_bound": {
            "L2": 100.0 * planned.foot_plan.lower_bound,
            "gap": planned.foot_plan.gap,
            "level": "envelope",
        },
        "limits": {
            name: {
                "lower": math.degrees(limits.lower[j]),
                "upper": math.degrees(limits.upper[j]),
                "excess": {
                    method: math.degrees(planned.excess(method, j))
                    for method in (*plans, "foot_optimal")
                },
            }
            for j, name in enumerate(names)
        },
    }


def virtual_results(outcome: VirtualOutcome) -> dict[str, Any]:
    """The document that ``reproduce --robot virtual`` writes and prints.

    Every distance is the mean over the cycles by the true angles, in degrees or centimetres, with
    its standard deviation (``std``), the same by the sensors (``sensed``), the plan's
    prediction on the identified models (``predicted``), the relative excess of the mean over it
    (``loss``), and the paper's own.
    """
    planned, constants = outcome.planned, outcome.constants
    sensed, predicted = outcome.table2("sensed"), planned.table2
    mean_table2 = {
        joint: {pair: over.mean for pair, over in pairs.items()}
        for joint, pairs in outcome.table2().items()
    }
    mean_foot = {method: over.mean for method, over in outcome.foot_table().items()}
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
                pair: _entry(
                    over, sensed[joint][pair], predicted[joint][pair], published(joint, pair)
                )
                for pair, over in pairs.items()
            }
            for joint, pairs in outcome.table2().items()
        },
        "foot": {
            method: _entry(
                over,
                outcome.foot_table("sensed")[method],
                planned.foot_table[method],
                published_foot(method),
            )
            for method, over in outcome.foot_table().items()
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
        "baseline_deviation": float(np.mean(deviations(mean_table2, mean_foot))),
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


def _entry(
    over: OverCycles, sensed: OverCycles, predicted: Distance, published: OverCycles | None
) -> dict[str, Any]:
    return {
        **distance_entry(over.mean, published),
        "std": _norms(over.deviation),
        "sensed": {**_norms(sensed.mean), "std": _norms(sensed.deviation)},
        "predicted": _norms(predicted),
        "loss": over.mean.rms / predicted.rms - 1.0,
    }


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


def joint_paths(reproduction: Reproduction) -> dict[str, Array]:
    """Angles and requests of all joints [rad], each (n, k), by the name of their file."""
    requests, angles = reproduction.requests, reproduction.angles
    return {
        "desired": reproduction.walk.desired,
        "approximation_plain": reproduction.approximations["closed_form_plain"],
        "approximation": reproduction.approximations["closed_form"],
        **{f"requests_{name}": each for name, each in requests.items() if name != "direct"},
        **{f"angles_{name}": each for name, each in angles.items()},
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

GAPS = {
    "closed form, as in the paper": "closed_form_plain_gap",
    "closed form, knots refined": "closed_form_gap",
    "optimised": "gap",
}
"""Methods whose gaps over the lower bound the results hold, and the key of each."""

NORMS = {"L2": "L₂", "Linf": "L∞"}

TABLE_1 = {
    "v_max_deg_per_tick": "top speed [degrees per tick]",
    "theta_0_deg": "error that calls for it [degrees]",
    "lag_ticks": "lag [ticks]",
    "acceleration_ticks": "acceleration time [ticks]",
    "offset_deg": "static sag [degrees]",
}
"""Rows of Table 1: key in the results, and title."""

ERRORS = {
    "rms_deg": "prediction of the step tests [deg rms]",
    "held_out_rms_deg": "the same, held out [deg rms]",
    "unseen_walk_rms_deg": "prediction of a walk never seen [deg rms]",
}
"""Errors of an identified model: key in the results, and title."""

PLANS = {
    "direct": "Des,Dir",
    "closed_form_plain": "Des,Plain",
    "closed_form": "Des,MB",
    "optimal": "Des,Opt",
    "foot_optimal": "Des,Foot",
}
"""The row of Table 2 with a method's errors in the joints."""


def paper_text(results: Results) -> str:
    """All tables as plain text, for the terminal."""
    tables = {"table_2": table_2(results), "foot_table": foot_table(results)}
    bounds = bounds_table(results)
    return rendered_text("paper.txt", results=results, bounds_table=bounds, **tables)


def virtual_text(results: Results) -> str:
    """All tables of the virtual robot as plain text, for the terminal."""
    return rendered_text(
        "virtual.txt",
        results=results,
        table_1=table_1(results),
        table_2=table_2(results),
        foot_table=foot_table(results),
        executed_table=executed_table(results),
        dropped=dropped_words(results),
    )


def table_2(results: Results) -> Table:
    """Table 2: one row per comparison and norm, a cell per joint [degrees]."""
    rows = []
    for comparison, label in COMPARISONS.items():
        entries = [joint[comparison] for joint in results["table2"].values()]
        kind = "beyond" if all(entry["paper"] is None for entry in entries) else ""
        for norm, words in NORMS.items():
            rows.append(Row(words, tuple(_beside(e, norm) for e in entries), label, kind))
    columns = tuple(_column(joint) for joint in results["table2"])
    return Table("degrees", columns, tuple(rows), label="Table 2", apart=True)


def foot_table(results: Results) -> Table:
    """The foot: one row per method, a cell for each norm [cm]."""
    rows = []
    for method, label in METHODS.items():
        entry = results["foot"][method]
        cells = tuple(_beside(entry, norm) for norm in NORMS)
        rows.append(Row(label, cells, kind="beyond" if entry["paper"] is None else ""))
    columns = tuple(map(_column, NORMS.values()))
    return Table("centimetres", columns, tuple(rows), label="Foot distances")


def bounds_table(results: Results) -> Table:
    """The lower bound of every joint, the plans' gaps, and how far requests go beyond limits."""
    bounds, limits = results["bounds"].values(), results["limits"].values()
    ends = (signed(f"{limit['lower']:.0f} to {limit['upper']:.0f}") for limit in limits)
    rows = [
        Row("lower bound [degrees]", tuple(number(bound["rms"], 3) for bound in bounds)),
        *(Row(f"gap, {label}", tuple(percent(bound[key]) for bound in bounds))
          for label, key in GAPS.items()),
        Row("limits of the requests [degrees]", tuple(ends)),
    ]  # fmt: skip
    for method in ("closed_form_plain", "closed_form", "optimal", "foot_optimal"):
        excesses = (limit["excess"][method] for limit in limits)
        cells = tuple(f"{excess:.1f}" if excess else "kept" for excess in excesses)
        rows.append(Row(f"beyond them, {METHODS[method].split(':')[0]} [degrees]", cells))
    return Table("", tuple(map(Column, results["bounds"])), tuple(rows), label="Lower bounds")


def table_1(results: Results) -> Table:
    """Table 1: the identified parameters of every joint, and how well they predict."""
    joints = results["identified"].values()
    rows = []
    for key, label in TABLE_1.items():
        entries = [joint["table1"][key] for joint in joints]
        cells = [
            signed(f"{e['value']:.2f}\n{number(e['lower'])} to {number(e['upper'])}")
            for e in entries
        ]
        rows.append(Row(label, (*cells, number(entries[0]["paper"], 1))))
    for key, label in ERRORS.items():
        cells = [number(joint[key]) for joint in joints]
        rows.append(Row(label, (*cells, NOTHING), kind="beyond"))
    columns = tuple(map(Column, (*results["identified"], "paper")))
    return Table("joint", columns, tuple(rows), label="Table 1")


def executed_table(results: Results) -> Table:
    """Predicted and executed accuracy (L2) by method: the joints' [degrees], the foot's [cm]."""
    rows = []
    for method, label in METHODS.items():
        pair = PLANS.get(method)
        joints = [
            (NOTHING,) * 3 if pair is None else _executed(joint[pair])
            for joint in results["table2"].values()
        ]
        cells = (*joints, _executed(results["foot"][method]))
        rows.append(Row(label.split(":")[0], cells))
    columns = tuple(
        Column(name, ("planned", "executed", "loss"), joined="{0} > {1} ({2})")
        for name in (*results["table2"], "foot")
    )
    return Table("L₂", columns, tuple(rows), label="Planned and executed")


def signed_percent(share: float) -> str:
    """A share as a percentage with a sign."""
    tenths = round(1000.0 * share)
    return signed(f"{tenths / 10.0:+.1f} %") if tenths else "0.0 %"


def dropped_words(results: Results) -> str:
    """The number of dropped cycles, over all methods."""
    dropped = results["robot"]["dropped_cycles"].values()
    low, high = min(dropped), max(dropped)
    return f"{low}" if low == high else f"{low} to {high}"


def difference(ours: float, paper: float) -> str:
    """Our figure relative to the paper's, with a sign."""
    percents = round(100.0 * (ours / paper - 1.0))
    return signed(f"{percents:+d} %") if percents else "0 %"


def _column(title: str) -> Column:
    return Column(title, ("ours", "paper", "diff."), joined="{0} / {1} ({2})")


def _beside(entry: Results, norm: str) -> tuple[str, ...]:
    """One of our figures, the paper's, and the difference."""
    ours = f"{entry[norm]:.2f}"
    if "std" in entry:
        deviation = entry["std"][norm]
        ours += f"\n± {deviation:.{2 if deviation >= 0.005 else 3}f}"
    if entry["paper"] is None:
        return ours, NOTHING, NOTHING
    paper = entry["paper"][norm]
    return ours, f"{paper:.2f}", difference(entry[norm], paper)


def _executed(entry: Results) -> tuple[str, ...]:
    return (f"{entry['predicted']['L2']:.2f}", f"{entry['L2']:.2f}", signed_percent(entry["loss"]))
