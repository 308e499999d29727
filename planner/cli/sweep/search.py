"""Sweeps: plans over a range of gaits or speeds, towards much speed at little error.

A point is a value for each parameter. It is planned like a run file with these values in it, and
judged by its speed and by the error of the plan. Points that are not worse than another in both are
the Pareto front. The points are a grid, or are chosen by CMA-ES (Hansen and Ostermeier, 2001),
which needs far fewer plans for more than two parameters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.exceptions import KinematicsError, UnreachableFoot
from planner.cli.planning import Prepared, plan_of, prepare
from planner.cli.settings import HalfEllipse, Run
from planner.cli.sweep.space import Space
from planner.exceptions import PlannerError
from planner.files.results import Results, Task
from planner.parallel import carry_out
from planner.planning.plan import Plan
from planner.report.sweep import Outcome, Point, Requirement, Swept
from planner.trajectory import Array, error_norm, index_of_largest

TARGETS = 5
"""Trade-offs between speed and error that a search for a front pursues at once."""

FIRST = 16
"""Points spread over the ranges before a search begins, at most a quarter of its plans."""

SPREAD = 0.25
"""Standard deviation of a search's first steps, to each range: the range is then within two."""

MISSED = 10.0
"""Cost of missing a required error by a factor e, or a speed by its whole range."""

UNPLANNED = 1e3
"""Cost of a point without a plan: more than any other."""


def sweep(
    space: Space, results: Results, executor: Executor, *, progress: Callable[[Task], None]
) -> Swept:
    """Plan the points of a grid or of a search.

    Args:
        space: The parameters and their values.
        results: The store of the outcomes.
        executor: The executor for the plans.
        progress: Called with each point that is planned.
    """
    by_point: dict[Point, Outcome] = {}

    def outcomes_at(points: Sequence[Point]) -> list[Outcome]:
        new = [point for point in dict.fromkeys(points) if point not in by_point]
        tasks = [
            Task(repr(point), (space.content(point), str(Path(space.folder).resolve())))
            for point in new
        ]
        failures = carry_out(evaluate, tasks, results, executor, progress=progress)
        for point, task in zip(new, tasks, strict=True):
            reason, result = failures.get(task.name), results.read(task)
            fields = {"reason": reason} if result is None else json.loads(result)
            by_point[point] = _with_requirement(space.requirement, Outcome(point, **fields))
        return [by_point[point] for point in points]

    if space.settings.sweep.method == "grid":
        outcomes_at([space.canonical(values) for values in product(*space.values.values())])
    else:
        _search(space, outcomes_at)
    return Swept(
        file=space.file.path,
        names=space.names,
        outcomes=tuple(by_point.values()),
        speed_unit="cm/s" if space.gait else "times",
        error_unit=space.error_unit,
        requirement=space.requirement,
    )


def evaluate(argument: tuple[dict[str, Any], str]) -> bytes:
    """The outcome of a point, without the point, as JSON: a task of :mod:`planner.parallel`.

    Args:
        argument: The run file of the point, and the folder from which files are named.
    """
    content, folder = argument
    try:
        prepared = prepare(Run.of(content), folder)
        fields = _figures(prepared, plan_of(prepared, bounded=False))
    except UnreachableFoot as error:
        fields = {
            "reason": f"foot out of reach at {len(error.indices)} samples, by up to "
            f"{100.0 * float(error.distances.max()):.2g} cm"
        }
    except (PlannerError, KinematicsError) as error:
        fields = {"reason": ": ".join([*getattr(error, "__notes__", ()), str(error)])}
    return json.dumps(fields).encode()


def _figures(prepared: Prepared, plan: Plan) -> dict[str, Any]:
    """Speed and errors of a plan."""
    run, desired, norm = prepared.settings, prepared.desired, plan.task.norm
    if desired.foot is not None:
        planned, direct = (
            100.0 * each[:, np.newaxis] for each in (plan.distances, plan.direct_distances)
        )
    else:
        planned, direct = np.degrees(plan.errors), np.degrees(plan.direct - plan.desired)
    slowest = index_of_largest(plan.too_fast)
    walk = run.path.half_ellipse
    return {
        "speed": run.path.speed or 1.0
        if walk is None or desired.foot is None
        else 100.0 * walking_speed(desired.foot, walk, desired.period),
        "error": max(error_norm(column, norm) for column in planned.T),
        "largest": float(np.max(np.abs(planned))),
        "direct": max(error_norm(column, norm) for column in direct.T),
        "too_fast": float(plan.too_fast[slowest]),
        "slowest": desired.names[slowest] if plan.too_fast[slowest] > 0.0 else "",
        "unreachable": desired.unreachable,
    }


def walking_speed(foot: Array, walk: HalfEllipse, period: float) -> float:
    """Mean speed at which the ground passes under the body [m/s].

    That of the desired foot along the heading, backward, while it is on the ground: twice the
    half ellipse's length in that time, unless the leg does not reach all of it.

    Args:
        foot: Desired positions [m], shape (n, 3).
        walk: The half ellipse that they are of.
        period: Time between them [s].
    """
    heading = math.radians(walk.heading_deg)
    along = foot[:, 0] * math.cos(heading) + foot[:, 1] * math.sin(heading)
    grounded = math.ceil(walk.ground_fraction * len(foot) - 1e-9)
    last = min(max(grounded - 1, 1), len(foot) - 1)
    return float(along[0] - along[last]) / (last * period)


def _with_requirement(required: Requirement | None, outcome: Outcome) -> Outcome:
    """The outcome, with the reason if it misses a requirement."""
    if required is None or not outcome.planned:
        return outcome
    if required.of == "error" and outcome.error > required.value:
        slow = (
            f"; {outcome.slowest} would have to exceed its top speed on "
            f"{100.0 * outcome.too_fast:.0f} % of the path"
        )
        return replace(
            outcome, reason=f"error above {required.value:g}{slow if outcome.slowest else ''}"
        )
    if required.of == "speed" and outcome.speed < required.value:
        return replace(outcome, reason=f"speed below {required.value:g}")
    return outcome


def _search(space: Space, outcomes_at: Callable[[Sequence[Point]], list[Outcome]]) -> None:
    """Seek by CMA-ES, for a front several trade-offs at once; each plans a generation in parallel.

    The first points are spread evenly (Sobol). Each trade-off minimises the larger of the weighted
    speed lost and logarithm of the error (Chebyshev), scaled to the first points' ranges.
    """
    import cma
    from scipy.stats import qmc

    search, many = space.settings.sweep, len(space.names)
    low, high = np.array([[each[0], each[-1]] for each in space.values.values()]).T
    most, rng = search.evaluations or 200, np.random.default_rng(search.seed or 0)

    def at(places: Array) -> list[Outcome]:
        return outcomes_at([space.canonical(low + (high - low) * place) for place in places])

    count = 2 ** int(math.log2(max(min(FIRST, most // 4), 2)))
    places = qmc.Sobol(many, rng=rng).random(count)
    first = at(places)
    costs = _costs(space, first)
    searches = []
    for cost in costs:
        start = places[int(np.argmin([cost(each) for each in first]))]
        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": math.nan,  # cma does not seed the global generator
            "verbose": -9,
        }
        searches.append((cost, cma.CMAEvolutionStrategy(start, SPREAD, options)))
    used = count
    while searches:
        generations = [each.ask() for _, each in searches]
        used += sum(map(len, generations))
        if used > most:
            return
        outcomes = iter(at(np.concatenate([np.asarray(each) for each in generations])))
        for (cost, each), generation in zip(searches, generations, strict=True):
            each.tell(generation, [cost(next(outcomes)) for _ in generation])
        searches = [(cost, each) for cost, each in searches if not each.stop()]


def _costs(space: Space, first: Sequence[Outcome]) -> list[Callable[[Outcome], float]]:
    """The cost function of each trade-off."""
    planned = [each for each in first if each.planned]
    speeds = np.array([each.speed for each in planned] or [0.0])
    errors = np.log(np.maximum([each.error for each in planned] or [1.0], 1e-9))
    fastest, span = speeds.max(), max(float(np.ptp(speeds)), 1e-9)
    smallest, factor = errors.min(), max(float(np.ptp(errors)), 1e-9)
    required = space.requirement

    def scaled(outcome: Outcome) -> tuple[float, float]:
        error = math.log(max(outcome.error, 1e-9))
        return float(fastest - outcome.speed) / span, float(error - smallest) / factor

    def trade(weight: float) -> Callable[[Outcome], float]:
        def cost(outcome: Outcome) -> float:
            if not outcome.planned:
                return UNPLANNED
            slow, off = scaled(outcome)
            parts = (weight * slow, (1.0 - weight) * off)
            return max(parts) + 0.05 * sum(parts)

        return cost

    def required_cost(outcome: Outcome) -> float:
        if not outcome.planned:
            return UNPLANNED
        assert required is not None, "without a requirement there are trade-offs"
        slow, off = scaled(outcome)
        if required.of == "error":
            return slow + MISSED * max(0.0, math.log(outcome.error / required.value))
        return off + MISSED * max(0.0, (required.value - outcome.speed) / span)

    if required is not None:
        return [required_cost]
    return [trade(weight) for weight in np.linspace(0.1, 0.9, TARGETS)]
