"""A convex set that contains every response better than a known error, and its distance.

Over angles x (one a tick) and calls u (one for every request at every tick where it acts):
condition 4 with the joint's speed within known ranges, and cuts from the hulls of the single
requests (``docs/math.md``, section 5).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.inversion.bounds.hull_cuts import ANYWHERE, HullCut, Place, separate
from planner.inversion.bounds.multipliers import dual_value, nearest_point
from planner.inversion.bounds.reachable_set import BoundProblem, distance_from_rest
from planner.model.joint import JointModel
from planner.trajectory import Array

Indices = npt.NDArray[np.int_]


class Contributions(NamedTuple):
    """Which requests act at which ticks, one entry for every pair.

    Attributes:
        tick: The tick, shape (m,).
        request: The request, shape (m,).
        weight: Its weight there, shape (m,).
        following: Index of the same request's entry one tick later; -1 where there is none.
    """

    tick: npt.NDArray[np.int_]
    request: npt.NDArray[np.int_]
    weight: Array
    following: npt.NDArray[np.int_]


class Acting(NamedTuple):
    """Where one request acts: its calls, and the ticks at whose angles it calls."""

    calls: Indices
    ticks: Indices


class Ranges(NamedTuple):
    """Where every angle and every speed is, for responses better than the known error."""

    least: Array
    most: Array
    slowest: Array
    fastest: Array

    def copy(self) -> Ranges:
        """The same ranges, to be narrowed on their own."""
        return Ranges(*(each.copy() for each in self))


class Task:
    """What is to be bounded.

    Attributes:
        gain: k = v_max / theta_0 [1/tick].
        desired: Wanted angles [v_max ticks], shape (n,).
        known: Error of a known plan, on which all conditions may rest [v_max ticks].
        norm: Which error.
        ticks: How many.
        sampled: Ticks at which the desired angles are compared.
        pinned: Requests that are known, as from rest the first.
    """

    def __init__(self, problem: BoundProblem, known: float) -> None:
        """Scale the problem: one is what the joint can move in a tick."""
        model, desired, cyclic, norm, start = problem
        unit, middle = model.v_max_per_tick, float(np.mean(desired))
        self.unit, self.model, self.cyclic, self.norm = unit, model, cyclic, norm
        self.gain = unit / model.theta_0
        self.desired = (desired - middle) / unit
        self.known = known / unit
        stride = model.hold
        self.ticks = len(desired) * stride if cyclic else (len(desired) - 1) * stride + 1
        self.sampled = np.arange(0, self.ticks, stride)
        self.start = None if start is None else (start - middle) / unit
        self.pinned = {} if self.start is None else {0: (self.start, self.start)}
        self.entries = contributions(model, self.ticks, cyclic=cyclic)
        self.before = (np.arange(self.ticks) - 1) % self.ticks
        # From rest nothing is known of the tick before the first.
        self.first = 0 if cyclic else 1
        counted = np.flatnonzero(self.entries.tick >= self.first)
        order = counted[np.argsort(self.entries.request[counted], kind="stable")]
        owner = self.entries.request[order]
        groups = np.split(order, np.flatnonzero(np.diff(owner)) + 1)
        self.acting = {
            int(self.entries.request[g[0]]): Acting(g, self.before[self.entries.tick[g]])
            for g in groups
        }

    @property
    def size(self) -> int:
        """Number of unknowns: angles and calls."""
        return self.ticks + len(self.entries.tick)

    def initial_ranges(self) -> Ranges:
        """What the known error, the top speed and the start say by themselves."""
        farthest = self.known * (np.sqrt(len(self.desired)) if self.norm == "rms" else 1.0)
        after = np.arange(self.ticks) % self.model.hold  # ticks since the last sample
        nearest = np.repeat(self.desired, self.model.hold)[: self.ticks]
        least, most = nearest - farthest - after, nearest + farthest + after
        if self.start is not None:
            near = distance_from_rest(self.model, self.ticks, "envelope") / self.unit
            least[: len(near)] = np.maximum(least[: len(near)], self.start - near)
            most[: len(near)] = np.minimum(most[: len(near)], self.start + near)
        return Ranges(least, most, np.full(self.ticks, -1.0), np.full(self.ticks, 1.0))

    @cached_property
    def speeds(self) -> sparse.csr_array:
        """Rows x(t) - x(t-1), of the ticks from the first known speed on."""
        eye = sparse.eye_array(self.ticks, self.size, format="csr")
        moved = np.arange(self.first, self.ticks)
        return sparse.csr_array(eye[moved] - eye[self.before[moved]])

    @cached_property
    def driven(self) -> sparse.csr_array:
        """Rows that vanish: every speed less the calls that make it."""
        entries, count = self.entries, len(self.entries.tick)
        weighted = sparse.csr_array(
            (entries.weight, (entries.tick, self.ticks + np.arange(count))),
            shape=(self.ticks, self.size),
        )
        return sparse.csr_array(self.speeds - weighted[self.first :])

    @cached_property
    def changes(self) -> tuple[sparse.csr_array, Indices]:
        """Rows u(r, t+1) - u(r, t), and the place of tick t among the speeds."""
        entries = self.entries
        pairs = np.flatnonzero((entries.following >= 0) & (entries.tick >= self.first))
        row = np.arange(len(pairs))
        ones = np.ones(len(pairs))
        matrix = sparse.csr_array(
            (
                np.concatenate([ones, -ones]),
                (
                    np.concatenate([row, row]),
                    self.ticks + np.concatenate([entries.following[pairs], pairs]),
                ),
            ),
            shape=(len(pairs), self.size),
        )
        return matrix, entries.tick[pairs] - self.first


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
    answer = nearest_point(
        matrix,
        limits,
        task.sampled,
        task.desired,
        norm=task.norm,
        equations=task.driven.shape[0],
    )
    point, multipliers = answer.unknowns, answer.multipliers
    angles = np.clip(point[: task.ticks], ranges.least, ranges.most)
    # What is compared with nothing may be anywhere in its range.
    room = np.ones(task.size)
    room[: task.ticks] = np.maximum(ranges.most - angles, angles - ranges.least)
    room[task.sampled] = 0.0
    compared = np.zeros(task.size)
    compared[: task.ticks] = angles
    compared[task.sampled] = task.desired
    proved, gradient = dual_value(matrix, limits, multipliers, compared, room)
    at_samples = gradient[task.sampled]
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


def contributions(model: JointModel, ticks: int, *, cyclic: bool) -> Contributions:
    """Every pair of a tick and a request that acts there.

    From rest, requests before the first are the first one.
    """
    window = model.window
    requests = ticks // model.hold if cyclic else (ticks - 1) // model.hold + 1
    ages = window.first + np.arange(len(window.weights))
    tick = np.repeat(np.arange(ticks), len(ages))
    number = np.floor_divide((np.arange(ticks)[:, np.newaxis] - ages).ravel(), model.hold)
    if not cyclic:
        number = np.maximum(number, 0)
    # In a short cycle a request may act twice at one tick, as sent in two cycles: it is the same.
    number = number % requests
    key = tick * requests + number
    unique, inverse = np.unique(key, return_inverse=True)
    weight: Array = np.zeros(len(unique))
    np.add.at(weight, inverse, np.tile(window.weights, ticks))
    tick, number = np.divmod(unique, requests)
    later = tick + 1
    wanted = (later % ticks) * requests + number
    place = np.minimum(np.searchsorted(unique, wanted), len(unique) - 1)
    found = unique[place] == wanted
    if not cyclic:
        found &= later < ticks
    return Contributions(tick, number, weight, np.where(found, place, -1))
