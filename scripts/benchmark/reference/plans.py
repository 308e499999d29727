"""Reference plans: requests of joints and legs, and the bounds below them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import planner
from benchmark.instances import FREE, Instance, random_attainable, random_saturating, reference
from benchmark.parts.foot import Task, tasks
from benchmark.reference.record import Case, Numbers
from tests.instances import random_model, random_model_outside_equation_13, saturating

UNSEEN = 2000  # first seed of instances that no test uses
ATTAINED = math.radians(0.005)  # errors below this [rad] are compared as if they were it
FOOT_ATTAINED = 1e-5  # the same for the foot [m]
EXACT_SECONDS = 5.0  # longest search for an exact bound [s], as counted by its work


def joints() -> Iterator[tuple[str, Instance, dict[str, Any]]]:
    """The 115 joints: name, instance and further keywords of ``invert_optimal``."""
    for instance in reference():
        for norm in ("rms", "max"):
            yield f"{instance.name}, {norm}", instance, {"norm": norm}
    for seed in range(UNSEEN, UNSEEN + 35):
        yield f"saturating {seed}", random_saturating(seed, samples=60 + seed % 60), {}
    for seed in range(UNSEEN, UNSEEN + 12):
        yield f"limited {seed}", random_saturating(seed, limited=True), {}
    for seed in range(UNSEEN, UNSEEN + 14):
        yield f"attainable {seed}", random_attainable(seed), {}
    for seed in range(UNSEEN + 50, UNSEEN + 66):
        instance = random_saturating(seed, samples=60 + seed % 60, limited=seed % 2 == 0)
        yield f"from rest {seed}", instance, {"cyclic": False}
    for seed in range(UNSEEN + 70, UNSEEN + 82):
        yield f"largest error {seed}", random_saturating(seed), {"norm": "max"}
    for seed in range(UNSEEN + 90, UNSEEN + 110):
        kind, make = KINDS[seed % 3]
        rng = np.random.default_rng(seed)
        model = make(rng)
        desired = saturating(rng, model, samples=int(rng.integers(40, 110)))
        yield f"{kind} {seed}", Instance(kind, model, desired, FREE), {}


def _held(rng: np.random.Generator) -> planner.JointModel:
    return random_model(rng, whole=False, hold=int(rng.integers(2, 5)), offset=True)


def _slow(rng: np.random.Generator) -> planner.JointModel:
    """A joint whose requests take effect after 10 to 25 ticks, over 5 to 20."""
    model = random_model(rng)
    lag, acceleration = rng.uniform(10.0, 25.0), rng.uniform(5.0, 20.0)
    return replace(model, lag=lag * model.tick, acceleration_time=acceleration * model.tick)


KINDS = (
    ("held", _held),
    ("slow", _slow),
    ("outside Equation 13", random_model_outside_equation_13),
)


def plans() -> Iterator[Case]:
    """Optimised plans."""
    for name, instance, arguments in joints():
        yield name, partial(optimal, instance, **arguments)


def optimal(instance: Instance, **arguments: Any) -> Numbers:
    """The plan's numbers."""
    arguments |= {"limits": instance.asked_limits}
    return numbers_of(planner.invert_optimal(instance.model, instance.desired, **arguments))


def closed_forms() -> Iterator[Case]:
    """The closed forms of every third joint, and of the reference walk by both rules."""
    for name, instance, arguments in [*joints()][::3]:
        keeps = instance.model.keeps_equation_13
        kept = {key: arguments[key] for key in arguments if key == "cyclic"}
        for rule in ("paper", "exact") if keeps else ("exact",):
            yield f"{name}, {rule}", partial(by_lines, instance, segments=6, rule=rule, **kept)
    for instance in reference():
        yield f"{instance.name}, automatic", partial(by_lines, instance)
        yield f"{instance.name}, not refined", partial(by_lines, instance, refine=False)


def by_lines(instance: Instance, **arguments: Any) -> Numbers:
    """The closed form's numbers."""
    plan = planner.invert_closed_form(instance.model, instance.desired, **arguments)
    return numbers_of(plan) | {"segments": plan.approximation.segments}


def numbers_of(plan: planner.Inversion) -> Numbers:
    """The compared numbers of a plan."""
    return {
        "error": plan.error,
        "floor": ATTAINED,
        "rms": plan.rms,
        "max_error": plan.max_error,
        "equation 13": int(plan.model.keeps_equation_13),
        "largest step": plan.largest_step,
        "requests": plan.requests.tolist(),
    }


def feet() -> Iterator[Case]:
    """Eighteen plans of whole legs."""
    for task in tasks(60):
        for norm in ("rms", "max"):
            yield f"{task.name}, {norm}", partial(stepped, task, norm=norm)
    front = [task for task in tasks(44) if task.name in ("reference walk", "front left")]
    for task in front:
        lower, upper = task.leg.limits
        middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
        narrow = middle - 0.8 * half, middle + 0.8 * half
        for variant, arguments in {
            "from rest": {"cyclic": False},
            "from rest, max": {"cyclic": False, "norm": "max"},
            "height": {"weights": (0.2, 0.2, 1.0)},
            "narrow": {"limits": narrow},
        }.items():
            yield f"{task.name}, {variant}", partial(stepped, task, **arguments)


def stepped(task: Task, **arguments: Any) -> Numbers:
    """The numbers of a leg's plan."""
    plan = planner.invert_foot(planner.JointModel.ers210a(), task.leg, task.desired, **arguments)
    return {
        "error": plan.error,
        "floor": FOOT_ATTAINED,
        "rms": plan.rms,
        "max_error": plan.max_error,
        "requests": plan.requests.ravel().tolist(),
    }


def certificates() -> Iterator[Case]:
    """Forty bounds beside the plan that they are about."""
    for seed in range(UNSEEN + 200, UNSEEN + 209):
        instance = random_saturating(seed, samples=50 + seed % 50)
        cyclic = seed % 3 > 0
        for level in ("slope", "envelope"):
            for norm in ("rms", "max"):
                name = f"{level}, {norm} {seed} {'cycle' if cyclic else 'from rest'}"
                yield name, partial(bounded, instance, level=level, norm=norm, cyclic=cyclic)
    for seed in range(UNSEEN + 220, UNSEEN + 224):
        instance = random_saturating(seed, samples=18 + seed % 4)
        arguments = {"level": "exact", "norm": "rms" if seed % 2 else "max", "cyclic": seed % 4 > 0}
        yield f"exact {seed}", partial(bounded, instance, **arguments, time_limit=EXACT_SECONDS)


def bounded(instance: Instance, *, norm: str, cyclic: bool, **arguments: Any) -> Numbers:
    """A bound, and the error of the plan [rad]."""
    start = None if cyclic else float(instance.desired[0])
    arguments |= {"norm": norm, "cyclic": cyclic, "start": start}
    certificate = planner.certify(instance.model, instance.desired, **arguments)
    plan = planner.invert_optimal(instance.model, instance.desired, norm=norm, cyclic=cyclic)
    return {"bound": certificate.bound, "plan": plan.error, "solver gap": certificate.solver_gap}
