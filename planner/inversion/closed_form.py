"""The paper's inversion: the inverses of the lines of an approximation, joined (Section 4.3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.fit import fit_pwl
from planner.approximation.stack import CurveStack
from planner.given import as_flag
from planner.inversion.line import Rule, check_rule, line_offset
from planner.inversion.refinement import MOST_WORK, refined_curve
from planner.inversion.result import Inversion
from planner.inversion.switching import requests_of, switching_time
from planner.inversion.tracking import Tracking, follow
from planner.model.joint import JointModel, checked_model
from planner.trajectory import Array, as_trajectory

MORE_LINES = 2
"""Lines that are tried beyond those that the approximation needs by itself."""

WORTH_MORE = 0.995
"""Tracking error, relative to that of fewer lines, that is worth more of them."""


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

    The wanted trajectory is approximated by a piecewise linear one within ±v_max, each line is
    raised by its C_m (Section 4.2), and the requests change from one line to the next l + a/2
    before the approximation does (Section 4.3), at the true time, be it between two requests.

    From rest the joint rests at the first desired angle until the plan begins.

    Args:
        model: The joint.
        desired: Wanted angles [rad], shape (n,), one every ``model.period``.
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
        InvalidInput: The rule or the number of segments is none.
        SolverFailed: The approximation was not found.
    """
    model = checked_model(model)
    check_rule(rule)
    desired = as_trajectory(desired, name="desired", minimum=3)
    cyclic, refine = as_flag("cyclic", cyclic), as_flag("refine", refine)
    start = None if cyclic else float(desired[0])
    problem = follow(model, desired, cyclic=cyclic, start=start)
    curve, column = closed_form(
        problem, desired, segments=segments, rule=rule, refining=MOST_WORK if refine else 0
    )
    more = curve.segments + MORE_LINES
    if refine and segments is None and more <= desired.size - (not cyclic):
        other = closed_form(problem, desired, segments=more, rule=rule, refining=MOST_WORK)
        if problem.exact_error(other[1]) < WORTH_MORE * problem.exact_error(column):
            curve, column = other
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


def closed_form(
    problem: Tracking,
    desired: Array,
    *,
    segments: int | None = None,
    rule: Rule,
    refining: int,
) -> tuple[PiecewiseLinear, Array]:
    """The approximation and the requests of a joint's closed form.

    Args:
        problem: One joint that should follow the desired angles, and within which limits.
        desired: The desired angles [rad], shape (n,).
        segments: Number of lines; None for an automatic choice.
        rule: How to invert a line.
        refining: Samples to simulate at most while the approximation is refined; 0 not to refine.

    Returns:
        The piecewise linear approximation, and the admissible requests [rad], shape (n, 1).
    """
    (model,) = problem.models
    curve: PiecewiseLinear = fit_pwl(
        desired,
        v_max=model.v_max,
        tick=model.period,
        cyclic=problem.cyclic,
        segments=segments,
    )
    requests = problem.admissible(requests_along(model, curve, rule=rule)[:, np.newaxis])
    if refining:
        ahead = switching_time(model) / model.period
        refined = refined_curve(problem, curve, rule=rule, ahead=ahead, most_work=refining)
        answer = problem.admissible(requests_along(model, refined, rule=rule)[:, np.newaxis])
        if problem.exact_error(answer) < problem.exact_error(requests):
            curve, requests = refined, answer
    return curve, requests


def requests_along(
    model: JointModel,
    curve: PiecewiseLinear,
    *,
    rule: Rule,
    offset_of: Callable[..., float | Array] = line_offset,
) -> Array:
    """The inverted lines of one curve, each until l + a/2 before the next begins [rad], (n,)."""
    requests: Array = requests_of(model, CurveStack.of([curve]), rule=rule, offset_of=offset_of)[0]
    return requests
