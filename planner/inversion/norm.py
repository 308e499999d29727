"""The error that counts: the root mean square, or the largest."""

from __future__ import annotations

from typing import Literal

from planner.exceptions import InvalidInput

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")


def check_norm(norm: str) -> None:
    """Raise InvalidInput unless ``norm`` is the name of a norm."""
    if norm not in NORMS:
        raise InvalidInput(f"norm: got {norm!r}, expected one of {', '.join(map(repr, NORMS))}")
