"""Which of several poses to take at each point of a path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array, Chain, Indices
from kinematics.limits import TURN, Limits, half_turned

SAME = 6
"""Decimals [rad] to which margins and moves are compared, so that rounding decides nothing."""

JUMP_TOLERANCE = 1e-6
"""Deviation of the foot that is no jump yet, relative to the length of the leg."""


def choose(
    poses: Array,
    allowed: npt.NDArray[np.bool_],
    limits: Limits,
    *,
    near: Array | None = None,
    chain: Chain | None = None,
) -> Array:
    """One pose at each point: the first deep inside the limits, each later one close to the last.

    At the first point the pose whose least distance to any limit is largest, or the pose with the
    least move from ``near``; among equal poses the one with the larger angle of the last joint,
    then of the joint before it. At every later point the pose with the least move from the one
    before (root of the sum of squares), with the same order among equal poses. If that path jumps
    and there is a ``chain``, the search starts again from the next pose at the first point, and so
    on: the first path with the fewest jumps is chosen.

    A joint that can turn by a full turn or more starts within half a turn of the middle of its
    limits, or of ``near``, and goes on from sample to sample by half a turn at most. Where that
    leads out of its limits, it starts as few turns away as keep the path inside them; where none
    do, it turns back by a full turn at the limit.

    Args:
        poses: Angles [rad], shape (n, m, k), within the limits.
        allowed: Which of them may be chosen, at least one at each point, shape (n, m).
        limits: The joint limits.
        near: A pose near which to start [rad], shape (k,).
        chain: The leg, to see jumps.

    Returns:
        Angles [rad], shape (n, k).
    """
    margin = limits.margin(poses) if near is None else -_moved(poses - near, limits)
    margin = np.where(allowed, margin, -np.inf)
    keys = np.concatenate([-np.moveaxis(poses, -1, 0), -margin[None]])
    order = np.lexsort(np.round(keys, SAME), axis=-1)  # best first
    order = order[:, : allowed.sum(axis=1).max(initial=1)]  # forbidden poses come last
    poses = np.take_along_axis(poses, order[..., None], axis=1)
    allowed = np.take_along_axis(allowed, order, axis=1)

    following = []  # for each branch: the branch to take at the next point, shape (n - 1,)
    for branch in range(poses.shape[1]):
        length = np.round(_moved(poses[1:] - poses[:-1, branch, None], limits), SAME)
        following.append(np.where(allowed[1:], length, np.inf).argmin(axis=-1).tolist())
    start = limits.middle if near is None else near
    first = _from(0, poses, following, limits, start)
    if chain is None or not (fewest := len(jumps(chain, first))):
        return first
    for branch in range(1, int(np.sum(allowed[0]))):
        other = _from(branch, poses, following, limits, start)
        if (count := len(jumps(chain, other))) < fewest:
            first, fewest = other, count
    return first


def jumps(chain: Chain, angles: Array) -> Indices:
    """Samples after which a path of the joints changes to a pose of another kind.

    Half way between two poses of a smooth path the foot is half way between its two places, up to
    the square of the step. Between two poses of different kinds it is elsewhere: at a jump it is
    further from the half-way point than the two places are from each other.

    Args:
        chain: The leg.
        angles: Joint angles [rad], shape (n, k).

    Returns:
        Indices of the samples before the jumps.
    """
    half_way = 0.5 * (angles[1:] + angles[:-1])
    feet, middle = (chain.foot(np.cos(q.T), np.sin(q.T)).T for q in (angles, half_way))
    step = np.linalg.norm(feet[1:] - feet[:-1], axis=1)
    deviation = np.linalg.norm(middle - 0.5 * (feet[1:] + feet[:-1]), axis=1)
    return np.flatnonzero(deviation > step + JUMP_TOLERANCE * chain.size)


def _moved(moves: Array, limits: Limits) -> Array:
    """Length of moves of shape (..., k) [rad], (...,); whole turns count for nothing."""
    turned = np.where(limits.turning, half_turned(moves), moves)
    return np.asarray(np.sqrt((turned**2).sum(axis=-1)))


def _from(
    branch: int, poses: Array, following: list[list[int]], limits: Limits, start: Array
) -> Array:
    """The path that starts on a branch and takes the nearest pose at each point, (n, k)."""
    branches = np.zeros(len(poses), dtype=np.intp)
    branches[:1] = branch
    for point in range(1, len(poses)):
        branch = branches[point] = following[branch][point - 1]
    chosen = np.asarray(poses[np.arange(len(poses)), branches])
    if len(poses):
        for joint in np.flatnonzero(limits.turning):
            ends = float(limits.lower[joint]), float(limits.upper[joint])
            chosen[:, joint] = _unwrapped(chosen[:, joint], float(start[joint]), *ends)
    return limits.clip(chosen)  # by rounding at most


def _unwrapped(angles: Array, start: float, lower: float, upper: float) -> Array:
    """The same directions [rad], shape (n,), each within half a turn of the one before.

    The first is as near to ``start`` as it can be with all of them within the limits, a full turn
    or more apart. Where no start leaves all of them inside, some are a full turn further back.
    """
    turns = np.round((angles[:-1] - angles[1:]) / TURN)
    path = angles + TURN * np.concatenate([[0.0], np.cumsum(turns)])
    fewest, most = np.ceil((lower - path.min()) / TURN), np.floor((upper - path.max()) / TURN)
    turn = np.round((start - path[0]) / TURN)
    if fewest <= most:
        return np.asarray(path + TURN * np.clip(turn, fewest, most))
    last, inside = start, []
    for angle in angles.tolist():
        last = angle + TURN * round((last - angle) / TURN)
        last -= TURN * (last > upper)
        last += TURN * (last < lower)
        inside.append(last)
    return np.array(inside)
