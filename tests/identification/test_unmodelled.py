"""Backlash is named with its size and rows, an acceleration limit identified, and nowhere else."""

from __future__ import annotations

import math

import pytest

import planner
from tests.identification.made import random_servo

DEFECTS = ("backlash:",)

SECONDS = 12.0
"""Length of the logs: half of the time and more is spent on longer ones."""


def told(found):
    assert all(text in found.to_dict()["warnings"] for text in found.warnings)
    return [text for text in found.warnings if any(name in text for name in DEFECTS)]


@pytest.mark.parametrize(("seed", "limit"), [(3, 40.0), (6, 30.0)])
def test_an_acceleration_limit_is_a_term_of_the_model(seed, limit):
    log = random_servo(seed, kinds=("steps",), seconds=SECONDS, most=limit)
    found = planner.identify(log, hold_out=False)
    assert abs(found.model.max_acceleration / limit - 1.0) <= 0.05
    (term,) = [each for each in found.terms if each.name == "max_acceleration"]
    assert term.kept
    assert term.rms_with < 0.9 * term.rms_without
    (friction,) = [each for each in found.terms if each.name == "dead_band"]
    assert friction.kept or friction.interval.lower == 0.0  # sought with the others, and lost


@pytest.mark.parametrize("seed", [3, 8])
def test_a_servo_with_neither_shows_neither(seed):
    found = planner.identify(random_servo(seed, kinds=("steps",), seconds=SECONDS), hold_out=False)
    assert not told(found)
    assert found.model.max_acceleration == math.inf
