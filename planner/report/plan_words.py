"""What a plan for any joints amounts to, in sentences and figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from planner.evaluation.plan_outcome import PlanOutcome
    from planner.trajectory import Array

AT_LIMIT = math.radians(1e-6)
"""A request this close to a limit is at it [rad]."""

ROUNDING = 1e-12
"""What the division by a decimal step may add to a quotient, as a share of it."""


class Size(NamedTuple):
    """Errors of one kind, in the unit they are told in.

    Attributes:
        rms: Root mean square.
        largest: The largest.
    """

    rms: float
    largest: float


class JointRow(NamedTuple):
    """A row of the table of joints.

    Attributes:
        name: The joint.
        planned: Its error under the plan [deg].
        direct: Its error without [deg].
        bound: What no requests can go below [deg], or None.
        gap: How far the plan is above that, or None.
        speed: Largest speed on the desired path [deg/s].
        top_speed: What the joint can do [deg/s].
        too_fast: Share of the path that is faster.
        lower: Smallest request allowed [deg]; None where there is no limit.
        upper: Largest request allowed [deg], likewise.
        at_limit: How many requests are at a limit.
    """

    name: str
    planned: Size
    direct: Size
    bound: float | None
    gap: float | None
    speed: float
    top_speed: float
    too_fast: float
    lower: float | None
    upper: float | None
    at_limit: int


def size(errors: Array, factor: float) -> Size:
    """The errors times a factor in two figures."""
    return Size(factor * float(np.sqrt(np.mean(errors**2))), factor * float(np.max(np.abs(errors))))


def joint_rows(outcome: PlanOutcome) -> list[JointRow]:
    """The table of joints."""
    rows = []
    for j, name in enumerate(outcome.names):
        planned, direct = (
            size(outcome.errors[kind][:, j], math.degrees(1.0)) for kind in ("planned", "direct")
        )
        limits = outcome.limits.get(name, (-math.inf, math.inf))
        lower, upper = (math.degrees(limit) if math.isfinite(limit) else None for limit in limits)
        bound = outcome.bounds.get(name)
        told = None if bound is None else math.degrees(bound)
        error = planned.rms if outcome.norm == "rms" else planned.largest
        requests = outcome.requests[:, j]
        near = (requests <= limits[0] + AT_LIMIT) | (requests >= limits[1] - AT_LIMIT)
        rows.append(
            JointRow(
                name=name,
                planned=planned,
                direct=direct,
                bound=told,
                gap=error / told - 1.0 if told else None,
                speed=math.degrees(float(outcome.speeds[j])),
                top_speed=math.degrees(outcome.models[j].v_max),
                too_fast=float(outcome.too_fast[j]),
                lower=lower,
                upper=upper,
                at_limit=int(np.sum(near)),
            )
        )
    return rows


def verdict(outcome: PlanOutcome) -> tuple[str, str]:
    """The answer in a few words, and what it is worth."""
    if outcome.feet:
        planned, direct = (size(outcome.distances[kind], 100.0) for kind in ("planned", "direct"))
        unit = "cm"
        head = f"The foot stays within {_at_most(planned.largest)} cm of its path"
    else:
        planned, direct = (
            size(outcome.errors[kind], math.degrees(1.0)) for kind in ("planned", "direct")
        )
        unit = "degrees"
        those = "joint stays" if len(outcome.names) == 1 else "joints stay"
        whose = "its path" if len(outcome.names) == 1 else "their paths"
        head = f"The {those} within {_at_most(planned.largest)} degrees of {whose}"
    tail = (
        f"{_two_digits(planned.rms)} {unit} rms. Requested as they are, the same paths would be "
        f"missed by up to {_at_most(direct.largest)} {unit}, {_two_digits(direct.rms)} {unit} rms"
    )
    return head, tail


def remarks(outcome: PlanOutcome, *, unreachable: int, missed: Sequence[str]) -> list[str]:
    """What somebody who sends these requests should know first."""
    said = [f"{each}." for each in missed]
    if unreachable:
        said.append(
            f"{unreachable} of {len(outcome.desired)} positions are out of the leg's reach; the "
            "distances count them."
        )
    if outcome.jumps:
        listed = ", ".join(str(sample) for sample in outcome.jumps[:5])
        said.append(
            f"The leg leaps to another pose after {len(outcome.jumps)} samples ({listed}): the "
            "desired angles are no smooth path. Start near another pose (--near), or move the path."
        )
    rows = joint_rows(outcome)
    if fast := [row for row in rows if row.too_fast > 0.0]:
        worst = max(fast, key=lambda row: row.too_fast)
        said.append(
            f"{worst.name} should be faster than it can be during {100 * worst.too_fast:.0f} % of "
            f"the path ({worst.speed:.0f} of {worst.top_speed:.0f} deg/s at most): there no "
            "requests make it follow exactly. A slower or smaller path would be followed."
        )
    if held := [row for row in rows if row.at_limit]:
        listed = ", ".join(f"{row.name} ({row.at_limit})" for row in held)
        said.append(f"Requests at a limit of their joint: {listed}.")
    return said


def _at_most(value: float) -> str:
    """Two digits of a size, rounded up: what stays below the size stays below them."""
    if not value > 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return _two_digits(step * math.ceil(value / step * (1.0 - ROUNDING)))


def _two_digits(value: float) -> str:
    """Two digits of a number, without a power of ten."""
    return f"{float(f'{value:.2g}'):g}"
