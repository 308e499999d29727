"""A walk for any leg: a half ellipse around its standing pose that it can reach everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kinematics.dexterity import dexterity, standing_pose
from kinematics.exceptions import UnreachableFoot
from kinematics.leg import Leg
from planner.exceptions import Infeasible, InvalidInput
from planner.gait.half_ellipse import half_ellipse
from planner.trajectory import Array
from planner.validation import as_number, shown

LONGEST = 0.25
"""Half of the longest stroke chosen by default, over the length of the leg."""

HIGHEST = 0.15
"""The highest swing chosen by default, over the length of the leg."""

DEXTEROUS = 0.4
"""How dexterous the leg must remain, to its standing pose: it keeps away from stretching."""

HALVINGS = 10
"""Halvings of the range in which the size is sought: it is right to a thousandth."""


@dataclass(frozen=True, eq=False)
class Stride:
    """A walk of one leg over one cycle.

    Attributes:
        foot: The path of the foot in the leg's base frame [m], shape (n, 3), read-only.
        length: Half of its stroke [m].
        height: How high the foot swings [m].
        centre: Middle of the stroke on the ground [m], shape (3,), read-only.
        pose: The standing pose around which it lies [rad], shape (k,), read-only.
        angles: Angles of the joints that trace it [rad], shape (n, k), read-only.
    """

    foot: Array
    length: float
    height: float
    centre: Array
    pose: Array
    angles: Array


def stride(
    leg: Leg,
    *,
    samples: int = 88,
    length: float | None = None,
    height: float | None = None,
    forward: float | None = None,
    sideways: float | None = None,
    hip_height: float | None = None,
    ground_fraction: float = 0.5,
    heading: float = 0.0,
) -> Stride:
    """A half ellipse (:func:`planner.half_ellipse`) sized for a leg, in the leg's base frame.

    It lies in a plane of z and the heading around the foot of the standing pose
    (:func:`kinematics.dexterity.standing_pose`). By default length and height are as large as the
    leg allows, up to a quarter and three twentieths of its own length: it reaches every point
    without a jump and stays at least 0.4 as dexterous as when it stands.

    Args:
        leg: A leg of three joints at most.
        samples: Number of points in the cycle, at least 4.
        length: Half of the stroke [m].
        height: How high the foot is lifted [m].
        forward: x of the middle of the stroke [m].
        sideways: y of the path [m].
        hip_height: How far the ground lies below the base frame, -z [m].
        ground_fraction: Fraction of the cycle that the foot is on the ground.
        heading: Where the walk goes, from x towards y [rad].

    Returns:
        The walk.

    Raises:
        InvalidInput: A parameter is not a number or out of its range.
        Infeasible: The leg cannot trace it, or no half ellipse around this place.
        UnreachableFoot: Length and height are given and points are out of reach.
        UnsupportedLeg: The leg has more than three joints, or one of them never moves the foot.
    """
    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    pose = standing_pose(leg)
    x, y, z = leg.foot_positions(pose[None])[0]
    hip = _metres("hip_height", hip_height, -z)
    centre = np.array([_metres("forward", forward, x), _metres("sideways", sideways, y), -hip])
    centre.setflags(write=False)
    started = replace(leg, near=pose)
    least = DEXTEROUS * float(dexterity(leg.chain, pose[None])[0])
    fixed = length is not None and height is not None

    def scaled(scale: float) -> Stride:
        long = scale * LONGEST * leg.chain.size if length is None else length
        high = scale * HIGHEST * leg.chain.size if height is None else height
        foot = half_ellipse(
            samples=samples,
            length=long,
            height=high,
            forward=float(centre[0]),
            sideways=float(centre[1]),
            hip_height=-float(centre[2]),
            ground_fraction=ground_fraction,
            heading=heading,
        )
        angles = started.joint_angles(foot)
        _check_closed(leg, angles)
        if not fixed and dexterity(leg.chain, angles).min() < least:
            raise Infeasible("foot: the leg would be close to stretched or folded")
        return Stride(foot, long, high, centre, pose, angles)

    return scaled(1.0) if fixed else _largest(scaled)


def _metres(name: str, value: float | None, otherwise: float) -> float:
    """A length that may be left out [m]."""
    number = float(otherwise) if value is None else as_number(value)
    if not math.isfinite(number):
        raise InvalidInput(f"{name}: got {shown(value)}, expected a finite number")
    return number


def _largest(scaled: Callable[[float], Stride]) -> Stride:
    """The stride of the largest feasible scale up to 1."""
    low, high, best = 0.0, 1.0, None
    scale = high
    for _ in range(HALVINGS):
        try:
            best = scaled(scale)
            low = scale
        except (UnreachableFoot, Infeasible) as error:
            high, why = scale, error
        if low == high:
            break
        scale = 0.5 * (low + high)
    if best is None:
        raise Infeasible(
            "foot: the leg traces no half ellipse around this place, however small; move it with "
            f"forward, sideways and hip_height, or give another pose ({why})"
        ) from why
    return best


def _check_closed(leg: Leg, angles: Array) -> None:
    """Refuse a cycle in which the leg leaps from one pose to another."""
    jumps = leg.jumps(np.vstack([angles, angles[:1]]))
    if jumps.size:
        raise Infeasible(
            f"foot: the leg would have to leap to another pose after sample {jumps[0]}; make the "
            "stride smaller or move it"
        )
