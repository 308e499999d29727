"""What the exact bound is about: the unknowns and their equations, in units of v_max a tick."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.inversion.exact import contributions
from planner.inversion.question import Question
from planner.inversion.reachable import setting_off
from planner.trajectory import Array

Indices = npt.NDArray[np.int_]


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

    def __init__(self, question: Question, known: float) -> None:
        """Scale the problem: one is what the joint can move in a tick."""
        model, desired, cyclic, norm, start = question
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
            near = setting_off(self.model, self.ticks, "envelope") / self.unit
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
