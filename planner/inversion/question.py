"""What a bound is about."""

from __future__ import annotations

from typing import NamedTuple

from planner.inversion.norm import Norm
from planner.model.joint import JointModel
from planner.trajectory import Array


class Question(NamedTuple):
    """How close can a joint come to what is wanted of it?

    Attributes:
        model: The joint.
        desired: Wanted angles [rad], shape (n,).
        cyclic: Whether the trajectory repeats for ever.
        norm: Which error.
        start: From rest: where the joint rests before [rad]; None where any start will do.
    """

    model: JointModel
    desired: Array
    cyclic: bool
    norm: Norm
    start: float | None
