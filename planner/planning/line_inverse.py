"""The inverse of a line: C_m of Section 4.2, by the paper's rule and exactly."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, as_reals, check_choice, shown
from planner.exceptions import InvalidInput, OutsideEquation13, angle_text
from planner.model.joint import JointModel, acting_requests, checked_model
from planner.model.law import Law
from planner.model.response import checked_load

Rule = Literal["paper", "exact"]

RULES: tuple[Rule, ...] = ("paper", "exact")

AT_TOP_SPEED = 1e-12
"""A slope this close to v_max, relative to it, counts as v_max."""

LEAST_SHARE = 0.05
"""Least top speed with gravity for an inverse [v_max]: below it the joint hardly moves in that
direction, and no request makes it follow the line."""


def line_offset(
    model: JointModel,
    slope: npt.ArrayLike,
    *,
    rule: Rule = "exact",
    load: npt.ArrayLike | None = None,
) -> float | Array:
    """Offset of the requests from a line that the joint should follow: C_m.

    ``exact`` solves S(C) = m (Equation 6, with the model's own window), which is piecewise linear
    and monotone, so that the joint follows the line without a steady error; at its top speed, where
    every C from some threshold on solves it, C is the threshold. ``paper`` is Equations 10 to 12,
    which replace the sum in S by an integral; at v_max they give theta_0 + (l + a) v_max.

    A dead band adds its half width in the direction of the slope; a slope of 0 is held in its
    middle. With ``hold`` > 1 the requests are the line at the instants of the requests; with an
    ``offset`` and a load the answer is C_m less the sag, so that in every case requests = line +
    line_offset.

    Args:
        model: The joint.
        slope: Slope m of the desired line [rad/s], scalar or array, within the joint's speeds in
            either direction, :meth:`planner.JointModel.speed_limits`.
        rule: "exact" or "paper".
        load: Torque on the joint in the direction of positive angles [N m], a number or an array
            like ``slope``.

    Returns:
        Offset [rad], a float for a scalar slope, else an array like ``slope``.

    Raises:
        InvalidInput: A slope is beyond the speeds of the joint or not finite, the load does not fit
            the slopes or the joint, or the rule has another name.

    Warns:
        OutsideEquation13: The paper's rule was not derived for the model.

    Example:
        >>> import numpy as np
        >>> joint = JointModel.ers210a()
        >>> float(np.degrees(line_offset(joint, 2.0)).round(2))  # requests ahead of the line [deg]
        8.53
    """
    model = checked_model(model)
    check_rule(rule, model)
    expected = "a number or an array [rad/s]"
    try:
        slopes = as_reals(slope)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"slope: got {shown(slope)}, expected {expected}") from error
    try:
        each = np.broadcast_to(np.asarray(0.0 if load is None else load), slopes.shape).ravel()
    except ValueError as error:
        raise InvalidInput(
            f"load: got {shown(load)}, expected a torque [N m], or one for every slope"
        ) from error
    felt = checked_load(each, model, slopes.size)
    torques = np.zeros(slopes.shape) if felt is None else felt.reshape(slopes.shape)
    low, high = model.speed_limits(torques)
    rounding = model.v_max * AT_TOP_SPEED
    beyond = ~((slopes <= high + rounding) & (slopes >= low - rounding))
    if np.any(beyond):
        steep, least, most = (float(limits[beyond].flat[0]) for limits in (slopes, low, high))
        raise InvalidInput(
            f"slope: got {angle_text(steep)}/s, expected {slopes_text(least, most)}; no request "
            "makes the joint follow a steeper line"
        )
    offsets = offsets_of(model, slopes, rule=rule, load=torques)
    offsets.setflags(write=False)
    return float(offsets) if slopes.ndim == 0 else offsets


def offsets_of(
    model: JointModel,
    slopes: Array,
    *,
    rule: Rule,
    load: npt.ArrayLike = 0.0,
    angle: Array | None = None,
) -> Array:
    """:func:`line_offset` of slopes within the joint's speeds [rad/s], without a warning.

    At an ``angle`` gravity changes the top speeds; its sag is not part of the offsets.
    """
    sign, steady = np.sign(slopes), model.steady
    upwards = model.v_offset + model.top_speed_per_torque * np.asarray(load, dtype=np.float64)
    if angle is not None and model.most_pose_sag > 0.0:
        upwards = _limits_at(model, load, angle)[1] - model.v_max
    faster = sign * upwards  # the top speed in the direction of a slope less v_max [rad/s]
    # one number serves all slopes, where it can
    excess = np.broadcast_to(faster, slopes.shape).ravel() * model.tick if np.any(faster) else 0.0
    per_tick = np.minimum(np.abs(slopes).ravel() * model.tick, model.v_max_per_tick + excess)
    lead = (_exact if rule == "exact" else _paper)(steady, per_tick, excess).reshape(slopes.shape)
    return np.asarray(sign * lead - model.sag(load))


def interpolated_offset(
    model: JointModel,
    slope: Array,
    *,
    rule: Rule,
    load: npt.ArrayLike = 0.0,
    angle: Array | None = None,
) -> Array:
    """:func:`offsets_of` from a table, for searches: fast, and good to some 1e-5 of theta_0.

    The table is for the joint without a load. Where a load changes the top speed by the factor s,
    f(delta + s x) becomes s f(delta + x), so that C_m - delta of the slope m becomes s times its
    value at m / s, as long as no error in the window is below delta.
    """
    model = model.steady
    table = offset_table(model, rule)
    by_pose = angle is not None and model.most_pose_sag > 0.0
    if model.top_speed_per_torque == 0.0 and not by_pose:
        by_load = 0.0 if model.has_integral else model.compliance * np.asarray(load)
        return np.asarray(np.interp(slope, *table) - by_load)
    limits = _limits_at(model, load, angle)
    down, up = model.speed_limits()
    scale = np.where(slope < 0.0, limits[0] / down, limits[1] / up)
    band = np.sign(slope) * model.dead_band
    beyond = np.interp(slope / scale, *table) + model.offset - band
    return np.asarray(band + scale * beyond - model.sag(load))


def _limits_at(model: JointModel, load: npt.ArrayLike, angle: Array | None) -> tuple[Array, Array]:
    """Least and largest speed [rad/s], a share of v_max at least where gravity is stronger."""
    low, high = model.speed_limits(load, angle)
    if angle is None or model.most_pose_sag == 0.0:
        return low, high
    least = LEAST_SHARE * model.v_max
    most = 2.0 * model.v_max - least
    return np.clip(low, -most, -least), np.clip(high, least, most)


def slope_limits(model: JointModel, load: Array) -> tuple[float, float]:
    """Least and largest slope that a joint can follow at every sample, without gravity [rad/s]."""
    low, high = model.speed_limits(load)
    return float(np.max(low)), float(np.min(high))


def slopes_text(low: float, high: float) -> str:
    """The slopes from ``low`` to ``high`` [rad/s] in words."""
    if -low == high:
        return f"within ±v_max = ±{angle_text(high)}/s"
    return f"from {angle_text(low)}/s to {angle_text(high)}/s"


def advanced(values: Array, ahead: float, *, cyclic: bool) -> Array:
    """The values ``ahead`` samples later, on straight lines between them, shape (n,).

    Of a load that is when each request acts on average.
    """
    samples = np.arange(len(values))
    period = len(values) if cyclic else None
    later: Array = np.interp(samples + ahead, samples, values, period=period)
    return later


@lru_cache(maxsize=32)
def offset_table(model: JointModel, rule: Rule) -> tuple[Array, Array]:
    """Slopes [rad/s], dense towards top speed where C_m is steepest, and their offsets [rad]."""
    shares = 1.0 - np.linspace(1.0, 0.0, 513) ** 2
    if model.steady.dead_band:  # C_m jumps at 0
        shares = np.insert(shares, 1, 1e-9)
    low, high = model.speed_limits()
    slopes = np.concatenate([float(low) * shares[:0:-1], float(high) * shares])
    return slopes, offsets_of(model, slopes, rule=rule)


def check_rule(rule: str, model: JointModel, *, stacklevel: int = 3) -> None:
    """Raise InvalidInput unless ``rule`` is the name of a rule; warn where it was not derived."""
    check_choice("rule", rule, RULES)
    if rule == "paper" and not model.keeps_equation_13:
        warnings.warn(
            "the paper's rule assumes theta_0 > v_max and 4 theta_0 > v_max a (Equation 13), which "
            f"this joint breaks: theta_0 = {model.theta_0:.4g} rad, "
            f"v_max = {model.v_max_per_tick:.4g} rad/tick, "
            f"a = {model.acceleration_ticks:.4g} ticks; rule='exact' holds for every joint",
            OutsideEquation13,
            stacklevel=stacklevel,
        )


def _paper(model: JointModel, slope: Array, excess: Array | float) -> Array:
    """Equations 10 to 12 for slopes m >= 0 [rad/tick], beyond the dead band.

    v_max and theta_0 depend on the direction: v_max plus ``excess`` [rad/tick], and theta_0 larger
    by the same factor, so that v_max / theta_0 is the joint's own.
    """
    v_max = model.v_max_per_tick + excess
    theta_0 = model.theta_0 * (v_max / model.v_max_per_tick)
    lag, acceleration = model.lag_ticks, model.acceleration_ticks
    proportional = slope * (theta_0 / v_max + acceleration / 2.0) < theta_0  # (10)
    below = slope * (theta_0 / v_max + lag + acceleration / 2.0)  # (11)
    root = np.sqrt(2.0 * theta_0 * slope * acceleration * (v_max - slope) / v_max)
    above = theta_0 + slope * (lag + acceleration) - root  # (12), m moved under the root
    # A held request is older by (hold - 1) / 2 ticks on average.
    lead = np.where(proportional, below, above) + slope * (model.hold - 1) / 2.0
    return np.asarray(lead + model.dead_band)


def _exact(model: JointModel, slope: Array, excess: Array | float) -> Array:
    """The smallest C with S(C) = m for slopes m >= 0 [rad/tick].

    The top speed is v_max plus ``excess`` [rad/tick] in the direction of the slope, and v_max less
    ``excess`` in the other.
    """
    from planner.model import kernel

    acting = acting_requests(model)
    law = Law(model.law.gain, model.law.top, model.law.friction)  # without inertia
    target = slope * model.hold
    faster = np.broadcast_to(np.asarray(excess, dtype=np.float64), slope.shape).copy()
    forth, back = model.v_max_per_tick + faster, model.v_max_per_tick - faster
    # At these ends every term of S is saturated, even though the joint may stray from the line
    # until the next request.
    low = -model.theta_0 * (back / model.v_max_per_tick) - model.dead_band
    low = low - (back + slope) * (model.hold - 1)
    behind = model.window.last + model.hold - 2  # ticks by which the oldest request is, at most
    high = model.theta_0 * (forth / model.v_max_per_tick) + model.dead_band + slope * behind
    high = high + (forth - slope) * (model.hold - 1)

    def moved_by(offset: Array) -> Array:
        lines = (slope, offset, faster)
        return kernel.moved_along_lines(law, acting.weights[0], acting.youngest, *lines)

    moved_low, moved_high = moved_by(low), moved_by(high)
    solution = high.copy()
    open_ = slope < forth * (1.0 - AT_TOP_SPEED)
    for evaluation in range(200):  # halvings of an interval of doubles: more change nothing
        if not np.any(open_):
            break
        span = moved_high - moved_low
        share = np.where(span > 0.0, (target - moved_low) / np.where(span > 0.0, span, 1.0), 0.5)
        # Every third time the interval is halved, in case the secant moves one end only.
        share = share if evaluation % 3 else np.full_like(share, 0.5)
        middle = low + np.clip(share, 0.0, 1.0) * (high - low)
        moved = moved_by(middle)
        solution = np.where(open_, middle, solution)
        open_ &= np.abs(moved - target) > 1e-15 * model.v_max_per_tick * model.hold
        open_ &= high - low > 0.0
        below = moved < target
        low, moved_low = np.where(below, middle, low), np.where(below, moved, moved_low)
        high, moved_high = np.where(below, high, middle), np.where(below, moved_high, moved)
    return solution
