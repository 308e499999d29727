"""A curve within a largest error, in one pass: each line goes on as long as it can (swing filter).

Between the least and the largest angle that each sample allows, tightened so that slopes within the
bound can always go on, a line swings about its start; where no slope is left, a knot is set.
"""

from __future__ import annotations

import numpy as np

from planner.approximation.ideal import envelopes
from planner.approximation.objective import Candidate, Problem, candidate


def swung(problem: Problem, bound: float) -> Candidate:
    """A curve with no error above ``bound`` and knots on samples, from few lines; O(n).

    Args:
        problem: What to approximate, with nothing required.
        bound: Largest error at any sample, which slopes within the bound can keep.

    Returns:
        The curve; slopes within the bound but for rounding.
    """
    n, step = problem.samples, problem.step
    below, above = envelopes(problem.desired, step, cyclic=problem.cyclic)
    least, most = above - bound, below + bound
    value = 0.5 * float(least[0] + most[0])
    if problem.cyclic:  # end where it began
        way_back = step * (n - np.arange(n + 1.0))
        least = np.maximum(np.append(least, value), value - way_back)
        most = np.minimum(np.append(most, value), value + way_back)
    knots, values = [0], [value]
    low, high = -step, step
    for k, (lower, upper) in enumerate(zip(least.tolist(), most.tolist(), strict=True)):
        run = k - knots[-1]
        if run == 0:
            continue
        lowest, highest = (lower - value) / run, (upper - value) / run
        if lowest > high or highest < low:
            value += 0.5 * (low + high) * (run - 1)
            knots.append(k - 1)
            values.append(value)
            lowest, highest = lower - value, upper - value
            low, high = -step, step
        low, high = max(low, lowest), min(high, highest)
    if not problem.cyclic:
        knots.append(n - 1)
        values.append(value + 0.5 * (low + high) * (n - 1 - knots[-2]))
    return candidate(problem, np.array(knots, dtype=np.float64), np.array(values))
