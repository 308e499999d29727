"""Pictures of the joint's model: the paper's Figures 3, 4 and 5."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planner.report.style import CLOSED_FORM, INK, MUTED, REQUESTED, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.evaluation.outcome import Reproduction
    from planner.evaluation.step_response import StepResponse


def draw_step(reproduction: Reproduction, amplitude: float) -> Figure:
    """Figures 3 and 4: the answer to the step test, with what is read off it."""
    from matplotlib.figure import Figure

    response = reproduction.steps[amplitude]
    figure = Figure(figsize=(WIDTH, 2.5), layout="constrained")
    axes = figure.add_subplot()
    samples = np.arange(len(response.angles))
    axes.step(samples, np.degrees(response.requests), where="post", **REQUESTED.line)
    axes.plot(samples, np.degrees(response.angles), **{**CLOSED_FORM.line, "label": "actual"})
    axes.set_xlim(0, len(samples))
    axes.set_ylim(-0.12 * amplitude, 1.24 * amplitude)
    axes.set_xticks(range(0, len(samples) + 1, len(samples) // 8))
    axes.set_xlabel(f"time [samples of {1000.0 * reproduction.model.period:g} ms]")
    axes.set_ylabel("angle [deg]")
    _annotate(axes, response, reproduction.model.period)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure


def draw_speed(reproduction: Reproduction) -> Figure:
    """Figure 5: the speed f that an error between request and angle calls for."""
    from matplotlib.figure import Figure

    model = reproduction.model
    theta_0, v_max = math.degrees(model.theta_0), math.degrees(model.v_max_per_tick)
    errors = np.array([-2.2, -1.0, 0.0, 1.0, 2.2]) * theta_0
    figure = Figure(figsize=(WIDTH, 2.5), layout="constrained")
    axes = figure.add_subplot()
    axes.axhline(0.0, color=MUTED.light, lw=0.8)
    axes.axvline(0.0, color=MUTED.light, lw=0.8)
    speeds = model.tick * np.degrees(model.speed(np.radians(errors)))
    axes.plot(errors, speeds, **CLOSED_FORM.line)
    axes.set_xticks([-2 * theta_0, -theta_0, 0.0, theta_0, 2 * theta_0])
    axes.set_yticks([-v_max, 0.0, v_max])
    axes.set_xlim(errors[0], errors[-1])
    axes.set_ylim(-1.35 * v_max, 1.35 * v_max)
    axes.set_xlabel("request minus angle, x [deg]")
    axes.set_ylabel("f(x) [deg per tick]")
    _label(axes, r"$v_\mathrm{max}$", (1.6 * theta_0, v_max), (0, 5))
    _label(axes, r"$−v_\mathrm{max}$", (-1.6 * theta_0, -v_max), (0, -5))
    for side, name in ((1.0, "θ₀"), (-1.0, "−θ₀")):
        axes.plot([side * theta_0] * 2, [0.0, side * v_max], color=MUTED.light, lw=0.8, ls=":")
        _label(axes, name, (side * theta_0, 0.0), (0, -5 if side > 0 else 5))
    return figure


def _annotate(axes: Axes, response: StepResponse, period: float) -> None:
    """Lag and acceleration time as spans above the curve, top speed beside its slope."""
    top = 1.13 * math.degrees(response.amplitude)
    begun = response.step + response.lag
    full = begun + response.acceleration
    for edge in (response.step, begun, full):
        axes.axvline(edge, color=MUTED.light, lw=0.7, ls=":")
    for left, right, name, align in (
        (response.step, begun, f"lag {response.lag}", "right"),
        (begun, full, f"acceleration time {response.acceleration}", "left"),
    ):
        axes.annotate(
            "",
            xy=(left, top),
            xytext=(right, top),
            arrowprops={
                "arrowstyle": "<->",
                "color": INK.light,
                "lw": 0.8,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 7,
            },
        )
        at = (left, top) if align == "right" else (right, top)
        axes.annotate(
            name,
            at,
            xytext=(-5 if align == "right" else 5, 0),
            textcoords="offset points",
            ha=align,
            va="center",
            fontsize=8.5,
            color=INK.light,
        )
    speed = math.degrees(response.v_max) * period
    middle = full + max(1, round(0.3 * math.degrees(response.amplitude) / speed))
    last = min(middle, len(response.angles) - 1)
    axes.annotate(
        f"$v_\\mathrm{{max}}$ = {speed:.3g}\ndeg per sample",
        (last, math.degrees(response.angles[last])),
        xytext=(8, 0),
        textcoords="offset points",
        fontsize=8.5,
        color=INK.light,
    )


def _label(axes: Axes, text: str, at: tuple[float, float], shift: tuple[float, float]) -> None:
    axes.annotate(
        text,
        at,
        xytext=shift,
        textcoords="offset points",
        ha="center",
        fontsize=8.5,
        va="bottom" if shift[1] > 0 else "top",
        color=INK.light,
    )
