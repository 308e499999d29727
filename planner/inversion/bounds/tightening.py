"""Ranges of angles and speeds, narrowed to where a response better than a known error can be."""

from __future__ import annotations

from collections.abc import Iterable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy import sparse

from planner.inversion.bounds.clarabel import Cones, minimise
from planner.inversion.bounds.saturation_relaxation import Indices, Proof, Ranges, Task
from planner.trajectory import Array

NEIGHBOURHOOD = 11
"""Ticks on either side whose conditions are taken; twice as many narrowed ranges by 0.3 % more."""

TOLERANCE = 1e-5
"""The solver's; what its multipliers prove is taken, however exact they are."""


class Local(NamedTuple):
    """The conditions around one tick that every response better than the known error meets.

    Attributes:
        place: Where each of the task's unknowns is among the local ones; -1 where it is not.
        matrix, limits, cones: The conditions.
        middle, reach: A box around the local unknowns.
    """

    place: Indices
    matrix: sparse.csr_array
    limits: Array
    cones: Cones
    middle: Array
    reach: Array


def tighten(
    task: Task, ranges: Ranges, proof: Proof, ticks: Iterable[int], *, until: float
) -> bool:
    """Narrow the ranges in place, tick by tick; False where no such response is left.

    Args:
        task: What is to be bounded.
        ranges: What is known so far.
        proof: The nearest point of the present relaxation.
        ticks: Where to narrow.
        until: When to stop [s of ``perf_counter``].
    """
    columns = sparse.csc_array(proof.matrix)
    lengths = np.diff(proof.matrix.indptr)
    for tick in ticks:
        if perf_counter() >= until:
            break
        local = neighbourhood(task, ranges, proof, columns, lengths, tick)
        angle = np.zeros(len(local.middle))
        angle[local.place[tick]] = 1.0
        wanted = [angle, -angle]
        undecided = tick >= task.first and ranges.slowest[tick] < 0.0 < ranges.fastest[tick]
        if undecided:
            speed = angle.copy()
            speed[local.place[task.before[tick]]] -= 1.0
            wanted += [speed, -speed]
        found = least(local, wanted)
        ranges.least[tick] = max(ranges.least[tick], found[0])
        ranges.most[tick] = min(ranges.most[tick], -found[1])
        if undecided:
            ranges.slowest[tick] = max(ranges.slowest[tick], found[2])
            ranges.fastest[tick] = min(ranges.fastest[tick], -found[3])
        if ranges.least[tick] > ranges.most[tick] or ranges.slowest[tick] > ranges.fastest[tick]:
            return False
    return True


def least(local: Local, wanted: list[Array]) -> list[float]:
    """What each ``along @ z`` cannot be less than, proved by multipliers (``docs/math.md``)."""
    answers = minimise(wanted, local.matrix, local.limits, local.cones, tolerance=TOLERANCE)
    proved = []
    for along, answer in zip(wanted, answers, strict=True):
        left = along + local.matrix.T @ answer.multipliers
        loose = float(np.abs(left) @ local.reach + answer.multipliers @ local.limits)
        proved.append(float(left @ local.middle) - loose)
    return proved


def neighbourhood(
    task: Task,
    ranges: Ranges,
    proof: Proof,
    columns: sparse.csc_array,
    lengths: Indices,
    tick: int,
) -> Local:
    """The relaxation's rows that concern the neighbourhood alone, and what the known error adds.

    Args:
        task: What is to be bounded.
        ranges: What is known so far.
        proof: The nearest point of the present relaxation.
        columns: Its matrix, by columns.
        lengths: Entries in each of its rows.
        tick: The tick in the middle.
    """
    around = np.arange(tick - NEIGHBOURHOOD, tick + NEIGHBOURHOOD + 1)
    around = around % task.ticks if task.cyclic else around[(around >= 0) & (around < task.ticks)]
    near = np.zeros(task.ticks, dtype=np.bool_)
    near[around] = True
    chosen = np.flatnonzero(np.concatenate([near, near[task.entries.tick]]))
    place = np.full(task.size, -1)
    place[chosen] = np.arange(len(chosen))
    inside = sparse.csr_array(columns[:, chosen])
    count = np.diff(inside.indptr)
    kept = np.flatnonzero((count == lengths) & (count > 0))
    matrix, limits = sparse.csr_array(inside[kept]), proof.limits[kept]
    equations = int(np.searchsorted(kept, task.driven.shape[0]))
    multipliers = proof.multipliers[kept].copy()
    multipliers[:equations] = 0.0  # equations leave no slack
    # The weighted slack is at most the spare; weighted @ z + spare is what is left of it.
    weighted, spare = matrix.T @ multipliers, -float(multipliers @ limits)
    sampled = np.flatnonzero(near[task.sampled])
    inequalities = len(kept) - equations
    middle = np.zeros(len(chosen))
    reach = np.ones(len(chosen))
    angles = np.flatnonzero(near)
    middle[: len(angles)] = (ranges.least + ranges.most)[angles] / 2.0
    reach[: len(angles)] = (ranges.most - ranges.least)[angles] / 2.0
    if task.norm == "max":
        spare += task.known * float(np.abs(proof.pull).sum()) - proof.proved
        less = sparse.csr_array(-weighted[np.newaxis])
        matrix = sparse.csr_array(sparse.vstack([matrix, less]))
        cones = Cones(equations, inequalities + 1)
        return Local(place, matrix, np.append(limits, spare), cones, middle, reach)
    centre = (task.desired - proof.pull / 2.0)[sampled]
    spare += len(task.desired) * task.known**2 - proof.proved + float(proof.pull @ proof.pull) / 4.0
    distances = sparse.csr_array(
        (
            np.full(len(sampled), -2.0),
            (np.arange(len(sampled)), place[task.sampled[sampled]]),
        ),
        shape=(len(sampled), len(chosen)),
    )
    less = sparse.csr_array(-weighted[np.newaxis])
    ball = sparse.csr_array(sparse.vstack([less, less, distances]))
    return Local(
        place,
        sparse.csr_array(sparse.vstack([matrix, ball])),
        np.concatenate([limits, [spare + 1.0, spare - 1.0], -2.0 * centre]),
        Cones(equations, inequalities, len(sampled) + 2),
        middle,
        reach,
    )
