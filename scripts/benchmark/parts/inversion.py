"""Side by side with rival methods, on the same instances from the same start."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import planner
from benchmark.instances import Array, Instance, random_saturating, reference
from benchmark.machine import median_time, timed
from benchmark.parts import Options
from benchmark.rivals import opti_ipopt, scipy_least_squares
from benchmark.rivals.problem import Solve, best_of, exact_rms
from benchmark.table import Table


def build_ours(model: planner.JointModel, samples: int, **options: Any) -> Solve:
    """The optimised inversion, which builds its problem when it solves."""
    del samples

    def solve(desired: Array, limits: tuple[float, float], start: Array) -> Array:
        del start  # it finds its own, in its own time
        return planner.invert_optimal(model, desired, limits=limits, **options).requests

    return solve


OURS = "invert_optimal"
METHODS: dict[str, Callable[[planner.JointModel, int], Solve]] = {
    "IPOPT as a user writes it": opti_ipopt.build,
    "least_squares": scipy_least_squares.build,
    'invert_optimal, "ipopt"': partial(build_ours, solver="ipopt", smoothness=0.0),
    OURS: partial(build_ours, smoothness=0.0),  # no other method gives up accuracy for it
    "invert_optimal, smoothed": build_ours,
}
PLAINLY_STARTED = "IPOPT as a user writes it"
"""The method that sets out from the paper's closed form as it stands, as a user would."""


class Result(NamedTuple):
    """Result of a method on an instance."""

    rms: float  # of the exact model [rad]
    first: float  # time of construction and first solve [s]
    again: float  # time of the same solve once more, median [s]


def measure(options: Options) -> list[Table]:
    """Time and exact rms of every method on every instance."""
    random = partial(random_saturating, samples=options.samples)
    instances = [
        *reference(),
        *map(random, range(options.instances)),
        *(random(seed, limited=True) for seed in range((options.instances + 1) // 2)),
    ]
    compare(random(10**6), 0, repeats=1)  # warm-up
    results = [
        compare(instance, number, repeats=options.repeats)
        for number, instance in enumerate(instances, 1)
    ]
    return [summary(results), each(instances, results)]


def compare(instance: Instance, number: int, *, repeats: int) -> dict[str, Result]:
    """Every method on one instance, the ``number``-th."""
    # A new joint, so that the first solve of each method is one.
    model = replace(instance.model, v_max=instance.model.v_max * (1.0 + number * 2.0**-48))
    refined = closed_form(model, instance, {"rule": "paper"}, {"rule": "exact"})
    plain = closed_form(model, instance, {"refine": False})
    results = {}
    for name, build in METHODS.items():
        start = plain if name == PLAINLY_STARTED else refined
        arguments = instance.desired, instance.limits, start
        built, construction = timed(partial(build, model, len(instance.desired)))
        requests, solution = timed(partial(built, *arguments))
        if np.any(requests < instance.limits[0]) or np.any(requests > instance.limits[1]):
            raise RuntimeError(f"{name} leaves the limits on {instance.name}")
        results[name] = Result(
            exact_rms(model, instance.desired, requests),
            construction + solution,
            median_time(partial(built, *arguments), repeats),
        )
    return results


def closed_form(model: planner.JointModel, instance: Instance, *options: dict[str, Any]) -> Array:
    """The best of the paper's closed forms with these options, within the limits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", planner.OutsideEquation13)
        forms = [planner.invert_closed_form(model, instance.desired, **each) for each in options]
    return best_of(model, instance.desired, instance.limits, [form.requests for form in forms])


def summary(results: Sequence[dict[str, Result]]) -> Table:
    """One row for each method, ours last."""
    table = Table(
        "Inversion, summary",
        "method | first solve, ms | second, ms | second over ours | least"
        " | rms over the best, median % | worst %",
        note=f"Medians over {len(results)} instances of one cycle: the reference walk's joints, "
        "and random ones that cannot follow, without limits and with. "
        "The first solve includes construction. What a user writes for IPOPT: CasADi Opti over "
        "all angles and requests, a condition a tick as in CasADi's examples, every option as "
        "it comes, smoothed by 1, 0.3 and 0.1 degrees a tick in turn, from the paper's closed "
        "form. least_squares sets out from the better closed form, refined. No start's time is "
        "counted; invert_optimal finds its own, with each of its solvers, and builds CasADi's "
        "problem anew at every call. Its default of smoothing, for 0.5 % of the error, is off "
        "in all rows but the last. The best is the lowest exact rms of any other method.",
    )
    for name in METHODS:
        own = [result[name] for result in results]
        ratios = [result[name].again / result[OURS].again for result in results]
        excess = [over_best(result, name) for result in results]
        table.add(
            name,
            *(1e3 * np.median([(each.first, each.again) for each in own], axis=0)),
            np.median(ratios),
            min(ratios),
            np.median(excess),
            max(excess),
        )
    return table


def each(instances: Sequence[Instance], results: Sequence[dict[str, Result]]) -> Table:
    """One row for each instance."""
    measured = [f"{name}, {unit}" for unit in ("deg", "ms") for name in METHODS]
    table = Table(
        "Inversion, instance by instance",
        " | ".join(["instance", *measured, "ours over the best rival, %"]),
        note="Exact rms error, and time of the second solve.",
    )
    for instance, result in zip(instances, results, strict=True):
        errors = (math.degrees(result[name].rms) for name in METHODS)
        times = (1e3 * result[name].again for name in METHODS)
        table.add(instance.name, *errors, *times, over_best(result, OURS))
    return table


def over_best(result: dict[str, Result], name: str) -> float:
    """Excess of the error over the best of the other methods [%], to its last significant digit."""
    best = min(rival.rms for method, rival in result.items() if method != name)
    return round(100.0 * (result[name].rms / best - 1.0), 3) + 0.0
