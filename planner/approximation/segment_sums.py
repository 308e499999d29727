"""What curves cost by their knots alone: the squared error of best values, for thousands at once.

What a segment costs follows from running sums over the samples, wherever it begins and ends. A path
of two segments, and a cycle of two or three, have two free slopes at most, and so best values
within the slopes in closed form; those of longer paths are found with the slopes free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.approximation.moments import between, running
from planner.approximation.objective import Problem
from planner.trajectory import Array

TINY = 1e-12
"""Least curvature, lest a knot without samples divides by none."""


class Pieces(NamedTuple):
    """Sums over segments, with u the share of a segment behind a sample; any shape."""

    s00: Array  # Σ w (1-u)²
    s01: Array  # Σ w u (1-u)
    s11: Array  # Σ w u²
    r0: Array  # Σ w d (1-u)
    r1: Array  # Σ w d u
    length: Array  # [samples]

    def of(self, segment: int) -> Pieces:
        """Those of one segment of every curve, where the last axis counts them."""
        return Pieces(*(each[..., segment] for each in self))


class SegmentSums:
    """Running sums over the samples of a problem, of a cycle over two turns."""

    def __init__(self, problem: Problem) -> None:
        """Sum up once; O(n)."""
        n = problem.samples
        count = 2 * n + 1 if problem.cyclic else n
        self.problem = problem
        self._totals = np.stack(
            running(np.resize(problem.desired, count), np.resize(problem.weights, count))
        )
        self._weight = float(problem.weights.sum())
        self._moment = float(problem.weights @ problem.desired)
        self.square = float(problem.weights @ problem.desired**2)

    def pieces(self, start: Array, end: Array) -> Pieces:
        """The sums of segments between these places, of any shapes that broadcast."""
        begun, ended = (self._totals[:, place.astype(np.intp)] for place in (start, end))
        sums = between(start, list(begun), list(ended))
        length = np.maximum(end - start, TINY)
        k1, k2, e1 = sums.w1 / length, sums.w2 / length**2, sums.d1 / length
        s00, r0 = sums.w0 - 2.0 * k1 + k2, sums.d0 - e1
        if not self.problem.cyclic:  # a path's first sample is in its first segment
            first = self.problem.weights[0] * (start == 0.0)
            s00, r0 = s00 + first, r0 + first * self.problem.desired[0]
        return Pieces(s00, k1 - k2, k2, r0, e1, length)

    def gains(self, pieces: Pieces) -> Array:
        """By how much curves of these segments, the last axis, are below Σ w d² at best."""
        segments = pieces.length.shape[-1]
        if not self.problem.cyclic and segments > 2:
            return _free(pieces)
        return self._bounded(pieces, segments)

    def _bounded(self, pieces: Pieces, segments: int) -> Array:
        """Within the slopes, by the rises p and q of the first two segments."""
        one, two = pieces.of(0), pieces.of(1)
        step = self.problem.step
        qq, pq = two.s11, two.s01 + two.s11
        pp = one.s11 + two.s00 + two.s01 + pq
        by_q, by_p = two.r1, one.r1 + two.r0 + two.r1
        of_q, of_p = pq, one.s01 + pp
        reach = [step * one.length, step * two.length, np.full_like(one.length, np.inf)]
        if segments == 3:  # back from where both rises lead
            three = pieces.of(2)
            pp, pq, qq = pp + three.s00, pq + three.s00, qq + three.s00
            by_p, by_q = by_p + three.r0, by_q + three.r0
            back = three.s00 + three.s01
            of_p, of_q = of_p + back, of_q + back
            reach[2] = step * three.length
        # Less the share of the first value, which is free.
        weight, moment = self._weight, self._moment
        pp, pq, qq = pp - of_p**2 / weight, pq - of_p * of_q / weight, qq - of_q**2 / weight
        by_p, by_q = by_p - moment * of_p / weight, by_q - moment * of_q / weight
        if self.problem.cyclic and segments == 2:  # q = -p
            bend, pull = pp - 2.0 * pq + qq, by_p - by_q
            most = np.minimum(reach[0], reach[1])
            rise = np.clip(pull / np.maximum(bend, TINY), -most, most)
            gain = rise * (2.0 * pull - bend * rise)
        else:
            gain = _most_of_two(pp, pq, qq, by_p, by_q, reach)
        return np.asarray(gain + moment * moment / weight)


def _most_of_two(
    pp: Array, pq: Array, qq: Array, by_p: Array, by_q: Array, reach: list[Array]
) -> Array:
    """The most of 2 (by_p p + by_q q) - pp p² - 2 pq p q - qq q² with |p|, |q|, |p + q| in reach.

    It is inside or on an edge, where one variable is free between the bounds of the others.
    """

    def gain(p: Array, q: Array) -> Array:
        return p * (2.0 * (by_p - pq * q) - pp * p) + q * (2.0 * by_q - qq * q)

    b1, b2, b3 = reach
    determinant = np.maximum(pp * qq - pq * pq, TINY)
    p = (by_p * qq - by_q * pq) / determinant
    q = (by_q * pp - by_p * pq) / determinant
    inside = (np.abs(p) <= b1) & (np.abs(q) <= b2) & (np.abs(p + q) <= b3)
    best = np.where(inside, gain(p, q), -np.inf)
    if np.all(inside):
        return best
    bend = pp - 2.0 * pq + qq
    for sign in (-1.0, 1.0):
        p, q, total = sign * b1, sign * b2, sign * b3
        low, high = np.maximum(-b2, -b3 - p), np.minimum(b2, b3 - p)
        along = _between((by_q - pq * p) / np.maximum(qq, TINY), low, high)
        best = np.where(low <= high, np.maximum(best, gain(p, along)), best)
        low, high = np.maximum(-b1, -b3 - q), np.minimum(b1, b3 - q)
        along = _between((by_p - pq * q) / np.maximum(pp, TINY), low, high)
        best = np.where(low <= high, np.maximum(best, gain(along, q)), best)
        if np.isfinite(b3).all():
            low, high = np.maximum(-b1, total - b2), np.minimum(b1, total + b2)
            along = (by_p - by_q + (qq - pq) * total) / np.maximum(bend, TINY)
            along = _between(along, low, high)
            best = np.where(low <= high, np.maximum(best, gain(along, total - along)), best)
    return best


def _between(place: Array, low: Array, high: Array) -> Array:
    return np.asarray(np.minimum(np.maximum(place, low), high))


def _free(pieces: Pieces) -> Array:
    """With the slopes of a path free: the system of its values, eliminated knot by knot."""
    piece = pieces.of(0)
    floor = TINY * float(np.max(pieces.s11))
    diagonal, right = np.maximum(piece.s00, floor), piece.r0
    gain = right * right / diagonal
    segments = pieces.length.shape[-1]
    for number in range(1, segments + 1):
        factor = piece.s01 / diagonal
        right = piece.r1 - factor * right
        diagonal = piece.s11 - factor * piece.s01
        if number < segments:
            piece = pieces.of(number)
            right, diagonal = right + piece.r0, diagonal + piece.s00
        diagonal = np.maximum(diagonal, floor)
        gain = gain + right * right / diagonal
    return np.asarray(gain)
