"""Where the search for one joint begins: the best motion within its top speeds, inverted."""

from __future__ import annotations

import numpy as np

from planner.approximation.ideal import slope_bounded
from planner.model.joint import JointModel, request_ages
from planner.planning.closed_form import SAME_TIME, switching_time
from planner.planning.line_inverse import interpolated_offset
from planner.planning.problem import Problem
from planner.planning.search import State
from planner.trajectory import Array

BARELY_SLOWER = 1e-3
"""By what share a speed may be below the top speed and count as it: the ideal is iterative."""


def initial_guess(problem: Problem) -> State:
    """The ideal, the best trajectory within the top speeds (section 4), and its closed form.

    Every sample is a knot: request k is on the line from sample i = floor(k + l + a/2) on, raised
    by its C_m (section 3). From rest the ideal is brought to where the joint can be by then.
    """
    (model,), (load,) = problem.models, problem.loads
    desired, cyclic = problem.desired[:, 0], problem.cyclic
    count = len(desired)
    ideal = nearest_within_speeds(model, desired, load, cyclic=cyclic)
    if problem.start is not None:
        ideal = within_attainable_range(model, ideal, float(problem.start[0]), load)
    torques = np.zeros(count) if load is None else np.roll(load, -1)  # on the way to the next
    low, high = (limit * model.period for limit in model.speed_limits(torques))
    steps = np.diff(ideal, append=ideal[:1] if cyclic else ideal[-1:])
    steps = np.clip(steps, low, high)
    samples = np.arange(count)
    knots = samples + int(switching_time(model) / model.period + SAME_TIME)
    knots = knots if cyclic else np.minimum(knots, count - 2)
    at = knots % count
    slopes = steps[at] / model.period
    offsets = interpolated_offset(model, slopes, rule="exact", load=torques[at])
    requests = ideal[at] + steps[at] * (samples - knots) + offsets - model.pose_sag(ideal[at])
    return State(problem.admissible(requests[:, np.newaxis]), ideal[:, np.newaxis])


def nearest_within_speeds(
    model: JointModel, desired: Array, load: Array | None, *, cyclic: bool
) -> Array:
    """The trajectory within the joint's top speeds that is nearest in least squares [rad], (n,).

    Either top speed is v_max away from their mean, -v^- / 2 + v^+ / 2. What exceeds the sum of the
    means is bounded alike in both directions; a cycle is cut out of three in a row.
    """
    low, high = model.speed_limits(0.0 if load is None else load)
    mean = (low + high) / 2.0 * model.period
    if not np.any(mean):
        return slope_bounded(desired, model.v_max_per_period, cyclic=cyclic)
    turns, count = 3 if cyclic else 1, len(desired)
    drift = np.cumsum(np.tile(np.broadcast_to(mean, count), turns))
    sheared = np.tile(desired, turns) - drift
    bounded = slope_bounded(sheared, model.v_max_per_period, cyclic=False) + drift
    return bounded[(turns // 2) * count :][:count]


def below_top_speed(problem: Problem, ideal: Array) -> int:
    """How many samples the best trajectory within the top speeds reaches at less than these.

    Args:
        problem: One joint.
        ideal: That trajectory [rad], shape (n, 1).
    """
    (model,), (load,) = problem.models, problem.loads
    limits = model.speed_limits(0.0 if load is None else load)
    low, high = ((1.0 - BARELY_SLOWER) * limit * model.period for limit in limits)
    before = ideal[-1:] if problem.cyclic else ideal[:1]
    steps = np.diff(ideal[:, 0], prepend=before[:, 0])
    fast = (steps <= low) | (steps >= high)
    resting = 0 if problem.cyclic else request_ages(model).youngest + 1
    return int(np.count_nonzero(~fast[resting:]))


def within_attainable_range(
    model: JointModel, angles: Array, start: float, load: Array | None = None
) -> Array:
    """Angles, clipped to what a joint that rests at the start can attain by then [rad], (n,)."""
    resting = request_ages(model).youngest + 1  # samples before the second request acts
    moving = np.maximum(np.arange(len(angles)) - resting + 1.0, 0.0)
    if load is None:
        low, high = (limit * model.period * moving for limit in model.speed_limits())
    else:
        steps = np.diff(moving, prepend=0.0)  # 1 once it moves
        low, high = (np.cumsum(limit * model.period * steps) for limit in model.speed_limits(load))
    return np.clip(angles, start + low, start + high)


def early_and_late(problem: Problem) -> list[Array]:
    """The desired angles as requests, l + a/2 early and as they are [rad], (n, 1)."""
    (model,) = problem.models
    count = len(problem.resting)
    later = np.arange(count) + round(switching_time(model) / model.period)
    later = later % count if problem.cyclic else np.minimum(later, count - 1)
    return [problem.admissible(problem.resting[later]), problem.resting]
