"""The joint's model, live: the paper's step tests and its function f."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.curves import Curve, Panel, Span, cycle
from planner.report.live_plane import Axis, plane_plot
from planner.report.live_plot import time_plot
from planner.report.live_words import label, stroke
from planner.report.style import CLOSED_FORM, MUTED, REQUESTED

if TYPE_CHECKING:
    from planner.evaluation.outcome import Reproduction

SHADE = 0.16
"""Opacity of the shades of lag and acceleration time."""


def step_plot(reproduction: Reproduction, amplitude: float) -> dict[str, Any]:
    """Figures 3 and 4: the answer to a step test, its lag and its acceleration time shaded."""
    response = reproduction.steps[amplitude]
    period = reproduction.model.period
    begun = response.step + response.lag
    full = begun + response.acceleration
    spans = (
        Span(response.step, begun, MUTED, SHADE, f"lag {response.lag}", "left"),
        Span(begun, full, CLOSED_FORM, SHADE, f"acceleration time {response.acceleration}"),
    )
    speed = math.degrees(response.v_max) * period
    requests = cycle(response.requests, REQUESTED)._replace(held=True)
    panel = Panel(
        f"v_max = {speed:.3g} deg/sample",
        "angle",
        "deg",
        (requests, cycle(response.angles, CLOSED_FORM, "actual")),
        height=1.6,
        spans=spans,
        range=(-0.12 * amplitude, 1.24 * amplitude),
    )
    return time_plot([panel], unit="samples")


def speed_plot(reproduction: Reproduction) -> dict[str, Any]:
    """Figure 5: the speed that an error calls for."""
    model = reproduction.model
    theta_0, v_max = math.degrees(model.theta_0), math.degrees(model.v_max_per_tick)
    errors = np.linspace(-2.2, 2.2, 89) * theta_0
    speeds = model.tick * np.degrees(model.speed(np.radians(errors)))
    return plane_plot(
        [Curve(CLOSED_FORM, errors, speeds, "f")],
        Axis("request minus angle, x [deg]", "deg", (errors[0], errors[-1])),
        Axis("f(x) [deg per tick]", "deg per tick", (-1.35 * v_max, 1.35 * v_max)),
        height=260,
        shapes=[
            stroke((0, 0), (0, 1), yref="paper"),
            stroke((0, 1), (0, 0), xref="paper"),
            *(stroke((side * theta_0,) * 2, (0, side * v_max), dash="dot") for side in (1.0, -1.0)),
        ],
        words=[
            label("θ₀", theta_0, 0.0, yanchor="top"),
            label("−θ₀", -theta_0, 0.0, yanchor="bottom"),
            label("v_max", 1.6 * theta_0, v_max, yanchor="bottom"),
            label("−v_max", -1.6 * theta_0, -v_max, yanchor="top"),
        ],
    )
