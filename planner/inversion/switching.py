"""From lines to requests: each line raised by its C_m, and in force l + a/2 early (Section 4.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.stack import CurveStack, lines_in_force
from planner.exceptions import InvalidInput
from planner.inversion.line import AT_TOP_SPEED, Rule, check_rule, line_offset
from planner.model.joint import JointModel, checked_model
from planner.trajectory import Array

SAME_TIME = 1e-9
"""How much later than a request a line may begin and still count for it [samples]: rounding."""

SAME_PERIOD = 1e-9
"""Difference of the curve's tick from the joint's period that is rounding, relative."""


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
    check_rule(rule)
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
    offset_of: Callable[..., float | Array] = line_offset,
) -> Array:
    """The inverted lines of every curve, each until l + a/2 before the next [rad], (m, n)."""
    ahead = switching_time(model) / model.period  # [samples]
    slopes = np.clip(stack.slopes, -model.v_max, model.v_max)
    per_sample = slopes * stack.tick
    knots, values = stack.knots[:, : slopes.shape[1]], stack.values[:, : slopes.shape[1]]
    first = np.ceil(knots - ahead - SAME_TIME)  # request from which on a line counts, any cycle
    raised = values + np.asarray(offset_of(model, slopes, rule=rule))
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
