"""Proved minima of a foot's squared distance plus a linear term, sample by sample (``math.md``).

Branch and bound: a box of angles is cut into cells, and a cell is halved along every joint as long
as it may contain less than the least value so far (13b). All samples are searched at once, a block
of them at a time.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from kinematics.chain import Chain
from planner.trajectory import Array, Indices

MOST_CELLS = 400_000
"""Most open cells of a block; beyond it the search stops with their bounds. So many occur only
where angles far apart are equally good, and take some 100 MB."""


class Distance(NamedTuple):
    """The squared distance of a leg's foot from its desired position, with scaled axes."""

    chain: Chain
    lower: Array  # least angles at each sample [rad], shape (n, k)
    upper: Array  # greatest angles [rad], shape (n, k)
    desired: Array  # desired foot positions [m], shape (n, 3)
    scale: Array  # scale of each axis [1/m], shape (3,)

    def errors(self, angles: Array, samples: Indices | slice) -> tuple[Array, Array]:
        """Scaled errors at angles (m, k) of samples, (3, m); derivatives [1/rad], (k, 3, m)."""
        foot, columns = self.chain.foot_and_jacobian(np.cos(angles.T), np.sin(angles.T))
        scale = self.scale[:, np.newaxis]
        return scale * (foot - self.desired[samples].T), scale * np.stack(columns)

    def squared(self, angles: Array) -> Array:
        """Scaled squared distances at one row of angles per sample, shape (n,)."""
        errors, _ = self.errors(angles, slice(None))
        return _dot(errors, errors)

    def linearisation_error(self, half: Array) -> Array:
        """Largest scaled error of the linearised foot in cells of half widths (n, k), (n,)."""
        arms = np.linalg.norm(np.vstack([self.chain.translations[1:], self.chain.tip]), axis=1)
        reach = np.cumsum(arms[::-1])[::-1]  # of the foot from each joint: its move by a radian
        outer = np.minimum.outer(reach, reach)  # a pair's derivative turns about the outer one
        return np.asarray(np.sum(half @ outer * half, axis=1) / 2.0 * np.max(self.scale))


def minima(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, *, tolerance: float
) -> tuple[Array, Array]:
    """The least of ``weight * squared distance + slope @ angles`` over the box, for every sample.

    For weights of 0 or more, (n,), slopes [1/rad] and guesses of good angles in the box [rad], both
    (n, k): lower bounds over all angles, (n,), valid however early the search has to stop, the
    tolerance below the least values where it need not, and angles that come close to them, (n, k).
    """
    chain, *rows, scale = distance
    blocks = []
    for first in range(0, len(weights), 64):  # each has up to a few thousand first cells
        part = slice(first, first + 64)
        lower, upper, desired = (each[part] for each in rows)
        own = Distance(chain, lower, upper, desired, scale)
        blocks.append(_block(own, weights[part], slopes[part], guesses[part], tolerance))
    proved, angles = (np.concatenate(column) for column in zip(*blocks, strict=True))
    return proved, angles


def _block(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, tolerance: float
) -> tuple[Array, Array]:
    angles = guesses.copy()
    least = weights * distance.squared(angles) + np.sum(slopes * angles, axis=1)
    owner, half, centres = _first_cells(distance)
    halves = np.array(list(product((-1.0, 1.0), repeat=guesses.shape[1])))
    for _ in range(40):  # cells are then as small as rounding
        errors, jacobians = distance.errors(centres, owner)
        weight, slope = weights[owner], slopes.T[:, owner]
        values = weight * _dot(errors, errors) + _dot(slope, centres.T)
        lowest = least.copy()
        np.minimum.at(lowest, owner, values)
        best = (values == lowest[owner]) & (values < least[owner])
        angles[owner[best]], least = centres[best], lowest
        # How far a cell goes below its centre, (13b): slope times half the width, and a term for
        # the curvature of the foot's path.
        wide, curved = half.T[:, owner], distance.linearisation_error(half)[owner]
        gradients = 2.0 * weight * np.stack([_dot(each, errors) for each in jacobians]) + slope
        farthest = np.sqrt(_dot(errors, errors)) + _dot(np.sqrt(np.sum(jacobians**2, axis=1)), wide)
        bounds = values - _dot(np.abs(gradients), wide) - 2.0 * weight * farthest * curved
        is_open = ~(bounds >= (least - tolerance)[owner])
        proved = least - tolerance
        np.minimum.at(proved, owner[is_open], bounds[is_open])
        if not np.any(is_open) or np.count_nonzero(is_open) * len(halves) > MOST_CELLS:
            break
        half = half / 2.0
        owner = np.repeat(owner[is_open], len(halves))
        centres = np.repeat(centres[is_open], len(halves), axis=0)
        centres += np.tile(halves, (len(owner) // len(halves), 1)) * half[owner]
    return proved, angles


def _first_cells(distance: Distance) -> tuple[Indices, Array, Array]:
    """Sample of each cell, (m,), half a cell's width by sample [rad], (n, k), centres, (m, k).

    The samples' boxes are cut alike.
    """
    width = distance.upper - distance.lower
    across, widest = np.max(width, axis=0), np.radians(15.0)
    while len(width) * np.prod(np.ceil(across / widest) + 1.0) > MOST_CELLS:
        widest *= 1.5
    count = np.maximum(np.ceil(across / widest), 1.0).astype(int)
    half = width / count / 2.0
    odd = 2.0 * np.array(list(np.ndindex(*count))) + 1.0
    centres = distance.lower[:, np.newaxis] + odd * half[:, np.newaxis]
    return np.repeat(np.arange(len(width)), len(odd)), half, centres.reshape(-1, len(count))


def _dot(a: Array, b: Array) -> Array:
    """Sum over the first axis of the products: faster than over a short last one."""
    total: Array = np.sum(a * b, axis=0)
    return total
