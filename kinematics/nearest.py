"""The poses within the joint limits that bring the foot nearest to a point, numerically."""

from __future__ import annotations

import numpy as np

from kinematics.chain import Array, Chain, Indices
from kinematics.limits import Limits

GRID = 9
"""Poses per joint among which the searches start."""

MOST_STEPS = 200
"""Newton steps after which a search is given up; a dozen are typical."""

SETTLED = 1e-13
"""A search ends when its step is below this [rad]."""

CHUNK = 512
"""Points searched at once, which bounds the memory."""


def nearest_poses(chain: Chain, limits: Limits, foot: Array) -> Array:
    """Local minima of the distance between foot and point, within the limits.

    A grid of poses finds the basins; from the lowest pose of each a projected Newton method with
    exact second derivatives goes down. All points and basins go together.

    Args:
        chain: The leg.
        limits: The joint limits.
        foot: Points in the base frame [m], shape (n, 3).

    Returns:
        Poses [rad], shape (n, m, k), m the largest number of basins; a point that has fewer repeats
        its first.
    """
    steps = [np.linspace(*ends, GRID) for ends in zip(*limits.central, strict=True)]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)  # (GRID, ..., k)
    flat = grid.reshape(-1, len(steps))
    feet = chain.foot(np.cos(flat.T), np.sin(flat.T)).T  # (GRID ** k, 3)
    found = []
    for begin in range(0, len(foot), CHUNK):
        points = foot[begin : begin + CHUNK]
        which, basin = _basins(feet, points, grid.shape[:-1])
        poses = _descend(chain, limits, points[which], flat[basin])
        found.append(_padded(which, poses, len(points)))
    most = max((poses.shape[1] for poses in found), default=1)
    filled = [np.concatenate([p, np.repeat(p[:, :1], most - p.shape[1], axis=1)], 1) for p in found]
    return np.concatenate([np.empty((0, most, len(steps))), *filled])


def _basins(feet: Array, points: Array, shape: tuple[int, ...]) -> tuple[Indices, Indices]:
    """Point and grid index of every pose that no neighbour on the grid beats."""
    squares = ((points[:, None] - feet) ** 2).sum(axis=-1).reshape(-1, *shape)
    lowest = np.ones_like(squares, dtype=bool)
    for axis in range(1, squares.ndim):
        rise = np.diff(squares, axis=axis)  # from each pose to the next
        edge = np.ones_like(np.take(lowest, [0], axis=axis))
        lowest &= np.concatenate([rise >= 0.0, edge], axis=axis)
        lowest &= np.concatenate([edge, rise <= 0.0], axis=axis)
    which, basin = np.nonzero(lowest.reshape(len(points), -1))
    return which, basin


def _padded(which: Indices, poses: Array, count: int) -> Array:
    """Poses (p, k) of points ``which`` as (count, m, k), short rows filled with their first."""
    counts = np.bincount(which, minlength=count)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    column = np.arange(counts.max())
    return np.asarray(poses[first[:, None] + np.where(column < counts[:, None], column, 0)])


def _descend(chain: Chain, limits: Limits, points: Array, poses: Array) -> Array:
    """The minimum below each start: projected Newton steps, damped until they go down."""
    poses = poses.copy()
    going = np.arange(len(poses))
    damping = np.zeros(len(poses))
    value = _half_squares(chain, points, poses)
    for _ in range(MOST_STEPS):
        if not going.size:
            break
        here = poses[going]
        step = _newton_step(chain, limits, points[going], here, damping[going])
        there = limits.clip(here + step)
        reached = _half_squares(chain, points[going], there)
        better = reached < value[going]
        poses[going[better]] = there[better]
        value[going[better]] = reached[better]
        scale = np.maximum(damping[going], 1e-6 * (chain.tip @ chain.tip))
        damping[going] = np.where(better, 0.1 * damping[going], 10.0 * scale)
        going = going[np.abs(there - here).max(axis=1) > SETTLED]
    return poses


def _half_squares(chain: Chain, points: Array, poses: Array) -> Array:
    """Half the squared distance between foot and point [m²], shape (p,)."""
    miss = chain.foot(np.cos(poses.T), np.sin(poses.T)) - points.T
    return 0.5 * np.asarray((miss**2).sum(axis=0))


def _newton_step(
    chain: Chain, limits: Limits, points: Array, poses: Array, damping: Array
) -> Array:
    """Newton's step for half the squared distance among the joints that are free to move."""
    cosines, sines = np.cos(poses.T), np.sin(poses.T)
    foot, columns = chain.foot_and_jacobian(cosines, sines)
    axes = chain.turned_axes(cosines, sines)
    miss = foot - points.T  # (3, p)
    joints = range(len(columns))
    gradient = np.stack([(miss * column).sum(axis=0) for column in columns], axis=-1)  # (p, k)
    hessian = np.empty((len(poses), len(columns), len(columns)))
    for i in joints:
        for j in joints[i:]:
            # The second derivative of the foot is the first axis crossed with the second's column.
            bend = np.cross(axes[i], columns[j], axis=0)
            hessian[:, i, j] = hessian[:, j, i] = (columns[i] * columns[j] + miss * bend).sum(
                axis=0
            )
    held = (poses <= limits.lower) & (gradient > 0.0)
    held |= (poses >= limits.upper) & (gradient < 0.0)
    gradient[held] = 0.0
    hessian[held[:, :, None] | held[:, None, :]] = 0.0
    # Away from a minimum the curvature may be negative: its size keeps the step going down.
    curvatures, directions = np.linalg.eigh(hessian)
    strongest = np.abs(curvatures).max(axis=1, keepdims=True)
    strength = np.maximum(np.abs(curvatures), 1e-12 * strongest) + damping[:, None]
    along = np.einsum("pji,pj->pi", directions, gradient)
    scaled = along / np.maximum(strength, np.finfo(np.float64).tiny)
    return -np.asarray(np.einsum("pij,pj->pi", directions, scaled))
