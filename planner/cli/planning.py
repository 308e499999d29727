"""From settings to a task, its load and its plan, which is checked before it is handed over."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from planner.cli import settings
from planner.cli.console import BadSetting, FailedCheck, Key, Remark
from planner.cli.desired import (
    Desired,
    Limits,
    desired_of,
    find_leg,
    limits_of,
    load_leg,
    starts_of,
)
from planner.cli.models import model_words
from planner.files.robot import LegPlace
from planner.planning.arguments import checked_leg, has_intervals, limits_of_each
from planner.planning.inversion import planned
from planner.planning.plan import Method, Plan
from planner.planning.task import Task
from planner.trajectory import Array, error_norm, index_of_largest

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.model.joint import JointModel
    from planner.planning.inversion import LoadOfPose
    from planner.recording.recorded_path import RecordedPath


ROUNDING = 1e-9
"""Limits and bounds hold up to this [rad]; files carry 12 decimals of a degree."""

CORE_METHODS: Mapping[settings.Method, Method] = {
    "shift": "shift",
    "closed-form": "closed_form",
    "optimal": "optimal",
    "foot-optimal": "optimal",
}
"""Names of the methods in the core, where a foot is optimised too."""


@dataclass(frozen=True)
class Prepared:
    """A plan, ready to be computed: the settings, and all that their files hold.

    Limits of the requests and rest angles before the path are by joint [rad].
    """

    settings: settings.Run
    place: LegPlace | None
    desired: Desired
    limits: Limits
    starts: Mapping[str, float]
    load: Load | None = None
    folder: str = ""


def prepare(run: settings.Run, folder: str = "") -> Prepared:
    """Load the inputs that the settings name, and check that the method can plan for them."""
    prepared = load(run, folder)
    check_settings(run, prepared.desired)
    return prepared


def load(run: settings.Run, folder: str = "") -> Prepared:
    """Load the inputs that the settings name, for any method; see :func:`prepare`."""
    place = find_leg(run.leg, folder)
    desired = desired_of(run, load_leg(place), folder)
    if desired.loads is not None and run.plan.load is None:
        words = "the load in the path's columns is not used: ask for it with "
        unused = Remark(words, Key("plan.load", "column"))
        desired = replace(desired, remarks=(*desired.remarks, unused))
    starts = starts_of(run.start, desired.names, cyclic=desired.cyclic)
    limits, carried = limits_of(run.limits, desired), load_of(run.plan, desired)
    return Prepared(run, place, desired, limits, starts, carried, folder)


def check_settings(run: settings.Run, desired: Desired) -> None:
    """Refuse settings that do not go with the method or the path."""
    plan_settings, method = run.plan, Key("plan.method", run.plan.method)
    ignored = [f"plan.{name}" for name in plan_settings.without_effect(plan_settings.method)]
    if plan_settings.method in ("closed-form", "foot-optimal") and run.start.keys_set:
        ignored.append("start.deg")
    for name in ignored:
        raise BadSetting(Key(name), " has no effect with ", method)
    if plan_settings.method == "foot-optimal" and desired.foot is None:
        moved = {joint for leg in desired.legs.values() for joint in leg.joint_names}
        if moved != set(desired.names):
            raise BadSetting(
                method, " plans for a foot path: it needs columns x_m, y_m, z_m and a leg"
            )
    pairs = zip(desired.names, desired.models, strict=True)
    if plan_settings.robust and (without := [name for name, m in pairs if not has_intervals(m)]):
        raise BadSetting(
            Key("plan.robust", plan_settings.robust),
            f" draws models from intervals, and the model of {', '.join(without)} has none "
            f"({model_words(run.model)}); identify the joint, which writes them, or add to its "
            "model file what you know, such as v_max_interval = [5.2, 5.7] beside v_max",
        )
    degrees, centimetres = Key("tolerance.deg"), Key("tolerance.cm")
    of_foot = plan_settings.method == "foot-optimal" and desired.foot is not None
    if run.tolerance.deg is not None and of_foot:
        raise BadSetting(
            degrees, " is for joints, and ", method, " plans for the foot: use ", centimetres
        )
    if run.tolerance.cm is not None and desired.foot is None:
        raise BadSetting(centimetres, " is for a foot path: use ", degrees)


def plan_of(
    prepared: Prepared,
    progress: Callable[[str], None] = lambda _: None,
    *,
    bounded: bool = True,
) -> Plan:
    """Plan by the chosen method, and check the plan before it is handed over.

    The plan's task also has leg and foot, for a path of a leg's joints, and the limits of a closed
    form, which ignores them. The lower bound of a plan for the foot takes longer.
    """
    run, desired, limits = prepared.settings, prepared.desired, prepared.limits
    plan_settings = run.plan
    whole_robot = plan_settings.method == "foot-optimal" and desired.foot is None
    if plan_settings.method == "foot-optimal" and not whole_robot:
        progress("the foot")
    with desired.units_in_messages():
        if whole_robot:
            plan = _by_feet(prepared, progress)
        else:
            plan = planned(
                task_of(prepared),
                load=prepared.load,
                method=CORE_METHODS[plan_settings.method],
                solver=plan_settings.solver or "gauss-newton",
                lines={"segments": plan_settings.segments, "rule": plan_settings.rule or "paper"},
                progress=progress,
            )
    if plan.task.goal == "angles":
        lower, upper = limits_of_each(limits, desired.names)
        whole = desired.leg is not None and desired.leg.joint_names == desired.names
        leg, foot = (desired.leg, desired.foot) if whole else (None, None)
        plan = replace(plan, task=replace(plan.task, lower=lower, upper=upper, leg=leg, foot=foot))
    for each in plan.inversions:
        if each.error < each.lower_bound - ROUNDING:
            unit = desired.unit(each.column)
            error = math.degrees(each.error)
            bound = math.degrees(each.lower_bound)
            raise FailedCheck(
                f"{desired.names[each.column]}: an error of {error:.6g} {unit} is below its own "
                f"lower bound of {bound:.6g} {unit}; please report this with the path and the model"
            )
    chosen = run.limits.deg is not None or run.limits.joints
    beyond = beyond_limits(plan, desired)
    if beyond and (chosen or plan_settings.method != "closed-form"):  # which ignores limits
        raise beyond[0]
    if bounded and plan.task.goal == "foot":
        progress("the lower bound")
        _ = plan.foot_bound  # takes seconds, and is cached
    return plan


def _by_feet(prepared: Prepared, progress: Callable[[str], None]) -> Plan:
    """A plan for the joints of a robot, from one plan for the foot of each leg."""
    desired, load = prepared.desired, prepared.load
    requests = np.empty_like(desired.angles)
    for name, leg in desired.legs.items():
        progress(f"the foot {name}")
        columns = [desired.names.index(joint) for joint in leg.joint_names]
        angles = desired.angles[:, columns]
        part = replace(
            desired,
            names=leg.joint_names,
            angles=angles,
            models=tuple(desired.models[j] for j in columns),
            leg=leg,
            foot=leg.foot_positions(angles),
        )
        carried = None if load is None else np.asarray(load)[:, columns]
        plan = planned(task_of(replace(prepared, desired=part, load=carried)), method="optimal")
        requests[:, columns] = plan.requests
    return Plan(task=task_of(prepared), requests=requests)


def beyond_limits(plan: Plan, desired: Desired) -> list[FailedCheck]:
    """Failures of requests beyond the limits of their joints, one for each joint."""
    failures = []
    columns = zip(plan.requests.T, plan.task.lower, plan.task.upper, strict=True)
    for j, (requests, lower, upper) in enumerate(columns):
        excess = np.maximum(lower - requests, requests - upper)
        worst = index_of_largest(excess)
        if excess[worst] > ROUNDING:
            failures.append(
                FailedCheck(
                    f"{desired.names[j]}: request {worst} is {np.degrees(requests[worst]):.2f} "
                    f"{desired.unit(j)}, beyond the limits {np.degrees(lower):.2f} to "
                    f"{np.degrees(upper):.2f}; ",
                    Key("plan.method", "optimal"),
                    " keeps to them",
                )
            )
    return failures


def errors_document(errors: Array, unit: str, factor: float = 1.0) -> dict[str, float]:
    """Root mean square and largest of some errors, times a factor, for machines."""
    return {
        f"rms_{unit}": factor * error_norm(errors, "rms"),
        f"max_{unit}": factor * error_norm(errors, "max"),
    }


def off_by(subject: str, error: float, unit: str, norm: str, expected: float) -> str:
    """A missed tolerance in words."""
    return f"{subject} is off by {error:.4g} {unit} ({norm}), expected at most {expected:g}"


def misses(run: settings.Run, desired: Desired, plan: Plan) -> list[str]:
    """Messages about the tolerances that the plan misses, in its norm; empty if it keeps all."""
    norm, tolerance = plan.task.norm, run.tolerance
    messages = []
    if tolerance.deg is not None:
        for j, inversion in enumerate(plan.inversions):
            error, least = np.degrees([inversion.error, inversion.lower_bound])
            if error > tolerance.deg:
                bound = f"; the lower bound for any requests is {least:.4g}" if least else ""
                words = off_by(desired.names[j], error, desired.unit(j), norm, tolerance.deg)
                messages.append(words + ("" if plan.task.load_of_pose else bound))
    if tolerance.cm is not None:
        error = error_norm(100.0 * plan.distances, norm)
        if error > tolerance.cm:
            messages.append(off_by("the foot", error, "cm", norm, tolerance.cm))
    return messages


def search_options(
    plan: settings.Plan, period: float, *, units: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """The settings of the search, as arguments of :func:`planner.plan`, for a period [s].

    ``units``: by joint, how many of the settings' degrees are one of the joint's unit; by default
    all are angles [rad].
    """
    steps = [math.inf if plan.max_step_deg is None else plan.max_step_deg]
    if plan.max_request_speed_deg_s is not None:
        steps.append(plan.max_request_speed_deg_s * period)
    degrees = min(steps)
    by_joint = units and {name: degrees / each for name, each in units.items()}
    return {
        "norm": plan.norm or "rms",
        "max_step": math.radians(degrees) if by_joint is None else by_joint,
        "smoothness": plan.smoothness,
        "robust": plan.robust,
    }


def task_of(prepared: Prepared) -> Task:
    """The task of the settings; without the torques of a load that depends on the pose."""
    plan_settings, desired, limits = prepared.settings.plan, prepared.desired, prepared.limits
    options = search_options(plan_settings, desired.period)
    options |= {
        "cyclic": desired.cyclic,
        "load": None if callable(prepared.load) else prepared.load,
    }
    if plan_settings.method == "foot-optimal" and desired.foot is not None:
        lower, upper = zip(*(limits[name] for name in desired.names), strict=True)
        options |= {"weights": plan_settings.weights or (1.0, 1.0, 1.0), "limits": (lower, upper)}
        return Task.of(desired.models, desired.foot, leg=checked_leg(desired.leg), **options)
    if plan_settings.method != "closed-form":  # which ignores limits
        options |= {"limits": limits, "start": prepared.starts}
    return Task.of(desired.models, desired.angles, names=desired.names, **options)


Load = Array | Callable[[Array], Array]
"""Torques [N m], shape (n, k), or a function of poses [rad], shape (n, k), that returns them."""


def load_of(plan: settings.Plan, desired: Desired) -> Load | None:
    """The torques on the joints of a path; None if the settings have no load.

    Of ``urdf-dynamics`` inertia counts along the desired path and gravity in the predicted pose:
    differences of a prediction would not settle.
    """
    if plan.load is None:
        return None
    key = Key("plan.load", plan.load)
    _check_felt(key, desired.models)
    if plan.load == "column":
        if desired.loads is None:
            raise BadSetting(key, ": the path has no columns <joint>_load_Nm")
        return desired.loads
    leg = desired.leg
    if leg is None or set(leg.joint_names) != set(desired.names):
        raise BadSetting(
            key, ": needs a path of all joints of a leg; name it with ", Key("leg.name")
        )
    poses = desired.angles[:, [desired.names.index(name) for name in leg.joint_names]]
    return _load_of_masses(
        plan.load, leg, desired.names, poses, period=desired.period, cyclic=desired.cyclic
    )


def with_load(plan: settings.Plan, path: RecordedPath, leg: Leg | None) -> RecordedPath:
    """A recording with the load of the settings, or by default the load in its logs.

    The leg's joints that are not planned are where they were recorded.
    """
    if plan.load is None:
        return path
    key, planned = Key("plan.load", plan.load), path.planned
    _check_felt(key, [each.model for each in planned if each.model])
    if plan.load == "column":
        if not any(each.load is not None for each in planned):
            raise BadSetting(key, ": the recording has no torque of a joint that feels it")
        return path
    if leg is None:
        raise BadSetting(key, ": needs the leg or arm; name it with ", Key("leg.urdf"))
    by_name = {each.name: each for each in path.joints}
    for name in leg.joint_names:
        if name not in by_name:
            joints = ", ".join(by_name)
            raise BadSetting(
                key,
                f": the recording has no joint '{name}', which the leg has; joints: {joints}; "
                "name it with ",
                Key("replay.urdf_joints"),
            )
        if by_name[name].unit != "rad":
            raise BadSetting(
                key,
                f": {name} is in shares of its range, and a pose needs angles; choose its "
                "unit with --unit",
            )
    form, names = plan.load, [each.name for each in planned]

    def load_at(moments: Array) -> LoadOfPose:
        poses = [
            each.at(moments, each.angles if each.model is None else each.followed)
            for each in (by_name[name] for name in leg.joint_names)
        ]
        return _load_of_masses(
            form, leg, names, np.column_stack(poses), period=path.period, cyclic=False
        )

    load_at(path.moments(1.0))  # refuses a URDF without masses before anything is planned
    return replace(path, load_at=load_at)


def _check_felt(key: Key, models: Sequence[JointModel]) -> None:
    if not any(model.feels_load for model in models):
        raise BadSetting(
            key,
            " has no effect: compliance and speed_per_torque of the models are 0; identify them "
            "from logs with a load, or leave the load out",
        )


def _load_of_masses(
    form: Literal["urdf", "urdf-dynamics"],
    leg: Leg,
    names: Sequence[str],
    poses: Array,
    *,
    period: float,
    cyclic: bool,
) -> Callable[[Array], Array]:
    """Torques on joints by their angles; the leg's other joints follow the desired poses."""
    inside = [j for j, name in enumerate(names) if name in leg.joint_names]
    places = [leg.joint_names.index(names[j]) for j in inside]
    gravity = leg.load_torques(poses)
    inertia = np.zeros_like(gravity)
    if form == "urdf-dynamics":
        inertia = leg.load_torques(poses, dynamics=True, period=period, cyclic=cyclic) - gravity

    def torques(angles: Array) -> Array:
        pose, loads = poses.copy(), np.zeros(angles.shape)
        pose[:, places] = angles[:, inside]
        loads[:, inside] = (leg.load_torques(pose) + inertia)[:, places]
        return loads

    return torques


def doubted(run: settings.Run, desired: Desired, plan: Plan) -> list[Remark]:
    """Remarks on errors that keep the tolerance by the models, but are larger on the robot."""
    if plan.task.norm != "rms":  # what is expected is a root mean square
        return []
    degrees, centimetres = run.tolerance.deg, run.tolerance.cm
    errors: list[tuple[str, float, float, str, float]] = []
    if degrees is not None:
        errors = [
            (name, *np.degrees([each.error, each.expected.error]), desired.unit(j), degrees)
            for j, (name, each) in enumerate(zip(desired.names, plan.inversions, strict=True))
        ]
    if centimetres is not None and plan.expected_foot is not None:
        error = error_norm(100.0 * plan.distances, "rms")
        errors.append(("the foot", error, 100.0 * plan.expected_foot, "cm", centimetres))
    return [
        Remark(
            f"{name} keeps {most:g} {unit} (rms) by the model; on the robot {expected:.3g} {unit} "
            "is to be expected"
        )
        for name, error, expected, unit, most in errors
        if error <= most < expected
    ]
