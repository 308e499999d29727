"""From the desired motion to its plan, which is checked before it is handed over, and answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.arrays import excess, index_of_largest
from planner.cli import settings
from planner.cli.console import BadSetting, SettingsError, marked
from planner.cli.declared import flat
from planner.cli.desired import Desired, desired_of, model_words, own_robot, units_in_messages
from planner.files.text import toml_value
from planner.planning.candidate_models import has_intervals
from planner.planning.inversion import planned
from planner.planning.plan import Plan
from planner.planning.task import Task, checked_leg
from planner.report.plan_results import PlanAnswer, against_tolerances

if TYPE_CHECKING:
    from planner.report.page import Page

# SciPy takes all names of NumPy, and with them would import f2py, a fifteenth of the time of a plan
vars(np).setdefault("f2py", None)

ROUNDING = 1e-9  # limits and bounds hold up to this [rad]; files carry 12 decimals of a degree


def prepare(run: settings.Run) -> Desired:
    """Load the inputs that the settings name; refuse settings that the method cannot plan for."""
    desired = desired_of(run)
    plan_settings, method = run.plan, marked("plan.method", run.plan.method)
    plan_settings.check_effect("plan", "method")
    if plan_settings.method in ("closed-form", "foot-optimal") and run.start.keys_set:
        raise BadSetting(
            f"{marked(('start', min(run.start.keys_set)))} has no effect with {method}"
        )
    if plan_settings.method == "foot-optimal" and desired.foot is None:
        moved = {joint for leg in desired.legs.values() for joint in leg.joint_names}
        if moved != set(desired.names):
            words = "plans for a foot path: it needs columns x_m, y_m, z_m and a leg"
            raise BadSetting(f"{method} {words}")
    pairs = zip(desired.names, desired.models, strict=True)
    if plan_settings.robust and (without := [name for name, m in pairs if not has_intervals(m)]):
        raise BadSetting(
            f"{marked('plan.robust', plan_settings.robust)} draws models from intervals, and the "
            f"model of {', '.join(without)} has none ({model_words(run.model)}); identify the "
            "joint, which writes them, or add to its model file what you know, such as "
            "v_max_interval = [5.2, 5.7] beside v_max"
        )
    of_foot = plan_settings.method == "foot-optimal" and desired.foot is not None
    if run.tolerance.deg is not None and of_foot:
        words = f"is for joints, and {method} plans for the foot: use ‹tolerance.cm›"
        raise BadSetting(f"‹tolerance.deg› {words}")
    if run.tolerance.cm is not None and desired.foot is None:
        raise BadSetting("‹tolerance.cm› is for a foot path: use ‹tolerance.deg›")
    return desired


def plan_of(
    desired: Desired, progress: Callable[[str], None] = lambda _: None, *, bounded: bool = True
) -> Plan:
    """Plan by the chosen method, and check the plan before it is handed over.

    The lower bound of a plan for the foot takes longer, and is left out if not ``bounded``.
    """
    run, chosen = desired.settings, desired.settings.plan
    by_feet = chosen.method == "foot-optimal" and desired.foot is None  # of a whole robot
    method: Any = chosen.method.removeprefix("foot-").replace("-", "_")
    if chosen.method == "foot-optimal" and not by_feet:
        progress("the foot")
    with units_in_messages(desired.shown_units):
        if by_feet:
            requests = np.empty_like(desired.angles)
            for name, leg in desired.legs.items():
                progress(f"the foot {name}")
                part = desired.of_leg(leg)
                part = replace(part, foot=leg.foot_positions(part.angles))
                columns = [desired.names.index(joint) for joint in leg.joint_names]
                requests[:, columns] = planned(task_of(part), method="optimal").requests
            plan = Plan(task=task_of(desired), requests=requests)
        else:
            plan = planned(
                task_of(desired),
                load=desired.load,
                method=method,
                solver=chosen.solver,
                lines={"segments": chosen.segments, "rule": chosen.rule},
                progress=progress,
            )
    for each in plan.inversions:
        if each.error < each.lower_bound - ROUNDING:
            unit = desired.shown_units[desired.names[each.column]]
            error, bound = np.degrees([each.error, each.lower_bound])
            raise SettingsError(
                f"{desired.names[each.column]}: an error of {error:.6g} {unit} is below its own "
                f"lower bound of {bound:.6g} {unit}; please report this with the path and the model"
            )
    has_limits = run.limits.deg is not None or run.limits.joints
    beyond = beyond_limits(desired, plan)
    if beyond and (has_limits or chosen.method != "closed-form"):  # which ignores limits
        raise SettingsError(beyond[0])
    if bounded and plan.task.goal == "foot":
        progress("the lower bound")
        _ = plan.foot_bound  # takes seconds, and is cached
    return plan


def beyond_limits(desired: Desired, plan: Plan) -> list[str]:
    """The joints whose requests are beyond their limits, a message for each."""
    messages = []
    columns = zip(plan.requests.T, plan.task.lower, plan.task.upper, strict=True)
    for (name, unit), (requests, lower, upper) in zip(
        desired.shown_units.items(), columns, strict=True
    ):
        beyond = excess(requests, lower, upper)
        worst = index_of_largest(beyond)
        if beyond[worst] > ROUNDING:
            request, low, high = np.degrees([requests[worst], lower, upper])
            messages.append(
                f"{name}: request {worst} is {request:.2f} {unit}, beyond "
                f'the limits {low:.2f} to {high:.2f}; ‹plan.method = "optimal"› keeps to them'
            )
    return messages


def search_options(
    plan: settings.Plan, period: float, units: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """The arguments of :func:`planner.plan` that set its search, for a period [s].

    ``units``: by joint, how many of the settings' degrees are one of the joint's unit; by default
    all are angles [rad].
    """
    rate = plan.max_request_speed_deg_s
    step = min(plan.max_step_deg or math.inf, math.inf if rate is None else rate * period)
    by_joint = {name: step / each for name, each in (units or {}).items()}
    set_keys = {name: each for name in settings.SEARCH if (each := getattr(plan, name)) is not None}
    return {"max_step": by_joint or math.radians(step), **set_keys}


def task_of(desired: Desired) -> Task:
    """The task of the settings; without the torques of a load that depends on the pose.

    A path of a leg's joints has leg and foot, too. The limits of a closed form, which ignores them,
    are not checked.
    """
    chosen, leg, limits = desired.settings.plan, desired.leg, desired.limits
    options = search_options(chosen, desired.period) | {"cyclic": desired.cyclic}
    options["load"] = None if callable(desired.load) else desired.load
    if chosen.method == "foot-optimal" and desired.foot is not None:
        leg, options["weights"] = checked_leg(leg), chosen.weights
        return Task.of(desired.models, desired.foot, leg=leg, limits=limits, **options)
    options["limits"] = None if chosen.method == "closed-form" else limits
    options |= {"start": desired.starts, "names": desired.names}
    task = Task.of(desired.models, desired.angles, **options)
    if leg is not None and leg.joint_names == desired.names:
        task = replace(task, leg=leg, foot=desired.foot)
    lower, upper = limits or (task.lower, task.upper)
    return replace(task, lower=lower, upper=upper)


# The answer: JSON for machines, text and pages for people.


def answer_of(desired: Desired, plan: Plan) -> tuple[PlanAnswer, list[str]]:
    """The plan with how the settings asked for it, and remarks on it."""
    tolerance, units = desired.settings.tolerance, desired.shown_units
    missed, doubted = against_tolerances(
        plan, [*units.values()], degrees=tolerance.deg, centimetres=tolerance.cm
    )
    answer = PlanAnswer(
        plan=plan,
        method=desired.settings.plan.method,
        model=model_words(desired.settings.model),
        units=units,
        legs=desired.legs,
        of_foot=desired.foot is not None,
        unreachable=desired.unreachable,
        missed=None if tolerance.deg is None and tolerance.cm is None else missed,
    )
    return answer, [*beyond_limits(desired, plan), *doubted]


def page_of(desired: Desired, answer: PlanAnswer) -> Page:
    """The page about a plan."""
    from planner.report.plan_page import plan_page

    notes, given = notes_of(desired), desired.foot_given
    return plan_page(answer, title=desired.title, foot_given=given, notes=notes)


def notes_of(desired: Desired) -> list[str]:
    """Remarks on the models, for a page."""
    if desired.settings.model.file != settings.FROM_URDF:
        return []
    return [
        "The URDF has no more than the top speeds of the servos; the rest of their models is "
        "assumed. Identify the joints before these requests are sent."
    ]


def inputs_of(desired: Desired) -> list[tuple[str, str]]:
    """The files that the settings name, not standard input or a shipped model: role and path."""
    run = desired.settings
    named = [("path", run.path.file), ("model", run.model.file), ("robot", own_robot(run))]
    places = [(role, run.place(name)) for role, name in named if name]
    return [(role, place) for role, place in places if Path(place).is_file()]


def origins_of(run: settings.Run) -> list[tuple[str, str]]:
    """Inputs and settings of the plans that were set, and the model: pairs of name and value."""
    return [
        (name.removesuffix(".file"), toml_value(value).strip('"'))
        for name, (value, is_set) in flat(run).items()
        if (is_set and not name.startswith(("out", "export"))) or name == "model.file"
    ]
