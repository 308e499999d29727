"""The paper's inversion: the inverses of the lines of an approximation, joined (Section 4.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear, lines_in_force
from planner.approximation.curve_batch import CurveStack
from planner.approximation.fit import fit_pwl
from planner.exceptions import InvalidInput
from planner.inversion.line_inverse import AT_TOP_SPEED, RULES, Rule, check_rule, offsets_of
from planner.inversion.pattern_search import refined_curve
from planner.inversion.result import Inversion
from planner.inversion.tracking_problem import TrackingProblem, track
from planner.model.joint import JointModel, checked_model
from planner.trajectory import Array, as_trajectory
from planner.validation import as_flag


@dataclass(frozen=True, kw_only=True)
class ClosedFormOptions:
    """Which number of segments is taken where none is given.

    Measured on the tracking errors of 40 random cycles of 30 to 110 samples.

    Attributes:
        more_segments: Segments tried beyond those that the approximation needs by itself [-]: a
            joint that rounds corners may track better along more lines. With 1 errors are 3.5 %
            larger in the mean and 71 % at worst, with 4 they are 5.7 % smaller in the mean and 41 %
            larger at worst, with more lines to send; without, they are 20 % larger.
        gain: Relative decrease of the tracking error from which on the larger number is taken [-].
            Half and twice change nothing.
    """

    more_segments: int = 2
    gain: float = 0.005


OPTIONS = ClosedFormOptions()

SAME_TIME = 1e-9
"""How much later than a request a line may begin and still count for it [samples]: rounding."""

SAME_PERIOD = 1e-9
"""Difference of the curve's tick from the joint's period that is rounding, relative."""


def invert_closed_form(
    model: JointModel,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    segments: int | None = None,
    rule: Rule = "paper",
    refine: bool = True,
) -> Inversion:
    """Requests by the paper's method: approximate by lines, invert each, switch between them early.

    The desired trajectory is approximated by a piecewise linear one within ±v_max, each line is
    raised by its C_m (Section 4.2), and the requests change from one line to the next l + a/2
    before the approximation does (Section 4.3), at the true time, be it between two requests.

    From rest the joint rests at the first desired angle until the plan begins.

    Args:
        model: The joint.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        segments: Number of lines; where not given, chosen by :func:`planner.fit_pwl`, or two more
            if the joint then comes closer by half a percent.
        rule: How to invert a line, see :func:`planner.line_offset`.
        refine: Whether to move the knots of the approximation until the joint itself, not only the
            approximation, comes as close to ``desired`` as it can with these lines; this never
            makes the plan worse.

    Returns:
        The requests, with the approximation behind them.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) that is long enough.
        InvalidInput: The rule is unknown, or ``segments`` is not a number that the samples allow.
        SolverFailed: The approximation was not found.
    """
    model = checked_model(model)
    check_rule(rule, model)
    desired = as_trajectory(desired, name="desired", minimum=3)
    cyclic, refine = as_flag("cyclic", cyclic), as_flag("refine", refine)
    start = None if cyclic else float(desired[0])
    problem = track(model, desired, cyclic=cyclic, start=start)
    curves = approximations(model, desired, cyclic=cyclic, segments=segments, refine=refine)
    curve, column = inverted(problem, curves, rule=rule, refine=refine)
    requests = column[:, 0].copy()
    requests.setflags(write=False)
    return Inversion(
        model=model,
        desired=desired,
        requests=requests,
        method="closed_form",
        cyclic=cyclic,
        start=start,
        approximation=curve,
    )


def best_closed_form(problem: TrackingProblem, desired: Array) -> Array:
    """The requests of :func:`invert_closed_form`, by whichever rule does better [rad], (n, 1).

    They are planned without limits and then clipped to them.
    """
    (model,) = problem.models
    start = None if problem.start is None else float(problem.start[0])
    free = track(model, desired, cyclic=problem.cyclic, start=start)
    curves = approximations(model, desired, cyclic=problem.cyclic, segments=None, refine=True)
    columns = [inverted(free, curves, rule=rule, refine=True)[1] for rule in RULES]
    return min(map(problem.admissible, columns), key=problem.exact_error)


def approximations(
    model: JointModel, desired: Array, *, cyclic: bool, segments: int | None, refine: bool
) -> Sequence[PiecewiseLinear]:
    """The approximation, and where neither count nor knots are fixed one of two more segments."""
    v_max, tick = model.v_max, model.period
    curves = [fit_pwl(desired, v_max=v_max, tick=tick, cyclic=cyclic, segments=segments)]
    more = curves[0].segments + OPTIONS.more_segments
    if refine and segments is None and more <= desired.size - (not cyclic):
        curves.append(fit_pwl(desired, v_max=v_max, tick=tick, cyclic=cyclic, segments=more))
    return curves


def inverted(
    problem: TrackingProblem, curves: Sequence[PiecewiseLinear], *, rule: Rule, refine: bool
) -> tuple[PiecewiseLinear, Array]:
    """The curve whose lines track best, and its admissible requests [rad], (n, 1).

    Args:
        problem: One joint that should follow the desired angles, and within which limits.
        curves: Approximations of them; a later one must be better by half a percent.
        rule: How to invert a line.
        refine: Whether to move the knots until the joint comes no closer.
    """
    curve, requests = _one_inverted(problem, curves[0], rule, refine)
    for other in curves[1:]:
        answer = _one_inverted(problem, other, rule, refine)
        if problem.exact_error(answer[1]) < (1.0 - OPTIONS.gain) * problem.exact_error(requests):
            curve, requests = answer
    return curve, requests


def _one_inverted(
    problem: TrackingProblem, curve: PiecewiseLinear, rule: Rule, refine: bool
) -> tuple[PiecewiseLinear, Array]:
    (model,) = problem.models
    requests = problem.admissible(requests_along(model, curve, rule=rule)[:, np.newaxis])
    if refine:
        ahead = switching_time(model) / model.period
        refined = refined_curve(problem, curve, rule=rule, ahead=ahead)
        answer = problem.admissible(requests_along(model, refined, rule=rule)[:, np.newaxis])
        if problem.exact_error(answer) < problem.exact_error(requests):
            curve, requests = refined, answer
    return curve, requests


def requests_along(
    model: JointModel,
    curve: PiecewiseLinear,
    *,
    rule: Rule,
) -> Array:
    """The inverted lines of one curve, each until l + a/2 before the next begins [rad], (n,)."""
    requests: Array = requests_of(model, CurveStack.of([curve]), rule=rule)[0]
    return requests


def closed_form_requests(
    model: JointModel,
    curves: PiecewiseLinear | Sequence[PiecewiseLinear] | CurveStack,
    *,
    rule: Rule = "paper",
) -> Array:
    """The paper's requests for curves that are known already, all in one pass over arrays.

    This is :func:`planner.invert_closed_form` without the search for lines: each line is raised by
    its C_m and gives way to the next l + a/2 before the curve turns. Time and memory: O(m (n + s))
    for m curves of s lines; no loop in Python goes over curves, lines or samples.

    Args:
        model: The joint; a curve's samples are ``model.period`` apart.
        curves: One curve, several of the same number of knots, or a :class:`planner.CurveStack`,
            which takes m sets of knots and values as arrays. Slopes within ±v_max.
        rule: How to invert a line, see :func:`planner.line_offset`.

    Returns:
        Requests [rad], shape (n,) for one curve, (m, n) for several or a stack.

    Raises:
        InvalidInput: A slope is beyond ±v_max, the curves do not fit together or to the joint, or
            the rule has another name.

    Example:
        >>> stack = CurveStack(knots=knots, values=values, samples=88, tick=0.008, cyclic=True)
        >>> requests = closed_form_requests(model, stack)
    """
    model = checked_model(model)
    check_rule(rule, model)
    if isinstance(curves, CurveStack):
        stack = curves
    else:
        stack = CurveStack.of([curves] if isinstance(curves, PiecewiseLinear) else curves)
    requests = _checked_requests(model, stack, rule)
    requests.setflags(write=False)
    one: Array = requests[0]
    return one if isinstance(curves, PiecewiseLinear) else requests


def _checked_requests(model: JointModel, stack: CurveStack, rule: Rule) -> Array:
    if abs(stack.tick - model.period) > SAME_PERIOD * model.period:
        raise InvalidInput(
            f"curves: got samples every {stack.tick:g} s, expected every {model.period:g} s, as "
            "often as requests are sent"
        )
    steepest = np.max(np.abs(stack.slopes), axis=1)
    if not np.all(steepest <= model.v_max * (1.0 + AT_TOP_SPEED)):
        row = int(np.argmax(steepest))
        raise InvalidInput(
            f"curves: got {steepest[row]:g} rad/s in curve {row}, expected slopes within ±v_max = "
            f"±{model.v_max:g} rad/s; no request makes the joint follow a steeper line"
        )
    return requests_of(model, stack, rule=rule)


def requests_of(
    model: JointModel,
    stack: CurveStack,
    *,
    rule: Rule,
) -> Array:
    """The inverted lines of every curve, each until l + a/2 before the next [rad], (m, n)."""
    ahead = switching_time(model) / model.period  # [samples]
    slopes = np.clip(stack.slopes, -model.v_max, model.v_max)
    per_sample = slopes * stack.tick
    knots, values = stack.knots[:, : slopes.shape[1]], stack.values[:, : slopes.shape[1]]
    first = np.ceil(knots - ahead - SAME_TIME)  # request from which on a line counts, any cycle
    raised = values + offsets_of(model, slopes, rule=rule)
    at_first = raised + per_sample * (first - knots)
    line = lines_in_force(first.astype(np.intp), stack.samples, cyclic=stack.cyclic)
    since = np.arange(stack.samples) - np.take_along_axis(first, line, axis=1)
    if stack.cyclic:
        since = np.mod(since, stack.samples)
    requests = np.take_along_axis(per_sample, line, axis=1) * since
    requests += np.take_along_axis(at_first, line, axis=1)
    return np.asarray(requests)


def switching_time(model: JointModel) -> float:
    """How long before the angles the requests change from line to line: l + a/2 [s].

    A request that is held acts (hold - 1) / 2 ticks later on average than the line it stands for.
    """
    return model.lag + model.acceleration_time / 2.0 + (model.hold - 1) / 2.0 * model.tick
