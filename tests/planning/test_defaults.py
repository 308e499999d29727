"""What is asked for where nothing else is said: the defaults that the documentation states."""

from __future__ import annotations

import inspect

import pytest

import planner
from planner.approximation.fit import choices
from planner.evaluation.reproduction import reproduce
from planner.evaluation.virtual_experiment import play_experiment
from planner.planning.task import checked_smoothness

BOUND = {"cyclic": True, "norm": "rms", "level": "envelope"}

DEFAULTS = {
    planner.invert_optimal: {"cyclic": True, "norm": "rms", "solver": "gauss-newton"},
    planner.invert_foot: {
        "cyclic": True,
        "norm": "rms",
        "weights": (1.0, 1.0, 1.0),
        "unreachable": "nearest",
    },
    planner.plan: {"cyclic": True, "method": "optimal"},
    planner.invert_closed_form: {"cyclic": True, "rule": "paper", "refine": True},
    planner.invert_shift: {"cyclic": True, "norm": "rms"},
    planner.closed_form_requests: {"rule": "paper"},
    planner.line_offset: {"rule": "exact"},
    planner.fit_pwl: {"cyclic": True, "required": (), "exact": False},
    choices: {"most": 12},
    planner.certify: {**BOUND, "time_limit": 60.0},
    planner.lower_bound: {**BOUND, "time_limit": 60.0},
    planner.cross_check: BOUND,
    planner.Stream: {"on_bad": "hold"},
    planner.Stream.step: {"missed": 0},
    reproduce: {"segments": 6},
    play_experiment: {"segments": 6, "cycles": 20, "seed": 0},
}
"""Of all options but ``progress``; those that are not here are None."""


@pytest.mark.parametrize("function", DEFAULTS, ids=lambda each: each.__qualname__)
def test_the_defaults_are_those_of_the_documentation(function):
    stated = {
        name: each.default
        for name, each in inspect.signature(function).parameters.items()
        if each.default not in (each.empty, None) and name != "progress"
    }
    assert stated == DEFAULTS[function]


def test_half_a_per_cent_of_the_error_is_what_smoother_requests_may_cost_by_default():
    assert checked_smoothness(None) == 0.005
