"""A serial chain of revolute joints: the constants of its positions and derivatives, its limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import TURN, Array, freeze


class Link(NamedTuple):
    """The map of a joint for a point beyond it: ``p -> origin + (A + cos C + sin S) p``.

    This is Rodrigues' formula with the joint's constant placement R multiplied in:
    A = R a aᵀ, C = R (1 - a aᵀ), S = R [a]× for the unit axis a.
    """

    origin: Array  # the joint's origin in the frame before it [m], shape (3, 1)
    axial: Array  # part along the axis, which the rotation keeps, shape (3, 3)
    cosine: Array  # part that goes with the cosine, shape (3, 3)
    sine: Array  # part that goes with the sine, shape (3, 3)


@dataclass(frozen=True, eq=False)
class Chain:
    """Revolute joints in series, from the base to the foot.

    Every joint's frame is the one before it, moved by the joint's constant placement and then
    turned about the joint's axis; the foot is a point in the last frame. Methods that take the
    cosines and the sines of the k joints' angles take numbers, arrays (n,) or symbols.
    """

    rotations: Array  # constant rotations of the joints' frames, shape (k, 3, 3)
    translations: Array  # origins of the joints in the frames before them [m], shape (k, 3)
    axes: Array  # unit axes of the joints, in their own frames, shape (k, 3)
    tip: Array  # the foot in the last joint's frame [m], shape (3,)

    def __post_init__(self) -> None:
        """Freeze the constants."""
        freeze(self.rotations, self.translations, self.axes, self.tip)

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The constants of each joint, from the base to the foot."""
        links = []
        for rotation, origin, axis in zip(
            self.rotations, self.translations, self.axes, strict=True
        ):
            along, across = np.outer(axis, axis), np.cross(axis, np.eye(3)).T
            parts = (along, np.eye(3) - along, across)
            links.append(Link(origin[:, None], *(rotation @ part for part in parts)))
        return tuple(links)

    @cached_property
    def size(self) -> float:
        """Length of the polyline from the first joint over all joints to the foot [m]."""
        steps = np.linalg.norm(self.translations[1:], axis=1)
        return float(np.sum(steps) + np.linalg.norm(self.tip))

    def foot(self, cosines: Iterable[Any], sines: Iterable[Any]) -> Any:
        """The foot in the base frame [m]: (3, n) for arrays, a column of three otherwise."""
        point: Any = self.tip[:, None]
        for link, cosine, sine in reversed(list(zip(self.links, cosines, sines, strict=True))):
            point = link.origin + _turned(link, point, cosine, sine)
        return point

    def feet(self, angles: Array) -> Array:
        """The foot in the base frame [m], (n, 3), along a path of the joints [rad], (n, k)."""
        return np.asarray(self.foot(np.cos(angles.T), np.sin(angles.T)).T)

    def points_and_axes(self, angles: Array) -> tuple[list[Array], list[Array]]:
        """Origins of the joints and, last, the foot [m], and the joints' unit axes: (3, 1 or n)."""
        points, axes = [self.tip[:, None]], list[Array]()
        turns = zip(self.links, self.axes, np.cos(angles.T), np.sin(angles.T), strict=True)
        for link, axis, cosine, sine in reversed(list(turns)):
            moved = [link.origin + _turned(link, point, cosine, sine) for point in points]
            points = [link.origin, *moved]
            axes = [link.axial @ axis[:, None], *(_turned(link, x, cosine, sine) for x in axes)]
        return points, axes

    def derivatives(self, angles: Array) -> tuple[Array, Array, list[Array]]:
        """The foot [m], (3, n), its derivatives by the angles [m/rad], (k, 3, n), and the axes."""
        (*joints, foot), axes = self.points_and_axes(angles)
        pairs = zip(axes, joints, strict=True)
        return foot, np.stack([np.cross(axis, foot - joint, axis=0) for axis, joint in pairs]), axes

    def jacobians(self, angles: Array) -> Array:
        """Derivatives of the foot [m/rad], (n, 3, k), along a path of the joints [rad], (n, k)."""
        return np.ascontiguousarray(self.derivatives(angles)[1].transpose(2, 1, 0))


def _turned(link: Link, vector: Any, cosine: Any, sine: Any) -> Any:
    """A vector beyond the joint, in the frame before it."""
    return link.axial @ vector + cosine * (link.cosine @ vector) + sine * (link.sine @ vector)


class Limits(NamedTuple):
    """Joint limits, read-only arrays.

    Attributes:
        lower: Lower limits [rad], -inf for a continuous joint, shape (k,).
        upper: Upper limits [rad], inf for a continuous joint, shape (k,).
    """

    lower: Array
    upper: Array

    @property
    def turning(self) -> npt.NDArray[np.bool_]:
        """Which joints can turn by a full turn or more, shape (k,)."""
        return np.asarray(self.upper - self.lower >= TURN)

    @property
    def middle(self) -> Array:
        """The middle of each range [rad], of a full turn or more near 0, shape (k,)."""
        near_zero = np.clip(0.0, self.lower + 0.5 * TURN, self.upper - 0.5 * TURN)
        return np.asarray(np.mean(np.where(self.turning, near_zero, self), axis=0))

    @property
    def central(self) -> Limits:
        """At most half a turn to either side of the middle: every direction once."""
        half = np.minimum(0.5 * (self.upper - self.lower), 0.5 * TURN)
        return Limits(self.clip(self.middle - half), self.clip(self.middle + half))

    def clip(self, angles: Array) -> Array:
        """The nearest angles within the limits [rad], for angles of shape (..., k)."""
        return np.clip(angles, self.lower, self.upper)

    def wrap(self, angles: Array) -> Array:
        """The same directions within half a turn of the middle, clipped to the limits [rad]."""
        return self.clip(self.middle + half_turned(angles - self.middle))

    def margin(self, angles: Array) -> Array:
        """How far inside the limits a pose is [rad]: (...,) for angles of shape (..., k)."""
        inside = np.minimum(angles - self.lower, self.upper - angles)
        return np.asarray(inside.min(axis=-1))


def half_turned(angles: Array) -> Array:
    """The same directions between minus half a turn and half a turn [rad]."""
    return np.asarray(np.remainder(angles + 0.5 * TURN, TURN) - 0.5 * TURN)
