"""fatrop in stage order: the requests of the window as state, the cycle closed through the state.

The lag is a pure shift, so stage k chooses the youngest request that acts at tick k, and the state
is the angle and the other requests of the window. fatrop knows no cycles: two more states carry
what the first stage began with to the last one, which must end there.
"""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

import planner

from .problem import DEGREE, PULL, RADII, Array, Limits, Solve, best_of, smoothed

OPTIONS: dict[str, Any] = {
    "structure_detection": "auto",
    "expand": True,
    "print_time": False,
    "fatrop": {"print_level": 0, "max_iter": 300},
}


def build(model: planner.JointModel, samples: int) -> Solve:
    """The cycle as an optimal control problem."""
    v_max, theta_0 = model.v_max_per_tick / DEGREE, model.theta_0 / DEGREE
    weights = model.window.weights.tolist()
    states = len(weights)  # the angle and all but the youngest request of the window
    desired = casadi.SX.sym("desired", samples)
    radius = casadi.SX.sym("radius")
    stages, conditions, equality = [], [], []
    objective = 0.0
    now, carried = _stage(states, 0)
    for tick in range(samples):
        request = casadi.SX.sym(f"request_{tick}")
        stages += [now, carried, request]
        window = [request, *casadi.vertsplit(now[1:])] if states > 1 else [request]
        angle = now[0]
        for weight, sent in zip(weights, window, strict=True):
            error = sent + model.offset / DEGREE - now[0]
            angle = angle + weight * smoothed(error, radius, v_max=v_max, theta_0=theta_0)
        following, still_carried = _stage(states, tick + 1)
        conditions += [
            following - casadi.vertcat(angle, *window[: states - 1]),
            still_carried - carried,
        ]
        equality += [True] * (2 * states)
        if tick == 0:
            conditions.append(now - carried)
            equality += [True] * states
        resting = desired[(tick - model.window.first) % samples] - model.offset / DEGREE
        objective += (angle - desired[tick]) ** 2 + PULL * (request - resting) ** 2
        now, carried = following, still_carried
    stages += [now, carried]
    conditions.append(now - carried)
    equality += [True] * states
    unknowns = casadi.vertcat(*stages)
    problem = {
        "x": unknowns,
        "p": casadi.vertcat(desired, radius),
        "f": objective,
        "g": casadi.vertcat(*conditions),
    }
    solver = casadi.nlpsol("cycle", "fatrop", problem, {**OPTIONS, "equality": equality})
    stride = 2 * states + 1
    places = 2 * states + stride * np.arange(samples)  # of the requests among the unknowns
    shift = model.window.first

    def solve(wanted: Array, limits: Limits, start: Array) -> Array:
        lower, upper = np.full(unknowns.numel(), -np.inf), np.full(unknowns.numel(), np.inf)
        lower[places], upper[places] = limits[0] / DEGREE, limits[1] / DEGREE
        guess = _guess(model, start) / DEGREE
        candidates = [start]
        for share in RADII:
            answer = solver(
                x0=guess,
                p=np.append(wanted / DEGREE, share * theta_0),
                lbx=lower,
                ubx=upper,
                lbg=0.0,
                ubg=0.0,
            )
            found = np.asarray(answer["x"]).ravel()
            if not np.all(np.isfinite(found)):
                break
            candidates.append(np.roll(found[places], -shift) * DEGREE)
            guess = found
        return best_of(model, wanted, limits, candidates)

    return solve


def _stage(states: int, tick: int) -> tuple[Any, Any]:
    return casadi.SX.sym(f"state_{tick}", states), casadi.SX.sym(f"carried_{tick}", states)


def _guess(model: planner.JointModel, requests: Array) -> Array:
    """The unknowns that belong to these requests."""
    samples, states = len(requests), len(model.window.weights)
    angles = planner.simulate(model, requests)
    acting = np.roll(requests, model.window.first)
    columns = [np.roll(angles, 1), *(np.roll(acting, age) for age in range(1, states))]
    state = np.stack(columns, axis=1)  # at the beginning of each stage
    carried = np.tile(state[0], (samples, 1))
    stages = np.hstack([state, carried, acting[:, np.newaxis]])
    return np.concatenate([stages.ravel(), state[0], state[0]])
