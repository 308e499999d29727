"""How the reasons why requests differ are shown: a shade behind the curves, one per reason."""

from __future__ import annotations

from typing import NamedTuple

from planner.evaluation.differences import Reason
from planner.report.style import CLOSED_FORM, DIRECT, MUTED, REQUESTED, SURFACE, Role


class Tint(NamedTuple):
    """How the background of a reason looks; the hatching tells it apart without colours."""

    role: Role
    opacity: float
    hatch: str = ""

    @property
    def colour(self) -> tuple[str, float]:
        """As matplotlib takes it."""
        return self.role.light, self.opacity


TINTS: dict[Reason, Tint] = {
    "saturated": Tint(REQUESTED, 0.22),
    "limit": Tint(DIRECT, 0.26, "////"),
    "corner": Tint(CLOSED_FORM, 0.2, "..."),
    "after_end": Tint(MUTED, 0.25, "xxx"),
    "free": Tint(SURFACE, 0.0),
}
"""By reason."""
