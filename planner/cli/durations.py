"""How long the steps of ``reproduce`` take, in proportion to each other, to tell the time left."""

from __future__ import annotations

_PLANS = {
    "the walk": 0.1,
    "the baselines": 0.02,
    "the optimised requests for the foot": 0.5,
    "the lower bound for the foot": 2.0,
    "the closed form for the rotator": 0.6,
    "the optimised requests for the rotator": 0.04,
    "the lower bound for the rotator": 0.9,
    "the closed form for the abductor": 0.2,
    "the optimised requests for the abductor": 0.04,
    "the lower bound for the abductor": 0.1,
    "the closed form for the knee": 0.3,
    "the optimised requests for the knee": 0.04,
    "the lower bound for the knee": 0.1,
}

_JOINTS = ("rotator", "abductor", "knee")

_METHODS = ("direct", "closed form plain", "closed form", "optimal", "foot optimal")

DURATIONS = {
    "model": {**_PLANS, "the step tests": 0.01, "the report": 7.0},
    "virtual": {
        **{f"the step tests of the {joint}": 0.25 for joint in _JOINTS},
        **{f"the model of the {joint}": 0.4 for joint in _JOINTS},
        **_PLANS,
        **{f"20 cycles of the walk: {method}": 0.5 for method in _METHODS},
        "the report": 6.5,
    },
}
"""Seconds that each step took on two cores, by robot, in their order."""
