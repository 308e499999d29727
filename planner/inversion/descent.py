"""The search of the optimised inversion: Gauss-Newton on a saturation sharpened in stages.

Angles and requests are unknowns both, so no step waits for a simulation: an iterate's angles need
not be what the joint makes of its requests. What they lack is charged for in the merit by which
steps are judged, and vanishes as the steps go on; the exact models judge the requests in the end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.inversion.iterate import Iterate, Stage, State, iterate
from planner.inversion.step import Damping, Mask, Step, gauss_newton_step
from planner.inversion.tracking import Tracking
from planner.trajectory import Array

AS_WELL = 2e-4
"""Relative error that the last stages' pull may cost: it keeps requests quiet."""

ENOUGH = 5e-4
"""A stage ends when a step lowers its merit by less than this fraction."""

JUDGED = 0.1
"""Smoothing below which what a stage ends with is worth a simulation [theta_0]."""

DAMPING = (1e-9, 3e-4, 1e2)
"""Least weight on the size of a step, least one on that of a stage's first step, and largest one,
relative to that on the errors."""

CHARGE = 60.0
"""Weight on the squares of what the angles lack, relative to that on the errors."""

SHORTER = 0.4
"""Share of a step that is tried after one that was too long."""

TRIES = 4
"""Lengths of a step that are tried before it is computed anew."""

ACTIVE_SET_ROUNDS = 3
"""How often requests that would leave their limits are held there and the step is taken anew."""


SEARCH = (
    Stage(0.5, 1e-2),
    Stage(0.2, 1e-3),
    Stage(0.1, 1e-4),
    Stage(0.04, 5e-5),
    Stage(0.02, 5e-5),
    Stage(0.008, 5e-5),
    Stage(0.006, 1e-5, steps=2),
)
"""The stages of a search. A pull keeps the first ones out of the plains where saturated requests no
longer count, and the last ones from jumping where nothing is gained by it."""

WIDE_SEARCH = (
    Stage(2.0, 1e-3),
    Stage(1.0, 1e-3),
    Stage(0.5, 1e-4),
    Stage(0.2, 1e-4),
    Stage(0.08, 1e-4),
    Stage(0.02, 1e-5),
    Stage(0.008, 1e-8),
)
"""The stages of a search that leaves the place where it begins: under corners so wide every request
counts. Hardly a pull is left at the end, which matters where next to no error is."""


TOWARDS_THE_LARGEST = tuple(
    Stage(smoothing, 1e-5, power=power, steps=8)
    for smoothing, power in ((0.1, 4), (0.1, 8), (0.1, 16), (0.05, 32), (0.02, 64), (0.006, 64))
)
"""Where the largest error counts, it is approached through sums of powers of the errors. Corners
are still wide then: a plan for the one error is far from one for the other."""


def stages(problem: Tracking, search: Sequence[Stage]) -> Sequence[Stage]:
    """The search's stages, and where the largest error counts those that turn to it."""
    if problem.norm == "rms":
        return search
    widest = TOWARDS_THE_LARGEST[0].smoothing
    return [*(stage for stage in search if stage.smoothing >= widest), *TOWARDS_THE_LARGEST]


def improve(
    problem: Tracking, state: State, search: Sequence[Stage] = SEARCH
) -> tuple[State, float]:
    """The best of where a search leads, judged by the exact models, and that error.

    Args:
        problem: What to reach, and within which limits.
        state: Where to start; its requests within the limits.
        search: The stages to go through.
    """
    best, least = state, problem.exact_error(state.requests)
    for stage in stages(problem, search):
        state = descend(problem, state, stage)
        if stage.smoothing >= JUDGED:
            continue
        error = problem.exact_error(state.requests, state.angles[-1])
        if error < least:
            best, least = state, error
    return best, least


def descend(problem: Tracking, state: State, stage: Stage) -> State:
    """Lower one stage's cost by damped Gauss-Newton steps."""
    if stage.power > 2.0:
        largest = float(np.max(problem.goal.distances(state.angles)))
        stage = stage._replace(unit=max(largest, np.finfo(np.float64).tiny))
    damping = max(state.damping, DAMPING[1])
    multipliers, held = state.multipliers, state.held
    current = iterate(problem, state.requests, state.angles, stage)
    charge = CHARGE * float(current.cost.curvature.max())
    for _ in range(stage.steps):
        try:
            step, held = _step(problem, current, damping, multipliers, held)
        except np.linalg.LinAlgError:  # the matrix is singular to working precision
            damping *= 10.0
            continue
        merit = current.merit(step.multipliers, charge)
        gain = merit - step.expected
        following, length = _follow(problem, current, step, stage, charge)
        if following is None:
            damping *= 3.0
            if damping > DAMPING[2] or gain < 0.1 * ENOUGH * merit:
                break
            continue
        after = following.merit(step.multipliers, charge)
        if length < 1.0:
            damping *= 2.0
        elif merit - after > 0.6 * gain:
            damping = max(damping / 3.0, DAMPING[0])
        elif merit - after < 0.2 * gain:
            damping *= 3.0
        current, multipliers = following, step.multipliers
        if merit - after < ENOUGH * after:
            break
    return State(current.requests, current.angles, damping, multipliers, held)


def _follow(
    problem: Tracking, current: Iterate, step: Step, stage: Stage, charge: float
) -> tuple[Iterate | None, float]:
    """The first share of the step that lowers the merit, and how large a share; None if none."""
    length, merit = 1.0, current.merit(step.multipliers, charge)
    for _ in range(TRIES):
        requests = problem.admissible(current.requests + length * step.requests)
        following = iterate(problem, requests, current.angles + length * step.angles, stage)
        if following.merit(step.multipliers, charge) < merit:
            return following, length
        length *= SHORTER
    return None, length


def _step(
    problem: Tracking,
    current: Iterate,
    damping: float,
    multipliers: Array | None,
    held: Mask | None,
) -> tuple[Step, Mask | None]:
    """The Gauss-Newton step, and the requests held at the limits that they would leave."""
    below, above = current.requests <= problem.lower, current.requests >= problem.upper
    free = problem.movable if held is None else problem.movable & ~(held & (below | above))
    for _ in range(ACTIVE_SET_ROUNDS):
        step = gauss_newton_step(
            problem.stencil,
            current.response,
            current.cost,
            pull=current.pull,
            lacking=current.lacking,
            damping=_damping(problem, current, damping, multipliers),
            free=free,
        )
        if not problem.limited:
            return step, None
        outward = (below & (step.pushes < 0.0)) | (above & (step.pushes > 0.0))
        before, free = free, problem.movable & ~outward
        if np.all(free >= before):  # those that may come back do so in the next step
            break
    return step, problem.movable & ~free


def _damping(
    problem: Tracking, current: Iterate, damping: float, multipliers: Array | None
) -> Damping:
    """An even weight, and where a corner bends the response to the worse one as large as that.

    See ``docs/math.md``, section 6.
    """
    even = np.full_like(current.requests, damping)
    if multipliers is None:
        return Damping(even, np.zeros_like(even))
    bending = np.maximum(-multipliers * current.response.bending, 0.0)
    after = bending.sum(axis=0)[problem.stencil.after]  # bends by the angle before each sample
    return Damping(even + problem.stencil.gathered(bending), after)
