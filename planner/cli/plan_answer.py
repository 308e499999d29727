"""What a plan has to say: to machines and to people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from planner.cli import tolerance

if TYPE_CHECKING:
    from planner.cli.planning import Plan
    from planner.cli.wanted import Wanted


def document(
    choices: Mapping[str, Any], wanted: Wanted, made: Plan, missed: list[str]
) -> dict[str, Any]:
    """The plan for machines; what a plan for the foot does not have is null."""
    import numpy as np

    joints = {}
    for j, name in enumerate(wanted.names):
        inversion = made.inversions.get(name)
        joints[name] = {
            **_errors(np.degrees(np.abs(made.predicted[:, j] - wanted.angles[:, j])), "deg"),
            "norm": inversion and inversion.norm,
            "solver": inversion and inversion.solver,
            "lower_bound_deg": inversion and float(np.degrees(inversion.lower_bound)),
            "gap": inversion and inversion.gap,
            "requests_deg": np.degrees(made.requests[:, j]).tolist(),
            "predicted_deg": np.degrees(made.predicted[:, j]).tolist(),
        }
    foot = None
    if wanted.foot is not None:
        foot = {
            **_errors(100.0 * made.foot_distances(wanted), "cm"),
            "norm": made.together and made.together.norm,
            "lower_bound_cm": None if made.foot_bound is None else 100.0 * made.foot_bound,
            "gap": None if made.foot_bound is None else made.together and made.together.gap,
            "predicted_m": made.foot_positions(wanted).tolist(),
        }
    return {
        "method": choices["method"],
        "cyclic": choices["cyclic"],
        "period_s": wanted.period,
        "unreachable_samples": wanted.moved,
        "joints": joints,
        "foot": foot,
        "within_tolerance": not missed if tolerance.asked(choices) else None,
    }


def summary(wanted: Wanted, made: Plan) -> str:
    """The plan for people."""
    import numpy as np

    from planner.report.text_table import NOTHING, percent, text_table

    rows = []
    for j, name in enumerate(wanted.names):
        errors = _errors(np.degrees(np.abs(made.predicted[:, j] - wanted.angles[:, j])), "deg")
        bounded = [NOTHING, NOTHING]
        if name in made.inversions:
            inversion = made.inversions[name]
            bounded = [f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap)]
        rows.append([name, *(f"{error:.3f}" for error in errors.values()), *bounded])
    text = text_table(["joint", "rms [deg]", "max [deg]", "no plan below", "gap"], rows)
    if wanted.foot is not None:
        rms, largest = _errors(100.0 * made.foot_distances(wanted), "cm").values()
        text += f"\nfoot: {rms:.3f} cm rms from its path, {largest:.3f} cm at most"
        text += _bounded_foot(made)
    if wanted.moved:
        text += f"\n{wanted.moved} samples were out of the leg's reach"
    return text


def _bounded_foot(made: Plan) -> str:
    """What is proved about the foot, if anything is."""
    from planner.report.text_table import percent

    if made.together is None or not made.foot_bound:
        return ""
    weighted = "" if len(set(made.together.weights)) == 1 else " as weighted"
    norm = {"rms": "rms", "max": "at most"}[made.together.norm]
    return (
        f"\nno requests within the limits bring it below {100.0 * made.foot_bound:.3f} cm {norm}"
        f"{weighted}: the plan is {percent(made.together.gap)} above that"
    )


def _errors(errors: Any, unit: str) -> dict[str, float]:
    import numpy as np

    return {
        f"rms_{unit}": float(np.sqrt(np.mean(errors**2))),
        f"max_{unit}": float(np.max(errors)),
    }
