"""The cost of a plan of a stream and the Riccati recursion of its step, compiled by Numba.

See ``riccati_step``. Nothing here depends on the law of the joint. Import this module where it is
used, inside functions.
"""

from __future__ import annotations

import numpy as np

from planner.model.kernel import compiled
from planner.trajectory import Array


@compiled
def cost(
    errors: Array,
    weights: Array,
    resting: Array,
    settings: Array,
    exceeding: float,
    per_rest: float,
    requests: Array,
) -> float:
    """The cost of a plan [rad^2]; ``requests`` are the one before it, then the plan."""
    total = 0.0
    for k in range(len(errors)):
        change, away = requests[k + 1] - requests[k], requests[k + 1] - resting[k]
        excess = change - min(max(change, -settings[1]), settings[1])
        total += weights[k] * errors[k] ** 2 + settings[0] * change**2
        total += exceeding * excess**2 + per_rest * away**2
    return total


@compiled
def step(
    errors: Array,
    slopes: Array,
    first: int,
    states: int,
    weights: Array,
    resting: Array,
    settings: Array,
    damping: Array,
    exceeding: float,
    per_rest: float,
    past: int,
    requests: Array,
    steps: Array,
) -> None:
    """Fill ``steps`` with minus the Gauss-Newton step of a plan.

    Args:
        errors: Angles under the plan less desired ones [rad], (n,).
        slopes: Derivatives by angle, speed and requests, of :func:`planner.model.kernel.linearise`.
        first: How much older the youngest request that acts is than the one of the same sample.
        states: 2 where the speed counts, else 1.
        weights: Weight of each squared error, (n,).
        resting: Requests that would hold the desired angles [rad], (n,).
        settings: Weight of squared changes, largest change, least and largest request, (4,).
        damping: Levenberg-Marquardt term, and 1 where the first request stays, (2,).
        exceeding: Weight of squared excesses over the largest change.
        per_rest: Weight of squared distances from ``resting``.
        past: Requests before the plan.
        requests: These, then the plan [rad], (past + n,).
        steps: Filled, (n,).
    """
    count, width, size = len(errors), slopes.shape[2] - 2, states + past
    smoothing, rate, lower, upper = settings
    own, per_change = np.empty(count), np.empty(count)
    # Half the derivatives of the cost by the requests
    for k in range(count):
        change = requests[past + k] - requests[past + k - 1]
        excess = change - min(max(change, -rate), rate)
        force = smoothing * change + exceeding * excess
        per_change[k] = smoothing + (exceeding if excess != 0.0 else 0.0)
        own[k] = force + per_rest * (requests[past + k] - resting[k])
        if k:
            own[k - 1] -= force
    gradient, by_angle, by_speed = own.copy(), 0.0, 0.0
    for k in range(count - 1, -1, -1):
        by_angle += weights[k] * errors[k]
        for j in range(width):
            number = k - first - j
            if number >= 0:
                gradient[number] += slopes[k, 0, 2 + j] * by_angle + slopes[k, 1, 2 + j] * by_speed
        by_angle, by_speed = (
            slopes[k, 0, 0] * by_angle + slopes[k, 1, 0] * by_speed,
            slopes[k, 0, 1] * by_angle + slopes[k, 1, 1] * by_speed,
        )
    # Riccati recursion, backward. With x = (dM, dw, dR_{k-1}, ..., dR_{k-past}) before period k the
    # cost of what follows is x'Px - 2 p'x; z = (dR_k, x), and P and p are taken to before it.
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    whole, linear = np.empty((size + 1, size + 1)), np.empty(size + 1)
    leads, half = np.zeros((2, size + 1)), np.zeros((2, size + 1))
    feedback, constant = np.zeros((count, size)), np.zeros(count)
    for k in range(count - 1, -1, -1):
        leads[:] = 0.0
        for s in range(states):
            for t in range(states):
                leads[s, 1 + t] = slopes[k, s, t]
            for j in range(width):
                age = first + j
                leads[s, states + age if age else 0] = slopes[k, s, 2 + j]
        # half = (P_ss + w e e') leads / 2 + P_sr kept
        for s in range(states):
            for a in range(size + 1):
                half[s, a] = weights[k] / 2.0 * leads[0, a] if s == 0 else 0.0
                for t in range(states):
                    half[s, a] += matrix[s, t] / 2.0 * leads[t, a]
            half[s, 0] += matrix[s, states]
            for i in range(1, past):
                half[s, states + i] += matrix[s, states + i]
        for a in range(size + 1):
            for b in range(a + 1):
                entry = 0.0
                for s in range(states):
                    entry += leads[s, a] * half[s, b] + leads[s, b] * half[s, a]
                row = states if a == 0 else a
                column = states if b == 0 else b
                inner = (a == 0 or states < a < size) and (b == 0 or states < b < size)
                if inner:
                    entry += matrix[row, column]
                whole[a, b] = whole[b, a] = entry
        whole[0, 0] += per_change[k] + per_rest + damping[0]
        whole[states + 1, states + 1] += per_change[k]
        whole[states + 1, 0] -= per_change[k]
        whole[0, states + 1] -= per_change[k]
        for a in range(size + 1):
            linear[a] = weights[k] * errors[k] * leads[0, a]
            for s in range(states):
                linear[a] += vector[s] * leads[s, a]
            if a == 0 or states < a < size:
                linear[a] += vector[states if a == 0 else a]
        linear[0] += own[k]
        value = requests[past + k]
        free = not (
            (value <= lower and gradient[k] > 0.0) or (value >= upper and gradient[k] < 0.0)
        )
        if k == 0 and damping[1] != 0.0:
            free = False
        share = 1.0 / whole[0, 0] if free else 0.0
        constant[k] = share * linear[0]
        for a in range(size):
            feedback[k, a] = share * whole[1 + a, 0]
            vector[a] = linear[1 + a] - feedback[k, a] * linear[0]
            for b in range(size):
                matrix[a, b] = whole[1 + a, 1 + b] - feedback[k, a] * whole[1 + b, 0]
    state, after = np.zeros(size), np.zeros(size)
    for k in range(count):
        move = constant[k]
        for a in range(size):
            move -= feedback[k, a] * state[a]
        steps[k] = move
        for s in range(states):
            after[s] = 0.0
            for t in range(states):
                after[s] += slopes[k, s, t] * state[t]
            for j in range(width):
                age = first + j
                after[s] += slopes[k, s, 2 + j] * (move if age == 0 else state[states + age - 1])
        after[states] = move
        for i in range(1, past):
            after[states + i] = state[states + i - 1]
        state[:] = after
