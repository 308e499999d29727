"""Instances of the benchmark: those of the tests, by name and seed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

import planner
from planner.arrays import Array
from tests.instances import REFERENCE_JOINTS, attainable, random_model, saturating

FREE = (-math.inf, math.inf)  # no limits on the requests


class Instance(NamedTuple):
    """A joint, its desired angles and its limits."""

    name: str
    model: planner.JointModel
    desired: Array  # (n,) [rad]
    limits: tuple[float, float]  # [rad]

    @property
    def asked_limits(self) -> tuple[float, float] | None:
        """The limits as a plan takes them: None for none."""
        return None if self.limits == FREE else self.limits


def reference() -> list[Instance]:
    """The joints of the reference walk, within the leg's limits."""
    joint = planner.JointModel.ers210a()
    return [Instance(j.name, joint, j.desired, j.limits) for j in REFERENCE_JOINTS]


def random_saturating(seed: int, *, samples: int = 88, limited: bool = False) -> Instance:
    """A random joint that cannot follow, whose lag is whole ticks at even seeds.

    Where it is limited, requests may leave the range of the desired angles by half of theta_0.
    """
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=seed % 2 == 0)
    desired = saturating(rng, model, samples=samples)
    if not limited:
        return Instance(f"seed {seed}", model, desired, FREE)
    beyond = model.theta_0 / 2.0
    limits = float(np.min(desired)) - beyond, float(np.max(desired)) + beyond
    return Instance(f"seed {seed}, limited", model, desired, limits)


def random_attainable(seed: int, *, samples: int = 88) -> Instance:
    """A random joint that can follow, whose lag is whole ticks at even seeds."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=seed % 2 == 0)
    return Instance(f"seed {seed}", model, attainable(rng, model, samples=samples), FREE)


def long_walk(samples: int) -> Instance:
    """The rotator of the reference walk over and over, its stroke changing slowly by some 10 %.

    The change is a sum of sines of at least five cycles' length, so no two cycles are alike and the
    whole still closes. A cycle has 88 samples, or nearly so where that does not divide the length.
    """
    rotator = reference()[0]
    cycle, middle = len(rotator.desired), float(np.mean(rotator.desired))
    turns = np.arange(samples) / samples
    cycles = max(1, round(samples / cycle))
    place = turns * cycles * cycle
    angles = np.interp(place, np.arange(cycle), rotator.desired, period=cycle) - middle
    fastest = cycles // 5
    harmonics = np.unique(np.linspace(1, fastest, 8, dtype=int)) if fastest else np.zeros(0)
    shifts = np.random.default_rng(samples).uniform(0.0, 2.0 * np.pi, size=len(harmonics))
    change = np.sin(2.0 * np.pi * np.outer(turns, harmonics) + shifts).sum(axis=1)
    desired = middle + np.clip(1.0 + 0.05 * change, 0.8, 1.2) * angles
    return rotator._replace(name=f"{samples} samples", desired=np.clip(desired, *rotator.limits))
