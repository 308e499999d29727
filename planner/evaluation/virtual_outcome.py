"""Results of the paper's experiment on the virtual robot: mean and deviation of each distance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.evaluation.metrics import Distance, angle_distance, foot_distance
from planner.evaluation.outcome import PlannedWalk, approximation
from planner.identification.result import Identification
from planner.planning.result import FootInversion
from planner.trajectory import Array
from planner.virtual.constants import Constants

PAIRS: Mapping[str, str] = {
    "Des,Dir": "direct",
    "Des,Plain": "closed_form_plain",
    "Pwl,Plain": "closed_form_plain",
    "Des,MB": "closed_form",
    "Pwl,MB": "closed_form",
    "Des,Opt": "optimal",
    "Des,Foot": "foot_optimal",
}
"""The rows of Table 2, and the method whose run each of them judges."""


class OverCycles(NamedTuple):
    """A distance over several cycles: its mean and its standard deviation."""

    mean: Distance
    deviation: Distance

    def in_units_of(self, unit: float) -> OverCycles:
        """The same where ``unit`` counts as 1."""
        return OverCycles(self.mean.in_units_of(unit), self.deviation.in_units_of(unit))


def over_cycles(distances: Sequence[Distance]) -> OverCycles:
    """Mean and standard deviation of the distances of single cycles."""
    rows = np.array(distances)
    deviation = rows.std(axis=0, ddof=1) if len(rows) > 1 else np.zeros(2)
    return OverCycles(Distance(*map(float, rows.mean(axis=0))), Distance(*map(float, deviation)))


@dataclass(frozen=True, eq=False)
class Run:
    """A walk as the robot made it.

    Attributes:
        requests: What was sent in every cycle [rad], shape (n, k).
        sensed: What the sensors said [rad], shape (cycles, n, k).
        angles: What the joints did [rad], shape (cycles, n, k).
        dropped: Cycles before these, until the walk was steady.
    """

    requests: Array
    sensed: Array
    angles: Array
    dropped: int


@dataclass(frozen=True, eq=False)
class LearningRun:
    """Learning on the robot, from the foot-optimised plan on.

    Attributes:
        runs: What the robot made of the requests of each trial.
        plans: The plan of each trial, and last the one that the last trial has led to.
    """

    runs: tuple[Run, ...]
    plans: tuple[FootInversion, ...]


@dataclass(frozen=True, eq=False)
class VirtualOutcome:
    """Everything that the experiment on the virtual robot gave.

    Attributes:
        constants: What the robot is made of.
        seed: Of its noise.
        identifications: What the step tests say about each joint.
        planned: The plans on the identified models, with what these predict.
        runs: What the robot made of each method's requests.
        learning: What it learnt from the foot-optimised plan on.
        shift_samples: Lead of the best time shift, found on the robot.
        seconds: Time that each part took [s].
    """

    constants: Constants
    seed: int
    identifications: tuple[Identification, ...]
    planned: PlannedWalk
    runs: Mapping[str, Run]
    learning: LearningRun
    shift_samples: int
    seconds: Mapping[str, float]

    @property
    def table2(self) -> dict[str, dict[str, OverCycles]]:
        """Table 2 by joint and comparison [degrees], by the true angles."""
        return self._table2(lambda run: run.angles)

    @property
    def sensed_table2(self) -> dict[str, dict[str, OverCycles]]:
        """Table 2 by what the sensors said [degrees]."""
        return self._table2(lambda run: run.sensed)

    @property
    def foot_table(self) -> dict[str, OverCycles]:
        """Distances of the foot from its desired path by method [cm], by the true angles."""
        return self._foot_table(lambda run: run.angles)

    @property
    def sensed_foot_table(self) -> dict[str, OverCycles]:
        """Distances of the foot by what the sensors said [cm]."""
        return self._foot_table(lambda run: run.sensed)

    @property
    def learnt_foot(self) -> list[OverCycles]:
        """Distance of the foot from its desired path in each trial [cm], by the true angles."""
        walk = self.planned.walk
        return [
            over_cycles(
                [foot_distance(walk.leg.foot_positions(c), walk.desired_foot) for c in run.angles]
            ).in_units_of(0.01)
            for run in self.learning.runs
        ]

    @cached_property
    def legs(self) -> dict[str, Array]:
        """True positions of joints and, last, foot by method [m], (cycles, n, joints + 1, 3)."""
        leg = self.planned.walk.leg
        return {
            method: np.stack([leg.joint_positions(cycle) for cycle in run.angles])
            for method, run in self.runs.items()
        }

    @cached_property
    def foot_paths(self) -> dict[str, Array]:
        """True path of the foot by method [m], shape (cycles, n, 3)."""
        return {method: points[:, :, -1] for method, points in self.legs.items()}

    @property
    def unseen_rms(self) -> dict[str, float]:
        """How well each model predicts the walk under the direct method [rad], by joint.

        It is identified from step tests alone, so this walk is new to it.
        """
        run = self.runs["direct"]
        found = {}
        for j, joint in enumerate(self.planned.joints):
            actual = run.angles[:, :, j].mean(axis=0)
            found[joint.name] = angle_distance(actual, joint.direct).rms
        return found

    def _table2(self, read: Callable[[Run], Array]) -> dict[str, dict[str, OverCycles]]:
        table: dict[str, dict[str, OverCycles]] = {}
        for j, joint in enumerate(self.planned.joints):
            goals = {
                "Pwl,Plain": approximation(joint.closed_form_plain),
                "Pwl,MB": approximation(joint.closed_form),
            }
            table[joint.name] = {
                pair: over_cycles(
                    [
                        angle_distance(cycle, goals.get(pair, joint.desired))
                        for cycle in read(self.runs[method])[:, :, j]
                    ]
                ).in_units_of(math.radians(1.0))
                for pair, method in PAIRS.items()
            }
        return table

    def _foot_table(self, read: Callable[[Run], Array]) -> dict[str, OverCycles]:
        walk = self.planned.walk
        return {
            method: over_cycles(
                [
                    foot_distance(walk.leg.foot_positions(cycle), walk.desired_foot)
                    for cycle in read(run)
                ]
            ).in_units_of(0.01)
            for method, run in self.runs.items()
        }
