"""The inverse of a line: C_m of Section 4.2, by the paper's rule and exactly."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, OutsideEquation13
from planner.model.joint import JointModel, checked_model
from planner.model.response import advance
from planner.trajectory import Array
from planner.validation import is_one_of, shown

Rule = Literal["paper", "exact"]

RULES: tuple[Rule, ...] = ("paper", "exact")

AT_TOP_SPEED = 1e-12
"""A slope this close to v_max, relative to it, counts as v_max."""

SOLVED = 1e-15
"""The exact rule is solved when the speed agrees with the slope to this, relative to v_max."""

TABLE = 513
"""Slopes from 0 to v_max at which C_m is tabulated."""

MOST_EVALUATIONS = 200
"""Halving an interval of doubles more often than this changes nothing."""


def line_offset(model: JointModel, slope: npt.ArrayLike, *, rule: Rule = "exact") -> float | Array:
    """What must be added to a line to get the requests that make the joint follow it: C_m.

    ``exact`` solves S(C) = m (Equation 6, with the model's own window), which is piecewise linear
    and monotone, so that the joint follows the line without a steady error; at v_max, where every C
    from some threshold on solves it, the threshold is taken. ``paper`` is Equations 10 to 12, which
    replace the sum in S by an integral; at v_max they give the threshold theta_0 + (l + a) v_max.

    With ``hold`` > 1 the requests are the line at the instants of the requests; with an ``offset``
    the answer is C_m - offset, so that in every case requests = line + line_offset.

    Args:
        model: The joint.
        slope: Slope m of the desired line [rad/s], scalar or array, |m| <= v_max.
        rule: "exact" or "paper".

    Returns:
        Offset [rad], a float for a scalar slope, else an array like ``slope``.

    Raises:
        InvalidInput: A slope is beyond ±v_max or not finite, or the rule has another name.

    Warns:
        OutsideEquation13: The paper's rule is asked for a model for which it was not derived.
    """
    model = checked_model(model)
    check_rule(rule, model)
    try:
        given = np.asarray(slope)
    except ValueError:  # rows of different lengths
        given = np.asarray("ragged")
    if given.dtype.kind not in "iuf":
        raise InvalidInput(f"slope: got {shown(slope)}, expected a number or an array [rad/s]")
    slopes = given.astype(np.float64)
    beyond = ~(np.abs(slopes) <= model.v_max * (1.0 + AT_TOP_SPEED))
    if np.any(beyond):
        raise InvalidInput(
            f"slope: got {slopes[beyond].flat[0]:g} rad/s, expected within ±v_max = "
            f"±{model.v_max:g} rad/s; no request makes the joint follow a steeper line"
        )
    offsets = offsets_of(model, slopes, rule=rule)
    offsets.setflags(write=False)
    return float(offsets) if slopes.ndim == 0 else offsets


def offsets_of(model: JointModel, slopes: Array, *, rule: Rule) -> Array:
    """:func:`line_offset` of slopes within ±v_max [rad/s], without a warning: like ``slopes``."""
    per_tick = np.minimum(np.abs(slopes) * model.tick, model.v_max_per_tick)
    solve = _exact if rule == "exact" else _paper
    lead = solve(model, per_tick.ravel()).reshape(slopes.shape)
    return np.asarray(np.sign(slopes) * lead - model.offset)


def interpolated_offset(model: JointModel, slope: Array, *, rule: Rule) -> Array:
    """:func:`line_offset` from a table, for searches: fast, and good to some 1e-5 of theta_0."""
    slopes, offsets = _table(model, rule)
    interpolated: Array = np.interp(slope, slopes, offsets)
    return interpolated


@lru_cache(maxsize=32)
def _table(model: JointModel, rule: Rule) -> tuple[Array, Array]:
    """Slopes [rad/s], dense towards ±v_max where C_m is steepest, and their offsets [rad]."""
    positive = model.v_max * (1.0 - np.linspace(1.0, 0.0, TABLE) ** 2)
    slopes = np.concatenate([-positive[:0:-1], positive])
    return slopes, offsets_of(model, slopes, rule=rule)


def check_rule(rule: str, model: JointModel) -> None:
    """Raise InvalidInput unless ``rule`` is the name of a rule; warn where it was not derived."""
    if not is_one_of(rule, RULES):
        raise InvalidInput(
            f"rule: got {shown(rule)}, expected one of {', '.join(map(repr, RULES))}"
        )
    if rule == "paper" and not model.keeps_equation_13:
        warnings.warn(
            "the paper's rule assumes theta_0 > v_max and 4 theta_0 > v_max a (Equation 13), which "
            f"this joint breaks: theta_0 = {model.theta_0:.4g} rad, "
            f"v_max = {model.v_max_per_tick:.4g} rad/tick, "
            f"a = {model.acceleration_ticks:.4g} ticks; rule='exact' holds for every joint",
            OutsideEquation13,
            stacklevel=3,
        )


def _paper(model: JointModel, slope: Array) -> Array:
    """Equations 10 to 12 for slopes m >= 0 [rad/tick]."""
    v_max, theta_0 = model.v_max_per_tick, model.theta_0
    lag, acceleration = model.lag_ticks, model.acceleration_ticks
    proportional = slope * (theta_0 / v_max + acceleration / 2.0) < theta_0  # (10)
    below = slope * (theta_0 / v_max + lag + acceleration / 2.0)  # (11)
    root = np.sqrt(2.0 * theta_0 * slope * acceleration * (v_max - slope) / v_max)
    above = theta_0 + slope * (lag + acceleration) - root  # (12), m taken under the root
    # A held request is older by (hold - 1) / 2 ticks on average.
    return np.where(proportional, below, above) + slope * (model.hold - 1) / 2.0


def _exact(model: JointModel, slope: Array) -> Array:
    """The smallest C with S(C) = m for slopes m >= 0 [rad/tick]."""
    ages = model.window.first + np.arange(len(model.window.weights))
    ticks = np.arange(model.hold)  # the ticks between two requests
    # Where the held line stands, at each tick and age, relative to the angle of the line there.
    steps = np.floor_divide(ticks[:, np.newaxis] + 1 - ages, model.hold) * model.hold
    behind = float(np.max(ticks[:, np.newaxis] - steps))
    target = slope * model.hold
    # At these ends every term of S is saturated, even though the joint may stray from the line
    # until the next request.
    low = -model.theta_0 - (model.v_max_per_tick + slope) * (model.hold - 1)
    high = model.theta_0 + slope * behind + (model.v_max_per_tick - slope) * (model.hold - 1)
    moved_low, moved_high = _moved(model, slope, steps, low), _moved(model, slope, steps, high)
    solution = high.copy()
    open_ = slope < model.v_max_per_tick * (1.0 - AT_TOP_SPEED)
    for evaluation in range(MOST_EVALUATIONS):
        if not np.any(open_):
            break
        span = moved_high - moved_low
        share = np.where(span > 0.0, (target - moved_low) / np.where(span > 0.0, span, 1.0), 0.5)
        # Every third time the interval is halved, in case the secant moves one end only.
        share = share if evaluation % 3 else np.full_like(share, 0.5)
        middle = low + np.clip(share, 0.0, 1.0) * (high - low)
        moved = _moved(model, slope, steps, middle)
        solution = np.where(open_, middle, solution)
        open_ &= np.abs(moved - target) > SOLVED * model.v_max_per_tick * model.hold
        open_ &= high - low > 0.0
        low, moved_low = (
            np.where(moved < target, middle, low),
            np.where(moved < target, moved, moved_low),
        )
        high, moved_high = (
            np.where(moved < target, high, middle),
            np.where(moved < target, moved_high, moved),
        )
    return solution


def _moved(model: JointModel, slope: Array, steps: npt.NDArray[np.int_], offset: Array) -> Array:
    """How far the joint moves in one request period when it is ``offset`` behind the line."""
    angle = np.zeros_like(slope)
    for held in steps:
        angle = advance(
            angle,
            [offset + slope * step for step in held],
            weights=model.window.weights.tolist(),
            gain=model.gain_per_tick,
            v_max=model.v_max_per_tick,
        )
    moved: Array = angle
    return moved
