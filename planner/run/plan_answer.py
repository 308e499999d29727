"""What the command line and run files say of a plan: JSON for machines, text for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED, untested_words
from planner.model.response import path_speeds
from planner.planning.error_norm import error_norm
from planner.planning.plan import ErrorsOfModels
from planner.report.table import NOTHING, percent, text_table
from planner.run import settings
from planner.run.models import model_words
from planner.run.plan import max_step_of

if TYPE_CHECKING:
    from planner.evaluation.metrics import RequestMotion
    from planner.planning.result import FootInversion, Inversion
    from planner.run.desired import Desired
    from planner.run.plan import Answer
    from planner.trajectory import Array


def document(run: settings.Run, answer: Answer, missed: list[str]) -> dict[str, Any]:
    """The plan for machines; what a plan for the foot does not have is null."""
    desired, together, loads = answer.desired, answer.together, answer.loads
    joints = {}
    for j, name in enumerate(desired.names):
        inversion, unit = answer.inversions.get(name), desired.unit(j)
        joints[name] = {
            **_errors(np.degrees(np.abs(answer.predicted[:, j] - desired.angles[:, j])), unit),
            "norm": inversion and inversion.norm,
            "solver": inversion and inversion.solver,
            f"expected_rms_{unit}": _degrees_or_null(answer.expected[j].error),
            "untested": list(answer.expected[j].untested),
            f"lower_bound_{unit}": inversion and float(np.degrees(inversion.lower_bound)),
            "gap": inversion and inversion.gap,
            "over_models": inversion and _over_models(inversion, unit, math.degrees(1.0)),
            **_motion(answer.motions[name], unit),
            f"requests_{unit}": np.degrees(answer.requests[:, j]).tolist(),
            f"predicted_{unit}": np.degrees(answer.predicted[:, j]).tolist(),
            **({} if loads is None else {"load_Nm": loads[:, j].tolist()}),
        }
    foot = None
    if desired.foot is not None:
        bound = answer.foot_bound
        foot = {
            **_errors(100.0 * answer.foot_distances, "cm"),
            "expected_rms_cm": answer.expected_foot and 100.0 * answer.expected_foot,
            "norm": together and together.norm,
            "lower_bound_cm": None if bound is None else 100.0 * bound,
            "gap": None if bound is None else together and together.gap,
            "over_models": together and _over_models(together, "cm", 100.0),
            "predicted_m": answer.foot_positions.tolist(),
        }
    step = max_step_of(run.plan, desired.period)
    asked = run.tolerance.deg is not None or run.tolerance.cm is not None
    return {
        "method": run.plan.method,
        "cyclic": desired.cyclic,
        "period_s": desired.period,
        "robust": run.plan.robust,
        "max_step_deg": None if step is None else math.degrees(step),
        "unreachable_samples": desired.unreachable,
        "lower_bound_withdrawn": answer.bound_withdrawn,
        "joints": joints,
        "foot": foot,
        "within_tolerance": not missed if asked else None,
    }


def summary(run: settings.Run, answer: Answer) -> str:
    """The plan for people."""
    desired, rows = answer.desired, []
    known = any(np.isfinite(each.error) for each in answer.expected)
    text = (
        f"{len(answer.requests)} requests, one every {1e3 * desired.period:g} ms; "
        f"{model_words(run.model)}\n"
    )
    for j, name in enumerate(desired.names):
        errors = _errors(np.degrees(np.abs(answer.predicted[:, j] - desired.angles[:, j])), "deg")
        bounded = [NOTHING, NOTHING]
        if name in answer.inversions and not answer.bound_withdrawn:
            inversion = answer.inversions[name]
            bounded = [f"{np.degrees(inversion.lower_bound):.3f}", percent(inversion.gap)]
        expected = np.degrees(answer.expected[j].error)
        robot = [NOTHING if np.isnan(expected) else f"{expected:.3f}"] * known
        rows.append(
            [_label(desired, j), *(f"{error:.3f}" for error in errors.values()), *robot, *bounded]
        )
    robot = ["on the robot"] * known
    text += text_table(["joint", "rms [deg]", "max [deg]", *robot, "lower bound", "gap"], rows)
    text += "\n" + text_table(
        [
            "requests",
            "largest step [deg]",
            "reversals/s",
            "length [deg]",
            "desired",
            "beyond [deg]",
        ],
        [_motion_cells(name, each) for name, each in answer.motions.items()],
    )
    if over_models := _over_models_table(answer):
        text += f"\n{over_models}"
    if desired.foot is not None:
        rms, largest = _errors(100.0 * answer.foot_distances, "cm").values()
        text += f"\nfoot: {rms:.3f} cm rms from its path, {largest:.3f} cm at most"
        if answer.expected_foot is not None:
            text += f"; on the robot {100.0 * answer.expected_foot:.3f} cm rms to expect"
        text += _bounded_foot(answer)
    if known:
        text += "\non the robot: rms error to expect, by what the models were tested on"
    if words := untested_words(desired.names, answer.expected):
        text += f"\n{words}"
    if unknown := _unknown_top_speeds(answer):
        text += f"\nlower bounds of the model only: {', '.join(unknown)} ({OPEN_TOP_SPEED})"
    if answer.bound_withdrawn:
        text += f"\nthere is no lower bound under {answer.bound_withdrawn}"
    if max_step_of(run.plan, desired.period) is not None:
        text += "\nlower bounds are for requests with steps of any size"
    if desired.unreachable:
        text += f"\n{desired.unreachable} samples were out of the leg's reach"
    return text


def _unknown_top_speeds(answer: Answer) -> list[str]:
    """Joints whose path is faster than a top speed that is only known to be at least so large."""
    desired, loads = answer.desired, answer.loads
    open_ones = []
    for j, (name, model) in enumerate(zip(desired.names, desired.models, strict=True)):
        load = None if loads is None else loads[:, j]
        speeds = path_speeds(model, desired.angles[:, j], cyclic=desired.cyclic, load=load)
        if model.evidence and model.evidence.leaves_top_speed_open and speeds.too_fast.any():
            open_ones.append(name)
    return open_ones


def _label(desired: Desired, joint: int) -> str:
    """The joint's name, with the unit where its errors are no angles."""
    name = desired.names[joint]
    return name if desired.unit(joint) == "deg" else f"{name} [% of its range]"


def _over_models(
    made: Inversion | FootInversion, unit: str, factor: float
) -> dict[str, Any] | None:
    """Errors over the models that were drawn, for machines; None where none were."""
    if made.nominal is None:
        return None
    return {
        name: {
            **{
                f"{which}_{unit}": factor * error
                for which, error in plan.over_models._asdict().items()
            },
            f"of_each_{unit}": (factor * plan.errors_of_models).tolist(),
        }
        for name, plan in (("robust_plan", made), ("nominal_plan", made.nominal))
    }


def _over_models_table(answer: Answer) -> str:
    """The same for people; empty where no models were drawn."""
    if answer.together is not None:
        unit, factor = "cm", 100.0
        parts: dict[str, Inversion | FootInversion] = {"foot": answer.together}
    else:
        unit, factor = "deg", math.degrees(1.0)
        parts = {
            _label(answer.desired, j): inversion
            for j, inversion in enumerate(answer.inversions.values())
        }
    rows, norm, drawn = [], "", 0
    for name, made in parts.items():
        if made.nominal is None:
            return ""
        norm, drawn = made.norm, len(made.errors_of_models) - 1
        for plan, kind in ((made, made.robust), (made.nominal, "nominal model")):
            errors = (f"{factor * error:.3f}" for error in plan.over_models)
            rows.append([f"{name}, for the {kind}", *errors])
    header = ["plan", *(f"{which} [{unit}]" for which in ErrorsOfModels._fields)]
    return (
        f"{norm} errors over the nominal model and {drawn} drawn from its intervals:\n"
        f"{text_table(header, rows)}"
    )


def _bounded_foot(answer: Answer) -> str:
    """What is proved about the foot, if anything is."""
    if answer.together is None or not answer.foot_bound:
        return ""
    weighted = "" if len(set(answer.together.weights)) == 1 else " as weighted"
    norm = {"rms": "rms", "max": "at most"}[answer.together.norm]
    return (
        f"\nno requests within the limits bring it below {100.0 * answer.foot_bound:.3f} cm {norm}"
        f"{weighted}: the plan is {percent(answer.together.gap)} above that"
    )


def _degrees_or_null(angle: float) -> float | None:
    return None if np.isnan(angle) else float(np.degrees(angle))


def _motion(motion: RequestMotion, unit: str) -> dict[str, float]:
    """How the requests of a joint move, for machines."""
    return {
        f"largest_step_{unit}": math.degrees(motion.largest_step),
        "reversals_per_s": motion.reversals_per_s,
        f"path_length_{unit}": math.degrees(motion.path_length),
        f"desired_path_length_{unit}": math.degrees(motion.desired_length),
        f"beyond_desired_{unit}": math.degrees(motion.beyond),
    }


def _motion_cells(name: str, motion: RequestMotion) -> list[str]:
    """The same for people."""
    step, length, desired, beyond = np.degrees(
        [motion.largest_step, motion.path_length, motion.desired_length, motion.beyond]
    )
    return [
        *(name, f"{step:.2f}", f"{motion.reversals_per_s:.1f}", f"{length:.1f}", f"{desired:.1f}"),
        f"{beyond:.2f}",
    ]


def _errors(errors: Array, unit: str) -> dict[str, float]:
    return {
        f"rms_{unit}": error_norm(errors, "rms"),
        f"max_{unit}": error_norm(errors, "max"),
    }
