"""The fitter's inner loops, compiled: bounded slopes, chains on grids, descents, small QPs.

Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from planner.compilation import compiled, inner
from planner.trajectory import Array, Mask

Indices = npt.NDArray[np.intp]


@compiled
def open_ended(desired: Array, weights: Array, step: float) -> Array:
    """The x nearest to ``desired`` with |x[k+1] - x[k]| <= step, shape (n,).

    The cost of the best sequence that ends in x is convex and piecewise quadratic. Its derivative
    is kept as two stacks of corners left and right of its root, which one more sample moves apart
    by ``step`` and tilts by its weight. From the last root, the best end, the sequence follows
    backwards.

    Args:
        desired: Sequence to approximate [any unit], (n,).
        weights: Weight of every sample's squared error, (n,).
        step: Largest change from one sample to the next [same unit].
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
def segment_costs(
    desired: Array, step: float, nodes: Indices, states: Array, fixed: Mask, by_lines: bool
) -> Array:
    """Squared errors of segments between nodes, each over the samples after its start.

    Args:
        desired: Samples, shape (n,).
        step: Largest change per sample.
        nodes: Samples where knots may lie, increasing, shape (m,).
        states: Values that the curve may have there, shape (m, g); infinite where there are fewer.
        fixed: Which nodes must be knots, shape (m,).
        by_lines: Whether a segment is the best line within the slopes through its samples, whatever
            its states, of which there is one.

    Returns:
        Costs by end and start, shape (m g, m g), infinite where a segment is too steep, does not
        end after its start or passes a fixed node.
    """
    size, count = states.shape
    costs, totals = _infinite(size * count), _totals(desired)
    for i in range(size):
        for j in range(i + 1, size):
            length = float(nodes[j] - nodes[i])
            d0, d1, d2 = _moments(totals, nodes[i], nodes[j])
            w1 = 0.5 * length * (length + 1.0)
            if by_lines:
                sxx, sxy = length * (length * length - 1.0) / 12.0, d1 - w1 * d0 / length
                slope = min(max(sxy / max(sxx, 1e-9), -step), step)
                cost = d2 - d0 * d0 / length + slope * (slope * sxx - 2.0 * sxy)
                costs[j, i] = max(cost, 0.0)
            w2 = w1 * (2.0 * length + 1.0) / 3.0
            for start in range(0 if by_lines else count):
                a = states[i, start]
                for end in range(count):
                    slope = (states[j, end] - a) / length
                    if abs(slope) <= step * (1.0 + 1e-9):
                        cost = a * (length * a + 2.0 * (slope * w1 - d0))
                        cost += slope * (slope * w2 - 2.0 * d1) + d2
                        costs[j * count + end, i * count + start] = max(cost, 0.0)
            if fixed[j]:
                break
    return costs


@inner
def _infinite(size: int) -> Array:
    """A matrix of infinite numbers."""
    matrix = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            matrix[i, j] = np.inf
    return matrix


@inner
def _totals(desired: Array) -> Array:
    """Running sums of d, k d and d², shape (3, n)."""
    totals = np.zeros((3, len(desired)))
    d0, d1, d2 = 0.0, 0.0, 0.0
    for k in range(len(desired)):
        d0, d1, d2 = d0 + desired[k], d1 + k * desired[k], d2 + desired[k] * desired[k]
        totals[0, k], totals[1, k], totals[2, k] = d0, d1, d2
    return totals


@inner
def _moments(totals: Array, start: int, end: int) -> tuple[float, float, float]:
    """Σ d, Σ k d and Σ d² over the samples after ``start`` up to ``end``, with k = 0 there."""
    d0 = totals[0, end] - totals[0, start]
    d1 = totals[1, end] - totals[1, start] - start * d0
    return d0, d1, totals[2, end] - totals[2, start]


@compiled
def cheapest_chain(costs: Array, at_start: Array, segments: int) -> Indices:
    """States on the cheapest way from the first node to the last; empty if there is none.

    Args:
        costs: Costs of segments by end and start, shape (m g, m g).
        at_start: Costs of the states of the first node, shape (g,).
        segments: Number of segments.
    """
    size, count = len(costs), len(at_start)
    total, after = np.zeros(size), np.zeros(size)
    for state in range(size):
        total[state] = at_start[state] if state < count else np.inf
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
    last = size - count
    for state in range(last, size):
        if total[state] < total[last]:
            last = state
    if not total[last] < np.inf:
        return np.zeros(0, np.int64)
    way = np.zeros(segments + 1, np.int64)
    way[segments] = last
    for level in range(segments - 1, -1, -1):
        way[level] = came_from[level, way[level + 1]]
    return way


@compiled
def descend(
    desired: Array,
    step: float,
    cyclic: bool,
    knots: Array,
    values: Array,
    free: Mask,
    rounds: int,
    progress: float,
) -> tuple[Array, Array, float]:
    """Newton's method on knots and values, damped until it goes down.

    Args:
        desired: Samples, shape (n,).
        step: Largest change per sample.
        cyclic: Whether the first sample follows the last.
        knots: Where to start, of a cycle within one cycle, which may begin in any turn, shape (K,).
        values: Values there, within the slopes, shape (K,).
        free: Which knots and then which values move, shape (2K,).
        rounds: Most evaluations.
        progress: Relative decrease of the squared error below which the descent ends.

    Returns:
        Knots, values and squared error of the best curve; never worse than the start.
    """
    size = len(knots)
    rows = constraint_rows(size, step, cyclic)
    error, gradient, hessian, diagonal = evaluate(desired, cyclic, knots, values)
    zero, moving = 0.0, False
    for k in range(len(desired)):
        zero += 1e-26 * desired[k] * desired[k]
    for i in range(2 * size):
        moving |= free[i]
    damping, scales = 1e-3, np.zeros(2 * size)
    for _ in range(rounds):
        if error <= zero or not moving:
            break
        by_knot, by_value = 0.0, 0.0
        for i in range(size):
            by_knot, by_value = by_knot + diagonal[i] / size, by_value + diagonal[size + i] / size
        for i in range(size):
            # A knot between segments of one slope has no curvature, nor has a constant by any knot.
            scales[i] = diagonal[i] + 1e-2 * by_knot + 1e-12 * by_value
            scales[size + i] = diagonal[size + i] + 1e-6 * by_value
        bounds = slacks(len(desired), step, cyclic, knots, values)
        for i in range(len(bounds)):
            bounds[i] = max(bounds[i], 0.0)
        move, solved, damping = minimise_damped(
            hessian, gradient, rows, bounds, free, scales, damping
        )
        if not solved:
            damping *= 10.0
            continue
        predicted, other_knots, other_values = 0.0, np.zeros(size), np.zeros(size)
        curved = applied(hessian, move)
        for i in range(2 * size):
            predicted -= (2.0 * gradient[i] + curved[i] + damping * scales[i] * move[i]) * move[i]
        for i in range(size):
            other_knots[i], other_values[i] = knots[i] + move[i], values[i] + move[size + i]
        there = evaluate(desired, cyclic, other_knots, other_values)
        gain = error - there[0]
        if gain > 0.0:
            knots, values = other_knots, other_values
            error, gradient, hessian, diagonal = there
            if gain <= progress * error and damping < 1.0:
                break
        elif predicted <= progress * error:
            break
        damping *= 0.2 if gain > 0.5 * predicted else 0.7 if gain > 0.0 else 6.0
    return knots, values, error


@inner
def evaluate(
    desired: Array, cyclic: bool, knots: Array, values: Array
) -> tuple[float, Array, Array, Array]:
    """Squared error of a curve and the derivatives of half of it, knots first, then values.

    Args:
        desired: Samples, shape (n,).
        cyclic: Whether the first sample follows the last.
        knots: Knots t, shape (K,).
        values: Values y, shape (K,).

    Returns:
        The squared error; the gradient, shape (2K,); the Hessian, shape (2K, 2K); and the diagonal
        of the Hessian without the residuals' part, that of Gauss and Newton, shape (2K,).
    """
    size, n = len(knots), len(desired)
    error = 0.0
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
        r0 = r1 = w1 = w2 = 0.0  # Σ r, Σ r u, Σ u and Σ u² with u the share of the segment
        for k in range(first, stop):
            share = (k - knots[start]) / length
            residual = values[start] + share * rise - desired[k % n]
            error += residual * residual
            r0, r1 = r0 + residual, r1 + residual * share
            w1, w2 = w1 + share, w2 + share * share
        g0, g1, s11, s01 = r0 - r1, r1, w2, w1 - w2
        s00 = (stop - first) - w1 - s01
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
def constraint_rows(size: int, step: float, cyclic: bool) -> Array:
    """Rows A such that a step p of knots and values is allowed if A p <= the slacks.

    The bound on a slope, |y' - y| <= v (t' - t), is linear in knots and values together, so the
    rows are the same for all knots and values.

    Args:
        size: Number of knots K.
        step: Largest change per sample v.
        cyclic: Whether a last segment leads from the last knot to the first.

    Returns:
        A, shape (3S, 2K) for S segments: no slope too high, none too low, no segment too short.
    """
    count = size if cyclic else size - 1
    rows = np.zeros((3 * count, 2 * size))
    for start in range(count):
        for knot, sign in ((start, -1.0), ((start + 1) % size, 1.0)):
            rows[start, knot] -= sign * step
            rows[start, size + knot] += sign
            rows[count + start, knot] -= sign * step
            rows[count + start, size + knot] -= sign
            rows[2 * count + start, knot] -= sign
    return rows


@inner
def slacks(samples: int, step: float, cyclic: bool, knots: Array, values: Array) -> Array:
    """How far slopes and lengths are from their bounds, in the order of the rows, shape (3S,)."""
    size = len(knots)
    count = size if cyclic else size - 1
    slack = np.empty(3 * count)
    for start in range(count):
        end = (start + 1) % size
        length = knots[end] - knots[start] + (samples if end == 0 else 0)
        rise = values[end] - values[start]
        slack[start] = step * length - rise
        slack[count + start] = step * length + rise
        slack[2 * count + start] = length - 1.0
    return slack


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
    """The p that minimises ½ pᵀ(H + λS)p + gᵀp among those with A p <= b.

    With H + λS = LLᵀ and z = Lᵀp + L⁻¹g this is the point of a polyhedron that is nearest to the
    origin.

    Args:
        hessian: H, shape (k, k).
        gradient: g, shape (k,).
        rows: A, shape (r, k).
        bounds: b >= 0, shape (r,).
        free: Which variables are sought, shape (k,); the others stay zero.
        scales: Diagonal of S, shape (k,).
        damping: λ; ten times as large as often as it takes to make the sum definite.

    Returns:
        The step, zero without a solution; whether there is one; and the damping.
    """
    size = len(gradient)
    nothing = np.zeros(size)
    inverse = np.zeros((size, size))
    damped = np.zeros((size, size))
    while True:
        for i in range(size):
            for j in range(size):
                damped[i, j] = hessian[i, j] if free[i] and free[j] else 0.0
            damped[i, i] += damping * scales[i] if free[i] else 1.0
        if inverted_factor(damped, inverse):
            break
        damping *= 10.0
        if not damping < 1e13:  # where a number is not finite, it never ends
            return nothing, False, damping
    count, largest = len(rows), 0.0
    own, steepest = np.zeros((count, size)), np.zeros(size)
    for j in range(size):
        if free[j]:
            steepest[j] = gradient[j]
            for i in range(count):
                own[i, j] = rows[i, j]
    nearest = applied(inverse, steepest)  # of all z, but for the conditions
    normals, shortfalls = product(own, transposed(inverse)), np.zeros(count)
    short = applied(normals, nearest)
    for i in range(count):
        shortfalls[i] = -(bounds[i] + short[i])
        largest = max(largest, shortfalls[i])
    if largest > 0.0:
        further = nearest_to_origin(normals, shortfalls)
        for i in range(size):
            nearest[i] += further[i]
    move, reach, beyond = applied(transposed(inverse), nearest), 1e-300, -np.inf
    for j in range(size):
        move[j] = -move[j]
    for i in range(count):
        moved, far = 0.0, 0.0
        for j in range(size):
            moved, far = moved + own[i, j] * move[j], far + abs(own[i, j] * move[j])
        reach, beyond = max(reach, far), max(beyond, moved - bounds[i])
    if not beyond <= 1e-9 * reach:
        return nothing, False, damping
    return move, True, damping


@inner
def applied(matrix: Array, vector: Array) -> Array:
    """A matrix times a vector."""
    answer = np.zeros(len(matrix))
    for i in range(len(matrix)):
        for j in range(len(vector)):
            answer[i] += matrix[i, j] * vector[j]
    return answer


@inner
def product(left: Array, right: Array) -> Array:
    """The product of two matrices; zeros of the left one take no time."""
    answer = np.zeros((len(left), right.shape[1]))
    for i in range(len(left)):
        for k in range(len(right)):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(right.shape[1]):
                    answer[i, j] += factor * right[k, j]
    return answer


@inner
def transposed(matrix: Array) -> Array:
    """The transpose of a matrix, contiguous as well."""
    answer = np.zeros((matrix.shape[1], len(matrix)))
    for i in range(len(matrix)):
        for j in range(matrix.shape[1]):
            answer[j, i] = matrix[i, j]
    return answer


@inner
def inverted_factor(matrix: Array, inverse: Array) -> bool:
    """L⁻¹ of a matrix LLᵀ, written to ``inverse``; False if the matrix is not positive definite."""
    size = len(matrix)
    factor = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = rest / factor[j, j]
            elif rest > 1e-15 * matrix[i, i]:
                factor[i, i] = math.sqrt(rest)
            else:
                return False
    for j in range(size):
        inverse[j, j] = 1.0 / factor[j, j]
        for i in range(j + 1, size):
            total = 0.0
            for k in range(j, i):
                total -= factor[i, k] * inverse[k, j]
            inverse[i, j] = total / factor[i, i]
    return True


@inner
def nearest_to_origin(normals: Array, shortfalls: Array) -> Array:
    """The shortest z with N z >= s, up to rounding if the conditions can be met.

    It is z = Nᵀu with the u >= 0 that minimises ½ |Nᵀu|² - sᵀu: non-negative least squares by
    Lawson and Hanson (Solving Least Squares Problems, 1974, Chapter 23).

    Args:
        normals: N, shape (r, k).
        shortfalls: s, shape (r,).
    """
    count, enough = len(shortfalls), 0.0
    gram, lengths, by_row = (
        product(normals, transposed(normals)),
        np.zeros(count),
        transposed(normals),
    )
    for i in range(count):  # infinite for bounds on variables that stay
        lengths[i] = math.sqrt(gram[i, i]) if gram[i, i] > 0.0 else np.inf
        enough = max(enough, 1e-15 * abs(shortfalls[i]) / lengths[i])
    multipliers, active = np.zeros(count), np.zeros(count, np.int64)
    for _ in range(3 * count):
        reached, worst, violation = applied(gram, multipliers), 0, 0.0
        for i in range(count):
            if not active[i] and (shortfalls[i] - reached[i]) / lengths[i] > violation:
                worst, violation = i, (shortfalls[i] - reached[i]) / lengths[i]
        if violation <= enough:
            break
        active[worst], settled = 1, False
        while not settled:
            index, size = np.zeros(count, np.int64), 0
            for i in range(count):
                if active[i]:
                    index[size] = i
                    size += 1
            system, eased = np.zeros((size, size)), np.zeros((size, size))
            for i in range(size):
                for j in range(size):
                    system[i, j] = eased[i, j] = gram[index[i], index[j]]
                # Bounds may repeat one another: a touch of regularisation, removed by refinement.
                eased[i, i] += 1e-13 * system[i, i]
            inverse, trial, residual = np.zeros((size, size)), np.zeros(size), np.zeros(size)
            if not inverted_factor(eased, inverse):
                return applied(by_row, multipliers)
            for _ in range(3):
                reached = applied(system, trial)
                for i in range(size):
                    residual[i] = shortfalls[index[i]] - reached[i]
                further = applied(transposed(inverse), applied(inverse, residual))
                for i in range(size):
                    trial[i] += further[i]
            share, settled = 1.0, True
            for i in range(size):
                before = multipliers[index[i]]
                if trial[i] <= 0.0 and before <= share * (before - trial[i]):
                    share, worst, settled = before / (before - trial[i]), index[i], False
            for i in range(size):
                multipliers[index[i]] += share * (trial[i] - multipliers[index[i]])
            if not settled:
                multipliers[worst], active[worst] = 0.0, 0
    return applied(by_row, multipliers)
