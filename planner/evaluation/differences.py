"""Where along a trajectory two plans request different things, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
from planner.planning.closed_form import switching_time
from planner.planning.result import Inversion
from planner.trajectory import Array, index_of_largest, rms

Reason = Literal["saturated", "limit", "at_rest", "corner", "averaged", "line", "free", "after_end"]

REASONS: Mapping[Reason, str] = {
    "saturated": "the joint moves at v_max when the request acts: any larger one does the same",
    "limit": "the optimised request lies at a limit, of which the closed form knows nothing",
    "at_rest": "the joint is at rest under both plans: any request within its dead band holds it",
    "corner": "a knot of the approximation is near, where the closed form changes its line at once",
    "averaged": "the angles differ by less than a quarter of the requests: the joint averages them",
    "line": "the closed form follows its straight line, which is not on the desired path",
    "free": "none of the others",
    "after_end": "nothing that the request does happens before the last sample",
}
"""Why two plans may differ in a request; where several hold, the first one counts."""

AT_TOP_SPEED = 1e-3
"""A joint this close to v_max, relative to it, moves at v_max: a sample behind after a thousand."""

AT_LIMIT = 1e-9
"""A request this close to a limit [rad] is at the limit: rounding of degrees, no more."""

AT_REST = 1e-6
"""A joint that moves slower than this, relative to v_max, is at rest."""

AVERAGED = 0.25
"""Angles that differ by a smaller share than this of the requests are about the same."""

FROM_LINE = 2.0
"""Requests of a line differ from those of the path by at most so many times their distance."""

ALIKE = 1e-2
"""Errors closer than this, relative to the larger, are the same: neither plan tracks better."""


@dataclass(frozen=True)
class Interval:
    """Successive requests that differ for one reason.

    Attributes:
        reason: Why.
        start: First request.
        end: Last request; in a cycle it may come before the first.
        samples: Number of requests.
        share: Their share of the squared difference of all requests.
        closed_form_rms: Error of the closed form where these requests act [rad].
        optimal_rms: Error of the optimised plan there [rad].
    """

    reason: Reason
    start: int
    end: int
    samples: int
    share: float
    closed_form_rms: float
    optimal_rms: float

    @property
    def better(self) -> Literal["closed_form", "optimal", "neither"]:
        """Which plan tracks better where these requests act."""
        smaller, larger = sorted((self.closed_form_rms, self.optimal_rms))
        if larger - smaller <= ALIKE * larger:
            return "neither"
        return "optimal" if self.optimal_rms == smaller else "closed_form"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, angles in degrees."""
        return {
            "reason": self.reason,
            "start": self.start,
            "end": self.end,
            "samples": self.samples,
            "share": self.share,
            "closed_form_rms_deg": math.degrees(self.closed_form_rms),
            "optimal_rms_deg": math.degrees(self.optimal_rms),
            "better": self.better,
        }


@dataclass(frozen=True)
class Difference:
    """How far the requests of a closed form are from the optimised ones.

    Attributes:
        rms: Root mean square of the difference [rad].
        largest: Largest difference [rad].
        largest_at: The request where it is.
        intervals: Where and why, in the order of time; together they cover every request once.
    """

    rms: float
    largest: float
    largest_at: int
    intervals: tuple[Interval, ...]

    @property
    def shares(self) -> dict[Reason, float]:
        """Share of each reason in the squared difference, for those that occur."""
        found: dict[Reason, float] = {}
        for reason in REASONS:
            shares = [each.share for each in self.intervals if each.reason == reason]
            if shares:
                found[reason] = sum(shares)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, angles in degrees."""
        return {
            "rms_deg": math.degrees(self.rms),
            "largest_deg": math.degrees(self.largest),
            "largest_at": self.largest_at,
            "shares": dict(self.shares),
            "intervals": [interval.to_dict() for interval in self.intervals],
        }


def difference(closed_form: Inversion, optimal: Inversion) -> Difference:
    """Compare two plans for the same joint and the same desired angles.

    A request is judged where it acts: l + a/2 after it is sent.

    Args:
        closed_form: A plan with an approximation behind it.
        optimal: An optimised plan.
    """
    reasons = classify(closed_form, optimal)
    acts = _acts_at(optimal)
    apart = closed_form.requests - optimal.requests
    squared = apart**2
    total = float(np.sum(squared))
    intervals = []
    for first, samples in runs(reasons, cyclic=optimal.cyclic):
        indices = (first + np.arange(samples)) % len(apart)
        where = acts[indices]
        where = where[where < len(apart)]
        intervals.append(
            Interval(
                reason=reasons[first],
                start=first,
                end=int(indices[-1]),
                samples=samples,
                share=float(np.sum(squared[indices])) / total if total > 0.0 else 0.0,
                closed_form_rms=rms(closed_form.errors[where]),
                optimal_rms=rms(optimal.errors[where]),
            )
        )
    return Difference(
        rms=rms(apart),
        largest=float(np.max(np.abs(apart))),
        largest_at=index_of_largest(np.abs(apart)),
        intervals=tuple(intervals),
    )


def classify(closed_form: Inversion, optimal: Inversion) -> list[Reason]:
    """The reason why each request may differ, one of :data:`REASONS` per request."""
    acts = _acts_at(optimal)
    inside = acts < len(acts)
    there = np.where(inside, acts, 0)
    at_top = (_at_top_speed(closed_form) | _at_top_speed(optimal))[there]
    near = _near_corner(closed_form)[there]
    holds: dict[Reason, npt.NDArray[np.bool_]] = {
        "saturated": inside & at_top,
        "limit": inside & _at_limit(optimal),
        "at_rest": inside & (_is_at_rest(closed_form) & _is_at_rest(optimal))[there],
        "corner": inside & near,
        "free": inside,
        "after_end": ~inside,
    }
    names = list(holds)
    first = np.argmax(np.stack(list(holds.values())), axis=0)
    reasons = [names[number] for number in first]
    for start, samples in runs(reasons, cyclic=optimal.cyclic):
        if reasons[start] == "free":
            indices = (start + np.arange(samples)) % len(reasons)
            reason = _reason_between(closed_form, optimal, indices, acts[indices])
            for k in indices.tolist():
                reasons[k] = reason
    return reasons


def _reason_between(
    closed_form: Inversion,
    optimal: Inversion,
    requests: npt.NDArray[np.int_],
    acts: npt.NDArray[np.int_],
) -> Reason:
    """The reason of successive requests that are neither saturated nor near a limit or corner.

    Args:
        closed_form: A plan with an approximation behind it.
        optimal: An optimised plan.
        requests: The requests.
        acts: The samples at which they act.
    """
    apart = rms((closed_form.requests - optimal.requests)[requests])
    if rms((closed_form.predicted - optimal.predicted)[acts]) < AVERAGED * apart:
        return "averaged"
    curve = closed_form.approximation
    if curve is None or apart == 0.0:
        return "free"
    line = curve(acts.astype(np.float64))
    off_path = rms(line - closed_form.desired[acts])
    explained = apart <= FROM_LINE * off_path
    on_line = rms(closed_form.predicted[acts] - line) < off_path
    gains = rms(optimal.errors[acts]) < rms(closed_form.errors[acts])
    return "line" if explained and on_line and gains else "free"


def runs(reasons: list[Reason], *, cyclic: bool) -> list[tuple[int, int]]:
    """First index and length of every run of equal reasons; one may cross a cycle's boundary."""
    count = len(reasons)
    first = [k for k in range(count) if (cyclic or k > 0) and reasons[k] != reasons[k - 1]]
    if not cyclic:
        first = [0, *first]
    if not first:
        return [(0, count)]
    ends = [*first[1:], first[0] + count if cyclic else count]
    return [(start, end - start) for start, end in zip(first, ends, strict=True)]


def _acts_at(plan: Inversion) -> npt.NDArray[np.int_]:
    """The sample that each request moves the most; n for those that move none before the end."""
    model, count = plan.model, len(plan.requests)
    samples = np.arange(count)
    middle = np.floor(samples + switching_time(model) / model.period + 0.5).astype(np.int_)
    if plan.cyclic:
        return np.asarray(np.mod(middle, count))
    earliest = samples * model.hold + model.window.first  # [ticks]
    late = earliest > (count - 1) * model.hold
    return np.where(late, count, np.minimum(middle, count - 1))


def _at_top_speed(plan: Inversion) -> npt.NDArray[np.bool_]:
    """Whether the joint moves at its top speed all the way to each sample."""
    speeds = _speeds(plan)
    low, high = plan.model.speed_limits(0.0 if plan.load is None else plan.load)
    near = 1.0 - AT_TOP_SPEED
    return np.asarray((speeds >= near * high) | (speeds <= near * low))


def _is_at_rest(plan: Inversion) -> npt.NDArray[np.bool_]:
    """Whether the joint rests in its dead band all the way to each sample."""
    if plan.model.dead_band == 0.0:
        return np.zeros(len(plan.requests), dtype=np.bool_)
    return np.asarray(np.abs(_speeds(plan)) <= AT_REST * plan.model.v_max)


def _speeds(plan: Inversion) -> Array:
    """Mean speed on the way to each sample [rad/s], shape (n,)."""
    before = np.roll(plan.predicted, 1)
    if not plan.cyclic:
        before[0] = plan.predicted[0] if plan.start is None else plan.start
    return np.asarray((plan.predicted - before) / plan.model.period)


def _at_limit(plan: Inversion) -> npt.NDArray[np.bool_]:
    if plan.limits is None:
        return np.zeros(len(plan.requests), dtype=np.bool_)
    lower, upper = plan.limits
    return (plan.requests <= lower + AT_LIMIT) | (plan.requests >= upper - AT_LIMIT)


def _near_corner(closed_form: Inversion) -> npt.NDArray[np.bool_]:
    """Whether a corner of the approximation is within the acceleration time of each sample."""
    curve = closed_form.approximation
    samples = np.arange(len(closed_form.requests), dtype=np.float64)
    if curve is None or curve.segments == 1:
        return np.zeros(len(samples), dtype=np.bool_)
    corners = _corners(curve)
    after = np.searchsorted(corners, samples)
    away = np.minimum(samples - corners[after - 1], corners[after] - samples)
    reach = closed_form.model.acceleration_time / closed_form.model.period
    return np.asarray(away <= reach)


def _corners(curve: PiecewiseLinear) -> Array:
    """Knots at which one line gives way to another, around every sample, increasing."""
    if not curve.cyclic:  # the ends are no corners
        return np.concatenate([[-np.inf], curve.knots[1:-1], [np.inf]])
    within = np.sort(np.mod(curve.knots, curve.samples))
    return np.concatenate([[within[-1] - curve.samples], within, [within[0] + curve.samples]])
