"""From what the joints or the foot should do to requests, checked before they are handed over."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.evaluation.metrics import RequestMotion, foot_distances, request_motion
from planner.evaluation.plan_outcome import expected_foot
from planner.model.drawn_models import has_intervals
from planner.model.evidence import Expectation, expectation
from planner.model.load import load_columns
from planner.planning.error_norm import error_norm
from planner.planning.foot.bound import MOST_SAMPLES_BOUNDED
from planner.planning.inversion import planned
from planner.planning.result import FootInversion, Inversion
from planner.planning.task import Task, checked_leg
from planner.run import settings
from planner.run.desired import Desired, Limits
from planner.run.faults import BadSetting, FailedCheck, Key
from planner.run.load import Load
from planner.run.models import model_words
from planner.trajectory import index_of_largest

if TYPE_CHECKING:
    from planner.trajectory import Array

ROUNDING = 1e-9
"""Limits and bounds hold up to this [rad]; files carry 12 decimals of a degree."""

NO_BOUND = "a load that depends on the pose: other requests would meet another load"
"""Why there is no lower bound where there is none."""

IGNORED = {
    "closed-form": (
        *("norm", "solver", "weights", "start"),
        *("max_step_deg", "max_request_speed_deg_s", "smoothness", "robust"),
    ),
    "optimal": ("segments", "rule", "weights"),
    "foot-optimal": ("segments", "rule", "solver", "start"),
}
"""Settings that have no effect on a method, and that are therefore refused."""


@dataclass(frozen=True)
class Answer:
    """Requests for all joints.

    Attributes:
        desired: What the joints or the foot should do.
        requests: What to send to the joints [rad], shape (n, k).
        predicted: What the joints then do [rad], shape (n, k).
        inversions: The plan of every joint, where they were planned one by one.
        together: The plan for the foot, where they were planned all at once.
        remarks: What the user should know about the requests.
    """

    desired: Desired
    requests: Array
    predicted: Array
    inversions: Mapping[str, Inversion]
    together: FootInversion | None = None
    remarks: tuple[FailedCheck, ...] = ()

    @cached_property
    def loads(self) -> Array | None:
        """Torques on the joints for which the requests are [N m], shape (n, k); None for none."""
        together = self.together
        each = together.loads if together else [plan.load for plan in self.inversions.values()]
        return load_columns(each, len(self.requests))

    @cached_property
    def expected(self) -> tuple[Expectation, ...]:
        """What to expect of each joint on the robot."""
        desired, loads = self.desired, self.loads
        return tuple(
            expectation(
                model.evidence,
                desired.angles[:, j],
                self.predicted[:, j],
                period=desired.period,
                cyclic=desired.cyclic,
                load=None if loads is None else loads[:, j],
            )
            for j, model in enumerate(desired.models)
        )

    @property
    def bound_withdrawn(self) -> str | None:
        """Why there is no lower bound on the error of any requests; None where there is one."""
        made = [self.together] if self.together else [*self.inversions.values()]
        return NO_BOUND if any(each.load_of_pose for each in made) else None

    @cached_property
    def motions(self) -> Mapping[str, RequestMotion]:
        """How the requests of each joint move."""
        desired = self.desired
        columns = zip(desired.names, self.requests.T, desired.angles.T, strict=True)
        return {
            name: request_motion(sent, angles, period=desired.period, cyclic=desired.cyclic)
            for name, sent, angles in columns
        }

    @property
    def foot_bound(self) -> float | None:
        """Lower bound on the foot's error [m]; None where it would take minutes."""
        if self.together is None or len(self.requests) > MOST_SAMPLES_BOUNDED:
            return None
        return self.together.lower_bound

    @cached_property
    def foot_positions(self) -> Array:
        """Positions of the foot at the predicted angles [m], shape (n, 3)."""
        assert self.desired.leg is not None, "a foot belongs to a leg"
        return self.desired.leg.foot_positions(self.predicted)

    @cached_property
    def foot_distances(self) -> Array:
        """Distances of the foot from its desired positions [m], shape (n,)."""
        assert self.desired.foot is not None, "only a foot path has desired positions"
        return foot_distances(self.foot_positions, self.desired.foot)

    @cached_property
    def expected_foot(self) -> float | None:
        """Root mean square distance of the foot to expect on the robot [m]; None where unknown."""
        desired = self.desired
        if desired.leg is None or desired.foot is None:
            return None
        return expected_foot(
            desired.leg, desired.foot, desired.angles, self.predicted, self.expected
        )


def check_settings(run: settings.Run, desired: Desired) -> None:
    """Refuse settings that do not go with the method or the path.

    Raises:
        BadSetting: The message says which.
    """
    given, method = run.plan, Key("plan.method", run.plan.method)
    for name in IGNORED[given.method]:
        start = run.start.deg is not None or run.start.joints
        if start if name == "start" else getattr(given, name) is not None:
            key = Key("start.deg" if name == "start" else f"plan.{name}")
            raise BadSetting(key, " has no effect with ", method)
    if given.method == "foot-optimal" and desired.foot is None:
        raise BadSetting(method, " plans for a foot path: it needs columns x_m, y_m, z_m and a leg")
    _check_intervals(run, desired)
    degrees, centimetres = Key("tolerance.deg"), Key("tolerance.cm")
    if run.tolerance.deg is not None and given.method == "foot-optimal":
        raise BadSetting(
            degrees, " is for joints, and ", method, " plans for the foot: use ", centimetres
        )
    if run.tolerance.cm is not None and desired.foot is None:
        raise BadSetting(centimetres, " is for a foot path: use ", degrees)


def _check_intervals(run: settings.Run, desired: Desired) -> None:
    """Refuse to plan for models that no interval tells.

    Raises:
        BadSetting: A joint's model has no intervals.
    """
    if run.plan.robust is None:
        return
    pairs = zip(desired.names, desired.models, strict=True)
    if without := [name for name, model in pairs if not has_intervals(model)]:
        raise BadSetting(
            Key("plan.robust", run.plan.robust),
            f" draws models from intervals, and the model of {', '.join(without)} has none "
            f"({model_words(run.model)}); identify the joint, which writes them, or add to its "
            "model file what you know, such as v_max_interval = [5.2, 5.7] beside v_max",
        )


def answer_of(
    run: settings.Run,
    desired: Desired,
    limits: Limits,
    starts: Mapping[str, float],
    *,
    load: Load | None = None,
    progress: Callable[[str], None] = lambda _: None,
    bounded: bool = True,
) -> Answer:
    """Plan by the chosen method, and check the answer before it is handed over.

    Args:
        run: The settings.
        desired: What the joints or the foot should do.
        limits: Limits of the requests [rad].
        starts: Where joints rest before [rad].
        load: What the joints carry.
        progress: Called with the name of each part before it is planned.
        bounded: Whether to compute the lower bound of a plan for the foot, too, which takes longer.

    Raises:
        FailedCheck: The answer failed a check.
        PlannerError: There is none.
    """
    together = run.plan.method == "foot-optimal"
    if together:
        progress("the foot")
    lines = {"segments": run.plan.segments, "rule": run.plan.rule or "paper"}
    with desired.units_in_messages():
        made = planned(
            task_of(run.plan, desired, limits, starts, load=load),
            load=load,
            method="closed_form" if run.plan.method == "closed-form" else "optimal",
            solver=run.plan.solver or "gauss-newton",
            lines=lines,
            progress=progress,
        )
    if together:
        answer = Answer(desired, made.requests, made.predicted, {}, FootInversion(made))
    else:
        inversions = dict(zip(made.names, made.inversions, strict=True))
        answer = Answer(desired, made.requests, made.predicted, inversions)
        for name, inversion in inversions.items():
            _check_bound(name, inversion, desired.unit(desired.names.index(name)))
    beyond = [
        fault
        for j, name in enumerate(desired.names)
        if name in limits
        and (fault := _beyond_limits(name, answer.requests[:, j], limits[name], desired.unit(j)))
    ]
    chosen = run.limits.deg is not None or run.limits.joints
    if beyond and (chosen or run.plan.method != "closed-form"):  # which knows no limits
        raise beyond[0]
    if answer.together is not None and bounded:
        progress("the lower bound")
        _ = answer.foot_bound  # takes seconds, and is kept
    return replace(answer, remarks=tuple(beyond))


def misses(run: settings.Run, answer: Answer) -> list[str]:
    """Which tolerances the plan misses, in its norm, and by how much; none where it keeps all."""
    norm, tolerance = run.plan.norm or "rms", run.tolerance
    found = []
    if tolerance.deg is not None:
        for j, (joint, inversion) in enumerate(answer.inversions.items()):
            error, least = np.degrees([inversion.error, inversion.lower_bound])
            if error > tolerance.deg:
                found.append(
                    f"{joint} is off by {error:.4g} {answer.desired.unit(j)} ({norm}), expected "
                    f"at most {tolerance.deg:g}; the lower bound for any requests is {least:.4g}"
                )
    if tolerance.cm is not None:
        error = error_norm(100.0 * answer.foot_distances, norm)
        if error > tolerance.cm:
            found.append(
                f"the foot is off by {error:.4g} cm ({norm}), expected at most {tolerance.cm:g}"
            )
    return found


def max_step_of(given: settings.Plan, period: float) -> float | None:
    """The largest change from one request to the next [rad]; None where there is no limit."""
    steps = []
    if given.max_step_deg is not None:
        steps.append(math.radians(given.max_step_deg))
    if given.max_request_speed_deg_s is not None:
        steps.append(math.radians(given.max_request_speed_deg_s) * period)
    return min(steps, default=None)


def task_of(
    given: settings.Plan,
    desired: Desired,
    limits: Limits,
    starts: Mapping[str, float],
    *,
    load: Load | None = None,
) -> Task:
    """What the settings ask of a plan; the torques of a load of the pose are not in it.

    Args:
        given: Method and options.
        desired: What the joints or the foot should do.
        limits: Limits of the requests [rad].
        starts: Where joints rest before [rad].
        load: What the joints carry.

    Raises:
        PlannerError: They do not fit together.
    """
    options: dict[str, Any] = {
        "cyclic": desired.cyclic,
        "norm": given.norm or "rms",
        "max_step": max_step_of(given, desired.period),
        "smoothness": given.smoothness,
        "robust": given.robust,
        "load": None if callable(load) else load,
    }
    if given.method == "foot-optimal":
        assert desired.foot is not None, "this method plans for a foot path"
        lower, upper = zip(*(limits[name] for name in desired.names), strict=True)
        options |= {"weights": given.weights or (1.0, 1.0, 1.0), "limits": (lower, upper)}
        return Task.of(desired.models, desired.foot, leg=checked_leg(desired.leg), **options)
    if given.method == "optimal":  # the closed form knows no limits
        options |= {"limits": limits, "start": starts}
    return Task.of(desired.models, desired.angles, names=desired.names, **options)


def _check_bound(joint: str, inversion: Inversion, unit: str) -> None:
    """Make sure that the error is not below the lower bound on the error of any requests."""
    error = inversion.error
    if error < inversion.lower_bound - ROUNDING:
        raise FailedCheck(
            f"{joint}: an error of {np.degrees(error):.6g} {unit} is below its own lower bound of "
            f"{np.degrees(inversion.lower_bound):.6g} {unit}; please report this with the path and "
            "the model"
        )


def _beyond_limits(
    joint: str, requests: Array, limits: tuple[float, float], unit: str
) -> FailedCheck | None:
    """The message about requests [rad] beyond the limits [rad] of their joint."""
    lower, upper = limits
    excess = np.maximum(lower - requests, requests - upper)
    worst = index_of_largest(excess)
    if excess[worst] <= ROUNDING:
        return None
    return FailedCheck(
        f"{joint}: request {worst} is {np.degrees(requests[worst]):.2f} {unit}, beyond the "
        f"limits {np.degrees(lower):.2f} to {np.degrees(upper):.2f}; ",
        Key("plan.method", "optimal"),
        " keeps to them",
    )
