"""Joints to which a path gives nothing to do."""

from __future__ import annotations

import numpy as np

from planner.inversion.descent import AS_WELL, SEARCH, improve
from planner.inversion.iterate import State
from planner.inversion.step import Mask
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

STILL = 1e-9
"""Range of the angles of a joint that does not move [rad]."""

UNSEEN = 2e-5
"""Error that is none, in radians of a typical joint's turn: a thousandth of a degree, a tenth of
what is left where the joints can follow."""


ROUNDING = 1e-13
"""Difference of two errors that is none [rad]."""

SHARPENING = tuple(stage._replace(steps=16) for stage in SEARCH if stage.smoothing < 0.1)
"""The stages that a plan goes through once more when a joint is held."""


def without_idle_motion(
    problem: Tracking, found: State, wanted: Array, *, at_most: float
) -> tuple[Tracking, State]:
    """The plan with the joints at rest that need not move, if it then is as good.

    A joint that stays where it is all along the path can still make up for a little of what the
    others miss. Where that is next to nothing, it had better not move at all.

    Args:
        problem: What the joints should do together.
        found: A good plan.
        wanted: The angles that the path asks for [rad], shape (n, joints).
        at_most: Error that is not to be passed in any case.

    Returns:
        The problem with those joints held, and the plan for it; or what was given.
    """
    still: Mask = np.ptp(wanted, axis=0) <= STILL
    if not np.any(still) or np.all(still):
        return problem, found
    held = holding(problem, still)
    as_well = problem.exact_error(found.requests, found.angles[-1]) * (1.0 + AS_WELL) + UNSEEN
    answer, error = improve(held, State(held.admissible(found.requests), found.angles), SHARPENING)
    return (held, answer) if error <= min(as_well, at_most + ROUNDING) else (problem, found)


def holding(problem: Tracking, still: Mask) -> Tracking:
    """The same problem with some of the joints where they rest, from the first sample on."""
    place = problem.resting[0]
    lower, upper = (np.where(still, place, limit) for limit in (problem.lower, problem.upper))
    return problem.within((lower, upper))
