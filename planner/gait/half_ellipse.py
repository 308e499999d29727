"""The walk that the paper's trajectory comes from: a half ellipse, and the joints that trace it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from kinematics.robot import urdf_path
from planner.arrays import (
    LARGEST,
    MOST_SAMPLES,
    Array,
    Summarised,
    Summary,
    as_count,
    as_number,
    read_only,
    shown,
)
from planner.exceptions import InvalidInput


def half_ellipse(
    *,
    samples: int = 88,
    length: float = 0.04893,
    height: float = 0.042,
    forward: float = 0.049,
    sideways: float = 0.028,
    hip_height: float = 0.077,
    ground_fraction: float = 0.5,
    heading: float = 0.0,
) -> Array:
    """One cycle of a foot that pushes backward along the ground and swings forward in an arc.

    With the phase φ = k / samples and g = ``ground_fraction``, the foot moves backward at constant
    speed while φ < g, and then along the upper half of an ellipse at an angle uniform in time::

        on the ground:   s = length (1 - 2 φ / g)    z = -hip_height
        in the air:      s = length cos α            z = -hip_height + height sin α
        always:          x = forward + s cos η       y = sideways + s sin η

    where α = π (1 - φ) / (1 - g) falls from π to 0 and η is the heading, 0 for straight on. How
    much of it a leg can reach is the leg's affair. The defaults are the front legs of UT Austin
    Villa's hand-tuned walk of 2003 (Kohl and Stone, 2004) without its skew.

    Args:
        samples: Number of points in the cycle, at least 4.
        length: Horizontal semi-axis [m]: the stroke is twice this.
        height: Vertical semi-axis: how high the foot is lifted [m]; 0 drags it.
        forward: How far the middle of the stroke lies before the hip [m].
        sideways: How far the path lies outside the hip [m].
        hip_height: How far the ground lies below the hip [m].
        ground_fraction: Fraction of the cycle that the foot is on the ground, between 0 and 1.
        heading: Where the walk goes, from x towards y [rad]: π/2 along y, π backward.

    Returns:
        Foot positions [m], shape (samples, 3), read-only; hip frame with x forward, y outward,
        z up (a left leg's hip frame has y to the left, so it fits as it is).

    Raises:
        InvalidInput: A parameter is not a number or out of its range.

    Example:
        >>> half_ellipse(samples=4).round(3)  # x forward, y outward, z up [m]
        array([[ 0.098,  0.028, -0.077],
               [ 0.049,  0.028, -0.077],
               [ 0.   ,  0.028, -0.077],
               [ 0.049,  0.028, -0.035]])
    """
    expected = f"a whole number from 4 to {MOST_SAMPLES}"
    count = as_count("samples", samples, expected, least=4, most=MOST_SAMPLES)
    length = in_range("length", length, above=0.0)
    height = in_range("height", height, least=0.0)
    forward = in_range("forward", forward)
    sideways = in_range("sideways", sideways)
    hip_height = in_range("hip_height", hip_height)
    ground = in_range("ground_fraction", ground_fraction, above=0.0, below=1.0)
    heading = in_range("heading", heading)

    phase = np.arange(count) / count
    on_ground = phase < ground
    on_way = np.minimum(phase, ground) / ground
    angle = np.pi * (1.0 - phase) / (1.0 - ground)  # of the ellipse; π where the foot lifts off
    path = np.empty((count, 3))
    along = length * np.where(on_ground, 1.0 - 2.0 * on_way, np.cos(angle))
    path[:, 0] = forward + along * math.cos(heading)
    path[:, 1] = sideways + along * math.sin(heading)
    path[:, 2] = -hip_height + height * np.where(on_ground, 0.0, np.sin(angle))
    return read_only(path)


def walking_speed(
    foot: Array, period: float, *, ground_fraction: float = 0.5, heading: float = 0.0
) -> float:
    """Mean speed of a foot along the heading, backward, while it is on the ground [m/s].

    Its positions are a cycle [m], (n, 3), that begins on the ground, a period apart [s].
    """
    along = foot[:, 0] * math.cos(heading) + foot[:, 1] * math.sin(heading)
    grounded = math.ceil(ground_fraction * len(foot) - 1e-9)
    last = min(max(grounded - 1, 1), len(foot) - 1)
    return float(along[0] - along[last]) / (last * period)


@dataclass(frozen=True, eq=False, repr=False)
class ReferenceWalk(Summarised):
    """The walk behind the paper's trajectories, for one front leg over one cycle.

    Attributes:
        leg: The simplified leg, 64 and 69 mm without offsets.
        half_ellipse: The half ellipse in the hip frame [m], shape (88, 3), read-only.
        desired: Desired joint angles [rad], shape (88, 3), read-only.
        desired_foot: Where these angles bring the foot [m], shape (88, 3), read-only.
        reachable: Whether that is the desired point, read-only, shape (88,).
        joint_names: The joints, in the order of the columns.
    """

    leg: Leg
    half_ellipse: Array
    desired: Array
    desired_foot: Array
    reachable: npt.NDArray[np.bool_]
    joint_names: tuple[str, ...]

    def _summarised(self) -> Summary:
        """The path and its leg."""
        beyond = len(self.reachable) - np.count_nonzero(self.reachable)
        leg = self.leg._summarised()
        head = (
            f"Walk of {len(self.desired)} samples, {beyond} clamped to the leg's reach. {leg.head}"
        )
        return leg._replace(head=head)


def reference_walk() -> ReferenceWalk:
    """The half ellipse of a front leg, turned into joint angles as the walk's authors did.

    On the way up to the top of the swing 15 of the 88 points are out of reach of the simplified
    leg or past a joint limit. There the argument of each inverse function is clamped, then the
    angles to the limits; the desired foot path is the one that these angles trace.

    Example:
        >>> walk = reference_walk()
        >>> walk.desired.shape, walk.leg.joint_names
        ((88, 3), ('rotator', 'abductor', 'knee'))
    """
    leg = Leg.from_urdf(urdf_path("reference_leg.urdf"), base="hip", foot="foot")
    path = half_ellipse()
    solution = leg.inverse(path, unreachable="clamp")
    return ReferenceWalk(
        leg=leg,
        half_ellipse=path,
        desired=solution.angles,
        desired_foot=leg.foot_positions(solution.angles),
        reachable=solution.reachable,
        joint_names=leg.joint_names,
    )


def in_range(
    name: str,
    value: float,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    below: float = math.inf,
) -> float:
    """The value as a float within its range, or an error that names the range."""
    number = as_number(value)
    if abs(number) > LARGEST:
        raise InvalidInput(f"{name}: got {number:g}, expected at most {LARGEST:g}; check the unit")
    if least <= number and above < number < below:
        return number
    bounds = {"at least": least, "above": above, "below": below}
    words = [f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound)]
    expected = " ".join(["a finite number", " and ".join(words)]).strip()
    raise InvalidInput(f"{name}: got {shown(value)}, expected {expected}")
