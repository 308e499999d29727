"""How much requests change from one to the next, and a pull that makes it less."""

from __future__ import annotations

import numpy as np

from planner.inversion.step import Pull
from planner.trajectory import Array

STIFFNESS = 3.0
"""Curvature that stands for that of the squared changes, which is 0 to 4: below the 4 that would
never promise too little, since steps are judged anyway and long ones save some."""


def changes(requests: Array, *, cyclic: bool) -> Array:
    """From each request to the next, in a cycle from the last to the first: (n, joints).

    From rest there is one less.
    """
    if cyclic:
        following: Array = np.concatenate([requests[1:], requests[:1]]) - requests
        return following
    steps: Array = requests[1:] - requests[:-1]
    return steps


def restlessness(requests: Array, *, cyclic: bool) -> float:
    """The sum of the squared changes [rad^2]."""
    steps = changes(requests, cyclic=cyclic)
    return float(np.vdot(steps, steps))


def calming(requests: Array, weight: float, *, cyclic: bool) -> Pull:
    """The pull that stands for ``weight`` times the squared changes around these requests.

    With differences D, ``|D (R + d)|^2 = |D R|^2 + 2 d' D'D R + |D d|^2`` couples neighbours, which
    the solve of a step does without. Here ``STIFFNESS |d|^2`` takes the place of the last term:
    each request is pulled towards the mean of its neighbours. Value and slope are those of the
    squared changes.
    """
    steps = changes(requests, cyclic=cyclic)
    slope = np.zeros_like(requests)  # D'D R
    if cyclic:
        slope[0] = steps[-1] - steps[0]
        slope[1:] = steps[:-1] - steps[1:]
    else:
        slope[:-1] -= steps
        slope[1:] += steps
    away = slope / STIFFNESS
    least = float(np.vdot(steps, steps)) - STIFFNESS * float(np.vdot(away, away))
    return Pull(weight * STIFFNESS, away, weight * least)
