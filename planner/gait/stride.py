"""Walks for any leg: half ellipses around a standing pose, gaits of four legs, shortest cycles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from kinematics.chain import Chain
from kinematics.inverse import MOST_JOINTS, check_joints
from kinematics.leg import Leg
from planner.arrays import Array, as_positive, check_choice, read_only
from planner.exceptions import Infeasible, InvalidInput, UnreachableFoot, UnsupportedLeg, nearest
from planner.gait.half_ellipse import half_ellipse
from planner.model.joint import JointModel
from planner.planning.inversion import invert_foot
from planner.planning.plan import FootInversion

LONGEST = 0.25  # half of the longest stroke chosen by default, over the length of the leg
HIGHEST = 0.15  # the highest swing chosen by default, over the length of the leg

DEXTEROUS = 0.4
"""How dexterous the leg must remain, to its standing pose: it keeps away from stretching."""

LEGS = ("hind-left", "front-left", "hind-right", "front-right")
"""Names of the legs, in the order in which their feet fall in a walk."""

FEWEST, MOST = 12, 1000
"""Samples of a cycle: below the fewest a path is no half ellipse any more, and the most are 8 s at
the Aibo's rate."""


@dataclass(frozen=True, eq=False)
class Stride:
    """A walk of one leg over one cycle."""

    foot: Array  # the path of the foot in the leg's base frame [m], shape (n, 3), read-only
    length: float  # half of its stroke [m]
    height: float  # how high the foot swings [m]
    centre: Array  # middle of the stroke on the ground [m], shape (3,), read-only
    pose: Array  # the standing pose around which it lies [rad], shape (k,), read-only
    angles: Array  # angles of the joints that trace it [rad], shape (n, k), read-only
    # in a gait, the share of the cycle by which it is later than that of the left hind leg
    phase: float = 0.0


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
    (:func:`planner.gait.stride.standing_pose`). By default length and height are as large as the
    leg, of three joints at most, allows, up to a quarter and three twentieths of its own length: it
    reaches every point without a jump and stays at least 0.4 as dexterous as when it stands.
    ``forward``, ``sideways`` and ``hip_height`` are by default those of the standing foot.

    Raises:
        InvalidInput: A parameter is not a number or out of its range.
        Infeasible: The leg cannot trace it, or no half ellipse around this place.
        UnsupportedLeg: The leg has more than three joints, or one of them never moves the foot.
    """
    pose = standing_pose(leg)
    own = leg.foot_positions(pose[None])[0].tolist()
    asked = (forward, sideways, None if hip_height is None else -hip_height)
    places = zip(own, asked, strict=True)
    centre = read_only(np.array([here if there is None else there for here, there in places]))
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
        jumps = leg.jumps(np.vstack([angles, angles[:1]]))
        if jumps.size:
            raise Infeasible(
                "half ellipse: the leg would have to leap to another pose after sample "
                f"{jumps[0]}; make the stride smaller or move it"
            )
        if not fixed and dexterity(leg.chain, angles).min() < least:
            raise Infeasible("half ellipse: the leg would be close to stretched or folded")
        return Stride(foot, long, high, centre, pose, angles)

    low, high, best = 0.0, 1.0, None
    scale = high
    for _ in range(1 if fixed else 10):  # to a thousandth
        try:
            best = scaled(scale)
            low = scale
        except (UnreachableFoot, Infeasible) as error:
            high, why = scale, error
        if low == high:
            break
        scale = 0.5 * (low + high)
    if best is None:
        given = {"half stroke": length, "height": height}
        size = " and ".join(f"of {name} {each:g} m" for name, each in given.items() if each)
        smaller = "make it smaller, " if size else ""
        size, reason = size or "at all, however small,", str(why).partition(";")[0]
        raise Infeasible(
            f"half ellipse: the leg traces none {size} around this place; {smaller}move it with "
            f"forward, sideways and hip_height, or give another pose ({reason})"
        ) from why
    return best


Pattern = Literal["walk", "trot", "pace", "bound"]

PATTERNS: Mapping[Pattern, tuple[float, tuple[float, ...]]] = {
    "walk": (0.75, (0.0, 0.25, 0.5, 0.75)),
    "trot": (0.5, (0.0, 0.5, 0.5, 0.0)),
    "pace": (0.5, (0.0, 0.0, 0.5, 0.5)),
    "bound": (0.4, (0.0, 0.5, 0.0, 0.5)),
}
"""By gait, the share of the cycle that each foot is on the ground, and the shares by which the feet
of :data:`LEGS` are later than the left hind one (M. Hildebrand, 1965, *Science* 150; R. M.
Alexander, 1984, *International Journal of Robotics Research* 3): the walk in lateral sequence, with
three feet on the ground; diagonal feet in pairs, lateral ones, and front and hind ones."""


def gait(legs: Mapping[str, Leg], pattern: Pattern, **walk: Any) -> dict[str, Stride]:
    """The walk of four legs, named as in :data:`LEGS`, in a pattern of footfalls, over one cycle.

    All legs have the same stroke and swing: those of :func:`planner.gait.stride.stride` that every
    leg can trace with these arguments, at the hip height of the lowest leg if all have the same
    base.
    """
    check_choice("pattern", pattern, get_args(Pattern))
    check_legs(legs)
    ground_fraction, phases = PATTERNS[pattern]
    walk = {"ground_fraction": ground_fraction, **walk}
    if walk.get("hip_height") is None and len({leg.base for leg in legs.values()}) == 1:
        walk["hip_height"] = min(-float(stride(leg, **walk).centre[2]) for leg in legs.values())
    if walk.get("length") is None or walk.get("height") is None:
        strides = [stride(leg, **walk) for leg in legs.values()]
        walk["length"] = min(each.length for each in strides)
        walk["height"] = min(each.height for each in strides)
    walks = {}
    for name, leg in legs.items():
        leg_stride, phase = stride(leg, **walk), phases[LEGS.index(name)]
        later = round(phase * len(leg_stride.angles))
        foot, angles = (
            read_only(np.roll(each, later, axis=0)) for each in (leg_stride.foot, leg_stride.angles)
        )
        walks[name] = replace(leg_stride, foot=foot, angles=angles, phase=phase)
    return walks


def check_legs(names: Mapping[str, Any]) -> None:
    """Raise InvalidInput for legs that are not the four of a gait."""
    if set(names) != set(LEGS):
        odd = next((name for name in names if name not in LEGS), "")
        hint = nearest(odd, LEGS) if odd else ""
        raise InvalidInput(
            f"legs: got {', '.join(names) or 'none'}{hint}, expected {', '.join(sorted(LEGS))}"
        )


def standing_pose(leg: Leg) -> Array:
    """A bent leg with its foot below the hip, z of the base frame pointing up.

    Of the poses with nearly the best dexterity the one nearest to the middle of the limits [rad],
    (k,), read-only, rounded to a degree, with the foot then moved to below the joint before the
    last, if possible; or the leg's ``near``. UnsupportedLeg is raised for a leg with more joints
    and no ``near``, or with a joint that never moves the foot.
    """
    if leg.near is not None:
        return leg.near
    count = len(leg.joint_names)
    if count > MOST_JOINTS:
        raise UnsupportedLeg(
            f"a standing pose is sought for {MOST_JOINTS} joints at most, this leg has "
            f"{count}: lock the others, or give the angles that they are near"
        )
    lower, upper = leg.limits.central
    check_joints(leg.chain, leg.joint_names)
    steps = [np.linspace(*ends, 25) for ends in zip(lower, upper, strict=True)]
    poses = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, count)
    quality = dexterity(leg.chain, poses)
    away = np.linalg.norm(poses - 0.5 * (lower + upper), axis=1)
    well = quality >= 0.9 * quality.max()
    keys = (*-poses.T, np.where(well, away, np.inf))
    best = poses[np.lexsort(np.round(keys, 6))[0]]
    best = _below_hip(leg, best, 0.7 * float(quality.max()))
    return read_only(leg.limits.clip(np.radians(np.round(np.degrees(best)) + 0.0)))


def _below_hip(leg: Leg, pose: Array, least: float) -> Array:
    """The pose with the foot straight below the joint before the last, or else unchanged."""
    candidate = pose
    for _ in range(2):  # that joint moves with the joints above it
        points = leg.joint_positions(candidate[None])[0]
        hip, foot = points[max(len(pose) - 2, 0)], points[-1]
        if hip[2] - foot[2] < 0.3 * leg.chain.size:  # as of the hand of an arm
            return pose
        target = np.array([[hip[0], hip[1], foot[2]]])
        solution = replace(leg, near=candidate).inverse(target, unreachable="nearest")
        candidate = solution.angles[0]
        if dexterity(leg.chain, candidate[None])[0] < least:
            return pose
    return candidate


def dexterity(chain: Chain, angles: Array) -> Array:
    """Yoshikawa's manipulability at angles [rad], (n, k), by the leg's length: (n,).

    The product of the singular values of the Jacobian: 0 in a singular pose.
    """
    jacobians = chain.jacobians(angles) / chain.size
    if jacobians.shape[-1] == jacobians.shape[-2]:
        return np.asarray(np.abs(np.linalg.det(jacobians)))  # a tenth of the time
    return np.asarray(np.prod(np.linalg.svd(jacobians, compute_uv=False), axis=-1))


def shortest_cycle(
    models: JointModel | Sequence[JointModel],
    leg: Leg,
    path: Callable[[int], Array],
    *,
    tolerance: float,
    samples: int = 88,
    progress: Callable[[str], None] = lambda _: None,
) -> FootInversion:
    """The cycle of fewest samples whose foot never is further off than a tolerance [m].

    Each trial, from ``samples`` on, is a plan for the foot along the ``path`` in n samples [m],
    (n, 3): :func:`planner.invert_foot` with the norm "max". Infeasible is raised where not even the
    longest cycle keeps the tolerance.
    """
    as_positive("tolerance", tolerance, "more than 0 m")
    plans: dict[int, FootInversion] = {}

    def plan(count: int) -> FootInversion:
        if count not in plans:
            progress(f"a cycle of {count} samples")
            plans[count] = invert_foot(models, leg, path(count), norm="max")
        return plans[count]

    low, high = FEWEST - 1, samples
    while plan(high).max_error > tolerance:
        low, high = high, 2 * high
        if high > MOST:
            raise Infeasible(
                f"tolerance: in a cycle of {low} samples the foot still is "
                f"{100.0 * plan(low).max_error:.3g} cm off, expected at most "
                f"{100.0 * tolerance:g} cm; allow more, or make the steps smaller"
            )
    while high - low > 1:
        middle = (low + high) // 2
        within = plan(middle).max_error <= tolerance
        low, high = (low, middle) if within else (middle, high)
    return plan(high)


def in_samples(path: Array, count: int) -> Array:
    """A cyclic path in another number of samples, on straight lines between its own, (count, 3)."""
    own, places = np.arange(len(path)), np.arange(count) * (len(path) / count)
    columns = [np.interp(places, own, column, period=len(path)) for column in path.T]
    return np.column_stack(columns)
