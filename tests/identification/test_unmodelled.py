"""Backlash is named with its size and rows, an acceleration limit identified, and nowhere else."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import planner
from tests.identification.made import measured, random_servo, servo

DEFECTS = ("backlash:",)

SECONDS = 12.0
"""Length of the logs: half of the time and more is spent on longer ones."""

PLACE = re.compile(r"rows (\d+) to (\d+) \((\d+\.\d\d) to (\d+\.\d\d) s\)")


def sentences(log):
    return told(planner.identify(log, hold_out=False))


def told(found):
    assert all(text in found.to_dict()["warnings"] for text in found.warnings)
    return [text for text in found.warnings if any(name in text for name in DEFECTS)]


@pytest.mark.parametrize("degrees", [1.0, 3.0])
def test_backlash_is_named_with_its_play_and_the_rows_after_reversals(degrees):
    period = 0.02
    levels = np.tile([0.1, 0.2, 0.5, 0.6, 0.3, 0.0], 6)
    requests = np.repeat(levels, 20)
    angles = servo(
        requests,
        period,
        gain=12.0,
        up=5.0,
        down=5.0,
        delay=0.02,
        constant=0.01,
        play=math.radians(degrees),
    )
    log = planner.Log(
        times=period * np.arange(len(requests)),
        requests=requests,
        angles=measured(angles, np.random.default_rng(0), noise=0.001, quantum=0.0015),
    )
    (said,) = sentences(log)
    play = float(re.search(r"play of about ([\d.]+) rad", said).group(1))
    assert abs(math.degrees(play) / degrees - 1.0) <= 0.1
    places = PLACE.findall(said)
    assert len(places) == 2
    assert "most in rows " in said  # without the name of the only log
    reversals = 20 * np.flatnonzero(np.isin(levels, [0.3, 0.1]))  # the first steps down and up
    for first, last, begins, ends in places:
        assert begins == f"{log.times[int(first)]:.2f}"
        assert ends == f"{log.times[int(last)]:.2f}"
        late = int(first) - reversals
        assert np.min(late[late >= 0]) <= 5  # of 20 rows: the delay, and the time to cross the play


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
