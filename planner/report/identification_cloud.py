"""The paper's Figure 5 from data: what of the cloud is shown, and the live plot of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.identification.result import SpeedPoints, speed_against_error
from planner.report.curves import Curve
from planner.report.identification_parameters import units_of
from planner.report.live_plane import Axis, plane_plot
from planner.report.live_words import label, stroke
from planner.report.style import CLOSED_FORM, INK, MUTED

if TYPE_CHECKING:
    from planner.identification.result import Identification

MOST_POINTS = 1500
"""Points of each kind that are drawn, evenly chosen: enough to see a shape, and a light page."""

PALE, CLEAR = 0.3, 0.6
"""Opacity of points that may lie off the line, and of those that should not."""


class CloudView(NamedTuple):
    """What of a cloud is shown.

    Attributes:
        cloud: The points of all logs.
        reach: The largest error shown [rad].
        highest: The largest speed shown [rad/s].
    """

    cloud: SpeedPoints
    reach: float
    highest: float


def cloud_view(identification: Identification) -> CloudView:
    """All points of an identification, and the part of the plane that nearly all of them are in."""
    model = identification.model
    clouds = [speed_against_error(model, fit) for fit in identification.fits]
    cloud = SpeedPoints(*(np.concatenate(parts) for parts in zip(*clouds, strict=True)))
    reach = _reach(cloud, model.theta_0)
    shown = np.abs(cloud.speeds[np.abs(cloud.errors) <= reach])
    line = float(model.speed(reach))
    most = float(np.quantile(shown, 0.995)) if len(shown) else 0.0
    return CloudView(cloud, reach, 1.15 * max(line, most))


def cloud_plot(identification: Identification) -> dict[str, Any]:
    """Figure 5 from data, live: zoom out for what lies outside the picture."""
    model, units = identification.model, units_of(identification)
    cloud, reach, highest = cloud_view(identification)
    factor, known = units.factor, np.isfinite(cloud.errors) & np.isfinite(cloud.speeds)
    curves = []
    for chosen, role, opacity, name in (
        (known & cloud.apart, MUTED, PALE, "window across a corner of f"),
        (known & ~cloud.apart, INK, CLEAR, "measured"),
    ):
        points = np.flatnonzero(chosen)
        points = points[:: max(1, math.ceil(len(points) / MOST_POINTS))]
        if len(points):
            errors, speeds = factor * cloud.errors[points], factor * cloud.speeds[points]
            curves.append(Curve(role, errors, speeds, name, dots=True, filled=opacity))
    far = max(reach, float(np.max(np.abs(cloud.errors[known]), initial=0.0)))
    corner = min(model.theta_0, far)
    errors = np.array([-far, -corner, corner, far])
    line = model.speed(errors)
    looks = CLOSED_FORM._replace(width=2.4)
    curves.append(Curve(looks, factor * errors, factor * line, "f, identified"))
    shapes = [stroke((0, 0), (0, 1), yref="paper"), stroke((0, 1), (0, 0), xref="paper")]
    words = []
    if identification.saturates and model.theta_0 <= reach:
        corner, top = factor * model.theta_0, factor * model.v_max
        shapes.append(stroke((corner, corner), (0, top), dash="dot"))
        words = [
            label("θ₀", corner, 0.0, yanchor="top"),
            label("v_max", -factor * reach, top, xanchor="left", yanchor="middle"),
        ]
    return plane_plot(
        curves,
        Axis(
            f"request minus angle [{units.angle}]",
            units.angle,
            (-factor * reach, factor * reach),
            decimals=3,
        ),
        Axis(f"speed [{units.speed}]", units.speed, (-factor * highest, factor * highest)),
        shapes=shapes,
        words=words,
    )


def _reach(cloud: SpeedPoints, theta_0: float) -> float:
    """How far to draw: nearly all errors, and a little beyond theta_0 where the data gets there."""
    if not len(cloud.errors):
        return 2.0 * theta_0
    most = 1.1 * float(np.quantile(np.abs(cloud.errors), 0.99))
    return max(most, 1e-9) if most < theta_0 else max(1.3 * theta_0, min(most, 5.0 * theta_0))
