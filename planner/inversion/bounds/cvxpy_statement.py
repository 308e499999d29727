"""The bounds of the levels slope and envelope, as a reader would write them down: in CVXPY.

This is the second opinion on :mod:`planner.inversion.bounds.multipliers`, which solves the same
programmes many times faster. It shares the joint's window with them and nothing else.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.inversion.bounds.reachable_set import BoundProblem, Level


def stated_bound(problem: BoundProblem, level: Level) -> float:
    """The distance of the desired angles from what conditions 1 to 3 of math.md leave [rad].

    Args:
        problem: The joint, and what is desired of it.
        level: "slope" for condition 1, otherwise conditions 1 to 3.
    """
    import cvxpy

    cp: Any = cvxpy  # untyped: its atoms have no types
    model, desired, cyclic, norm, start = problem
    v, ratio = model.v_max_per_tick, model.v_max_per_tick / model.theta_0
    weights = model.window.weights
    ticks = len(desired) * model.hold if cyclic else (len(desired) - 1) * model.hold + 1
    x = cp.Variable(ticks)
    w = cp.hstack([x[:1] - x[-1:], x[1:] - x[:-1]]) if cyclic else x[1:] - x[:-1]
    conditions = [cp.abs(w) <= v]  # condition 1
    if level != "slope":
        # Condition 2, with (v - w) / 2 for max(0, -w), which is the convex majorant on [-v, v].
        replaced = np.sum(np.abs(np.diff(weights, prepend=0.0, append=0.0)))
        common = np.sum(np.minimum(weights[1:], weights[:-1]))
        later, now = (cp.hstack([w[1:], w[:1]]), w) if cyclic else (w[1:], w[:-1])
        conditions += [
            later - now <= v * replaced + ratio * common * (v - now) / 2.0,
            now - later <= v * replaced + ratio * common * (v + now) / 2.0,
        ]
    if start is not None:
        # Condition 3: at rest until the second request acts, then as far as new requests carry.
        resting = min(model.hold + model.window.first, ticks)
        conditions.append(x[:resting] == start)
        if level != "slope":
            new = np.minimum(np.cumsum(weights), 1.0)[: ticks - resting]
            after = x[resting : resting + len(new)]
            conditions.append(cp.abs(after - start) <= v * np.cumsum(new))
    errors = x[:: model.hold] - desired
    rms = cp.norm(errors, 2) / np.sqrt(len(desired))
    objective = rms if norm == "rms" else cp.norm(errors, "inf")
    return float(cp.Problem(cp.Minimize(objective), conditions).solve(solver="CLARABEL"))
