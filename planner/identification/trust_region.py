"""The step of a fit in its trust region, compiled: Moré (1978), with first angles eliminated.

The unknowns are the free coordinates, p of them, and the first angle of each run, which acts on the
rows of its own run alone (Golub and Pereyra, 1973): the normal equations of the first angles are
diagonal. Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Indices
from planner.compilation import compiled, inner


class Quadratic(NamedTuple):
    """Huber's loss to second order, by the free coordinates and the first angles."""

    whole: Array  # second derivatives by the coordinates, (p, p)
    by_parameter: Array  # first derivatives by them, (p,)
    matrix: Array  # the same with the first angles eliminated, (p, p)
    gradient: Array  # (p,)
    sizes: Array  # size of each coordinate's derivatives, (p,)
    beside: Array  # second derivatives by first angles and coordinates, (runs, p)
    squares: Array  # second derivatives by first angles, (runs,); inf where one is held
    by_start: Array  # first derivatives by them, (runs,)


@compiled
def quadratic_of(
    slopes: Array,
    change: Array,
    residuals: Array,
    weights: Array,
    corner: float,
    run: Indices,
    firsts: Array,
) -> Quadratic:
    """J'WJ and J'Wr of Huber's loss of weighted residuals r: W = w^2 min(1, corner / abs(w r)).

    Slopes are derivatives of the angles by the law's numbers, and last by the first angle of the
    row's own run, (rows, c + 1); ``change`` those of these numbers by the coordinates, (c, p). A
    first angle that counts hardly more than in its own row, with the weight of ``firsts``, is held.
    """
    (laws, count), runs = change.shape, len(firsts)
    of_law, by_law = np.zeros((laws, laws)), np.zeros(laws)
    joint, squares, by_start = np.zeros((runs, laws)), np.zeros(runs), np.zeros(runs)
    for row in range(len(residuals)):
        size, start, number = abs(weights[row] * residuals[row]), slopes[row, laws], run[row]
        weight = weights[row] ** 2 * (1.0 if size <= corner else corner / size)
        pull = weight * residuals[row]
        for p in range(laws):
            scaled = weight * slopes[row, p]
            by_law[p] += pull * slopes[row, p]
            joint[number, p] += scaled * start
            for q in range(p + 1):
                of_law[p, q] += scaled * slopes[row, q]
        squares[number] += weight * start * start
        by_start[number] += pull * start
    whole, by_parameter, beside = np.zeros((count, count)), np.zeros(count), np.zeros((runs, count))
    half = np.zeros((laws, count))
    for p in range(laws):
        for q in range(laws):
            product = of_law[max(p, q), min(p, q)]
            for i in range(count):
                half[p, i] += product * change[q, i]
    for i in range(count):
        for p in range(laws):
            by_parameter[i] += change[p, i] * by_law[p]
            for j in range(count):
                whole[i, j] += change[p, i] * half[p, j]
            for r in range(runs):
                beside[r, i] += joint[r, p] * change[p, i]
    matrix, gradient, sizes = whole.copy(), by_parameter.copy(), np.zeros(count)
    for r in range(runs):
        if squares[r] <= 0.5 * firsts[r] ** 2:
            squares[r] = np.inf
    for i in range(count):
        sizes[i] = np.sqrt(max(whole[i, i], 0.0))
        for r in range(runs):
            share = beside[r, i] / squares[r]
            gradient[i] -= share * by_start[r]
            for j in range(count):
                matrix[i, j] -= share * beside[r, j]
    return Quadratic(whole, by_parameter, matrix, gradient, sizes, beside, squares, by_start)


@compiled
def most_reduction(near: Quadratic) -> float:
    """By how much the Gauss-Newton step would lower the loss, were it free."""
    step, total = np.zeros(len(near.gradient)), 0.0
    unit = np.where(near.sizes > 0.0, near.sizes, 1.0)
    set_damped(near.matrix / unit / unit[:, np.newaxis], near.gradient / unit, np.inf, step)
    for i in range(len(step)):
        total -= near.gradient[i] * step[i] / unit[i]
    for r in range(len(near.squares)):
        total += near.by_start[r] ** 2 / near.squares[r]
    return 0.5 * total


@compiled
def step_of(
    near: Quadratic, sizes: Array, radius: float, lower: Array, upper: Array
) -> tuple[Array, Array, float, float]:
    """The step in a trust region that stays between least and largest changes of the coordinates.

    ``sizes`` are the units of these in the region [rad], (p,); one of 0 does not move. Returned are
    the step, how the first angles follow [rad], by how much the quadratic falls [rad^2], and the
    length of the step in the unit of the radius [rad].
    """
    count, step, starts = len(sizes), np.zeros(len(sizes)), np.zeros(len(near.squares))
    moves = sizes > 0.0
    for i in range(count):
        held = lower[i] >= 0.0 and near.gradient[i] > 0.0
        moves[i] &= not (held or (upper[i] <= 0.0 and near.gradient[i] < 0.0))
    while moves.any():
        free = np.flatnonzero(moves)
        gradient, matrix = np.empty(len(free)), np.empty((len(free), len(free)))
        for a in range(len(free)):
            i = free[a]
            gradient[a] = near.gradient[i]
            for j in range(count):
                gradient[a] += 0.0 if moves[j] else near.matrix[i, j] * step[j]
            gradient[a] /= sizes[i]
            for b in range(len(free)):
                matrix[a, b] = near.matrix[i, free[b]] / (sizes[i] * sizes[free[b]])
        found = np.empty(len(free))
        set_damped(matrix, gradient, radius, found)
        beyond = False
        for a in range(len(free)):
            i = free[a]
            step[i] = found[a] / sizes[i]
            if step[i] < lower[i] or step[i] > upper[i]:
                step[i], moves[i], beyond = min(max(step[i], lower[i]), upper[i]), False, True
        if not beyond:
            break
    reduction, squared, longest = 0.0, 0.0, 0.0
    for i in range(count):
        squared += (sizes[i] * step[i]) ** 2
        reduction -= near.by_parameter[i] * step[i]
        for j in range(count):
            reduction -= 0.5 * step[i] * near.whole[i, j] * step[j]
    for r in range(len(starts)):
        square, slope = near.squares[r], near.by_start[r]
        for i in range(count):
            slope += near.beside[r, i] * step[i]
        most = radius / np.sqrt(square)
        starts[r] = min(max(-slope / square, -most), most)
        if square < np.inf:
            reduction -= (slope + 0.5 * square * starts[r]) * starts[r]
            longest = max(longest, np.sqrt(square) * abs(starts[r]))
    return step, starts, reduction, max(np.sqrt(squared), longest)


@inner
def set_damped(matrix: Array, gradient: Array, radius: float, step: Array) -> None:
    """Fill the Gauss-Newton step, damped so that it is no longer than the radius by a tenth.

    Newton's method for the damping, with the factor L L' of the damped matrix.
    """
    size, damping, least = len(gradient), 0.0, 1e-18
    for i in range(size):
        least = max(least, matrix[i, i])
    least *= 1e-12  # of a matrix in its own unit
    lower, half = np.zeros((size, size)), np.empty(size)
    for _ in range(20):
        for i in range(size):
            for j in range(i + 1):
                entry = matrix[i, j] + (least + damping if i == j else 0.0)
                for k in range(j):
                    entry -= lower[i, k] * lower[j, k]
                lower[i, j] = np.sqrt(max(entry, least)) if i == j else entry / lower[j, j]
            half[i] = gradient[i]
            for k in range(i):
                half[i] -= lower[i, k] * half[k]
            half[i] /= lower[i, i]
        squared, by_damping = 0.0, 0.0
        for i in range(size - 1, -1, -1):
            step[i] = -half[i]
            for k in range(i + 1, size):
                step[i] -= lower[k, i] * step[k]
            step[i] /= lower[i, i]
            squared += step[i] ** 2
        length = np.sqrt(squared)
        if length <= 1.1 * radius:
            break
        for i in range(size):
            half[i] = step[i]
            for k in range(i):
                half[i] -= lower[i, k] * half[k]
            half[i] /= lower[i, i]
            by_damping += half[i] ** 2
        damping += squared / by_damping * (length - radius) / radius
