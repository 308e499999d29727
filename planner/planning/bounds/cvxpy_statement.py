"""The bounds of the levels slope and envelope, stated in CVXPY as in docs/math.md.

This is the second opinion on :mod:`planner.planning.bounds.multipliers`, which solves the same
programmes many times faster. It shares the joint's window with them and nothing else.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner.planning.bounds.reachable_set import BoundProblem, Level


def stated_bound(problem: BoundProblem, level: Level) -> float:
    """Distance of the desired angles from the set of conditions 1 to 3 of docs/math.md [rad].

    Args:
        problem: The joint, without inertia, and what is desired of it.
        level: "slope" for condition 1, otherwise conditions 1 to 3.
    """
    import cvxpy

    cp: Any = cvxpy  # untyped: its atoms have no types
    model, desired, cyclic, norm, start, load = problem
    v, ratio, hold = model.v_max_per_tick, model.v_max_per_tick / model.theta_0, model.hold
    weights, top = model.window.weights, v + ratio * model.dead_band
    ticks = len(desired) * hold if cyclic else (len(desired) - 1) * hold + 1
    by_sample = np.zeros(len(desired)) if load is None else load
    # The torque at tick t is that of the sample that is next.
    torque = np.array([by_sample[math.ceil(t / hold) % len(desired)] for t in range(ticks)])
    b = (model.v_offset + model.speed_per_torque * torque) * model.tick
    sag, pose = model.compliance * torque, math.hypot(model.sag_sin, model.sag_cos)
    x = cp.Variable(ticks)
    w = cp.hstack([x[:1] - x[-1:], x[1:] - x[:-1]]) if cyclic else x[1:] - x[:-1]
    moving = slice(0 if cyclic else 1, None)
    conditions = [w <= v + b[moving], w >= b[moving] - v]  # condition 1
    if level != "slope":
        # Condition 2, with chords from the least to the greatest speed, w = b - v and b + v.
        replaced = np.sum(np.abs(np.diff(weights, prepend=0.0, append=0.0)))
        common = np.sum(np.minimum(weights[1:], weights[:-1]))
        later, now = (cp.hstack([w[1:], w[:1]]), w) if cyclic else (w[1:], w[:-1])
        at = np.arange(ticks)[moving][: now.shape[0]]
        db, ds, b = b[(at + 1) % ticks] - b[at], sag[(at + 1) % ticks] - sag[at], b[at]
        more_slowest, more_fastest = pose * np.abs(b - v), pose * np.abs(b + v)
        slowest = np.maximum(ds - b + v + more_slowest, 0.0)
        fastest = np.maximum(ds - b - v + more_fastest, 0.0)
        up = slowest + cp.multiply((fastest - slowest) / (2.0 * v), now - b + v)
        slowest = np.maximum(b - v - ds + more_slowest, 0.0)
        fastest = np.maximum(b + v - ds + more_fastest, 0.0)
        down = slowest + cp.multiply((fastest - slowest) / (2.0 * v), now - b + v)
        rise, fall = np.maximum(db, 0.0), np.maximum(-db, 0.0)
        conditions += [
            later - now <= (top + db / 2.0) * replaced + common * (ratio * up + rise),
            now - later <= (top - db / 2.0) * replaced + common * (ratio * down + fall),
        ]
    if start is not None:
        # Condition 3: at rest until the second request acts, then as far as new requests carry it,
        # and all the time as far as a change of the sag does.
        new = np.zeros(min(hold + model.window.first, ticks))
        if level != "slope":
            new = np.append(new, np.minimum(np.cumsum(weights), 1.0))[:ticks]
        sags = ratio * np.abs(sag - sag[0])[: len(new)]
        excess = np.abs(model.v_offset + model.speed_per_torque * torque)[: len(new)]
        fastest = v + excess * model.tick
        farthest = np.cumsum(new * fastest + (1.0 - new) * sags)
        conditions.append(cp.abs(x[: len(new)] - start) <= farthest)
    errors = x[::hold] - desired
    rms = cp.norm(errors, 2) / np.sqrt(len(desired))
    objective = rms if norm == "rms" else cp.norm(errors, "inf")
    return float(cp.Problem(cp.Minimize(objective), conditions).solve(solver="CLARABEL"))
