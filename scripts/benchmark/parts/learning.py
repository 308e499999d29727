"""Learning from executed cycles, on joints and servos that are not the planner's model."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

import planner
from benchmark.compiled_servos import random_servo
from benchmark.parts import Options
from benchmark.plants import random_joint, random_path
from benchmark.table import Table
from planner.arrays import Array, rms

TRIALS = 10  # trials of each: the first is the plan, the rest are learnt
EARLY = 5  # trials that have learnt, after which the error is compared with the floor
DIVERGED = 1.05  # last over first error beyond which, and beyond the noise, learning has diverged


class Played(NamedTuple):
    """One plant, learnt."""

    errors: Array  # true, of each trial, rms [rad]
    floor: float  # of lower bound and noise, the root of the sum of their squares [rad]
    noise: float  # of the sensor, its steps included [rad]


def measure(options: Options) -> list[Table]:
    """One row for each kind of plant, with and without new identification."""
    table = Table(
        "Learning from executed cycles",
        f"plants | plants | first error, deg | best of {EARLY} trials, deg | over floor: median"
        " | 95 % | worst | above 1.5 floors, % | largest rise, noise: 95 % | worst | diverged",
        note=f"{TRIALS} trials, one measured cycle each; errors are those of the true angles. The "
        "floor is the lower bound of the true joint (of a servo: of its identified model) and "
        "the sensor's noise. The joints' parameters are within 30 % of the planner's, with "
        "dry friction, gravity, sag and top speeds that differ; half of the paths saturate.",
    )
    kinds: dict[str, Callable[[int], Played]] = {
        "joints, models identified anew": partial(joint, reidentify=True),
        "joints, one model": partial(joint, reidentify=False),
        "servos from physics": servo,
    }
    for name, play in kinds.items():
        played = [play(seed) for seed in range(options.instances)]
        first = [each.errors[0] for each in played]
        best = np.array([np.min(each.errors[1 : EARLY + 1]) for each in played])
        over = best / [each.floor for each in played]
        rises = [np.max(np.diff(each.errors)) / max(each.noise, 1e-6) for each in played]
        diverged = [each.errors[-1] > DIVERGED * each.errors[0] + each.noise for each in played]
        table.add(
            name,
            len(played),
            *np.degrees([np.median(first), np.median(best)]),
            *np.percentile(over, [50.0, 95.0, 100.0]),
            100.0 * np.mean(over > 1.5),
            *np.percentile(rises, [95.0, 100.0]),
            sum(diverged),
        )
    return [table]


def joint(seed: int, *, reidentify: bool) -> Played:
    """A joint of the model's form with other parameters, on the model of the ERS-210A."""
    plant = random_joint(seed)
    desired = random_path(seed, 88, span=1.2, fastest=(0.03, 0.06)[seed % 2])
    plan = planner.invert_optimal(planner.JointModel.ers210a(), desired)
    bound = planner.lower_bound(plant.model, desired, load=np.zeros(len(desired)))
    noise = math.hypot(plant.noise, plant.count / math.sqrt(12.0))
    return learnt(plan, plant.play, bound, noise, reidentify=reidentify)


def servo(seed: int) -> Played:
    """A servo from its physics, identified from steps and a slow triangle."""
    plant = random_servo(seed)
    levels = np.radians([0, 20, -20, 45, -45, 30, 60, -30, 5, -5, 0])
    triangle = np.radians(np.interp(np.arange(600), [0, 150, 450, 600], [0, 30, -30, 0]))
    logs = [plant.log(each, seed) for each in (np.repeat(levels, 40), triangle)]
    model = planner.identify(logs, hold_out=False).model
    desired = random_path(seed, 100, span=1.2, fastest=(0.05, 0.1)[seed % 2])
    plan = planner.invert_optimal(model, desired, limits=(-2.5, 2.5))
    random = np.random.default_rng(seed)

    def play(requests: Array) -> tuple[Array, Array]:
        true = plant.angles(requests, before=2)
        return true, plant.seen(true, random)

    noise = math.hypot(plant.noise, plant.count / math.sqrt(12.0))
    return learnt(plan, play, plan.lower_bound, noise, reidentify=True)


def learnt(
    plan: planner.Inversion,
    play: Callable[[Array], tuple[Array, Array]],
    bound: float,
    noise: float,
    *,
    reidentify: bool,
) -> Played:
    """The trials on a plant that plays requests, beside its bound and its sensor's noise [rad]."""
    errors = []
    for _ in range(TRIALS):
        true, seen = play(plan.requests)
        errors.append(rms(true - plan.desired))
        plan = planner.refine(plan, seen, reidentify=reidentify)
    return Played(np.array(errors), math.hypot(bound, noise), noise)
