"""The error that counts: the root mean square, or the largest."""

from __future__ import annotations

from typing import Literal

from planner.exceptions import InvalidInput
from planner.given import is_one_of, shown

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")


def check_norm(norm: str) -> None:
    """Raise InvalidInput unless ``norm`` is the name of a norm."""
    if not is_one_of(norm, NORMS):
        raise InvalidInput(
            f"norm: got {shown(norm)}, expected one of {', '.join(map(repr, NORMS))}"
        )
