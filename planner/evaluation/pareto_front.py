"""Sweeps: the Pareto front of speed and error, and a search for it by CMA-ES.

CMA-ES (Hansen and Ostermeier, 2001) needs far fewer plans than a grid for more than two parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal

import numpy as np

from planner.arrays import Array

Point = tuple[float, ...]  # a value for each parameter, in their order


@dataclass(frozen=True)
class Outcome:
    """Result of a point: speeds and errors in the units of the sweep."""

    point: Point
    speed: float = math.nan  # how fast it is; NaN without a plan
    error: float = math.nan  # the plan's error, in its norm, of the foot or of the worst joint
    largest: float = math.nan  # its largest error
    direct: float = math.nan  # the error of the desired angles as requests

    # share of the path on which a joint would have to exceed its top speed
    too_fast: float = math.nan
    slowest: str = ""  # that joint; "" where there is none
    unreachable: int = 0  # samples out of the leg's reach, where the settings let these be clamped
    reason: str = ""  # why there is no plan
    number: int = 1  # its number among the points of a sweep, from 1

    @property
    def planned(self) -> bool:
        """Whether there is a plan."""
        return math.isfinite(self.error)


@dataclass(frozen=True)
class Requirement:
    """Requirement on a point: at most an error, or at least a speed."""

    of: Literal["error", "speed"]
    value: float

    def is_met_by(self, outcome: Outcome) -> bool:
        """Whether a planned point meets it."""
        if self.of == "speed":
            return outcome.speed >= self.value
        return outcome.error <= self.value


@dataclass(frozen=True)
class Swept:
    """All points of a sweep in order; speeds are in cm/s, or "×" that of the path."""

    file: str
    names: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    speed_unit: str
    error_unit: str  # "cm", "deg", "percent" of a range or "deg_or_percent"
    requirement: Requirement | None = None

    @cached_property
    def front(self) -> tuple[Outcome, ...]:
        """The Pareto-optimal points in speed and error, by speed."""
        points, least = list[Outcome](), math.inf
        planned = (each for each in self.outcomes if each.planned)
        for each in sorted(planned, key=lambda each: (-round(each.speed, 9), each.error)):
            if each.error < least:
                least = each.error
                points.append(each)
        return tuple(reversed(points))

    @property
    def best(self) -> Outcome | None:
        """The best point that meets the requirement; None without one."""
        if self.requirement is None:
            return None
        points = list(filter(self.requirement.is_met_by, self.front))
        return (points[-1] if self.requirement.of == "error" else points[0]) if points else None

    @cached_property
    def failures(self) -> dict[str, list[Outcome]]:
        """The points without a plan, by their reason."""
        reasons: dict[str, list[Outcome]] = {}
        for each in self.outcomes:
            if not each.planned:
                reasons.setdefault(each.reason, []).append(each)
        return reasons


def search(
    outcomes_at: Callable[[Array], Sequence[Outcome]],  # plans points, (points, parameters)
    ranges: Sequence[tuple[float, float]],  # least and largest value of each parameter
    *,
    most: int,  # points that may be planned
    requirement: Requirement | None = None,  # None for the whole front
    seed: int = 0,
) -> None:
    """Seek by CMA-ES, for a front five trade-offs at once; each plans a generation in parallel.

    The first points are spread evenly (Sobol), at most a quarter of all. Each trade-off minimises
    the larger of the weighted speed lost and logarithm of the error (Chebyshev), scaled to the
    first points' ranges.
    """
    import cma
    from scipy.stats import qmc

    low, high = np.array(ranges).T
    rng = np.random.default_rng(seed)

    def at(places: Array) -> Sequence[Outcome]:
        return outcomes_at(low + (high - low) * places)

    used = 2 ** int(math.log2(min(16, most // 4)))
    places = qmc.Sobol(len(low), rng=rng).random(used)
    first, searches = at(places), []
    for cost in _costs(first, requirement):
        start = places[int(np.argmin([cost(each) for each in first]))]
        attributes = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": math.nan,  # cma does not seed the global generator
            "verbose": -9,
        }
        spread = 0.25  # standard deviation of the first steps: the range is within two of them
        searches.append((cost, cma.CMAEvolutionStrategy(start, spread, attributes)))
    while searches:
        generations = [each.ask() for _, each in searches]
        used += sum(map(len, generations))
        if used > most:
            return
        outcomes = iter(at(np.concatenate([np.asarray(each) for each in generations])))
        for (cost, each), generation in zip(searches, generations, strict=True):
            each.tell(generation, [cost(next(outcomes)) for _ in generation])
        searches = [(cost, each) for cost, each in searches if not each.stop()]


def _costs(
    first: Sequence[Outcome], required: Requirement | None
) -> list[Callable[[Outcome], float]]:
    """The cost of an outcome: of the requirement, or of each trade-off of speed and error."""
    planned = [each for each in first if each.planned]
    speeds = np.array([each.speed for each in planned] or [0.0])
    errors = np.log(np.maximum([each.error for each in planned] or [1.0], 1e-9))
    span, factor = (max(float(np.ptp(each)), 1e-9) for each in (speeds, errors))

    def cost(weight: float, outcome: Outcome) -> float:
        if not outcome.planned:
            return 1e3  # more than any other
        error = max(outcome.error, 1e-9)
        slow = (speeds.max() - outcome.speed) / span
        off = (math.log(error) - errors.min()) / factor
        if required is None:
            parts = (weight * slow, (1.0 - weight) * off)
            return float(max(parts) + 0.05 * sum(parts))
        if required.of == "error":  # missed by a factor e, it costs ten times the range of speeds
            return float(slow + 10.0 * max(0.0, math.log(error / required.value)))
        return float(off + 10.0 * max(0.0, (required.value - outcome.speed) / span))

    weights = [1.0] if required is not None else np.linspace(0.1, 0.9, 5)
    return [partial(cost, weight) for weight in weights]
