"""How fast a log calls for, and what that says of a top speed that was never reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.identification.grid import Grid
from planner.identification.least_squares import Fit
from planner.identification.parameters import Parameters
from planner.identification.simulation import Pulls
from planner.trajectory import Array

JUST_ABOVE = 1e-6
"""Share by which a top speed that was never reached lies above the fastest call."""


def peak_call(fit: Fit) -> float:
    """Highest speed that the requests of a fit called for, limited or not [rad/s]."""
    return fastest_call(fit.parameters, fit.grid, fit.pulls, fit.states)


def fastest_call(parameters: Parameters, grid: Grid, pulls: Pulls, states: Array) -> float:
    """Highest speed that the requests called for in any run, limited or not [rad/s]."""
    errors = pulls.targets - states[grid.states - 1][:, np.newaxis]
    errors[pulls.weights <= 0.0] = 0.0
    return float(parameters.gain * np.max(np.abs(errors)))


def with_shown_speed(fit: Fit) -> Fit:
    """The fit with a top speed no higher than anything the log called for.

    Beyond that every top speed predicts the same; this one promises the least.
    """
    shown = peak_call(fit)
    if fit.parameters.v_max <= shown:
        return fit
    return replace(fit, parameters=fit.parameters._replace(v_max=(1.0 + JUST_ABOVE) * shown))
