"""What a cross-check is given: joints' angles and names, made to fit each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from kinematics.leg import Leg
from planner.exceptions import InvalidInput, InvalidTrajectory
from planner.trajectory import Array
from planner.validation import shown

Limits = tuple[npt.ArrayLike, npt.ArrayLike]

COLUMNS = "columns of desired"
"""What has a joint each."""


def columns_of(desired: npt.ArrayLike) -> list[Array]:
    """The joints' desired angles [rad], each (n,); what they hold is checked by who plans them."""
    try:
        angles = np.asarray(desired)
    except ValueError as error:
        raise InvalidTrajectory(
            "desired: got rows of different lengths, expected shape (n,) or (n, k)"
        ) from error
    if angles.ndim == 1:
        return [angles]
    if angles.ndim != 2 or angles.shape[1] == 0:
        raise InvalidTrajectory(
            f"desired: got shape {angles.shape}, expected (n,), or (n, k) with a column per joint"
        )
    return list(angles.T)


def checked_names(names: Sequence[str] | None, leg: Leg | None, count: int) -> tuple[str, ...]:
    """What to call the joints; by default what the leg calls them."""
    if names is None:
        if leg is not None:
            return leg.joint_names
        return tuple(f"joint {j}" for j in range(count)) if count > 1 else ("joint",)
    listed = names if isinstance(names, Sequence) and not isinstance(names, str) else ()
    texts = {name for name in listed if isinstance(name, str)}
    if len(listed) != count or len(texts) != count:
        raise InvalidInput(f"names: got {shown(names)}, expected {count} different ones")
    return tuple(names)


def check_columns(leg: Leg, count: int) -> None:
    """Raise InvalidInput where there is no column for each joint of the leg."""
    if len(leg.joint_names) != count:
        raise InvalidInput(
            f"desired: got {count} columns, expected {len(leg.joint_names)}, one for each joint of "
            f"the leg ({', '.join(leg.joint_names)})"
        )
