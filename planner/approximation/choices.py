"""Segments against error: the error for every number of segments, and a lower bound."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from planner.approximation.fit import PiecewiseLinearFit, fit_pwl
from planner.approximation.problem import Problem
from planner.approximation.slope_projection import ideal_of
from planner.trajectory import Array

MOST = 12
"""Segments up to which errors are given."""


class Choices(NamedTuple):
    """The errors from which a person can choose.

    Attributes:
        segments: Numbers of segments, shape (m,).
        rms: Rms error of the curve of at most so many [rad], shape (m,).
        floor: Rms error of the slope-bounded ideal [rad]: no number of segments has less.
        automatic: The number that is chosen where none is asked for.
    """

    segments: tuple[int, ...]
    rms: Array
    floor: float
    automatic: int


def choices(fit: PiecewiseLinearFit, *, most: int = MOST) -> Choices:
    """The errors of curves through the samples of ``fit``, for 2 to ``most`` segments.

    Required knots and ends are left aside: they belong to the question, not to the samples. Time:
    that of ``most`` fits.
    """
    n = fit.desired.size
    weights = np.ones(n) if fit.weights is None else fit.weights
    plain = partial(
        fit_pwl,
        fit.desired,
        v_max=fit.v_max,
        tick=fit.tick,
        cyclic=fit.cyclic,
        weights=fit.weights,
    )
    chosen = plain()
    last = min(n if fit.cyclic else n - 1, max(most, chosen.segments, fit.segments))
    counts = tuple(range(2, min(last, 2 * most) + 1))
    # A curve with a segment less is one of so many, if it was found to be better.
    rms = np.minimum.accumulate([plain(segments=count).rms for count in counts])
    rms.setflags(write=False)
    ideal = ideal_of(
        Problem(desired=fit.desired, step=fit.v_max * fit.tick, cyclic=fit.cyclic, weights=weights)
    )
    floor = float(np.sqrt(np.average((ideal - fit.desired) ** 2, weights=weights)))
    return Choices(counts, rms, floor, chosen.segments)
