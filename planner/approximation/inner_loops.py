"""The fitter's inner loops, compiled: bounded slopes, chains on grids, descents, small QPs.

Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import math

import numpy as np

from planner.approximation.fit_problem import Problem
from planner.arrays import Array, Indices, Mask
from planner.compilation import compiled, inner


@compiled
def open_ended(desired: Array, weights: Array, step: float) -> Array:
    """The x nearest to ``desired``, in weighted squares, with |x[k+1] - x[k]| <= step, (n,).

    The cost of the best sequence that ends in x is convex and piecewise quadratic. Its derivative
    is kept as two stacks of corners left and right of its root, which one more sample moves apart
    by ``step`` and tilts by its weight. From the last root the sequence follows backwards.
    """
    samples = len(desired)
    # Corners: place + k * step on the left, - on the right, and change of the slope outwards.
    left, right = np.empty((2 * samples, 2)), np.empty((2 * samples, 2))
    on_left = on_right = 0
    best = np.empty(samples)  # for every k the x[k] that is best for the samples up to k alone
    root, slope = desired[0], weights[0]
    best[0] = root
    for k in range(1, samples):
        shift = k * step
        # The split at the root: flat between, the old slope outside.
        left[on_left, 0], left[on_left, 1] = root - step + shift, slope
        right[on_right, 0], right[on_right, 1] = root + step - shift, slope
        on_left, on_right = on_left + 1, on_right + 1
        root, slope = desired[k], weights[k]
        while on_left and left[on_left - 1, 0] - shift > root:
            on_left -= 1
            at, change = left[on_left, 0] - shift, left[on_left, 1]
            height = slope * (at - root)
            slope += change
            root = at - height / slope
            right[on_right, 0], right[on_right, 1] = at - shift, -change
            on_right += 1
        while on_right and right[on_right - 1, 0] + shift < root:
            on_right -= 1
            at, change = right[on_right, 0] + shift, right[on_right, 1]
            height = slope * (root - at)
            slope += change
            root = at + height / slope
            left[on_left, 0], left[on_left, 1] = at + shift, -change
            on_left += 1
        best[k] = root
    for k in range(samples - 2, -1, -1):
        best[k] = min(max(best[k], best[k + 1] - step), best[k + 1] + step)
    return best


@compiled
def cheapest_chain(
    nodes: Indices, values: Array, sums: Array, fixed: Mask, step: float, segments: int
) -> Indices:
    """Nodes on the cheapest way of so many chords from the first to the last; empty if none.

    The nodes are increasing samples, (m,), with ``values`` and the ``sums`` of the samples d, k d
    and d² up to them, (3, m); the ``fixed`` ones must be on the way. The cost of a chord is its
    squared error over the samples after its start, infinite where it is too steep.
    """
    size = len(nodes)
    costs = np.full((size, size), np.inf)  # by end and start
    for i in range(size):
        for j in range(i + 1, size):
            length = float(nodes[j] - nodes[i])
            d0, a, slope = sums[0, j] - sums[0, i], values[i], (values[j] - values[i]) / length
            d1, d2 = sums[1, j] - sums[1, i] - nodes[i] * d0, sums[2, j] - sums[2, i]
            w1 = 0.5 * length * (length + 1.0)
            w2 = w1 * (2.0 * length + 1.0) / 3.0
            if abs(slope) <= step * (1.0 + 1e-9):
                cost = a * (length * a + 2.0 * (slope * w1 - d0))
                cost += slope * (slope * w2 - 2.0 * d1) + d2
                costs[j, i] = max(cost, 0.0)
            if fixed[j]:
                break
    total, after = np.full(size, np.inf), np.zeros(size)
    total[0] = 0.0
    came_from = np.zeros((segments, size), np.int64)
    for level in range(segments):
        for end in range(size):
            best = 0
            for start in range(end):
                if total[start] + costs[end, start] < total[best] + costs[end, best]:
                    best = start
            came_from[level, end] = best
            after[end] = total[best] + costs[end, best]
        total, after = after, total
    if not total[size - 1] < np.inf:
        return np.zeros(0, np.int64)
    way = np.zeros(segments + 1, np.int64)
    way[segments] = size - 1
    for level in range(segments - 1, -1, -1):
        way[level] = came_from[level, way[level + 1]]
    return way


@compiled
def descend(
    problem: Problem, curve: Array, free: Mask, rounds: int, progress: float
) -> tuple[Array, float]:
    """Newton's method on knots and values, damped until it goes down; never worse than the start.

    A ``curve`` is its knots and then its values, within the slopes, (2K,); the knots of a cycle lie
    within one cycle, which may begin in any turn. Those that are ``free`` move, by at most so many
    evaluations, until the squared error decreases by a smaller share than ``progress``. Returns the
    curve and its squared error.
    """
    size, step = len(curve) // 2, problem.step
    # The conditions A x <= b of curves x: slopes not too high, not too low, no segment too short.
    count = size if problem.cyclic else size - 1
    rows, limits = np.zeros((3 * count, 2 * size)), np.zeros(3 * count)
    for start in range(count):
        end = (start + 1) % size
        period = problem.desired.size if end == 0 else 0
        for way, sign in ((start, 1.0), (count + start, -1.0)):
            rows[way, start] += step
            rows[way, end] -= step
            rows[way, size + start] -= sign
            rows[way, size + end] += sign
            limits[way] = step * period
        rows[2 * count + start, start] += 1.0
        rows[2 * count + start, end] -= 1.0
        limits[2 * count + start] = period - 1.0
    error, gradient, hessian, diagonal = evaluate(problem, curve)
    damping, scales = 1e-3, np.zeros(2 * size)
    for _ in range(rounds):
        by_knot, by_value = 0.0, 0.0
        for i in range(size):
            by_knot, by_value = by_knot + diagonal[i] / size, by_value + diagonal[size + i] / size
        for i in range(size):
            # A knot between segments of one slope has no curvature, nor has a constant by any knot.
            scales[i] = diagonal[i] + 1e-2 * by_knot + 1e-12 * by_value
            scales[size + i] = diagonal[size + i] + 1e-6 * by_value
        bounds = limits.copy()
        for i in range(len(rows)):
            for j in range(2 * size):
                bounds[i] -= rows[i, j] * curve[j]
            bounds[i] = max(bounds[i], 0.0)
        move, solved, damping = minimise_damped(
            hessian, gradient, rows, bounds, free, scales, damping
        )
        if not solved:
            damping *= 10.0
            continue
        predicted, other, curved = 0.0, curve.copy(), combined(move, hessian)
        for i in range(2 * size):
            predicted -= (2.0 * gradient[i] + curved[i] + damping * scales[i] * move[i]) * move[i]
            other[i] += move[i]
        there = evaluate(problem, other)
        gain = error - there[0]
        if gain > 0.0:
            curve = other
            error, gradient, hessian, diagonal = there
            if gain <= progress * error and damping < 1.0:
                break
        elif predicted <= progress * error:
            break
        damping *= 0.2 if gain > 0.5 * predicted else 0.7 if gain > 0.0 else 6.0
    return curve, error


@inner
def evaluate(problem: Problem, curve: Array) -> tuple[float, Array, Array, Array]:
    """Squared error of a curve, (2K,); gradient, Hessian, Gauss-Newton diagonal of half of it."""
    desired, cyclic = problem.desired, problem.cyclic
    size, n, error = len(curve) // 2, problem.desired.size, 0.0
    knots, values = curve[:size], curve[size:]
    gradient, diagonal = np.zeros(2 * size), np.zeros(2 * size)
    hessian = np.zeros((2 * size, 2 * size))
    part, own = np.empty(4), np.empty((4, 4))
    for start in range(size if cyclic else size - 1):
        end = (start + 1) % size
        # A knot a rounding behind a sample counts as on it, as bounds may hold knots on samples.
        first, stop = math.ceil(knots[start] - 1e-9), math.ceil(knots[end] - 1e-9)
        length, rise = knots[end] - knots[start], values[end] - values[start]
        if end == 0:
            length, stop = length + n, stop + n
        if not cyclic and start == 0:
            first = 0
        if not cyclic and end == size - 1:
            stop = n
        # Σ w, Σ w u, Σ w u², Σ r and Σ r u with u the share of the segment
        w0 = w1 = w2 = r0 = r1 = 0.0
        for k in range(first, stop):
            share, weight = (k - knots[start]) / length, 1.0
            residual = values[start] + share * rise - desired[k % n]
            error += residual * residual
            beyond = abs(residual) - problem.bound
            if beyond > 0.0:
                error += problem.penalty * beyond * beyond
                residual += np.copysign(problem.penalty * beyond, residual)
                weight += problem.penalty
            r0, r1 = r0 + residual, r1 + residual * share
            w0, w1, w2 = w0 + weight, w1 + weight * share, w2 + weight * share * share
        g0, g1, s11, s01 = r0 - r1, r1, w2, w1 - w2
        s00 = w0 - w1 - s01
        slope, e0, e1 = rise / length, g0 / length, g1 / length
        m00, m01, m11 = slope * s00, slope * s01, slope * s11
        # By start knot, end knot, start value, end value.
        part[0], part[1], part[2], part[3] = -slope * g0, -slope * g1, g0, g1
        own[0, 0] = slope * (m00 - 2.0 * e0)
        own[1, 1] = slope * (m11 + 2.0 * e1)
        own[0, 1] = slope * (m01 + e0 - e1)
        own[0, 2], own[0, 3] = e0 - m00, -m01 - e0
        own[1, 2], own[1, 3] = e1 - m01, -m11 - e1
        own[2, 2], own[2, 3], own[3, 3] = s00, s01, s11
        variables = (start, end, size + start, size + end)
        for i in range(4):
            gradient[variables[i]] += part[i]
            for j in range(4):
                hessian[variables[i], variables[j]] += own[min(i, j), max(i, j)]
        diagonal[start] += slope * m00
        diagonal[end] += slope * m11
        diagonal[size + start] += s00
        diagonal[size + end] += s11
    return error, gradient, hessian, diagonal


@inner
def minimise_damped(
    hessian: Array,
    gradient: Array,
    rows: Array,
    bounds: Array,
    free: Mask,
    scales: Array,
    damping: float,
) -> tuple[Array, bool, float]:
    """The p that minimises ½ pᵀ(H + λS)p + gᵀp among those with A p <= b; b >= 0, (r,).

    It is -(H + λS)⁻¹(g + Aᵀu) with the u >= 0 that minimises the dual, ½ uᵀGu - sᵀu with G = A (H +
    λS)⁻¹ Aᵀ and s = -A (H + λS)⁻¹ g - b. Variables that are not ``free`` stay zero; ``scales`` are
    the diagonal of S. λ grows tenfold until the sum is definite. Returns p, zero without a
    solution; whether there is one; and λ.
    """
    nothing, count = np.zeros(len(gradient)), len(rows)
    while True:
        inverse, definite = inverse_of(hessian, free, scales, damping)
        if definite:
            break
        damping *= 10.0
        if not damping < 1e13:  # where a number is not finite, it never ends
            return nothing, False, damping
    unbound, along, gram = combined(gradient, inverse), rows.copy(), np.empty((count, count))
    short, move, across = np.zeros(count), np.zeros(len(gradient)), inverse.T.copy()
    for i in range(count):
        along[i] = combined(rows[i], across)
        for j in range(len(move)):
            short[i] -= rows[i, j] * unbound[j]
        short[i] -= bounds[i]
    across = along.T.copy()
    for i in range(count):
        gram[i] = combined(rows[i], across)
    beside = combined(non_negative(gram, short), along)
    for j in range(len(move)):
        move[j] = -unbound[j] - beside[j]
    reach, beyond = 1e-300, -np.inf
    for i in range(count):
        moved, far = 0.0, 0.0
        for j in range(len(move)):
            moved, far = moved + rows[i, j] * move[j], far + abs(rows[i, j] * move[j])
        reach, beyond = max(reach, far), max(beyond, moved - bounds[i])
    if not beyond <= 1e-9 * reach:
        return nothing, False, damping
    return move, True, damping


@inner
def combined(shares: Array, rows: Array) -> Array:
    """The sum of the rows of a matrix, each times its share; zeros take no time."""
    total = np.zeros(rows.shape[1])
    for i in range(len(rows)):
        if shares[i] != 0.0:
            for j in range(len(total)):
                total[j] += shares[i] * rows[i, j]
    return total


@inner
def inverse_of(matrix: Array, chosen: Mask, diagonal: Array, share: float) -> tuple[Array, bool]:
    """The inverse of a matrix's chosen part, a share of a diagonal added; whether there is one.

    By Gauss and Jordan's elimination, which needs no pivoting where they are positive definite.
    """
    size = len(matrix)
    inverse = np.zeros((size, size))
    for i in range(size):
        for j in range(size if chosen[i] else 0):
            inverse[i, j] = matrix[i, j] if chosen[j] else 0.0
        inverse[i, i] += share * diagonal[i] if chosen[i] else 0.0
    for k in range(size):
        if not chosen[k]:
            continue
        pivot = inverse[k, k]
        if not pivot > 1e-15 * (matrix[k, k] + share * diagonal[k]):
            return inverse, False
        inverse[k, k] = 1.0
        for j in range(size):
            inverse[k, j] /= pivot
        for i in range(size):
            factor = inverse[i, k]
            if i != k and factor != 0.0:
                inverse[i, k] = 0.0
                for j in range(size):
                    inverse[i, j] -= factor * inverse[k, j]
    return inverse, True


@inner
def non_negative(gram: Array, short: Array) -> Array:
    """The u >= 0 that minimises ½ uᵀGu - sᵀu for a semidefinite G: non-negative least squares.

    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, Chapter 23.
    """
    count, enough = len(short), 0.0
    squares, lengths, multipliers = np.zeros((3, count))
    active = np.zeros(count, np.bool_)
    for i in range(count):  # infinite for bounds on variables that stay
        squares[i] = gram[i, i]
        lengths[i] = math.sqrt(gram[i, i]) if gram[i, i] > 0.0 else np.inf
        enough = max(enough, 1e-15 * abs(short[i]) / lengths[i])
    for _ in range(3 * count):
        reached, worst, violation = combined(multipliers, gram), 0, 0.0
        for i in range(count):
            if not active[i] and (short[i] - reached[i]) / lengths[i] > violation:
                worst, violation = i, (short[i] - reached[i]) / lengths[i]
        if violation <= enough:
            break
        active[worst], settled = True, False
        while not settled:
            # Bounds may repeat one another: a touch of regularisation, removed by refinement.
            inverse, definite = inverse_of(gram, active, squares, 1e-13)
            if not definite:
                return multipliers
            trial = np.zeros(count)
            for _ in range(3):
                residual = combined(trial, gram)
                for i in range(count):
                    residual[i] = short[i] - residual[i] if active[i] else 0.0
                further = combined(residual, inverse)
                for i in range(count):
                    trial[i] += further[i]
            share, settled = 1.0, True
            for i in range(count):
                before = multipliers[i]
                if active[i] and trial[i] <= 0.0 and before <= share * (before - trial[i]):
                    share, worst, settled = before / (before - trial[i]), i, False
            for i in range(count):
                multipliers[i] += share * (trial[i] - multipliers[i])
            if not settled:
                multipliers[worst], active[worst] = 0.0, False
    return multipliers
