"""The least-squares sequence with bounded slopes, by an exact dynamic programme, compiled.

Import this module where it is used, inside functions: Numba takes a quarter of a second.
"""

from __future__ import annotations

import numpy as np

from planner.compilation import compiled
from planner.trajectory import Array


@compiled
def open_ended(desired: Array, weights: Array, step: float) -> Array:
    """The x nearest to ``desired`` with |x[k+1] - x[k]| <= step, shape (n,).

    The cost of the best sequence that ends in x is convex and piecewise quadratic. Its derivative
    is kept as two stacks of corners left and right of its root, which one more sample moves apart
    by ``step`` and tilts by its weight. From the last root, the best end, the sequence follows
    backwards.

    Args:
        desired: What to come close to [any unit], (n,).
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
