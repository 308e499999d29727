"""The answer about a plan: its numbers, computed once, for machines and people and for its page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.model.evidence import (
    ENCODER_STEP,
    OPEN_TOP_SPEED,
    Expectation,
    expectation,
    untested_words,
)
from planner.model.joint import JointModel
from planner.planning.plan import (
    DEGREE,
    ErrorsOfModels,
    FootInversion,
    Inversion,
    Plan,
    RequestMotion,
)
from planner.planning.time_shift import (
    CLEARLY,
    has_refused,
    refining_recommended,
    shift_recommended,
    shifted,
)
from planner.report.wording import Column, Row, Table, by_columns, number, percent, thousandths
from planner.trajectory import Array, Distance, error_norm, rms, size

if TYPE_CHECKING:
    from kinematics import Leg


AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""


class JointNumbers(NamedTuple):
    """Numbers of one joint of a plan, angles in its unit: degrees, or percent of its range."""

    name: str
    unit: str  # "deg" or "percent"
    label: str  # the name, with the unit where that is not degrees
    planned: Distance  # error by the plan
    direct: Distance  # error when the desired angles are requested as they are
    early: float  # root mean square error under the best time shift
    lead: float  # of that shift [s]
    expected: Expectation  # error to expect on the robot [rad]
    expected_early: float  # under the shift; NaN where that is unknown
    bound: float  # lower bound on the error of any requests; NaN where there is none
    gap: float  # relative distance of the error from it
    speed: float  # of the path where that is largest for the joint [unit/s]
    top: float  # the joint's top speed there [unit/s]
    load: float  # that speed over the top speed [-]
    share: float  # of the path beyond the top speed [-]
    at_limit: int  # requests at a limit or beyond it
    beyond: float  # how far requests go beyond the limits


class FootNumbers(NamedTuple):
    """Errors of a foot [cm]: by the plan, without one, and under the best time shift."""

    planned: Distance
    direct: Distance
    early: Distance
    expected: float | None  # to expect on the robot, rms; None where it is unknown
    expected_early: float | None  # under the shift


def foot_numbers(feet: Sequence[Plan]) -> FootNumbers:
    """The numbers of a foot, or of several together."""
    shifts = [shifted(foot.task) for foot in feet]
    each = (feet, [foot.direct for foot in feet], shifts)
    planned, direct, early = (
        size(np.concatenate([plan.distances for plan in plans]), 100.0) for plans in each
    )
    known = [plans[0].expected_foot if len(feet) == 1 else None for plans in (feet, shifts)]
    expected, expected_early = (None if error is None else 100.0 * error for error in known)
    return FootNumbers(planned, direct, early, expected, expected_early)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanAnswer:
    """A plan and how it was asked for: all that JSON, text and page say about it."""

    plan: Plan
    method: str  # as the user names it
    model: str = ""  # where the models come from, in words
    units: Sequence[str] = ()  # of each joint, "deg" or "percent"; () if all are degrees
    # of a whole robot whose joints are all planned, by name
    legs: Mapping[str, Leg] = field(default_factory=dict)
    of_foot: bool = False  # whether the path is that of a foot
    unreachable: int = 0  # samples out of the leg's reach
    missed: Sequence[str] | None = None  # tolerances, in words; None where there are none to keep

    @cached_property
    def shift(self) -> Plan:
        """The best time shift for the same task."""
        return shifted(self.plan.task)

    @cached_property
    def joints(self) -> list[JointNumbers]:
        """The numbers of every joint."""
        plan, shift, task = self.plan, self.shift, self.plan.task
        excess = np.maximum(task.lower - plan.requests, plan.requests - task.upper)
        most, numbers = excess.max(axis=0), list[JointNumbers]()
        bounded = task.goal == "angles" and self.method != "foot-optimal"
        for j, (name, model) in enumerate(zip(plan.names, plan.models, strict=True)):
            has_bound = bounded and not (task.load_of_pose or model.exceeds_v_max)
            speed, top = np.degrees(plan.speeds[j].highest).tolist()
            unit = self.units[j] if self.units else "deg"
            numbers.append(
                JointNumbers(
                    name=name,
                    unit=unit,
                    label=name if unit == "deg" else f"{name} [% of its range]",
                    planned=size(np.ascontiguousarray(plan.errors[:, j]), DEGREE),
                    direct=size(np.ascontiguousarray(plan.direct.errors[:, j]), DEGREE),
                    early=math.degrees(rms(shift.errors[:, j])),
                    lead=shift.leads[j],
                    expected=plan.expected[j],
                    expected_early=math.degrees(shift.expected[j].error),
                    bound=math.degrees(plan.lower_bounds[j]) if has_bound else math.nan,
                    gap=float(plan.gaps[j]) if has_bound else math.nan,
                    speed=speed,
                    top=top,
                    load=speed / top,
                    share=float(plan.too_fast[j]),
                    at_limit=int(np.sum(excess[:, j] >= -AT_LIMIT)),
                    beyond=math.degrees(most[j]) if most[j] > AT_LIMIT else 0.0,
                )
            )
        return numbers

    @cached_property
    def parts(self) -> dict[str, Plan]:
        """The plans of the legs, by name."""
        return {name: self.plan.of_leg(leg) for name, leg in self.legs.items()}

    @cached_property
    def feet(self) -> dict[str, FootNumbers]:
        """The numbers of every foot of the legs, by name."""
        return {name: foot_numbers([part]) for name, part in self.parts.items()}

    @cached_property
    def foot(self) -> FootNumbers | None:
        """The numbers of the foot, or of all feet together; None where there is none."""
        feet = list(self.parts.values()) or ([self.plan] if self.plan.task.leg else [])
        return foot_numbers(feet) if feet else None

    @cached_property
    def recommended(self) -> str:
        """Why the best time shift is recommended instead of the plan; "" where it is not."""
        return "" if self.plan.method == "shift" else shift_recommended(self.plan, self.shift)

    @cached_property
    def refining(self) -> str:
        """Why the requests are better refined by a measured cycle; "" where they need not be."""
        return "" if self.plan.method == "shift" else refining_recommended(self.plan, self.shift)

    @property
    def advice(self) -> list[str]:
        """What to know and to do before the requests are sent to the robot."""
        refine = "play the requests and refine them (request-planner refine)"
        lines = [
            self.recommended and f"recommended: --method shift, as {self.recommended}",
            self.refining and f"recommended: {refine}: {self.refining}",
        ]
        untested = untested_words(self.plan.names, self.plan.expected)
        return list(filter(None, [untested, *lines, start_words(self.plan)]))

    @property
    def fast(self) -> list[JointNumbers]:
        """The joints that cannot follow, the worst first; less leaves no error worth a remark."""
        fast = (each for each in self.joints if each.share >= 0.005 or each.load > 1.01)
        return sorted(fast, key=lambda each: -each.load)

    @property
    def open_top_speeds(self) -> list[str]:
        """The joints whose top speed their logs leave open: bounds are of their models only."""
        pairs = zip(self.plan.names, self.plan.models, strict=True)
        return [name for name, m in pairs if m.evidence and m.evidence.leaves_top_speed_open]

    # The tables.

    @property
    def bounds(self) -> list[tuple[str, list[str]]]:
        """Columns of the lower bounds, of what error where that is not the rms error, and gaps."""
        title = "lower bound (max)" if self.plan.task.norm == "max" else "lower bound"
        gaps = [percent(each.gap) for each in self.joints]
        return [(title, [number(each.bound, 3) for each in self.joints]), ("gap", gaps)]

    @property
    def on_robot(self) -> list[str]:
        """Error to expect of each joint on the robot, rms, its range in a note; [] if unknown."""
        cells = []
        for each in self.plan.expected:
            error, *ends = np.degrees([each.error, each.low, each.high])
            low, high = (f"{end:.3g}" for end in ends)
            cells.append(number(error, 3) + ("" if low == high else f"\n{low} to {high}"))
        return cells if any(math.isfinite(each.error) for each in self.plan.expected) else []

    @property
    def over_models(self) -> Table | None:
        """Errors of a robust plan over the models that joints may have, and of the nominal plan."""
        unit, factor, labels = "deg", DEGREE, [each.label for each in self.joints]
        results: Sequence[Inversion | FootInversion] = self.plan.inversions
        if self.plan.of_foot is not None:
            unit, factor, labels, results = "cm", 100.0, ["foot"], [self.plan.of_foot]
        rows = []
        for label, robust in zip(labels, results, strict=True):
            if robust.nominal is None:
                return None
            kinds = {self.plan.task.robust: robust, "nominal model": robust.nominal}
            for kind, result in kinds.items():
                errors = [f"{factor * error:.3f}" for error in result.over_models]
                rows.append(Row(f"{label}, for the {kind}", errors))
        columns = (f"{which} [{unit}]" for which in ErrorsOfModels._fields)
        return Table("plan", columns, rows, "Errors over the models")

    @property
    def feet_table(self) -> Table:
        """How far the foot of each leg of a robot is from its path."""
        feet, norms = self.feet.values(), ("rms", "at most")
        robot = [f"{each.expected:.3f}" for each in feet if each.expected is not None]
        columns = [
            (Column("plan [cm]", norms), [thousandths(each.planned) for each in feet]),
            (Column("without a plan [cm]", norms), [thousandths(each.direct) for each in feet]),
            (Column("best shift [cm]", norms), [thousandths(each.early) for each in feet]),
            len(robot) == len(feet) and ("on the robot, rms [cm]", robot),
        ]
        return by_columns("foot", self.feet, columns, label="Feet")

    # For machines, and for people on a terminal.

    def document(self) -> dict[str, Any]:
        """The plan for machines; fields that a plan for the foot does not have are null."""
        plan, task = self.plan, self.plan.task
        step, method = float(np.min(task.max_step)), "shift" if self.recommended else self.method
        feet = {
            name: {
                **named(each.planned, "cm"),
                "expected_rms_cm": each.expected,
                "without_plan_rms_cm": each.direct.rms,
                "best_shift_rms_cm": each.early.rms,
            }
            for name, each in self.feet.items()
        }
        foot = None
        if self.of_foot and self.foot:
            numbers, bound, inversion = self.foot, plan.foot_bound, plan.of_foot
            early = {"rms_cm": numbers.early.rms, "expected_rms_cm": numbers.expected_early}
            foot = {
                **named(numbers.planned, "cm"),
                "expected_rms_cm": numbers.expected,
                "norm": inversion and inversion.norm,
                "best_shift": early,
                "lower_bound_cm": None if bound is None else 100.0 * bound,
                "gap": None if bound is None else inversion and inversion.gap,
                "over_models": inversion and _over_models(inversion, "cm", 100.0),
                "predicted_m": plan.foot.tolist(),
            }
        return {
            "method": self.method,
            "recommended_method": None if has_refused(plan) else method,
            "refining_recommended": bool(self.refining),
            "cyclic": plan.cyclic,
            "period_s": plan.period,
            "robust": task.robust,
            "max_step_deg": None if math.isinf(step) else math.degrees(step),
            "unreachable_samples": self.unreachable,
            "lower_bound_withdrawn": no_bound(plan) or None,
            "joints": {each.name: self._joint(j, each) for j, each in enumerate(self.joints)},
            "foot": foot,
            **({"legs": feet} if feet else {}),
            "within_tolerance": None if self.missed is None else not self.missed,
        }

    def _joint(self, j: int, numbers: JointNumbers) -> dict[str, Any]:
        """A joint for machines."""
        plan, unit, expected = self.plan, numbers.unit, numbers.expected
        motion = plan.motions[j]
        inversion = plan.inversions[j] if plan.inversions else None
        ends = np.degrees([expected.low, expected.high]).tolist()
        return {
            **named(numbers.planned, unit),
            "norm": inversion and inversion.norm,
            "solver": plan.solver,
            f"expected_rms_{unit}": math.degrees(expected.error),
            f"expected_range_{unit}": ends if np.isfinite(ends).all() else None,
            "untested": list(expected.untested),
            f"lower_bound_{unit}": inversion and math.degrees(inversion.lower_bound),
            "gap": inversion and inversion.gap,
            "over_models": inversion and _over_models(inversion, unit, DEGREE),
            "best_shift": {
                "lead_s": numbers.lead,
                f"rms_{unit}": numbers.early,
                f"expected_rms_{unit}": numbers.expected_early,
            },
            **verdict_results(plan.models[j]),
            f"largest_step_{unit}": math.degrees(motion.largest_step),
            "reversals_per_s": motion.reversals_per_s,
            f"path_length_{unit}": math.degrees(motion.path_length),
            f"desired_path_length_{unit}": math.degrees(motion.desired_length),
            f"beyond_desired_{unit}": math.degrees(motion.beyond),
            f"requests_{unit}": np.degrees(plan.requests[:, j]).tolist(),
            f"predicted_{unit}": np.degrees(plan.predicted[:, j]).tolist(),
            **({} if plan.task.load is None else {"load_Nm": plan.task.load[:, j].tolist()}),
        }

    def text(self) -> str:
        """The plan for people."""
        joints, plan = self.joints, self.plan
        columns = [
            ("rms [deg]", [f"{each.planned.rms:.3f}" for each in joints]),
            ("max [deg]", [f"{each.planned.max:.3f}" for each in joints]),
            *([("on the robot", self.on_robot)] if self.on_robot else []),
            *self.bounds,
        ]
        table = by_columns("joint", [each.label for each in joints], columns)
        lines = [
            f"{len(plan.requests)} requests, one every {1e3 * plan.period:.6g} ms; {self.model}",
            table.text(),
            "",
            motions_table(plan.names, plan.motions).text(),
        ]
        if over_models := self.over_models:
            draws = max(map(len, plan.task.models)) - 1
            words = f"{plan.task.norm} errors over the nominal model and {draws} drawn from its"
            lines += ["", f"{words} intervals:", over_models.text()]
        if self.feet:
            lines += ["", self.feet_table.text(), ""]
        if self.of_foot and self.foot:
            robot, (error, most) = "", self.foot.planned
            if self.foot.expected is not None:
                robot = f"; on the robot {self.foot.expected:.3f} cm rms to expect"
            lines.append(f"foot: {error:.3f} cm rms from its path, {most:.3f} cm at most{robot}")
            if plan.of_foot is not None and plan.foot_bound:
                norm = "rms" if plan.task.norm == "rms" else "at most"
                weighted = " as weighted" if len(set(plan.task.weights)) > 1 else ""
                lines.append(
                    f"no requests within the limits bring it below {100.0 * plan.foot_bound:.3f} "
                    f"cm {norm}{weighted}: the plan is {percent(plan.of_foot.gap)} above that"
                )
        if plan.method == "shift":
            early = (f"{each.name} {1e3 * each.lead:.0f} ms" for each in joints)
            lines.append(f"early by: {', '.join(early)}")
        else:
            lines.append(f"desired angles sent early instead, rms [deg]: {self._shift_words()}")
        if fast := self.fast:
            worst = ", ".join(
                f"{each.name} ({percent(each.share, 0)} of the path, up to {each.load:.3g} times "
                "the top speed)"
                for each in fast[:4]
            )
            more = f" and {len(fast) - 4} more" if len(fast) > 4 else ""
            words = "no requests follow exactly where the path is faster than the joint"
            lines.append(f"{words}: {worst}{more}")
        if self.on_robot:
            has_range = any(np.isfinite(each.expected.high) for each in joints)
            more = ", and the range of 90 % of such motions" if has_range else ""
            words = "on the robot: rms error to expect, by what the models were tested on"
            lines.append(f"{words}{more}")
        lines += self.advice
        unknown = [each.name for each in joints if each.share and each.name in self.open_top_speeds]
        if unknown:
            lines.append(f"lower bounds of the model only: {', '.join(unknown)} ({OPEN_TOP_SPEED})")
        if words := no_bound(plan):
            lines.append(f"there is no lower bound {words}")
        if np.any(np.isfinite(plan.task.max_step)):
            lines.append("lower bounds are for requests with steps of any size")
        if self.unreachable:
            lines.append(f"{self.unreachable} samples were out of the leg's reach")
        return "\n".join(lines)

    def _shift_words(self) -> str:
        """The errors of the best time shift."""
        joints = self.joints
        if len(joints) > 6:  # too many to list
            moving = np.ptp(self.plan.desired, axis=0) > 0.0
            leads = 1e3 * np.array([each.lead for each in joints])[moving if moving.any() else ...]
            most = max(each.early for each in joints)
            words = f"at most {most:.3f} ({min(leads):.0f} to {max(leads):.0f} ms early)"
        else:
            words = ", ".join(
                f"{j.label} {j.early:.3f}"
                + ("" if np.isnan(j.expected_early) else f", on the robot {j.expected_early:.3f}")
                + f" ({1e3 * j.lead:.0f} ms early)"
                for j in joints
            )
        if self.of_foot and self.foot is not None:
            words += f"; foot {self.foot.early.rms:.3f} cm"
        better = any(j.expected_early < CLEARLY * math.degrees(j.expected.error) for j in joints)
        if better and not (self.recommended or has_refused(self.plan)):
            words += "; on the robot that is better for some joints: see --method shift"
        return words


def named(errors: Distance, unit: str) -> dict[str, float]:
    """The sizes of errors for machines."""
    return {f"rms_{unit}": errors.rms, f"max_{unit}": errors.max}


def no_bound(plan: Plan) -> str:
    """For what there is no lower bound, and why; empty where there is one."""
    if plan.task.load_of_pose:
        return "under a load that depends on the pose: other requests would meet another load"
    pairs = zip(plan.names, plan.models, strict=True)
    faster = [name or "the joint" for name, model in pairs if model.exceeds_v_max]
    if not faster:
        return ""
    return f"for {', '.join(faster)}: with the integral of a speed loop v_max may be exceeded"


def start_words(plan: Plan) -> str:
    """How to bring joints to the start of a plan from rest; "" where it makes no difference.

    The first request holds a joint at its start in the middle of its dead band. A joint that comes
    to rest under it stops short of its start by that band, on either side. An integral term
    overcomes the friction. It is said where that is more than the error to expect, and than a step
    of an encoder.
    """
    if plan.cyclic:
        return ""
    off = {
        name or "the joint": math.degrees(model.steady.dead_band)
        for name, model, expected, own in zip(
            plan.names, plan.models, plan.expected, map(rms, plan.errors.T), strict=True
        )
        if model.steady.dead_band > max(np.nan_to_num(expected.error, nan=own), ENCODER_STEP)
    }
    if not off:
        return ""
    joints = ", ".join(f"{name} by up to {size:.2g} degrees" for name, size in off.items())
    return (
        f"by dry friction a joint may rest beside the start that the plan assumes ({joints}): lead "
        "it there slowly, from below to a request as much above the first one, or from above to "
        "one as much below"
    )


def motions_table(
    names: Iterable[str], motions: Sequence[RequestMotion], factors: Iterable[float] | None = None
) -> Table:
    """How requests move, beside the desired path: by joint, with the factor to degrees."""
    pairs = [*zip(motions, factors or [DEGREE] * len(motions), strict=True)]
    columns = [
        ("largest step [deg]", [f"{factor * m.largest_step:.2f}" for m, factor in pairs]),
        ("reversals/s", [f"{m.reversals_per_s:.1f}" for m in motions]),
        ("length [deg]", [f"{factor * m.path_length:.1f}" for m, factor in pairs]),
        ("desired", [f"{factor * m.desired_length:.1f}" for m, factor in pairs]),
        ("outside desired [deg]", [f"{factor * m.beyond:.2f}" for m, factor in pairs]),
    ]
    return by_columns("requests", names, columns, label="How the requests move")


def _over_models(
    inversion: Inversion | FootInversion, unit: str, factor: float
) -> dict[str, Any] | None:
    """Errors over the drawn models, for machines; None without drawn models."""
    if inversion.nominal is None:
        return None
    return {
        name: {
            **{f"{which}_{unit}": factor * e for which, e in plan.over_models._asdict().items()},
            f"of_each_{unit}": (factor * plan.errors_of_models).tolist(),
        }
        for name, plan in (("robust_plan", inversion), ("nominal_plan", inversion.nominal))
    }


def verdict_results(model: JointModel) -> dict[str, str]:
    """The verdict on a model and its reason, for machines; empty if unknown."""
    evidence = model.evidence
    if evidence is None or evidence.verdict is None:
        return {}
    return {"verdict": evidence.verdict, "verdict_reason": evidence.reason}


def simulation_answer(
    names: Sequence[str],
    models: Sequence[JointModel],
    predicted: Array,
    *,
    units: Sequence[str],
    desired: Array | None,
    cyclic: bool,
    loads: Array | None,
) -> tuple[dict[str, Any], str]:
    """Angles [rad], (n, k), beside the desired ones if there are any, for machines and people.

    ``units`` are "deg" or "percent" of each joint; the text begins with a new line.
    """
    joints, expected, text = dict[str, dict[str, Any]](), list[Expectation](), ""
    for j, (name, model, unit) in enumerate(zip(names, models, units, strict=True)):
        angles, load, joints[name] = predicted[:, j], None if loads is None else loads[:, j], {}
        if desired is not None:
            goal, known, period = desired[:, j], model.evidence, model.period
            each = expectation(known, goal, angles, period=period, cyclic=cyclic, load=load)
            expected.append(each)
            errors, robot = size(angles - goal, DEGREE), math.degrees(each.error)
            joints[name] = {
                **named(errors, unit),
                f"expected_rms_{unit}": robot,
                "untested": list(each.untested),
            }
            text += f"\n{name}: {errors.rms:.3f} {unit} rms from the desired angles"
            text += f", {errors.max:.3f} {unit} at most"
            if math.isfinite(robot):
                text += f"; on the robot expect about {robot:.3f} {unit} rms"
        joints[name] |= verdict_results(model)
        joints[name][f"angles_{unit}"] = np.degrees(angles).tolist()
    words = untested_words(names, expected) if expected else ""
    return joints, f"{text}\n{words}" if words else text


def against_tolerances(
    plan: Plan, units: Sequence[str], *, degrees: float | None, centimetres: float | None
) -> tuple[list[str], list[str]]:
    """Tolerances that a plan misses, in its norm, and those that it keeps by the models alone.

    The latter are of errors to expect on the robot, which are root mean squares.
    """
    missed, doubted, norm = [], [], plan.task.norm
    judged: list[tuple[str, str, float, float, float, str]] = []
    if degrees is not None:
        for name, unit, each in zip(plan.names, units, plan.inversions, strict=False):
            error, least, robot = np.degrees([each.error, each.lower_bound, each.expected.error])
            bound = f"; the lower bound for any requests is {least:.4g}"
            known = least > 0.0 and not plan.task.load_of_pose
            judged.append((name, unit, error, robot, degrees, bound if known else ""))
    if centimetres is not None:
        error, robot = error_norm(100.0 * plan.distances, norm), plan.expected_foot
        robot = math.nan if robot is None else 100.0 * robot
        judged.append(("the foot", "cm", error, robot, centimetres, ""))
    for subject, unit, error, robot, most, bound in judged:
        if error > most:
            missed.append(off_by(subject, error, unit, norm, most) + bound)
        elif norm == "rms" and robot > most:
            doubted.append(
                f"{subject} keeps {most:g} {unit} (rms) by the model; on the robot {robot:.3g} "
                f"{unit} is to be expected"
            )
    return missed, doubted


def off_by(subject: str, error: float, unit: str, norm: str, expected: float) -> str:
    """A missed tolerance in words."""
    return f"{subject} is off by {error:.4g} {unit} ({norm}), expected at most {expected:g}"
