"""Proved minima of a foot's squared distance plus a linear term in the angles, sample by sample.

A branch and bound in the angles of a leg: a box of angles is cut into cells, and a cell is halved
along every joint as long as it may contain less than the least value so far (``docs/math.md``,
(13b)).
All samples are searched at once, a block of them at a time.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kinematics.chain import Chain
from planner.trajectory import Array

WIDEST_CELL = float(np.radians(15.0))
"""Width of the first cells [rad], wider by steps of half of it where there would be too many."""

SAMPLES_AT_ONCE = 64
"""Samples in a block: each has up to a few thousand first cells."""

MOST_CELLS = 400_000
"""Most open cells of a block; beyond it the search stops with their bounds. So many occur only
where angles far apart are equally good, and take some 100 MB."""


class Distance(NamedTuple):
    """The squared distance of a leg's foot from its desired position, with scaled axes.

    Attributes:
        chain: The leg.
        lower: Least angles at each sample [rad], shape (n, k).
        upper: Greatest angles [rad], shape (n, k).
        desired: Desired foot positions [m], shape (n, 3).
        scale: Scale of each axis [1/m], shape (3,).
    """

    chain: Chain
    lower: Array
    upper: Array
    desired: Array
    scale: Array

    def by_axis(self, angles: Array) -> tuple[Array, Array]:
        """Scaled positions of the foot, (3, m), and their derivatives [1/rad], (k, 3, m)."""
        foot, columns = self.chain.foot_and_jacobian(np.cos(angles.T), np.sin(angles.T))
        scale = self.scale[:, np.newaxis]
        return scale * foot, scale * np.stack(columns)

    def errors(self, angles: Array) -> tuple[Array, Array]:
        """Scaled positions of the foot, (m, 3), and their derivatives [1/rad], (m, 3, k)."""
        positions, jacobians = self.by_axis(angles)
        return positions.T, jacobians.transpose(2, 1, 0)

    def squared(self, angles: Array) -> Array:
        """Scaled squared distances at one row of angles per sample, shape (n,)."""
        positions, _ = self.errors(angles)
        squared: Array = np.sum((positions - self.desired * self.scale) ** 2, axis=1)
        return squared


class Minima(NamedTuple):
    """Lower bounds over all angles, and angles that come close to them.

    Attributes:
        proved: Lower bounds, shape (n,).
        angles: Angles of the least values [rad], shape (n, k).
    """

    proved: Array
    angles: Array


def minima(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, *, tolerance: float
) -> Minima:
    """The least of ``weight * squared distance + slope @ angles`` over the box, for every sample.

    Args:
        distance: The foot's distance, and the box of angles.
        weights: Weights of the samples, 0 or more, shape (n,).
        slopes: Linear terms [1/rad], shape (n, k).
        guesses: Angles in the box that may be good [rad], shape (n, k).
        tolerance: Allowed distance of a bound below the least value.

    Returns:
        The bounds, valid however early the search has to stop.
    """
    blocks = [
        _block(
            distance._replace(
                lower=distance.lower[part],
                upper=distance.upper[part],
                desired=distance.desired[part],
            ),
            weights[part],
            slopes[part],
            guesses[part],
            tolerance,
        )
        for part in (
            slice(first, first + SAMPLES_AT_ONCE)
            for first in range(0, len(weights), SAMPLES_AT_ONCE)
        )
    ]
    proved, angles = (np.concatenate(column) for column in zip(*blocks, strict=True))
    return Minima(proved, angles)


def _block(
    distance: Distance, weights: Array, slopes: Array, guesses: Array, tolerance: float
) -> Minima:
    target = (distance.desired * distance.scale).T
    angles = guesses.copy()
    least = weights * distance.squared(angles) + np.sum(slopes * angles, axis=1)
    owner, half, centres = _first_cells(distance)
    halves = np.array(list(product((-1.0, 1.0), repeat=guesses.shape[1])))
    for _ in range(40):  # cells are then as small as rounding
        positions, jacobians = distance.by_axis(centres)
        cells = _Cells(
            positions - target[:, owner],
            jacobians,
            weights[owner],
            slopes.T[:, owner],
            half.T[:, owner],
            _linearisation_error(distance, half)[owner],
        )
        values = cells.weights * _dot(cells.errors, cells.errors) + _dot(cells.slopes, centres.T)
        _update_least(owner, values, centres, least, angles)
        enough = (least - tolerance)[owner]
        bounds = values - cells.depths()
        is_open = ~(bounds >= enough)
        proved = least - tolerance
        np.minimum.at(proved, owner[is_open], bounds[is_open])
        if not np.any(is_open) or np.count_nonzero(is_open) * len(halves) > MOST_CELLS:
            break
        half = half / 2.0
        owner = np.repeat(owner[is_open], len(halves))
        centres = np.repeat(centres[is_open], len(halves), axis=0)
        centres += np.tile(halves, (len(owner) // len(halves), 1)) * half[owner]
    return Minima(proved, angles)


def _first_cells(distance: Distance) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """Sample of each cell, (m,), half a cell's width by sample [rad], (n, k), centres, (m, k).

    The samples' boxes are cut alike.
    """
    width = distance.upper - distance.lower
    across, widest = np.max(width, axis=0), WIDEST_CELL
    while len(width) * np.prod(np.ceil(across / widest) + 1.0) > MOST_CELLS:
        widest *= 1.5
    count = np.maximum(np.ceil(across / widest), 1.0).astype(int)
    half = width / count / 2.0
    odd = np.stack(
        np.meshgrid(*(2.0 * np.arange(number) + 1.0 for number in count), indexing="ij"), axis=-1
    ).reshape(-1, len(count))
    centres = distance.lower[:, np.newaxis] + odd * half[:, np.newaxis]
    owner = np.repeat(np.arange(len(width)), len(odd))
    return owner, half, centres.reshape(-1, len(count))


def _update_least(
    owner: npt.NDArray[np.intp], values: Array, centres: Array, least: Array, angles: Array
) -> None:
    """Update the least value and its angles for every sample with cells, where one is less."""
    firsts = np.flatnonzero(np.diff(owner, prepend=-1))  # the cells of a sample stand together
    lowest = np.minimum.reduceat(values, firsts)
    better = lowest < least[owner[firsts]]
    reached = np.flatnonzero(values == np.repeat(lowest, np.diff(firsts, append=len(owner))))
    winners = reached[np.searchsorted(reached, firsts)][better]
    least[owner[winners]], angles[owner[winners]] = values[winners], centres[winners]


def _linearisation_error(distance: Distance, half: Array) -> Array:
    """Largest error of the linearised foot within a cell, scaled: (n,)."""
    reach = _reach(distance)
    outer = np.minimum.outer(reach, reach)  # a pair's derivative turns about the outer one
    curved: Array = np.sum(half @ outer * half, axis=1) / 2.0 * np.max(distance.scale)
    return curved


def _reach(distance: Distance) -> Array:
    """Largest distance of the foot from each joint [m], shape (k,): its move by a radian."""
    beyond = np.linalg.norm(
        np.vstack([distance.chain.translations[1:], distance.chain.tip]), axis=1
    )
    return np.cumsum(beyond[::-1])[::-1]


def _dot(a: Array, b: Array) -> Array:
    """Sum over the first axis of the products: faster than over a short last one."""
    total: Array = np.sum(a * b, axis=0)
    return total


class _Cells(NamedTuple):
    """Cells of angles, a column each, with the foot at their centres.

    Attributes:
        errors: Scaled errors of the foot, shape (3, m).
        jacobians: Derivatives of the foot [1/rad], shape (k, 3, m).
        weights: Weight of each cell's sample, shape (m,).
        slopes: Linear terms [1/rad], shape (k, m).
        half: Half the widths [rad], shape (k, m).
        curved: :func:`_linearisation_error`, shape (m,).
    """

    errors: Array
    jacobians: Array
    weights: Array
    slopes: Array
    half: Array
    curved: Array

    def depths(self) -> Array:
        """Bound on how far a cell goes below the value at its centre, shape (m,): (13b).

        The slope times the width, and a term for the curvature of the foot's path.
        """
        projected_errors = np.stack([_dot(column, self.errors) for column in self.jacobians])
        gradients = 2.0 * self.weights * projected_errors + self.slopes
        steps = np.sqrt(np.sum(self.jacobians**2, axis=1))
        farthest = np.sqrt(_dot(self.errors, self.errors)) + _dot(steps, self.half)
        bent: Array = 2.0 * self.weights * farthest * self.curved
        return _dot(np.abs(gradients), self.half) + bent
