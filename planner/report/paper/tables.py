"""The tables of the paper's experiment: our figures beside the paper's, with the difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from planner.report.table import NOTHING, Column, Row, Table, number, percent, signed

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

LIMIT_METHODS = ("closed_form_plain", "closed_form", "optimal", "foot_optimal")
"""The methods whose requests are compared with the limits of the joints."""

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

BESIDE = ("ours", "paper", "diff.")
"""The columns of a figure beside the paper's."""


def paper_text(results: Results) -> str:
    """All tables as plain text, for the terminal."""
    blocks = [
        distances_text(results),
        "",
        "Lower bound on the error under any requests [deg rms]; gap: how far above a plan is",
        bounds_table(results, 2).text(),
        "",
        "How far requests go beyond the joint's limits [deg]: the closed form knows none",
        excess_table(results).text(),
        "",
        "Closed form and optimised requests are planned joint by joint: better in every joint need",
        "not be better in the foot. Refining the knots is ours, not the paper's.",
        f"The ten baseline figures (direct, shift) deviate from the paper's by "
        f"{percent(results['baseline_deviation'], 1)} on average.",
        results["note"],
    ]
    return "\n".join(blocks)


def virtual_text(results: Results) -> str:
    """All tables of the virtual robot as plain text, for the terminal."""
    learning = ", ".join(f"{trial['L2']:.3f}" for trial in results["learning"]["trials"])
    blocks = [
        "What the step tests say about the joints: estimate (95 % interval)",
        table_1(results).text(),
        "",
        distances_text(results),
        "",
        "L2 as predicted by the plan > as executed (loss); joints [deg], foot [cm]",
        executed_table(results).text(),
        "",
        f"Learning from executed cycles: foot, L2 of each trial [cm]: {learning}",
        "",
        f"Means ± standard deviations over {results['robot']['cycles']} cycles by the true angles, "
        f"after {dropped_words(results)} until the walk was steady.",
        results["note"],
    ]
    return "\n".join(blocks)


def distances_text(results: Results) -> str:
    """Table 2 and the foot as plain text."""
    bound = results["foot_bound"]
    blocks = [
        "Distances between joint trajectories [deg]: ours / the paper's (difference)",
        table_2(results).text(),
        "",
        "Distance of the foot from its desired path [cm]: ours / the paper's (difference)",
        foot_table(results).text(),
        f"Lower bound on the foot's error within the joints' limits, by the model: "
        f"{bound['L2']:.3f} cm rms; the foot-optimised plan is {percent(bound['gap'])} above it.",
    ]
    return "\n".join(blocks)


def table_2(results: Results) -> Table:
    """Table 2: one row per comparison and norm, a cell per joint [degrees]."""
    rows = []
    for comparison, label in COMPARISONS.items():
        entries = [joint[comparison] for joint in results["table2"].values()]
        kind = "beyond" if all(entry["paper"] is None for entry in entries) else ""
        for norm, words in NORMS.items():
            rows.append(Row(words, tuple(_beside(e, norm) for e in entries), label, kind))
    columns = tuple(_column(joint) for joint in results["table2"])
    return Table("", columns, tuple(rows), label="Table 2", apart=True)


def foot_table(results: Results) -> Table:
    """The foot: one row per method, a cell for each norm [cm]."""
    rows = []
    for method, label in METHODS.items():
        entry = results["foot"][method]
        cells = tuple(_beside(entry, norm) for norm in NORMS)
        rows.append(Row(label, cells, kind="beyond" if entry["paper"] is None else ""))
    columns = tuple(map(_column, NORMS.values()))
    return Table("", columns, tuple(rows), label="Foot distances")


def bounds_table(results: Results, digits: int = 3) -> Table:
    """The lower bound of every joint, and the plans' gaps."""
    bounds = results["bounds"]
    rows = [Row("lower bound", tuple(number(bound["rms"], digits) for bound in bounds.values()))]
    for label, key in GAPS.items():
        rows.append(Row(f"gap, {label}", tuple(percent(bound[key]) for bound in bounds.values())))
    return Table("", tuple(map(Column, bounds)), tuple(rows), label="Lower bounds")


def excess_table(results: Results) -> Table:
    """How far requests go beyond the limits of every joint [degrees]."""
    limits, rows = results["limits"], []
    for method in LIMIT_METHODS:
        excesses = (each["excess"][method] for each in limits.values())
        cells = tuple(f"{excess:.1f}" if excess else "kept" for excess in excesses)
        rows.append(Row(METHODS[method].split(":")[0], cells))
    return Table("", tuple(map(Column, limits)), tuple(rows), label="Beyond the limits")


def limits_table(results: Results) -> Table:
    """Bounds, limits, and how far requests go beyond these, for a page."""
    bounds, excess, limits = bounds_table(results), excess_table(results), results["limits"]
    first, *gaps = bounds.rows
    ends = tuple(
        signed(f"{limit['lower']:.0f} to {limit['upper']:.0f}") for limit in limits.values()
    )
    rows = (
        replace(first, about="lower bound [degrees]"),
        *gaps,
        Row("limits of the requests [degrees]", ends),
        *(replace(row, about=f"beyond them, {row.about} [degrees]") for row in excess.rows),
    )
    return replace(bounds, rows=rows)


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
    return Table("", columns, tuple(rows), label="Table 1")


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
    return Table("", columns, tuple(rows), label="Planned and executed")


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
    return Column(title, BESIDE, joined="{0} / {1} ({2})")


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
