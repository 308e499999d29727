"""Joint angles that put the foot at the points of a path: enumerate, check, choose.

The closed form of a three-joint leg enumerates its poses. Of its axes two neighbours, the pair,
must intersect or be parallel; the third axis is the odd one. Turning about either axis of the pair
keeps the distance from their common point, or the height along their common direction. This alone
gives two angles of the odd joint; the other one, which turning about the pair's first axis keeps
too, gives two angles of its second joint, and an arctangent gives the first. These are Paden and
Kahan's subproblems, each of which here is ``a cos q + b sin q = c``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement, product
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from kinematics.chain import Chain, Limits, half_turned
from planner.arrays import TURN, Array, Indices, check_choice, read_only
from planner.exceptions import UnreachableFoot, UnsupportedLeg

if TYPE_CHECKING:
    from kinematics.leg import Leg

Unreachable = Literal["raise", "nearest", "clamp"]

MOST_JOINTS = 3  # joints that the position of a foot can determine
REACHED = 1e-9  # a pose reaches a point when its foot is within this of it [m]

REGIONS, SAMPLES = 3, 4
"""Parts that each joint's range is cut into, of which every combination is searched on its own, and
poses per joint and part among which each search starts."""

SAME = 6  # decimals [rad] to which margins and moves are compared, so that rounding decides nothing
EXACT = 1e-9  # tolerance of intersecting and of parallel axes: radians, and metres per metre of leg

APART = 1e-3
"""Least distance of axes and points, likewise: below it the closed form is ill-conditioned."""


class InverseSolution(NamedTuple):
    """Joint angles for a path of the foot, and their distances from it.

    Attributes:
        angles: Joint angles within the limits [rad], read-only, shape (n, k).
        reachable: Whether the foot is at the point, to 1e-9 m, read-only, shape (n,).
        distance: Distance between the foot at ``angles`` and the point [m], read-only, shape (n,).
    """

    angles: Array
    reachable: npt.NDArray[np.bool_]
    distance: Array


def solve_inverse(leg: Leg, foot: Array, unreachable: Unreachable) -> InverseSolution:
    """Joint angles that put the foot at each point of a path [m], (n, 3): ``Leg.inverse``."""
    chain, limits, closed_form = leg.chain, leg.limits, leg.closed_form
    check_choice("unreachable", unreachable, get_args(Unreachable))
    if len(chain.axes) > MOST_JOINTS:
        raise UnsupportedLeg(
            f"the inverse needs a leg of {MOST_JOINTS} joints at most, this one has "
            f"{len(chain.axes)}: lock the others, or choose the base and foot frames so that three "
            "joints lie between them"
        )
    if unreachable == "clamp" and closed_form is None:
        raise UnsupportedLeg(
            "unreachable='clamp' needs a leg with a closed form, whose arguments it clamps, and "
            "this leg has none: use 'nearest'"
        )
    check_joints(chain, leg.joint_names)
    if closed_form is None:
        poses = nearest_poses(chain, limits, foot)
    else:
        poses = limits.wrap(closed_form.poses(foot))
    distances = _distances(chain, poses, foot)
    missed = distances.min(axis=1) > REACHED
    if closed_form is not None and missed.any() and unreachable != "clamp":
        nearest = np.repeat(poses[:, :1], REGIONS ** len(chain.axes), axis=1)
        nearest[missed] = nearest_poses(chain, limits, foot[missed])
        poses = np.concatenate([poses, nearest], axis=1)
        distances = _distances(chain, poses, foot)
    if unreachable == "raise" and missed.any():
        indices, least = np.flatnonzero(missed), distances[missed].min(axis=1)
        raise UnreachableFoot(read_only(indices), read_only(least), of=len(foot))
    allowed = distances <= distances.min(axis=1, keepdims=True) + REACHED
    angles = choose(poses, allowed, limits, near=leg.near, chain=chain)
    distance = _distances(chain, angles[:, None], foot)[:, 0]
    return InverseSolution(read_only(angles), read_only(distance <= REACHED), read_only(distance))


def check_joints(chain: Chain, names: Sequence[str]) -> None:
    """Raise UnsupportedLeg where a joint of a leg of at most three never moves the foot."""
    # poses [rad] without a symmetry that could hide a movement
    poses = [[0.3, -0.7, 1.1], [-1.3, 0.5, 0.8], [2.1, 1.7, -0.4], [0.9, -2.3, 2.6]]
    jacobians = chain.jacobians(np.array(poses)[:, : len(chain.axes)])
    moved = np.linalg.norm(jacobians, axis=1).max(axis=0)  # [m/rad]
    unmoving = tuple(name for name, most in zip(names, moved, strict=True) if most <= 1e-9)
    if unmoving:
        raise UnsupportedLeg(
            f"leg: singular in every pose, as joint {unmoving[0]!r} does not move the foot, which "
            "lies on its axis; choose a foot frame further out, or lock the joint"
        )


def _distances(chain: Chain, poses: Array, foot: Array) -> Array:
    """Distance between the foot at each pose (n, m, k) and its point (n, 3) [m], shape (n, m)."""
    reached = chain.feet(poses.reshape(-1, poses.shape[-1])).reshape(*poses.shape[:2], 3)
    return np.asarray(np.linalg.norm(reached - foot[:, None], axis=-1))


def nearest_poses(chain: Chain, limits: Limits, foot: Array) -> Array:
    """Local minima of the distance between foot and point, within the limits [rad]: (n, 3 ** k, k).

    The range of the joints is cut into regions; from the best of a few poses in each a projected
    Newton method goes down. On 18,000 points in and out of reach of 450 random legs the best of
    these minima was the global one but once. A joint that can turn by a full turn has no limits on
    the way.
    """
    beyond = np.where(limits.turning, np.inf, 0.0)
    endless = Limits(limits.lower - beyond, limits.upper + beyond)
    parts = np.linspace(*limits.central, REGIONS * SAMPLES).T.reshape(-1, REGIONS, SAMPLES)
    regions = np.array([list(product(*ranges)) for ranges in product(*parts.tolist())])
    count, _, joints = regions.shape
    feet = chain.feet(regions.reshape(-1, joints)).reshape(count, -1, 3)
    poses = np.empty((len(foot), count, joints))
    for begin in range(0, len(foot), 128):  # at once, which bounds the memory
        points = foot[begin : begin + 128]
        squares = ((points[:, None, None] - feet) ** 2).sum(axis=-1)
        starts = regions[np.arange(count), squares.argmin(axis=-1)].reshape(-1, joints)
        settled = _descend(chain, endless, np.repeat(points, count, axis=0), starts)
        poses[begin : begin + 128] = settled.reshape(-1, count, joints)
    return limits.wrap(poses)


def _descend(chain: Chain, limits: Limits, points: Array, poses: Array) -> Array:
    """The minimum below each start: projected Newton steps, damped until they go down."""

    def missed(poses: Array, points: Array) -> Array:  # half the squared distance [m²]
        return 0.5 * np.asarray(((chain.feet(poses) - points) ** 2).sum(axis=1))

    poses = poses.copy()
    going, damping, value = np.arange(len(poses)), np.zeros(len(poses)), missed(poses, points)
    for _ in range(200):  # a dozen are typical
        if not going.size:
            break
        here = poses[going]
        step = _newton_step(chain, limits, points[going], here, damping[going])
        there = limits.clip(here + step)
        reached = missed(there, points[going])
        better = reached < value[going]
        poses[going[better]] = there[better]
        value[going[better]] = reached[better]
        scale = np.maximum(damping[going], 1e-6 * (chain.tip @ chain.tip))
        damping[going] = np.where(better, 0.1 * damping[going], 10.0 * scale)
        going = going[np.abs(there - here).max(axis=1) > 1e-13]  # [rad]
    return poses


def _newton_step(
    chain: Chain, limits: Limits, points: Array, poses: Array, damping: Array
) -> Array:
    """Newton's step for half the squared distance among the joints that are free to move."""
    foot, columns, axes = chain.derivatives(poses)
    miss = foot - points.T  # (3, p)
    gradient = (miss * columns).sum(axis=1).T.copy()  # (p, k)
    hessian = np.empty((len(poses), len(columns), len(columns)))
    for i, j in combinations_with_replacement(range(len(columns)), 2):
        # The second derivative of the foot is the first axis crossed with the second's column.
        bend = np.cross(axes[i], columns[j], axis=0)
        curvature = (columns[i] * columns[j] + miss * bend).sum(axis=0)
        hessian[:, i, j] = hessian[:, j, i] = curvature
    at_limit = (poses <= limits.lower) & (gradient > 0.0)
    at_limit |= (poses >= limits.upper) & (gradient < 0.0)
    gradient[at_limit] = 0.0
    hessian[at_limit[:, :, None] | at_limit[:, None, :]] = 0.0
    # Away from a minimum the curvature may be negative: its size keeps the step going down.
    curvatures, directions = np.linalg.eigh(hessian)
    strongest = np.abs(curvatures).max(axis=1, keepdims=True)
    strength = np.maximum(np.abs(curvatures), 1e-12 * strongest) + damping[:, None]
    along = np.einsum("pji,pj->pi", directions, gradient)
    scaled = along / np.maximum(strength, np.finfo(np.float64).tiny)
    step = -np.asarray(np.einsum("pij,pj->pi", directions, scaled))
    longest, most = np.abs(step).max(axis=1, keepdims=True), 0.5 * TURN  # no direction is further
    return np.asarray(step * (most / np.maximum(longest, most)))


def choose(
    poses: Array,
    allowed: npt.NDArray[np.bool_],
    limits: Limits,
    *,
    near: Array | None,
    chain: Chain,
) -> Array:
    """One pose at each point: the first deep inside the limits, each later one close to the last.

    Of the ``allowed`` poses, (n, m), of those within the limits [rad], (n, m, k), the first is the
    one that is deepest inside them, or nearest to ``near``, (k,), and each later one the nearest to
    the one before (root of the sum of squares; among equal ones that with the larger angle of the
    last joint, then of the joint before it). If that path jumps, the search starts again from the
    next pose at the first point, and so on: the first path with the fewest jumps is chosen.

    A joint that can turn by a full turn or more goes on by half a turn at most: :func:`_unwrapped`.
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

    def path_from(branch: int) -> Array:
        """The path that starts on a branch and takes the nearest pose at each point, (n, k)."""
        branches = np.zeros(len(poses), dtype=np.intp)
        branches[:1] = branch
        for point in range(1, len(poses)):
            branch = branches[point] = following[branch][point - 1]
        chosen = np.asarray(poses[np.arange(len(poses)), branches])
        for joint in np.flatnonzero(limits.turning) if len(poses) else ():
            ends = (float(each[joint]) for each in (start, limits.lower, limits.upper))
            chosen[:, joint] = _unwrapped(chosen[:, joint], *ends)
        return limits.clip(chosen)  # by rounding at most

    best = path_from(0)
    fewest = len(jumps(chain, best))
    for branch in range(1, int(np.sum(allowed[0])) if fewest else 0):
        other = path_from(branch)
        if (count := len(jumps(chain, other))) < fewest:
            best, fewest = other, count
    return best


def jumps(chain: Chain, angles: Array) -> Indices:
    """Samples after which a path of the joints [rad], (n, k), changes to a pose of another kind.

    Half way between two such poses the foot is further from the middle of its two places than they
    are from each other; on a smooth path it is there, up to the square of the step.
    """
    half_way = 0.5 * (angles[1:] + angles[:-1])
    feet, middle = chain.feet(angles), chain.feet(half_way)
    step = np.linalg.norm(feet[1:] - feet[:-1], axis=1)
    deviation = np.linalg.norm(middle - 0.5 * (feet[1:] + feet[:-1]), axis=1)
    return np.flatnonzero(deviation > step + 1e-6 * chain.size)


def _moved(moves: Array, limits: Limits) -> Array:
    """Length of moves of shape (..., k) [rad], (...,); whole turns count for nothing."""
    turned = np.where(limits.turning, half_turned(moves), moves)
    return np.asarray(np.sqrt((turned**2).sum(axis=-1)))


def _unwrapped(angles: Array, start: float, lower: float, upper: float) -> Array:
    """The same directions [rad], (n,), each within half a turn of the one before.

    The first is as near to ``start`` as all of them can be within the limits, a full turn or more
    apart. Where no start leaves all of them inside, some are a full turn further back.
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


Axis = tuple[Array, Array]  # a line to turn about: its unit direction and a point of it, each (3,)

Circle = tuple[Array, Array, Array]
"""The points ``middle + cosine cos q + sine sin q`` that a point reaches by a turn by q."""


def _circle(axis: Axis, points: Array) -> Circle:
    """The circles that points (..., 3) describe about an axis."""
    direction, origin = axis
    arms = points - origin
    along = (arms @ direction)[..., None] * direction
    return points - arms + along, arms - along, np.cross(direction, arms)


def _points(circle: Circle, angles: Array) -> Array:
    """The points of circles at angles of shape (2, ...) [rad], shape (2, ..., 3)."""
    middle, cosine, sine = circle
    return middle + cosine * np.cos(angles)[..., None] + sine * np.sin(angles)[..., None]


def _turns(circle: Circle, arm: Array, c: Array) -> Array:
    """The two solutions of ``a cos q + b sin q = c``, c clamped, for an arm's a and b: (2, ...)."""
    a, b = ((arm * way).sum(-1) for way in circle[1:])
    size = np.maximum(np.hypot(a, b), np.finfo(np.float64).tiny)
    centre, half = np.arctan2(b, a), np.arccos(np.clip(c / size, -1.0, 1.0))
    return np.stack(np.broadcast_arrays(centre + half, centre - half))


class ClosedForm(NamedTuple):
    """A leg whose geometry has a closed form."""

    axes: list[Axis]  # the three axes with every angle 0, in the base frame
    foot: Array  # the foot with every angle 0 [m], in the base frame, shape (3,)
    odd: int  # index of the joint outside the pair: 0 or 2
    parallel: bool  # whether the axes of the pair are parallel; they intersect otherwise
    point: Array  # where they intersect, or a point of the first one, (3,)

    def poses(self, foot: Array) -> Array:
        """Four poses [rad], (n, 4, 3), for each point, which may coincide, regardless of limits.

        Out of reach the argument of each inverse function is clamped.
        """
        goal, start = foot, self.foot
        first, second = (self.axes[index] for index in (0, 1, 2) if index != self.odd)

        def turns(circle: Circle, like: Array, *, height: bool) -> Array:
            """Turns to the height along the first axis, or the distance from the point."""
            middle, cosine, _ = circle
            if height:
                return _turns(circle, first[0], (like - middle) @ first[0])
            arm, target = middle - self.point, like - self.point
            c = 0.5 * ((target**2).sum(-1) - (arm**2).sum(-1) - (cosine**2).sum(-1))
            return _turns(circle, arm, c)

        if self.odd == 2:
            circle = _circle(self.axes[2], start)
            odd = turns(circle, goal, height=self.parallel)  # (2, n)
            start = _points(circle, odd)
        else:
            middle, cosine, sine = _circle(self.axes[0], goal)
            circle = middle, cosine, -sine  # turned back
            odd = turns(circle, start, height=self.parallel)
            goal = _points(circle, odd)
        circle = _circle(second, start)
        second_angle = turns(circle, goal, height=not self.parallel)  # (2, 2, n)
        middle, cosine, sine = _circle(first, _points(circle, second_angle))
        across, along = ((way * (goal - middle)).sum(-1) for way in (sine, cosine))
        angles = [np.arctan2(across, along), second_angle]
        angles.insert(self.odd, np.broadcast_to(odd, second_angle.shape))
        return np.stack(angles).reshape(3, 4, -1).T


def find_closed_form(chain: Chain) -> ClosedForm | None:
    """The closed form of a chain, or None where its geometry has none."""
    if len(chain.axes) != 3:
        return None
    (*points, foot), directions = chain.points_and_axes(np.zeros((1, 3)))
    axes = [(way[:, 0], point[:, 0]) for way, point in zip(directions, points, strict=True)]
    size = chain.size

    def away(axis: Axis, point: Array) -> float:
        return float(np.linalg.norm(np.cross(axis[0], point - axis[1])))

    for odd in (2, 0):
        first, second = (axes[index] for index in (0, 1, 2) if index != odd)
        (way, start), between = first, second[1] - first[1]
        normal = np.cross(way, second[0])
        sine = float(np.linalg.norm(normal))
        if sine > APART and abs(between @ normal) / sine <= EXACT * size:  # they intersect
            common = start + np.cross(between, second[0]) @ normal / sine**2 * way
            if away(axes[odd], common) > APART * size:
                return ClosedForm(axes, foot[:, 0], odd, False, common)
        slanted = np.linalg.norm(np.cross(way, axes[odd][0])) > APART
        if sine <= EXACT and slanted and away(first, second[1]) > APART * size:  # parallel
            return ClosedForm(axes, foot[:, 0], odd, True, start)
    return None
