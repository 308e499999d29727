"""Learning from executed cycles, on joints and servos that are not the planner's model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import planner
from benchmark.parts import Options
from benchmark.plants import random_joint, random_path, random_servo
from benchmark.table import Table
from planner.trajectory import Array

TRIALS = 10
"""Trials of each: the first is the plan, the rest are learnt."""

EARLY = 5
"""Trials that have learnt, after which the error is compared with the floor."""

DIVERGED = 1.05
"""Last over first error beyond which, and beyond the noise, learning has diverged."""

Play = Callable[[Array], tuple[Array, Array]]
"""True angles (n,) and measured cycles (cycles, n) under requests (n,) [rad]."""


class Played(NamedTuple):
    """One plant, learnt.

    Attributes:
        errors: True error of each trial, rms [rad].
        floor: Lower bound and noise of the sensor, as the root of the sum of their squares [rad].
        noise: Of the sensor, its steps included [rad].
    """

    errors: Array
    floor: float
    noise: float


def measure(options: Options) -> list[Table]:
    """One row for each kind of plant, with and without new identification."""
    table = Table(
        "Learning from executed cycles",
        (
            "plants",
            "first error, deg",
            f"best of {EARLY} trials, deg",
            "over floor: median",
            "95 %",
            "worst",
            "above 1.5 floors, %",
            "largest rise, noise: 95 %",
            "worst",
            "diverged",
        ),
        note=(
            f"{TRIALS} trials, one measured cycle each; errors are those of the true angles. The "
            "floor is the lower bound of the true joint (of a servo: of its identified model) and "
            "the sensor's noise. The joints' parameters are within 30 % of the planner's, with "
            "dry friction, gravity, sag and top speeds that differ; half of the paths saturate."
        ),
        stub="plants",
    )
    for name, play in (
        ("joints, models identified anew", lambda seed: joint(seed, reidentify=True)),
        ("joints, one model", lambda seed: joint(seed, reidentify=False)),
        ("servos from physics", servo),
    ):
        add(table, name, [play(seed) for seed in range(options.instances)])
    return [table]


def add(table: Table, name: str, played: list[Played]) -> None:
    """A row about some plants."""
    first = np.array([each.errors[0] for each in played])
    best = np.array([np.min(each.errors[1 : EARLY + 1]) for each in played])
    over = best / np.array([each.floor for each in played])
    rises = [np.max(np.diff(each.errors)) / max(each.noise, 1e-6) for each in played]
    diverged = [each.errors[-1] > DIVERGED * each.errors[0] + each.noise for each in played]
    table.add(
        name,
        len(played),
        math.degrees(float(np.median(first))),
        math.degrees(float(np.median(best))),
        *np.percentile(over, [50.0, 95.0, 100.0]),
        100.0 * float(np.mean(over > 1.5)),
        *np.percentile(rises, [95.0, 100.0]),
        sum(diverged),
    )


def joint(seed: int, *, reidentify: bool) -> Played:
    """A joint of the model's form with other parameters, on the model of the ERS-210A."""
    plant, nominal = random_joint(seed), planner.JointModel.ers210a()
    desired = random_path(seed, 88, span=1.2, fastest=(0.03, 0.06)[seed % 2])
    plan = planner.invert_optimal(nominal, desired)
    errors = learnt(plan, plant.play, reidentify=reidentify)
    bound = planner.lower_bound(plant.model, desired, load=np.zeros(len(desired)))
    noise = math.hypot(plant.noise, plant.count / math.sqrt(12.0))
    return Played(errors, math.hypot(bound, noise), noise)


def servo(seed: int) -> Played:
    """A servo from its physics, identified from steps and a slow triangle."""
    plant = random_servo(seed)
    levels = np.radians([0, 20, -20, 45, -45, 30, 60, -30, 5, -5, 0])
    triangle = np.radians(np.interp(np.arange(600), [0, 150, 450, 600], [0, 30, -30, 0]))
    logs = [plant.log(np.repeat(levels, 40)), plant.log(triangle)]
    model = planner.identify(logs, hold_out=False).model
    desired = random_path(seed, 100, span=1.2, fastest=(0.05, 0.1)[seed % 2])
    plan = planner.invert_optimal(model, desired, limits=(-2.5, 2.5))

    def play(requests: Array) -> tuple[Array, Array]:
        true, seen = plant.play(requests)
        return true.mean(axis=0), seen

    errors = learnt(plan, play, reidentify=True)
    noise = math.hypot(plant.noise, plant.count / math.sqrt(12.0))
    return Played(errors, math.hypot(plan.lower_bound, noise), noise)


def learnt(plan: planner.Inversion, play: Play, *, reidentify: bool) -> Array:
    """True errors of the trials [rad], shape (trials,)."""
    errors = []
    for _ in range(TRIALS):
        true, seen = play(plan.requests)
        errors.append(float(np.sqrt(np.mean((true - plan.desired) ** 2))))
        plan = planner.refine(plan, seen, reidentify=reidentify)
    return np.array(errors)
