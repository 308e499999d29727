"""A convex set that contains every response better than a known error, and its distance.

Over angles x (one a tick) and calls u (one for every request at every tick where it acts):
condition 4 with the joint's speed within known ranges, and cuts from the hulls of the single
requests (``docs/math.md``, section 5).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from planner.inversion.calls import ANYWHERE, HullCut, Place, separate
from planner.inversion.conic import Answer, Cones, minimise
from planner.inversion.task import Acting, Ranges, Task
from planner.trajectory import Array

TOLERANCE = 1e-8
"""The solver's, on a problem in units of v_max; what is proved does not depend on it."""


class Cut(NamedTuple):
    """A cut and whose it is."""

    acting: Acting
    hull: HullCut


class Proof(NamedTuple):
    """The nearest point of a relaxation, and what multipliers prove about all of it.

    Attributes:
        angles: Nearest angles, shape (ticks,).
        calls: Their calls.
        error: No point of the relaxation has a smaller one, in the task's norm.
        matrix, limits: The relaxation: the first rows are equations, the others at most.
        multipliers: One for every row.
        pull: ``matrix.T @ multipliers`` at the samples.
        proved: The numerator of (9).
        weights: Multipliers of the cuts.
    """

    angles: Array
    calls: Array
    error: float
    matrix: sparse.csr_array
    limits: Array
    multipliers: Array
    pull: Array
    proved: float
    weights: Array


def rows(task: Task, ranges: Ranges, cuts: list[Cut]) -> tuple[sparse.csr_array, Array]:
    """The relaxation's conditions: first the equations of motion, then what is at most something.

    max(0, -w) is convex in w, so between its values at the ends of w's range it is at most the
    chord; the chord is exact where the direction is known.
    """
    changes, at = task.changes
    speeds = task.speeds
    slow, fast = ranges.slowest[task.first :], ranges.fastest[task.first :]
    width = np.maximum(fast - slow, np.finfo(np.float64).tiny)
    back, forth = np.maximum(-slow, 0.0), np.maximum(fast, 0.0)
    # Slope and constant of the chord of max(0, -w), and of max(0, w).
    falling = (np.maximum(-fast, 0.0) - back) / width
    rising = (forth - np.maximum(slow, 0.0)) / width
    fallen, risen = back - falling * slow, forth - rising * fast
    unknowns = sparse.eye_array(task.size, format="csr")
    angles, calls = unknowns[: task.ticks], unknowns[task.ticks :]
    blocks: list[Any] = [
        task.driven,
        changes - sparse.diags_array(task.gain * falling[at]) @ speeds[at],
        -changes - sparse.diags_array(task.gain * rising[at]) @ speeds[at],
        speeds,
        -speeds,
        angles,
        -angles,
        calls,
        -calls,
    ]
    ones = np.ones(calls.shape[0])
    limits = [
        np.zeros(speeds.shape[0]),
        task.gain * fallen[at],
        task.gain * risen[at],
        fast,
        -slow,
        ranges.most,
        -ranges.least,
        ones,
        ones,
    ]
    if cuts:
        blocks.append(_cut_rows(task, cuts))
        limits.append(np.array([cut.hull.limit for cut in cuts]))
    return sparse.csr_array(sparse.vstack(blocks)), np.concatenate(limits)


def _cut_rows(task: Task, cuts: list[Cut]) -> sparse.csr_array:
    row = np.repeat(np.arange(len(cuts)), [2 * len(cut.acting.calls) for cut in cuts])
    column = [np.concatenate([task.ticks + c.acting.calls, c.acting.ticks]) for c in cuts]
    value = [np.concatenate([c.hull.by_call, -c.hull.by_angle]) for c in cuts]
    return sparse.csr_array(
        (np.concatenate(value), (row, np.concatenate(column))), shape=(len(cuts), task.size)
    )


def nearest(task: Task, ranges: Ranges, cuts: list[Cut]) -> Proof:
    """The relaxation's distance from the desired angles, proved by multipliers as in (9)."""
    matrix, limits = rows(task, ranges, cuts)
    answer = _solved(task, matrix, limits)
    multipliers = answer.multipliers[: len(limits)]
    point = answer.unknowns[: task.size]
    pull = matrix.T @ multipliers
    # What is not compared is free, so there the pull should vanish; what is left of it counts.
    angles = np.clip(point[: task.ticks], ranges.least, ranges.most)
    away = np.ones(task.size)
    away[: task.ticks] = np.maximum(ranges.most - angles, angles - ranges.least)
    away[task.sampled] = 0.0
    compared = np.zeros(task.size)
    compared[: task.ticks] = angles
    compared[task.sampled] = task.desired
    proved = float(multipliers @ (matrix @ compared - limits) - np.abs(pull) @ away)
    at_samples = pull[task.sampled]
    return Proof(
        angles=point[: task.ticks],
        calls=point[task.ticks :],
        error=_distance(task, proved, at_samples),
        matrix=matrix,
        limits=limits,
        multipliers=multipliers,
        pull=at_samples,
        proved=proved,
        weights=multipliers[len(limits) - len(cuts) :],
    )


def _solved(task: Task, matrix: sparse.csr_array, limits: Array) -> Answer:
    """The nearest point as the solver has it, by whichever norm."""
    equations = task.driven.shape[0]
    cones = Cones(equations, len(limits) - equations)
    samples = len(task.desired)
    slope = np.zeros(task.size)
    if task.norm == "rms":
        curvature = np.zeros(task.size)
        curvature[task.sampled] = 2.0
        slope[task.sampled] = -2.0 * task.desired
        answers = minimise([slope], matrix, limits, cones, curvature=curvature, tolerance=TOLERANCE)
        return answers[0]
    picked = sparse.eye_array(task.size, format="csr")[task.sampled]
    # The column of one more unknown, the largest error.
    largest = sparse.csr_array(-np.ones((samples, 1)))
    first = sparse.csr_array((matrix.shape[0], 1))
    rows = sparse.csr_array(sparse.vstack([matrix, picked, -picked]))
    column = sparse.csr_array(sparse.vstack([first, largest, largest]))
    system = sparse.hstack([rows, column])
    answers = minimise(
        [np.append(slope, 1.0)],
        sparse.csr_array(system),
        np.concatenate([limits, task.desired, -task.desired]),
        cones._replace(at_most=cones.at_most + 2 * samples),
        tolerance=TOLERANCE,
    )
    return answers[0]


def _distance(task: Task, proved: float, pull: Array) -> float:
    """The right-hand side of (9) as an error in the task's norm."""
    if proved <= 0.0:
        return 0.0
    size = float(np.linalg.norm(pull, 2 if task.norm == "rms" else 1))
    if size == 0.0:  # a pull from nowhere: the relaxation is empty
        return math.inf
    return proved / size / (math.sqrt(len(task.desired)) if task.norm == "rms" else 1.0)


def violated(
    task: Task, ranges: Ranges, proof: Proof, between: dict[int, tuple[float, float]]
) -> list[Cut]:
    """A cut for every request whose calls are in no hull."""
    found = []
    for request, acting in task.acting.items():
        place = Place(
            task.gain,
            ranges.least[acting.ticks],
            ranges.most[acting.ticks],
            between.get(request, ANYWHERE),
        )
        hull = separate(proof.calls[acting.calls], proof.angles[acting.ticks], place)
        if hull is not None:
            found.append(Cut(acting, hull))
    return found
