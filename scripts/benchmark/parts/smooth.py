"""Smoothness of requests, its cost, and robustness to a slightly wrong model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import planner
from benchmark.instances import FREE, Array, Instance, reference
from benchmark.parts import Options
from benchmark.table import Table
from kinematics import Leg, urdf_path
from planner.arrays import rms
from planner.gait.stride import stride
from planner.planning.candidate_models import PAIRS, drawn_models
from planner.planning.plan import RequestMotion, request_motion

JOINT = planner.JointModel.ers210a()

NOISE = math.radians(0.5)  # noise of the log from which a model is identified [rad]
FRESH = 40  # pairs of models, drawn from the identification, that no plan uses


def measure(options: Options) -> list[Table]:  # noqa: ARG001
    """The tables of joints, of the foot, and of wrong models."""
    corners = np.sign(np.sin(2.0 * np.pi * (np.arange(125) + 0.5) / 125))
    square = Instance("square, 20 degrees", JOINT, np.radians(20.0) * corners, FREE)
    instances = [*reference(), square]
    return [joints(instances), feet(), wrong_models(instances), wrong_legs()]


def joints(instances: Sequence[Instance]) -> Table:
    """Single joints by smoothness of the requests."""
    table = Table(
        "Smooth requests of single joints",
        "plan | rms, deg | over the least, % | largest step, deg | reversals per s | length, deg"
        " | length over desired | beyond, deg",
        note="ERS-210A; the least error is that without smoothing.",
    )
    optimal = {"not smoothed": {"smoothness": 0.0}, "default": {}}
    for degrees in (8, 5, 3):
        step = math.radians(float(degrees))
        optimal[f"at most {degrees} deg"] = {"max_step": step, "smoothness": 0.0}
    for instance in instances:
        model, desired = instance.model, instance.desired
        plans = {"closed form": planner.invert_closed_form(model, desired)} | {
            name: planner.invert_optimal(model, desired, limits=instance.asked_limits, **options)
            for name, options in optimal.items()
        }
        least = plans["not smoothed"].rms
        for name, plan in plans.items():
            motion = motion_of(plan)
            step, length, wished, beyond = np.degrees(
                [
                    motion.largest_step,
                    motion.path_length,
                    motion.desired_path_length,
                    motion.beyond_desired,
                ]
            )
            errors = math.degrees(plan.rms), 100.0 * (plan.rms / least - 1.0)
            lengths = motion.reversals_per_s, length, length / wished, beyond
            table.add(f"{instance.name}, {name}", *errors, step, *lengths)
    return table


def motion_of(plan: planner.Inversion) -> RequestMotion:
    """How the requests of a cycle move."""
    return request_motion(plan.requests, plan.desired, period=plan.model.period, cyclic=True)


def feet() -> Table:
    """The reference walk and the front-left leg's, by method."""
    table = Table(
        "Smooth requests of a foot",
        "plan | foot rms, cm | largest step, deg | length of all joints, deg | over closed form",
        note="ERS-210A; the length is that of all requests of a cycle. As smooth as the closed "
        "form's error allows: each joint with the smoothness with which its error is that of "
        "its closed form.",
    )
    walk = planner.reference_walk()
    front = Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")
    step = stride(front)
    for name, leg, foot, angles in (
        ("reference walk", walk.leg, walk.desired_foot, walk.desired),
        ("front-left walk", front, step.foot, step.angles),
    ):
        closed = planner.plan(JOINT, angles, method="closed_form")
        singly = {
            "closed form": closed.requests,
            "joint by joint": planner.plan(JOINT, angles).requests,
            "joint by joint, as smooth as the closed form's error allows": np.column_stack(
                [as_smooth_as_allowed(form) for form in closed.inversions]
            ),
        }
        for method, options in (("", {}), (", not smoothed", {"smoothness": 0.0})):
            plan = planner.invert_foot(JOINT, leg, foot, **options)
            singly[f"foot-optimal{method}"] = plan.requests
        shortest = math.nan
        for method, requests in singly.items():
            predicted = np.column_stack([planner.simulate(JOINT, each) for each in requests.T])
            distances = np.linalg.norm(leg.foot_positions(predicted) - foot, axis=1)
            steps = np.degrees(np.abs(np.diff(requests, axis=0, append=requests[:1])))
            shortest = np.sum(steps) if method == "closed form" else shortest
            row = 100.0 * rms(distances), np.max(steps), np.sum(steps), np.sum(steps) / shortest
            table.add(f"{name}, {method}", *row)
    return table


def as_smooth_as_allowed(form: planner.Inversion) -> Array:
    """The smoothest optimised requests whose error is at most that of a closed form."""
    best = planner.invert_optimal(form.model, form.desired, smoothness=0.0)
    room = max(form.rms / best.rms - 1.0, 0.0) if best.rms else 0.0
    return planner.invert_optimal(form.model, form.desired, smoothness=room).requests


def wrong_models(instances: Sequence[Instance]) -> Table:
    """Errors under models that the plan did not use."""
    table = Table(
        "Models that are a little wrong",
        "plan | nominal rms, deg | mean of fresh models, deg | worst of them, deg"
        " | lower bound of that, deg | acceleration time 20 % off, deg | reversals per s",
        note=f"{2 * FRESH} fresh models from the identification of a log of two seconds with "
        f"{math.degrees(NOISE):g} degrees of noise; from the fast sine on the log is one of "
        "small steps, which leaves the top speed open above. Under no requests the worst error is "
        "below its lower bound.",
    )
    phase = 2.0 * np.pi * np.arange(88) / 88
    wide, unsaturated = identified(reach=1.0).model, identified(reach=0.1).model
    cases = [
        *((wide, each.name, each.desired) for each in instances),
        (wide, "sine", 0.3 * np.sin(phase)),
        (unsaturated, "fast sine", 0.5 * np.sin(phase)),
        *((unsaturated, f"{each.name}, small steps", each.desired) for each in instances),
    ]
    for model, case, desired in cases:
        fresh = fresh_models(model)
        bound = max(planner.lower_bound(each, desired) for each in fresh)
        times = [factor * model.acceleration_time for factor in (0.8, 1.2)]
        off = [replace(model, acceleration_time=each) for each in times]
        plans = {
            "closed form": planner.invert_closed_form(model, desired),
            "not smoothed": planner.invert_optimal(model, desired, smoothness=0.0),
            "default": planner.invert_optimal(model, desired),
            "robust, mean": planner.invert_optimal(model, desired, robust="mean"),
            "robust, worst": planner.invert_optimal(model, desired, robust="worst"),
        }
        for name, plan in plans.items():
            errors, errors_off = (
                [rms(planner.simulate(each, plan.requests) - desired) for each in models]
                for models in (fresh, off)
            )
            row = plan.rms, np.mean(errors), max(errors), bound, max(errors_off)
            table.add(f"{case}, {name}", *np.degrees(row), motion_of(plan).reversals_per_s)
    return table


def wrong_legs() -> Table:
    """Errors of a foot under models of its joints that the plan did not use."""
    table = Table(
        "Models of a leg that are a little wrong",
        "plan | nominal rms, cm | mean of fresh models, cm | worst of them, cm"
        " | lower bound of that, cm | nominal loss, % | worst gain, % | true joints, cm",
        note="The reference walk at its own and at half its speed. Each joint is identified from "
        f"a log of its own, as above, with small steps or without; {2 * FRESH} fresh sets of "
        "models of the three joints. Loss and gain are those beside the plan for the nominal "
        "models; under no requests the worst error is below its lower bound, that of the slowest "
        "set. The true joints are those of the ERS-210A.",
    )
    walk = planner.reference_walk()
    foot, count = walk.desired_foot, len(walk.desired_foot)
    half = np.arange(2 * count) / 2.0
    slow = np.column_stack([np.interp(half, np.arange(count), x, period=count) for x in foot.T])
    cases = [
        ("known", 1.0, 1, foot),
        ("known, half speed", 1.0, 1, slow),
        *((f"small steps, leg {leg}", 0.1, leg, foot) for leg in (1, 2, 3, 4)),
        ("small steps, leg 1, half speed", 0.1, 1, slow),
    ]
    for case, reach, number, path in cases:
        results = [identified(reach=reach, seed=3 * number - 2 + joint) for joint in range(3)]
        drawn = [fresh_models(each.model, seed=seed) for seed, each in enumerate(results)]
        fresh = [*zip(*drawn, strict=True)]
        nominal = [each.model for each in results]
        plans = {
            "foot-optimal": planner.invert_foot(nominal, walk.leg, path),
            "robust, mean": planner.invert_foot(results, walk.leg, path, robust="mean"),
            "robust, worst": planner.invert_foot(results, walk.leg, path, robust="worst"),
        }
        alone = plans["foot-optimal"]
        slowest = min(fresh, key=lambda models: sum(each.v_max for each in models))
        bound = under(alone, slowest).lower_bound
        before = max(under(alone, each).rms for each in fresh)
        for name, plan in plans.items():
            errors = [under(plan, each).rms for each in fresh]
            shares = plan.rms / alone.rms - 1.0, 1.0 - max(errors) / before
            row = (
                plan.rms,
                np.mean(errors),
                max(errors),
                bound,
                *shares,
                under(plan, [JOINT] * 3).rms,
            )
            table.add(f"{case}, {name}", *(100.0 * np.array(row)))
    return table


def under(
    plan: planner.FootInversion, models: Sequence[planner.JointModel]
) -> planner.FootInversion:
    """The same requests to joints of other models."""
    return replace(plan, models=tuple((each,) for each in models))


def fresh_models(model: planner.JointModel, *, seed: int = 0) -> tuple[planner.JointModel, ...]:
    """Models from the intervals that no plan uses."""
    return drawn_models(model, pairs=PAIRS + FRESH, seed=seed)[1 + 2 * PAIRS :]


def identified(*, reach: float, seed: int = 1) -> planner.Identification:
    """Identification from a short noisy log of the ERS-210A's joint, of requests within a reach."""
    rng = np.random.default_rng(seed)
    requests = np.repeat(rng.uniform(-reach, reach, 10), 25)
    angles = planner.simulate(JOINT, requests, cyclic=False, start=float(requests[0]))
    noisy = angles + rng.normal(scale=NOISE, size=len(angles))
    times = JOINT.tick * np.arange(len(angles))
    return planner.identify(planner.Log(times=times, requests=requests, angles=noisy))
