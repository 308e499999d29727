"""The best time shift: the desired angles themselves, sent early; the baseline of every plan."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, rms
from planner.exceptions import NoSteadyCycle
from planner.model.evidence import ENCODER_STEP, unproven_gains
from planner.model.joint import JointModel, checked_model
from planner.planning.line_inverse import advanced
from planner.planning.plan import Inversion, Plan
from planner.planning.task import Norm, Task

USUAL = 2.0
"""All leads of up to this many delays of the joint are tried. (With the first rise as the end, 5 of
80 random joints miss the best lead, and 17 % of the error at worst.)"""


def invert_shift(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    norm: Norm = "rms",
    start: float | None = None,
    load: npt.ArrayLike | None = None,
) -> Inversion:
    """The desired angles as requests, the best time early: the usual manual remedy.

    Request k is the desired angle at sample k plus a lead, between samples on a straight line. The
    lead is the one under which the model comes closest. Every other plan should beat this one. From
    rest the first request holds the joint where it rests.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever; from rest the last angle is held at the
            end.
        norm: The error that the lead makes small: "rms" or "max".
        start: From rest: where the joint rests before the first request [rad]; by default at the
            first desired angle.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,);
            at the samples; see :func:`planner.simulate`.

    Returns:
        The requests; ``lead`` is how early they are [s].

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 3.
        InvalidInput: The norm is unknown, a cycle has a ``start``, or the load does not fit the
            samples or the joint.
        NoSteadyCycle: The joint does not settle into a cycle, however early the angles are.

    Example:
        >>> import numpy as np
        >>> desired = 0.5 * np.sin(2 * np.pi * np.arange(88) / 88)  # [rad], every 8 ms
        >>> plan = invert_shift(JointModel.ers210a(), desired)
        >>> f"{1e3 * plan.lead:.0f} ms early: {np.degrees(plan.rms):.1f} deg rms"
        '78 ms early: 0.6 deg rms'
    """
    task = Task.of(
        [checked_model(model)],
        desired,
        names=("",),
        cyclic=cyclic,
        norm=norm,
        start=start,
        load=load,
    )
    return Inversion(shifted(task))


@lru_cache(maxsize=2)  # tables, remarks and recommendations of an answer ask for the same one
def shifted(task: Task) -> Plan:
    """The plan in which the desired angles of each joint are requested the best time early.

    Requests beyond the limits are clipped; their steps are the desired path's.
    """
    each = [task.joint(j) for j in range(len(task.names))]
    leads = list(map(best_lead, each))
    columns = list(map(early, each, leads))
    return Plan(
        task=task.unsmoothed,
        requests=np.column_stack(columns),
        method="shift",
        leads=tuple(lead * task.period for lead in leads),
    )


def has_refused(plan: Plan) -> bool:
    """Whether a model is refused: neither a plan by it nor its best time shift is recommended."""
    return any(model.evidence and model.evidence.verdict == "refused" for model in plan.models)


def shift_recommended(plan: Plan, shift: Plan) -> str:
    """Why the best time shift is recommended instead of a plan, in words; empty where it is not.

    A model may be hardly better than a pure delay. Or a joint may move faster, or accelerate more,
    than in its logs, though these do not determine how fast it can be; far more, where the model
    has no limit of the acceleration. Or the errors to expect may differ, as those of robust plans,
    and of smooth ones for a path that no joint could follow. A shift whose requests or steps are
    beyond what the task allows is not recommended. An error of the model above that of
    the shift is no reason, since the lead is that model's, too: of nine such motions of simulated
    servos the plan was closer in seven. The plan is one by another method for the same task.
    """
    if has_refused(plan) or not plan.task.keeps(shift.requests, rounding=1e-9):
        return ""
    evidence, period = [model.evidence for model in plan.models], plan.task.period
    if why := unproven_gains(plan.names, evidence):
        return why
    for j, (name, model, expected) in enumerate(
        zip(plan.names, plan.models, plan.expected, strict=True)
    ):
        if model.evidence is None:
            continue
        limit, joint = model.evidence.intervals.get("max_acceleration"), name or "the joint"
        accelerates = "acceleration" in expected.untested
        if accelerates and limit is None:
            size = rms(np.diff(plan.predicted[:, j], 2)) / period**2
            # Of simulated joints whose limit of 15 or 30 rad/s^2 the model lacks, plans of pick and
            # place had 6 to 9 times the shift's error; of three other servos, beyond their logs,
            # 0.5 to 1.03 times.
            accelerates = size > 2.0 * model.evidence.by_acceleration[-1][0]
        if accelerates and (limit is None or limit[0] <= 0.0):
            return f"{joint} accelerates more than in its logs, which do not show its limit"
        if "speed" in expected.untested and model.evidence.leaves_top_speed_open:
            return f"{joint} moves faster than in its logs, which do not show its limit"
    pairs = zip(shift.expected, plan.expected, strict=True)  # 2 % less is clearly smaller
    if plan.task.goal != "foot" and all(early.error < 0.98 * own.error for early, own in pairs):
        return "its error to expect is smaller"
    return ""


def refining_recommended(plan: Plan, shift: Plan) -> str:
    """Why requests are better refined by a measured cycle, in words; empty where they need not be.

    Where the model's error is most of the one to expect, and that is more than half of the best
    shift's, plans by this model gain little, and no log tells which of the two is closer. What the
    model lacks repeats, and is learnt: in 14 such motions of five simulated servos plans had 0.44
    to 1.37 of the best shift's error, after one measured cycle 0.04 to 0.55.
    """
    names = []
    for j, name in enumerate(() if has_refused(plan) else plan.names):
        error, own = plan.expected[j].error, rms(plan.errors[:, j])
        moves = np.ptp(plan.desired[:, j]) > 10.0 * error  # else the joint counts as at rest
        least = max(2.0 * own, ENCODER_STEP, 0.5 * shift.expected[j].error)
        if moves and error > least:
            names.append(name)
    if not names:
        return ""
    whose = f"the model of {', '.join(names)}" if names[0] else "the model"
    return f"{whose} misses such motion by more than half of a time shift's error"


def early(joint: Task, lead: float) -> Array:
    """The desired angles of one joint, this many periods early, within its limits [rad], (n,).

    From rest the first request holds the joint where it rests, as in every plan.
    """
    requests = advanced(joint.desired[:, 0], lead, cyclic=joint.start is None)
    requests = np.clip(requests, joint.lower, joint.upper)
    if joint.start is not None:
        load = joint.loads_on(joint.nominal)[0, 0]
        requests[0] = joint.nominal[0].request_at(joint.start[0], load)
    return requests


def best_lead(joint: Task) -> float:
    """By how many periods one joint's desired angles are best requested early.

    A lead at which the joint does not settle into a cycle, but rings, counts as none.
    """

    def error(lead: float) -> float:
        try:
            angles = joint.response(early(joint, lead)[:, np.newaxis])
        except NoSteadyCycle:
            return math.inf
        return float(joint.errors_of(angles)[0])

    model = joint.nominal[0]
    delay = (model.switching_time + model.theta_0 / model.v_max) / joint.period
    most = int(min(1.0 / joint.period, len(joint.desired) - 1))  # servos lag by up to 0.4 s
    best, least = 0.0, error(0.0)
    for lead in map(float, range(1, most + 1)):
        trial_error = error(lead)
        if trial_error < least:
            best, least = lead, trial_error
        elif lead > max(best, USUAL * delay) + 3.0:  # three longer leads in a row are worse
            break
    for step in (0.25, 0.05):  # [periods]: the last one is the accuracy of the answer
        nearby = (min(max(best + step * k, 0.0), float(most)) for k in range(-4, 5))
        best = min(nearby, key=error)
    return best
