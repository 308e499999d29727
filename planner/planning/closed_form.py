"""The paper's inversion: the inverses of the lines of an approximation, joined (Section 4.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import CurveStack, PiecewiseLinear, lines_in_force
from planner.approximation.fit_pwl import fit_pwl
from planner.approximation.values import slope_bounded
from planner.arrays import Array, as_flag, steps
from planner.exceptions import InvalidInput, about, angle_text
from planner.model.joint import JointModel, acting_requests, checked_model
from planner.model.response import checked_load
from planner.planning.line_inverse import (
    AT_TOP_SPEED,
    RULES,
    Rule,
    advanced,
    check_rule,
    interpolated_offset,
    offsets_of,
    slope_limits,
    slopes_text,
)
from planner.planning.plan import Inversion, Plan
from planner.planning.task import Task

if TYPE_CHECKING:
    from planner.planning.problem import Problem


def invert_closed_form(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    segments: int | None = None,
    rule: Rule = "paper",
    refine: bool = True,
    load: npt.ArrayLike | None = None,
) -> Inversion:
    """Requests by the paper's method: approximate by lines, invert each, switch between them early.

    The desired trajectory is approximated by a piecewise linear one within ±v_max, each line is
    raised by its C_m (Section 4.2), and the requests change from one line to the next l + a/2
    before the approximation does (Section 4.3), at the exact time, also between two requests.

    From rest the joint rests at the first desired angle until the plan begins.

    C_m, :func:`planner.line_offset`, contains the dead band and the load when a request acts.
    Slopes are limited by the top speed in their direction, the smallest under the load, without a
    sag by the pose.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        segments: Number of lines; by default chosen by :func:`planner.fit_pwl`, or two more if the
            joint then comes closer by half a percent.
        rule: How to invert a line, see :func:`planner.line_offset`.
        refine: Whether to move the knots of the approximation until the joint itself, not only the
            approximation, comes as close to ``desired`` as it can with these lines; this never
            makes the plan worse.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,),
            at the samples; see :func:`planner.simulate`.

    Returns:
        The requests, with the approximation behind them.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) that is long enough.
        InvalidInput: The rule is unknown, ``segments`` does not fit the number of samples, or the
            load does not fit the samples or the joint.
        SolverFailed: The approximation was not found.

    Example:
        >>> import numpy as np
        >>> desired = 0.5 * np.sin(2 * np.pi * np.arange(88) / 88)  # [rad], every 8 ms
        >>> plan = invert_closed_form(JointModel.ers210a(), desired)
        >>> plan.requests.shape, f"{np.degrees(plan.rms):.2f} deg rms"
        ((88,), '0.19 deg rms')
    """
    task = Task.of([checked_model(model)], desired, names=("",), cyclic=cyclic, load=load)
    return Inversion(closed_forms(task, segments=segments, rule=rule, refine=refine))


def closed_forms(
    task: Task,
    *,
    segments: int | None = None,
    rule: Rule = "paper",
    refine: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """The plan of joints one by one, as :func:`invert_closed_form`; limits and norm do not count.

    ``progress`` is called with the name of each joint before it is planned.
    """
    from planner.planning.problem import problem_of  # compiled: Numba takes a quarter of a second

    refine, requests, curves = as_flag("refine", refine), np.empty_like(task.desired), []
    for j, name in enumerate(task.names):
        if progress:
            progress(name)
        with about(name):
            check_rule(rule, task.nominal[j], stacklevel=4)
            problem = problem_of(task.joint(j)).unlimited
            every = approximations(problem, segments=segments, refine=refine)
            curve, requests[:, j : j + 1] = inverted(problem, every, rule=rule, refine=refine)
        curves.append(curve)
    return Plan(
        task=task.unsmoothed,
        requests=requests,
        method="closed_form",
        approximations=tuple(curves),
    )


def best_closed_form(problem: Problem) -> Array:
    """The requests of :func:`invert_closed_form` by the better rule [rad], (n, 1).

    They are planned without limits and then clipped to them.
    """
    free = replace(problem.unlimited, norm="rms")
    curves = approximations(free, segments=None, refine=True)
    columns = [inverted(free, curves, rule=rule, refine=True)[1] for rule in RULES]
    return min(map(problem.admissible, columns), key=problem.exact_error)


def approximations(
    problem: Problem, *, segments: int | None, refine: bool
) -> Sequence[PiecewiseLinear]:
    """The approximation, and where neither count nor knots are fixed another with more segments."""
    model = problem.nominal[0]
    desired, cyclic = problem.desired[:, 0], problem.cyclic
    low, high = slope_limits(model, problem.load_of_drives[0])

    def fitted(segments: int | None) -> PiecewiseLinear:
        least, most = low * (1.0 + AT_TOP_SPEED), high * (1.0 + AT_TOP_SPEED)
        # The fit keeps one limit both ways: the larger, unless a line is then too steep one way.
        for v_max in sorted({-low, high}, reverse=True):
            curve = fit_pwl(
                desired, v_max=v_max, tick=model.period, cyclic=cyclic, segments=segments
            )
            if np.min(curve.slopes) >= least and np.max(curve.slopes) <= most:
                break
        return curve

    curves = [fitted(segments)]
    # A joint that rounds corners may track better along more lines. Over 40 random cycles errors
    # are 20 % larger without these, 3.5 % with one more line; with four they are 5.7 % smaller in
    # the mean and 41 % larger at worst.
    more = curves[0].segments + 2
    if refine and segments is None and more <= desired.size - (not cyclic):
        curves.append(fitted(more))
    return curves


def inverted(
    problem: Problem, curves: Sequence[PiecewiseLinear], *, rule: Rule, refine: bool
) -> tuple[PiecewiseLinear, Array]:
    """The curve whose lines track best, and its admissible requests [rad], (n, 1).

    Refined curves are tried, too. A curve of more lines must be better by half a percent.
    """
    (model,), load = problem.drives, problem.load_of_drives[0]
    answers = []
    for curve in curves:
        candidates = [curve]
        if refine:
            from planner.planning.pattern_search import refined_curve

            candidates.append(refined_curve(problem, curve, rule=rule))
        columns = [
            problem.admissible(requests_of(model, CurveStack.of([each]), rule=rule, load=load).T)
            for each in candidates
        ]
        errors = map(problem.exact_error, columns)
        answers.append(min(zip(errors, candidates, columns, strict=True), key=itemgetter(0)))
    best = answers[0]
    for answer in answers[1:]:
        if answer[0] < 0.995 * best[0]:
            best = answer
    return best[1:]


def closed_form_requests(
    model: JointModel,
    curves: PiecewiseLinear | Sequence[PiecewiseLinear] | CurveStack,
    *,
    rule: Rule = "paper",
    load: npt.ArrayLike | None = None,
) -> Array:
    """The paper's requests for given curves, all in one pass over arrays.

    This is :func:`planner.invert_closed_form` without the search for lines: each line is raised by
    its C_m and gives way to the next l + a/2 before the curve turns. Time and memory: O(m (n + s))
    for m curves of s lines; no loop in Python goes over curves, lines or samples.

    Args:
        model: The joint; a curve's samples are ``model.period`` apart.
        curves: One curve, several of the same number of knots, or a :class:`planner.CurveStack`,
            which takes m sets of knots and values as arrays. Slopes within the joint's top speeds.
        rule: How to invert a line, see :func:`planner.line_offset`.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,),
            the same for every curve.

    Returns:
        Requests [rad], shape (n,) for one curve, (m, n) for several or a stack.

    Raises:
        InvalidInput: A slope is beyond the top speeds under the load, the curves do not fit
            together or to the joint, the load does not, or the rule has another name.

    Example:
        >>> model = JointModel.ers210a()
        >>> desired = 0.2 * np.sin(2.0 * np.pi * np.arange(88) / 88)
        >>> curve = fit_pwl(desired, v_max=model.v_max, tick=model.period, segments=4)
        >>> closed_form_requests(model, curve).shape
        (88,)
    """
    model = checked_model(model)
    check_rule(rule, model)
    if isinstance(curves, CurveStack):
        stack = curves
    else:
        stack = CurveStack.of([curves] if isinstance(curves, PiecewiseLinear) else curves)
    felt = checked_load(load, model, stack.samples)
    torques = np.zeros(stack.samples) if felt is None else felt
    if abs(stack.tick - model.period) > 1e-9 * model.period:  # beyond rounding
        raise InvalidInput(
            f"curves: got samples every {stack.tick:g} s, expected every {model.period:g} s, as "
            "often as requests are sent"
        )
    low, high = slope_limits(model, torques)
    share = np.max(np.maximum(stack.slopes / high, stack.slopes / low), axis=1)
    if not np.all(share <= 1.0 + AT_TOP_SPEED):
        row = int(np.argmax(share))
        steepest = float(np.max(np.abs(stack.slopes[row])))
        raise InvalidInput(
            f"curves: got {angle_text(steepest)}/s in curve {row}, expected slopes "
            f"{slopes_text(low, high)}; no request makes the joint follow a steeper line"
        )
    requests = requests_of(model, stack, rule=rule, load=torques)
    requests.setflags(write=False)
    single: Array = requests[0]
    return single if isinstance(curves, PiecewiseLinear) else requests


def requests_of(
    model: JointModel,
    stack: CurveStack,
    *,
    rule: Rule,
    load: Array,
) -> Array:
    """The inverted lines of every curve, each until l + a/2 before the next begins [rad], (m, n).

    The slopes are within the joint's top speeds under the load, (n,) [N m].
    """
    ahead = model.switching_time / model.period  # [samples]
    slopes = np.clip(stack.slopes, *slope_limits(model, load))
    per_sample = slopes * stack.tick
    knots, values = stack.knots[:, : slopes.shape[1]], stack.values[:, : slopes.shape[1]]
    first = np.ceil(knots - ahead - 1e-9)  # request from which on a line counts, any cycle
    by_pose = model.most_pose_sag > 0.0
    raised = values
    varies = by_pose or bool(load.any())
    if not varies:
        raised = values + offsets_of(model, slopes, rule=rule)
    at_first = raised + per_sample * (first - knots)
    line = lines_in_force(first.astype(np.intp), stack.samples, cyclic=stack.cyclic)
    since = np.arange(stack.samples) - np.take_along_axis(first, line, axis=1)
    if stack.cyclic:
        since = np.mod(since, stack.samples)
    requests = np.take_along_axis(per_sample, line, axis=1) * since
    requests += np.take_along_axis(at_first, line, axis=1)
    acting = None
    if by_pose:
        acting = np.take_along_axis(values + per_sample * (first - knots), line, axis=1)
        acting += np.take_along_axis(per_sample, line, axis=1) * (since + ahead)
        requests -= model.pose_sag(acting)
    if varies:
        torques = advanced(load, ahead, cyclic=stack.cyclic)
        each = np.broadcast_to(torques, line.shape)
        in_force = np.take_along_axis(slopes, line, axis=1)
        requests += offsets_of(model, in_force, rule=rule, load=each, angle=acting)
    return np.asarray(requests)


def initial_guess(problem: Problem) -> tuple[Array, Array]:
    """Requests within the limits by the closed form of the ideal, and the ideal [rad], both (n, 1).

    Every sample is a knot: request k is on the line from sample i = floor(k + l + a/2) on, raised
    by its C_m. From rest the ideal is clipped to the attainable range.
    """
    (model,), desired, cyclic = problem.drives, problem.desired[:, 0], problem.cyclic
    count, torques = len(desired), problem.torques[0]
    ideal = nearest_within_speeds(model, desired, torques, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]), torques)
    torques = np.roll(torques, -1)  # on the way to the next
    low, high = np.multiply(model.speed_limits(torques, ideal), model.period)
    to_next = steps(np.append(ideal, ideal[:1] if cyclic else ideal[-1:]), cyclic=False)
    to_next = np.clip(to_next, low, high)
    samples = np.arange(count)
    knots = samples + int(model.switching_time / model.period + 1e-9)  # rounding
    knots = knots if cyclic else np.minimum(knots, count - 2)
    at = knots % count
    slopes = to_next[at] / model.period
    offsets = interpolated_offset(model, slopes, rule="exact", load=torques[at], angle=ideal[at])
    requests = ideal[at] + to_next[at] * (samples - knots) + offsets - model.pose_sag(ideal[at])
    return problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis]


def nearest_within_speeds(
    model: JointModel, desired: Array, torques: Array, *, cyclic: bool
) -> Array:
    """The trajectory within the joint's top speeds that is nearest in least squares [rad], (n,).

    Less the sum of the mean of both top speeds it has the same bound in both directions; a cycle is
    cut out of three in a row. A sag by the pose counts as at the desired angles.
    """
    low, high = model.speed_limits(torques, desired)
    mean = (low + high) / 2.0 * model.period
    if not np.any(mean):
        return slope_bounded(desired, model.v_max * model.period, cyclic=cyclic)
    turns, count = 3 if cyclic else 1, len(desired)
    drift = np.cumsum(np.tile(mean, turns))
    sheared = np.tile(desired, turns) - drift
    bounded = slope_bounded(sheared, model.v_max * model.period, cyclic=False) + drift
    return bounded[(turns // 2) * count :][:count]


def within_attainable_range(
    model: JointModel, angles: Array, start: float, torques: Array
) -> Array:
    """Angles clipped to the attainable range of a joint at rest at the start [rad], (n,)."""
    moving = np.arange(len(angles)) > acting_requests(model).youngest  # the second request acts
    limits = np.multiply(model.speed_limits(torques, angles), model.period)
    low, high = np.cumsum(limits * moving, axis=1)
    return np.clip(angles, start + low, start + high)


def below_top_speed(problem: Problem, ideal: Array) -> int:
    """Number of samples that the ideal [rad], (n, 1), reaches below the joint's top speeds."""
    model = problem.nominal[0]
    limits = model.speed_limits(problem.torques[0], ideal[:, 0])
    low, high = np.multiply(limits, 0.999 * model.period)  # the ideal is iterative
    before = ideal[-1:, 0] if problem.cyclic else ideal[:1, 0]
    moved = np.diff(ideal[:, 0], prepend=before)
    resting = 0 if problem.cyclic else acting_requests(model).youngest + 1
    return int(np.count_nonzero(((moved > low) & (moved < high))[resting:]))
