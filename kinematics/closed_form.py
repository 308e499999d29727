"""Every pose of a three-joint leg that puts its foot at a point, in closed form.

The foot is e1 e2 e3 p0, where e_i turns about axis i and p0 is the foot with every angle 0. Of the
three axes two neighbours must intersect or be parallel; they are called the pair, the third axis
the odd one. Turning about either axis of the pair keeps

- the distance from their common point, if they intersect;
- the height along their common direction, if they are parallel.

So this quantity alone gives two angles of the odd joint. Inside the pair, turning about its first
axis keeps both distance and height; the quantity not used for the odd joint gives two angles of
the pair's second joint, and an arctangent gives the first. This makes four poses. (These are
Paden and Kahan's subproblems, stated by the invariant quantity; each of them here is
``a cos q + b sin q = c``.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.chain import Array, Chain

EXACT = 1e-9
"""Tolerance of intersecting and of parallel axes: radians, and metres per metre of leg."""

APART = 1e-3
"""Least distance of axes and points, likewise: below it the closed form is ill-conditioned."""


class Circle(NamedTuple):
    """The points ``middle + cosine cos q + sine sin q`` that a point reaches by a turn by q."""

    middle: Array  # (3, ...)
    cosine: Array  # (3, ...)
    sine: Array  # (3, ...)

    def at(self, angle: Array) -> Array:
        """The points at angles of shape (2, ...) [rad], shape (3, 2, ...)."""
        middle, cosine, sine = (part[:, None] for part in self)
        return np.asarray(middle + cosine * np.cos(angle) + sine * np.sin(angle))


class Axis(NamedTuple):
    """A line to turn about."""

    direction: Array  # (3,), unit
    point: Array  # (3,)

    def circle(self, points: Array, *, backward: bool = False) -> Circle:
        """The circles of ``points`` (3, ...) about the axis, forward or backward."""
        arms = points - _column(self.point, points)
        along = _column(self.direction, points) * np.tensordot(self.direction, arms, 1)
        across = np.cross(self.direction, arms, axisb=0, axisc=0)
        return Circle(points - arms + along, arms - along, -across if backward else across)

    def angle_between(self, start: Array, end: Array) -> Array:
        """The turn that takes ``start`` to ``end`` [rad], or nearest to it: an arctangent."""
        circle = self.circle(start)
        arms = end - circle.middle
        return np.arctan2(_dot(circle.sine, arms), _dot(circle.cosine, arms))

    def distance(self, point: Array) -> float:
        """Distance of a point (3,) from the axis."""
        return float(np.linalg.norm(np.cross(self.direction, point - self.point)))


class Distance(NamedTuple):
    """The squared distance from a point, as a quantity that a turn may keep."""

    centre: Array  # (3,)

    def angles(self, circle: Circle, like: Array) -> Array:
        """The two angles on the circle as far from the centre as the points ``like``."""
        arm = circle.middle - _column(self.centre, circle.middle)
        target = like - _column(self.centre, like)
        constant = _dot(target, target) - _dot(arm, arm) - _dot(circle.cosine, circle.cosine)
        return _two_angles(_dot(arm, circle.cosine), _dot(arm, circle.sine), 0.5 * constant)


class Height(NamedTuple):
    """The height along a direction, as a quantity that a turn may keep."""

    direction: Array  # (3,)

    def angles(self, circle: Circle, like: Array) -> Array:
        """The two angles on the circle as high as the points ``like``."""
        middle, cosine, sine = (np.tensordot(self.direction, part, 1) for part in circle)
        return _two_angles(cosine, sine, np.tensordot(self.direction, like, 1) - middle)


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """A leg whose geometry has a closed form.

    Attributes:
        axes: The three axes with every angle 0, in the base frame.
        foot: The foot with every angle 0 [m], in the base frame, shape (3,).
        odd: Index of the joint outside the pair: 0 or 2.
        kept: Invariant of a turn about either axis of the pair.
        other: Second invariant of a turn about the pair's first axis.
    """

    axes: tuple[Axis, Axis, Axis]
    foot: Array
    odd: int
    kept: Distance | Height
    other: Distance | Height

    def poses(self, foot: Array) -> Array:
        """Four poses for each point, out of reach with each inverse function's argument clamped.

        Args:
            foot: Points in the base frame [m], shape (n, 3).

        Returns:
            Angles [rad] in (-2π, 2π), regardless of limits, shape (n, 4, 3). Poses may coincide.
        """
        goal, start = foot.T, self.foot[:, None]
        if self.odd == 2:
            circle = self.axes[2].circle(start)
            odd = self.kept.angles(circle, goal)  # (2, n)
            start = circle.at(odd)
            goal = goal[:, None]
        else:
            circle = self.axes[0].circle(goal, backward=True)
            odd = self.kept.angles(circle, start)
            goal = circle.at(odd)
            start = start[:, None]
        first, second = (self.axes[index] for index in (0, 1, 2) if index != self.odd)
        circle = second.circle(start)
        second_angle = self.other.angles(circle, goal)  # (2, 2, n)
        first_angle = first.angle_between(circle.at(second_angle), goal[:, None])
        angles = [first_angle, second_angle]
        angles.insert(self.odd, np.broadcast_to(odd, second_angle.shape))
        return np.stack(angles).reshape(3, 4, -1).T


def find_closed_form(chain: Chain) -> ClosedForm | None:
    """The closed form of a chain, or None where its geometry has none."""
    if len(chain.axes) != 3:
        return None
    directions, points, foot = chain.neutral_axes()
    axes = tuple(Axis(*line) for line in zip(directions, points, strict=True))
    size = chain.size
    for odd in (2, 0):
        first, second = (axes[index] for index in (0, 1, 2) if index != odd)
        common = _common_point(first, second, size)
        parallel = np.linalg.norm(np.cross(first.direction, second.direction)) <= EXACT
        if common is not None and axes[odd].distance(common) > APART * size:
            kept, other = Distance(common), Height(first.direction)
            return ClosedForm((axes[0], axes[1], axes[2]), foot, odd, kept, other)
        slanted = np.linalg.norm(np.cross(first.direction, axes[odd].direction)) > APART
        if parallel and slanted and first.distance(second.point) > APART * size:
            kept_height, other_distance = Height(first.direction), Distance(first.point)
            return ClosedForm((axes[0], axes[1], axes[2]), foot, odd, kept_height, other_distance)
    return None


def _common_point(first: Axis, second: Axis, size: float) -> Array | None:
    """Where two axes intersect, or None."""
    normal = np.cross(first.direction, second.direction)
    sine = float(np.linalg.norm(normal))
    between = second.point - first.point
    if sine <= APART or abs(between @ normal) / sine > EXACT * size:
        return None
    along = np.cross(between, second.direction) @ normal / sine**2
    return np.asarray(first.point + along * first.direction)


def _two_angles(a: Array, b: Array, c: Array) -> Array:
    """Both solutions of ``a cos q + b sin q = c`` [rad], c clamped to ±hypot(a, b): (2, ...)."""
    size = np.hypot(a, b)
    ratio = np.clip(c / np.maximum(size, np.finfo(np.float64).tiny), -1.0, 1.0)
    middle, half = np.arctan2(b, a), np.arccos(ratio)
    return np.stack(np.broadcast_arrays(middle + half, middle - half))


def _column(vector: Array, like: Array) -> Array:
    """A vector (3,) with the number of axes of ``like`` (3, ...)."""
    return vector.reshape(3, *(1,) * (like.ndim - 1))


def _dot(left: Array, right: Array) -> Array:
    """Scalar products along the first axis."""
    return np.asarray((left * right).sum(axis=0))
