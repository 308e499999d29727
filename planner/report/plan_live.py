"""What is live on the page of a plan: the moving leg, and plots over time that follow it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve, Panel
from planner.report.live_leg import Motion, moving_leg
from planner.report.live_plane import Axis, around, plane_plot
from planner.report.live_plot import time_plot
from planner.report.plan_draw import VIEWS
from planner.report.style import DESIRED, DIRECT, LIMIT, REQUESTED, Role

if TYPE_CHECKING:
    from planner.evaluation.plan_outcome import PlanOutcome
    from planner.trajectory import Array

NEAR = 0.6
"""A limit is drawn within this share of the requests' range beyond them."""


def live_leg(outcome: PlanOutcome, role: Role) -> dict[str, Any]:
    """The leg as it should move, as it does without a plan, and with it."""
    assert outcome.leg is not None, "only a leg has a foot"
    motions = []
    for looks, angles, distances in (
        (DESIRED, outcome.desired, None),
        (DIRECT, outcome.direct, outcome.distances["direct"]),
        (role, outcome.predicted, outcome.distances["planned"]),
    ):
        points = outcome.leg.joint_positions(angles)
        if looks is DESIRED:  # out of reach the foot is wanted where the leg cannot bring it
            points = np.concatenate([points[:, :-1], outcome.feet["desired"][:, None]], axis=1)
        motions.append(Motion(looks, points, distances))
    return moving_leg(motions, period=outcome.period, cyclic=outcome.cyclic)


def live_view(outcome: PlanOutcome, role: Role, view: str) -> dict[str, Any]:
    """The paths of the foot from the side or from the front, with the moments along them."""
    assert outcome.leg is not None, "only a leg has a foot"
    column, name = VIEWS[view]
    curves = []
    for positions, looks in zip(outcome.feet.values(), (DESIRED, DIRECT, role), strict=True):
        seen = 100.0 * (np.vstack([positions, positions[:1]]) if outcome.cyclic else positions)
        moments = tuple(f"{1000.0 * outcome.period * k:g} ms" for k in range(len(seen)))
        curves.append(Curve(looks, seen[:, column], seen[:, 2], notes=moments))
    across, up = (
        around(*each) for each in zip(*((c.times, c.values) for c in curves), strict=True)
    )
    return plane_plot(
        curves,
        Axis(f"{name} in the frame {outcome.leg.base} [cm]", "cm", across),
        Axis("z [cm]", "cm", up),
        equal=True,
    )


def live_distances(outcome: PlanOutcome, role: Role) -> dict[str, Any]:
    """How far the foot is from where it should be."""
    curves = [
        _curve(outcome, 100.0 * distances, looks)
        for distances, looks in zip(outcome.distances.values(), (DIRECT, role), strict=True)
    ]
    return _plot(outcome, [Panel("", "distance", "cm", tuple(curves), height=1.8, floor=True)])


def live_joint(outcome: PlanOutcome, role: Role, joint: int) -> dict[str, Any]:
    """A joint: above its angles, below its requests against the limits."""
    desired, direct, predicted, requests = (
        _curve(outcome, np.degrees(values[:, joint]), looks)
        for values, looks in (
            (outcome.desired, DESIRED),
            (outcome.direct, DIRECT),
            (outcome.predicted, role),
            (outcome.requests, REQUESTED),
        )
    )
    low, high = float(np.nanmin(requests.values)), float(np.nanmax(requests.values))
    limits = [
        Curve(LIMIT, requests.times[[0, -1]], np.full(2, math.degrees(limit)))
        for limit in outcome.limits.get(outcome.names[joint], ())
        if low - NEAR * (high - low) <= math.degrees(limit) <= high + NEAR * (high - low)
    ]
    return _plot(
        outcome,
        [
            Panel("what it does", "angle", "deg", (direct, predicted, desired)),
            Panel("what is requested", "request", "deg", (*limits, desired, requests)),
        ],
    )


def _curve(outcome: PlanOutcome, values: Array, role: Role) -> Curve:
    """A curve over samples; a cycle up to where it begins again."""
    drawn = np.append(values, values[0]) if outcome.cyclic else values
    return Curve(role, np.arange(float(len(drawn))), drawn)


def _plot(outcome: PlanOutcome, panels: list[Panel]) -> dict[str, Any]:
    """The panels in milliseconds; they follow the moving leg and one another."""
    clock = 1000.0 if outcome.feet or len(outcome.names) > 1 else None
    return time_plot(panels, unit="ms", scale=1000.0 * outcome.period, decimals=1, clock=clock)
