"""The answer about a plan: its numbers, computed once, for machines and people and for its page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.arrays import Array, error_norm, excess, size
from planner.model.evidence import (
    OPEN_TOP_SPEED,
    Expectation,
    expectation,
    untested_words,
)
from planner.model.joint import JointModel
from planner.planning.plan import DEGREE, ErrorsOfModels, FootInversion, Inversion, Plan
from planner.planning.time_shift import (
    has_refused,
    refining_recommended,
    shift_recommended,
    shifted,
)
from planner.report.wording import CARRIED, Table, Unit, labelled, number, percent, table, table_of

if TYPE_CHECKING:
    from kinematics import Leg

Numbers = dict[str, Any]
"""Numbers of a joint or a foot in its unit, named as for machines: see :func:`in_unit`."""

MOTION = {"largest_step", "path_length", "desired_path_length", "beyond_desired", "beyond_limits"}
ERRORS = (
    "rms max expected_rms expected_on_robot_rms expected_range lower_bound errors noise of_each"
)
PATHS = "requests desired predicted angles learnt"
SIZES = {*ERRORS.split(), *PATHS.split(), *MOTION, *ErrorsOfModels._fields}
"""Numbers in the unit of their joint or foot."""

SPEEDS = {"desired_speed", "top_speed"}
"""Numbers in this unit per second."""

AT_LIMIT = 1e-6
"""A request this close to a limit is at it [deg]."""


def in_unit(numbers: Mapping[str, Any], unit: str) -> Numbers:
    """Numbers for machines, named with their unit."""
    units = dict.fromkeys(SIZES, f"_{unit}") | dict.fromkeys(SPEEDS, f"_{unit}_per_s")
    return {
        name + units.get(name, ""): in_unit(value, unit) if isinstance(value, dict) else value
        for name, value in numbers.items()
    }


def sizes_of(errors: Array, factor: float = DEGREE) -> Numbers:
    """The sizes of errors, times the factor to their unit."""
    return size(errors, factor)._asdict()


def motion_of(plan: Plan, j: int, factor: float = DEGREE) -> Numbers:
    """How the requests to a joint move, with the factor to its unit."""
    motion = plan.motions[j]._asdict()
    return {name: value * (factor if name in MOTION else 1.0) for name, value in motion.items()}


def motions_table(rows: Iterable[tuple[str, Numbers]], unit: str) -> Table:
    """How requests move, beside the desired path."""
    columns = {
        f"largest step [{unit}]": "largest_step .2f",
        "reversals/s": "reversals_per_s .1f",
        f"length [{unit}]": "path_length .1f",
        f"desired [{unit}]": "desired_path_length .1f",
        f"outside desired [{unit}]": "beyond_desired .2f",
    }
    return table_of("requests", rows, columns, "How the requests move")


def foot_numbers(feet: Sequence[Plan]) -> Numbers:
    """The errors of a foot, or of several together [cm]."""

    def numbers(plans: Sequence[Plan]) -> Numbers:
        known = plans[0].expected_foot if len(plans) == 1 else None
        sizes = sizes_of(np.concatenate([plan.distances for plan in plans]), 100.0)
        return sizes | {"expected_rms": None if known is None else 100.0 * known}

    direct = np.concatenate([foot.direct.distances for foot in feet])
    return numbers(feet) | {
        "without_plan": sizes_of(direct, 100.0),
        "best_shift": numbers([shifted(foot.task) for foot in feet]),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanAnswer:
    """A plan and how it was asked for: all that JSON, text and page say about it."""

    plan: Plan
    method: str  # as the user names it
    model: str = ""  # where the models come from, in words
    # of joints in percent of their range, "percent"; others are in degrees, "deg"
    units: Mapping[str, str] = field(default_factory=dict)
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
    def shown(self) -> dict[str, Unit]:
        """The unit of each joint."""
        return {name: CARRIED[self.units.get(name, "deg")] for name in self.plan.names}

    @property
    def unit(self) -> str:
        """The unit of the joints in tables; the label of a joint in another says that."""
        return labelled(self.shown)[0]

    @cached_property
    def joints(self) -> dict[str, Numbers]:
        """The numbers of every joint: degrees, or percent of its range."""
        plan, shift, task, joints = self.plan, self.shift, self.plan.task, dict[str, Numbers]()
        beyond = np.degrees(excess(plan.requests, task.lower, task.upper))
        bounded = task.goal == "angles" and self.method != "foot-optimal" and not task.load_of_pose
        for j, (name, model) in enumerate(zip(plan.names, plan.models, strict=True)):
            has_bound = bounded and not model.exceeds_v_max
            inversion = plan.inversions[j] if plan.inversions else None
            expected, most = plan.expected[j], float(beyond[:, j].max())
            ends = np.degrees([expected.low, expected.high]).tolist()
            speed, top = np.degrees(plan.speeds[j].highest).tolist()
            joints[name] = {
                **sizes_of(plan.errors[:, j]),
                "norm": inversion and inversion.norm,
                "solver": plan.solver,
                "expected_rms": math.degrees(expected.error),
                "expected_range": ends if np.isfinite(ends).all() else None,
                "untested": list(expected.untested),
                "lower_bound": math.degrees(plan.lower_bounds[j]) if has_bound else None,
                "gap": float(plan.gaps[j]) if has_bound else None,
                "over_models": inversion and over_models(inversion, DEGREE),
                "without_plan": sizes_of(plan.direct.errors[:, j]),
                "best_shift": {
                    "lead_s": shift.leads[j],
                    **sizes_of(shift.errors[:, j]),
                    "expected_rms": math.degrees(shift.expected[j].error),
                },
                **verdict_results(model),
                # where the path is fastest for the joint
                "desired_speed": speed,
                "top_speed": top,
                "speed_ratio": speed / top,
                "share_too_fast": float(plan.too_fast[j]),
                "requests_at_limits": int(np.sum(beyond[:, j] >= -AT_LIMIT)),
                "beyond_limits": most if most > AT_LIMIT else 0.0,
                **motion_of(plan, j),
                "requests": np.degrees(plan.requests[:, j]).tolist(),
                "predicted": np.degrees(plan.predicted[:, j]).tolist(),
                **({} if task.load is None else {"load_Nm": task.load[:, j].tolist()}),
            }
        return joints

    @cached_property
    def parts(self) -> dict[str, Plan]:
        """The plans of the legs, by name."""
        return {name: self.plan.of_leg(leg) for name, leg in self.legs.items()}

    @cached_property
    def feet(self) -> dict[str, Numbers]:
        """The numbers of every foot of the legs, by name."""
        return {name: foot_numbers([part]) for name, part in self.parts.items()}

    @cached_property
    def foot(self) -> Numbers | None:
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
    def shift_steps(self) -> str:
        """A remark where the best time shift takes larger steps than are allowed; else empty."""
        larger = np.any(self.shift.largest_steps > self.plan.task.max_step + 1e-9)
        words = "the best time shift takes larger steps than the limit on steps allows"
        return words if larger else ""

    @property
    def advice(self) -> list[str]:
        """What to know and to do before the requests are sent to the robot."""
        refine = "play the requests and refine them (request-planner refine)"
        lines = [
            self.recommended and f"recommended: --method shift, as {self.recommended}",
            self.refining and f"recommended: {refine}: {self.refining}",
        ]
        untested = untested_words(self.plan.names, self.plan.expected)
        return list(filter(None, [untested, *lines]))

    @property
    def fast(self) -> dict[str, Numbers]:
        """The joints that cannot follow, the worst first; less leaves no error worth a remark."""
        ranked = sorted(self.joints.items(), key=lambda pair: -float(pair[1]["speed_ratio"]))
        return {k: n for k, n in ranked if n["share_too_fast"] >= 0.005 or n["speed_ratio"] > 1.01}

    @property
    def open_top_speeds(self) -> list[str]:
        """The joints whose top speed their logs leave open: bounds are of their models only."""
        pairs = zip(self.plan.names, self.plan.models, strict=True)
        return [name for name, m in pairs if m.evidence and m.evidence.leaves_top_speed_open]

    # The tables.

    @property
    def rows(self) -> list[tuple[str, Numbers]]:
        """The joints, with their unit where that is not degrees, and the errors on the robot."""
        rows, labels = list[tuple[str, Numbers]](), labelled(self.shown)[1]
        for name, each in self.joints.items():
            ends = [f"{end:.3g}" for end in each["expected_range"] or ()]
            note = f"\n{' to '.join(ends)}" if len(set(ends)) > 1 else ""
            rows.append((labels[name], each | {"on_robot": number(each["expected_rms"], 3) + note}))
        return rows

    @property
    def tested(self) -> bool:
        """Whether it is known what error to expect of some joint on the robot."""
        return any(math.isfinite(each["expected_rms"]) for each in self.joints.values())

    @property
    def bound(self) -> str:
        """What lower bounds are called, with the error that they are about if not the rms error."""
        return "lower bound (max)" if self.plan.task.norm == "max" else "lower bound"

    @property
    def over_models(self) -> list[tuple[str, Numbers]]:
        """Errors of a robust plan, and of the nominal one, over the models that joints may have."""
        named = [(name, each["over_models"]) for name, each in self.rows]
        if self.plan.of_foot is not None:
            named = [("foot", over_models(self.plan.of_foot, 100.0))]
        return [(name, errors) for name, errors in named if errors]

    @property
    def motions(self) -> Table:
        """How the requests move, beside the desired path."""
        return motions_table(self.rows, self.unit)

    # For machines, and for people on a terminal.

    def document(self) -> dict[str, Any]:
        """The plan for machines; fields that a plan for the foot does not have are null."""
        plan, task, foot = self.plan, self.plan.task, None
        step, method = float(np.min(task.max_step)), "shift" if self.recommended else self.method
        if self.of_foot and self.foot:
            bound, inversion = plan.foot_bound, plan.of_foot
            foot = self.foot | {
                "norm": inversion and inversion.norm,
                "lower_bound": None if bound is None else 100.0 * bound,
                "gap": None if bound is None else inversion and inversion.gap,
                "over_models": inversion and over_models(inversion, 100.0),
                "predicted_m": plan.foot.tolist(),
            }
        feet = {
            name: {
                **{f"{key}_cm": each[key] for key in ("rms", "max", "expected_rms")},
                "without_plan_rms_cm": each["without_plan"]["rms"],
                "best_shift_rms_cm": each["best_shift"]["rms"],
            }
            for name, each in self.feet.items()
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
            "joints": {
                name: in_unit(each, self.shown[name].name) for name, each in self.joints.items()
            },
            "foot": foot and in_unit(foot, "cm"),
            **({"legs": feet} if feet else {}),
            "within_tolerance": None if self.missed is None else not self.missed,
        }

    def text(self) -> str:
        """The plan for people."""
        joints, plan, task = self.joints, self.plan, self.plan.task
        columns = {f"rms [{self.unit}]": "rms .3f", f"max [{self.unit}]": "max .3f"}
        if self.tested:
            columns["on the robot"] = "on_robot"
        columns |= {self.bound: "lower_bound .3f", "gap": "gap .2%"}
        lines = [
            f"{len(plan.requests)} requests, one every {1e3 * plan.period:.6g} ms; {self.model}",
            table_of("joint", self.rows, columns).text(),
            "",
            self.motions.text(),
        ]
        if self.over_models:
            draws = max(map(len, task.models)) - 1
            words = f"{task.norm} errors over the nominal model and {draws} drawn from its"
            lines += ["", f"{words} intervals:", table("over_models", answer=self).text()]
        if self.feet:
            lines += ["", table("feet", answer=self).text(), ""]
        if self.of_foot and self.foot:
            foot, robot = self.foot, ""
            if foot["expected_rms"] is not None:
                robot = f"; on the robot {foot['expected_rms']:.3f} cm rms to expect"
            words = f"foot: {foot['rms']:.3f} cm rms from its path, {foot['max']:.3f} cm at most"
            lines.append(words + robot)
            if plan.of_foot is not None and plan.foot_bound:
                norm = "rms" if task.norm == "rms" else "at most"
                weighted = " as weighted" if len(set(task.weights)) > 1 else ""
                gap, bound = plan.of_foot.gap, f"{100.0 * plan.foot_bound:.3f} cm {norm}{weighted}"
                above = "" if math.isinf(gap) else f": the plan is {percent(gap)} above that"
                limits = () if task.leg is None else task.leg.limits
                own = "leg's own " * np.array_equal(limits, (task.lower, task.upper))
                lines.append(f"no requests within the {own}limits bring it below {bound}{above}")
        if plan.method == "shift":
            leads = (
                f"{n} {1e3 * each['best_shift']['lead_s']:.0f} ms" for n, each in joints.items()
            )
            lines.append(f"early by: {', '.join(leads)}")
        else:
            lines.append(f"desired angles sent early instead, {task.norm} [{self.unit}]: ")
            lines[-1] += ", ".join(
                f"{label} {each[task.norm]:.3f}"
                + f", on the robot {each['expected_rms']:.3f}" * math.isfinite(each["expected_rms"])
                + f" ({1e3 * each['lead_s']:.0f} ms early)"
                for label, each in ((label, row["best_shift"]) for label, row in self.rows)
            )
            if self.of_foot and self.foot:
                lines[-1] += f"; foot {self.foot['best_shift'][task.norm]:.3f} cm"
            lines += filter(None, [self.shift_steps])
        if fast := self.fast:
            worst = ", ".join(
                f"{name} ({percent(each['share_too_fast'], 0)} of the path, up to "
                f"{each['speed_ratio']:.3g} times the top speed)"
                for name, each in [*fast.items()][:4]
            )
            more = f" and {len(fast) - 4} more" if len(fast) > 4 else ""
            words = "no requests follow exactly where the path is faster than the joint"
            lines.append(f"{words}: {worst}{more}")
        if self.tested:
            has_range = any(each["expected_range"] for each in joints.values())
            more = ", and the range of 90 % of such motions" if has_range else ""
            words = "on the robot: rms error to expect, by what the models were tested on"
            lines.append(f"{words}{more}")
        lines += self.advice
        if unknown := [name for name in self.open_top_speeds if joints[name]["share_too_fast"]]:
            lines.append(f"lower bounds of the model only: {', '.join(unknown)} ({OPEN_TOP_SPEED})")
        if words := no_bound(plan):
            lines.append(f"there is no lower bound {words}")
        if np.any(np.isfinite(task.max_step)):
            lines.append("lower bounds are for requests with steps of any size")
        if self.unreachable:
            lines.append(f"{self.unreachable} samples were out of the leg's reach")
        return "\n".join(lines)


def no_bound(plan: Plan) -> str:
    """For what there is no lower bound, and why; empty where there is one."""
    if plan.task.load_of_pose:
        return "under a load that depends on the pose: other requests would meet another load"
    pairs = zip(plan.names, plan.models, strict=True)
    faster = [name or "the joint" for name, model in pairs if model.exceeds_v_max]
    if not faster:
        return ""
    return f"for {', '.join(faster)}: with the integral of a speed loop v_max may be exceeded"


def over_models(plan: Inversion | FootInversion, factor: float) -> Numbers | None:
    """Errors over the drawn models, times a factor; None without drawn models."""
    if plan.nominal is None:
        return None
    return {
        name: {which: factor * error for which, error in each.over_models._asdict().items()}
        | {"of_each": (factor * each.errors_of_models).tolist()}
        for name, each in (("robust_plan", plan), ("nominal_plan", plan.nominal))
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
    """Angles [rad], (n, k), beside the desired ones if there are any, for machines and people."""
    joints, expected, text = dict[str, Numbers](), list[Expectation](), ""
    for j, (name, model, unit) in enumerate(zip(names, models, units, strict=True)):
        angles, load, numbers = predicted[:, j], None if loads is None else loads[:, j], Numbers()
        if desired is not None:
            goal, known, period = desired[:, j], model.evidence, model.period
            each = expectation(known, goal, angles, period=period, cyclic=cyclic, load=load)
            expected.append(each)
            numbers, shown = sizes_of(angles - goal), CARRIED[unit].words
            text += f"\n{name}: {numbers['rms']:.3f} {shown} rms from the desired angles"
            text += f", {numbers['max']:.3f} {shown} at most"
            if math.isfinite(each.error):
                robot = math.degrees(each.error)
                text += f"; on the robot expect about {robot:.3f} {shown} rms"
            numbers |= {"expected_rms": math.degrees(each.error), "untested": list(each.untested)}
        numbers |= {**verdict_results(model), "angles": np.degrees(angles).tolist()}
        joints[name] = in_unit(numbers, unit)
    words = untested_words(names, expected) if expected else ""
    return joints, f"{text}\n{words}" if words else text


def against_tolerances(
    plan: Plan, units: Sequence[str], *, degrees: float | None, centimetres: float | None
) -> tuple[list[str], list[str]]:
    """Tolerances that a plan misses, in its norm, and those that only its models keep, in rms."""
    missed, doubted, norm = [], [], plan.task.norm
    judged: list[tuple[str, str, float, float, float, str]] = []
    if degrees is not None:
        for name, unit, each in zip(plan.names, units, plan.inversions, strict=False):
            error, least, robot = np.degrees([each.error, each.lower_bound, each.expected.error])
            bound = f"; the lower bound for any requests is {least:.4g}"
            known = least > 0.0 and not plan.task.load_of_pose
            words = CARRIED[unit].words
            judged.append((name, words, error, robot, degrees, bound if known else ""))
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
