"""A search that ends in a poor optimum does not take the place of a better fit that is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import planner
from planner.identification import identify as module
from planner.identification.excitation import excite
from planner.identification.least_squares import Fit, least_squares
from tests.identification.made import hobby_servo

WORSE = 1.02
"""How much more than the fit of a whole search misses one that began at a fit may."""


@cache
def log():
    requests = excite("combined", limits=(-0.8, 0.8), period=0.02, duration=5.0).requests
    return hobby_servo(requests, 0.02)


@cache
def found():
    return planner.identify(log())


def poor(fit: Fit) -> Fit:
    """The same joint but much weaker, as where a search has gone astray."""
    weak = fit.parameters._replace(gain=0.3 * fit.parameters.gain)
    return least_squares(fit.grid, weak, free=np.zeros_like(fit.free), starts=fit.starts)


def test_where_rows_are_weighed_the_joint_found_before_is_one_of_the_beginnings(monkeypatch):
    whole, searches, least = module._with_motor, [], found().rms

    def astray(logs, timing, joints):
        search = whole(logs, timing, joints)
        searches.append(logs)
        if len(searches) == 1:
            return search
        plain, joint = (each._replace(fit=poor(each.fit)) for each in (search.plain, search.joint))
        return search._replace(plain=plain, joint=joint)

    def uneven(fits, _):
        weights = np.where(np.arange(len(log().times)) % 2, 0.9, 1.0)
        return tuple(replace(fit.log, weights=weights) for fit in fits)

    monkeypatch.setattr(module, "_with_motor", astray)
    monkeypatch.setattr(module, "with_weights", uneven)
    assert planner.identify(log(), hold_out=False).rms <= WORSE * least
    assert len(searches) == 2


def test_rows_held_out_are_predicted_by_the_joint_of_all_rows_fitted_to_the_others(monkeypatch):
    whole, known = module.with_motor, found()

    def astray(fit, terms):
        fit, terms = whole(fit, terms)
        held = len(fit.grid.angles) < 0.7 * len(log().times)
        return (poor(fit), terms) if held else (fit, terms)

    monkeypatch.setattr(module, "with_motor", astray)
    again = planner.identify(log())
    assert again.rms == pytest.approx(known.rms, rel=0.1)
    assert again.held_out_rms <= 1.2 * known.held_out_rms
