"""The shortest period of a walk at which its foot stays within a tolerance, by bisection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.exceptions import Infeasible
from planner.model.joint import JointModel
from planner.planning.inversion import invert_foot
from planner.trajectory import Array
from planner.validation import as_positive

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.planning.result import FootInversion


FEWEST, MOST = 12, 1000
"""Samples of a cycle: below the fewest a path is no half ellipse any more, and the most are 8 s at
the Aibo's rate."""

PROOFS = 4
"""Lower bounds that are computed, each up to seconds, between the shortest period found and the one
that is proved too short."""


class TooShort(NamedTuple):
    """The proof that a period is too short.

    Attributes:
        samples: Samples of the cycle, the most for which it is proved here.
        bound: Lower bound on the largest distance of the foot [m].
    """

    samples: int
    bound: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortestCycle:
    """The shortest cycle found.

    Attributes:
        plan: Its requests, under which the foot stays within the tolerance.
        too_short: A period that is proved too short; None where none is.
    """

    plan: FootInversion
    too_short: TooShort | None

    @property
    def samples(self) -> int:
        """Samples of the cycle."""
        return len(self.plan.requests)

    @property
    def period(self) -> float:
        """Time of the cycle [s]."""
        return self.samples * self.plan.models[0].period


def shortest_cycle(
    models: JointModel | Sequence[JointModel],
    leg: Leg,
    path: Callable[[int], Array],
    *,
    tolerance: float,
    samples: int = 88,
    progress: Callable[[str], None] = lambda _: None,
) -> ShortestCycle:
    """The fewest samples of a cycle at which the foot never is further off than a tolerance.

    Each trial is a plan for the foot, :func:`planner.invert_foot` with the norm "max", within the
    leg's limits; the exact models decide.

    Args:
        models: One model for all joints, or one for each.
        leg: The leg.
        path: The foot path for a number of samples n [m], shape (n, 3).
        tolerance: Largest distance of the foot from its path [m].
        samples: Where to begin.
        progress: Called with the name of each trial.

    Raises:
        Infeasible: Not even the longest cycle keeps the tolerance.
        InvalidInput: The tolerance is not above 0.
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
    return ShortestCycle(plan=plan(high), too_short=_too_short(plan, low, tolerance, progress))


def _too_short(
    plan: Callable[[int], FootInversion],
    highest: int,
    tolerance: float,
    progress: Callable[[str], None],
) -> TooShort | None:
    """The longest cycle tried, of at most ``highest`` samples, that a lower bound refutes."""
    proof, low, high = None, FEWEST, highest
    for number in range(PROOFS):
        if low > high:
            break
        count = high if number == 0 else (low + high) // 2
        progress(f"the lower bound for {count} samples")
        bound = plan(count).lower_bound
        if bound > tolerance:
            proof, low = TooShort(count, bound), count + 1
        else:
            high = count - 1
    return proof


def in_samples(path: Array, count: int) -> Array:
    """A cyclic path in another number of samples, on straight lines between its own, (count, 3)."""
    closed = np.vstack([path, path[:1]])
    places = np.arange(count) * (len(path) / count)
    columns = [np.interp(places, np.arange(len(closed)), column) for column in closed.T]
    return np.column_stack(columns)
