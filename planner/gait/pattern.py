"""Gaits of four legs: the walk of each leg, and how much later than the others it runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from kinematics.leg import Leg
from planner.exceptions import InvalidInput, nearest
from planner.gait.stride import Stride, stride
from planner.trajectory import Array
from planner.validation import check_choice

Pattern = Literal["walk", "trot", "pace", "bound"]


class Footfalls(NamedTuple):
    """When the feet of a gait are on the ground.

    Attributes:
        ground_fraction: Share of the cycle that each is on the ground.
        phases: Share of the cycle by which each foot is later than the left hind one.
    """

    ground_fraction: float
    phases: Mapping[str, float]


LEGS = ("hind-left", "front-left", "hind-right", "front-right")
"""Names of the legs, in the order in which their feet fall in a walk."""

PATTERNS: Mapping[Pattern, Footfalls] = {
    "walk": Footfalls(0.75, dict(zip(LEGS, (0.0, 0.25, 0.5, 0.75), strict=True))),
    "trot": Footfalls(0.5, dict(zip(LEGS, (0.0, 0.5, 0.5, 0.0), strict=True))),
    "pace": Footfalls(0.5, dict(zip(LEGS, (0.0, 0.0, 0.5, 0.5), strict=True))),
    "bound": Footfalls(0.4, dict(zip(LEGS, (0.0, 0.5, 0.0, 0.5), strict=True))),
}
"""Gaits by their phases (M. Hildebrand, 1965, *Science* 150; R. M. Alexander, 1984, *International
Journal of Robotics Research* 3): the walk in lateral sequence, with three feet on the ground;
diagonal feet in pairs, lateral ones, and front and hind ones."""


class LegOfGait(NamedTuple):
    """One leg of a gait.

    Attributes:
        stride: Its walk, as it is before the phase.
        phase: Share of the cycle by which it is later than the left hind leg.
        angles: Angles of its joints [rad], shape (n, k), read-only.
    """

    stride: Stride
    phase: float
    angles: Array


def gait(legs: Mapping[str, Leg], pattern: Pattern, **walk: Any) -> dict[str, LegOfGait]:
    """The walk of four legs in a pattern of footfalls, over one cycle.

    All legs have the same stroke and swing: those of :func:`planner.gait.stride.stride` that every
    leg can trace, at the hip height of the lowest leg if all have the same base.

    Args:
        legs: The legs by name: front-left, front-right, hind-left and hind-right.
        pattern: "walk", "trot", "pace" or "bound".
        **walk: Arguments of :func:`planner.gait.stride.stride`, the same for all legs.

    Returns:
        The legs in the order given.

    Raises:
        InvalidInput: An unknown pattern, or other legs.
        Infeasible: A leg cannot trace the walk.
    """
    check_choice("pattern", pattern, get_args(Pattern))
    check_legs(legs)
    footfalls = PATTERNS[pattern]
    walk = {"ground_fraction": footfalls.ground_fraction, **walk}
    if walk.get("hip_height") is None and len({leg.base for leg in legs.values()}) == 1:
        walk["hip_height"] = min(-float(stride(leg, **walk).centre[2]) for leg in legs.values())
    if walk.get("length") is None or walk.get("height") is None:
        strides = [stride(leg, **walk) for leg in legs.values()]
        walk["length"] = min(each.length for each in strides)
        walk["height"] = min(each.height for each in strides)
    walks = {}
    for name, leg in legs.items():
        leg_stride, phase = stride(leg, **walk), footfalls.phases[name]
        angles = np.roll(leg_stride.angles, round(phase * len(leg_stride.angles)), axis=0)
        angles.setflags(write=False)
        walks[name] = LegOfGait(leg_stride, phase, angles)
    return walks


def check_legs(names: Mapping[str, Any]) -> None:
    """Refuse legs that are not the four of a gait.

    Raises:
        InvalidInput: One is missing, or has another name.
    """
    if set(names) != set(LEGS):
        odd = next((name for name in names if name not in LEGS), "")
        hint = nearest(odd, LEGS) if odd else ""
        raise InvalidInput(
            f"legs: got {', '.join(names) or 'none'}{hint}, expected {', '.join(sorted(LEGS))}"
        )
