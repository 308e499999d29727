"""The paper's experiment on the virtual robot: step tests, models from them, plans, execution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.arrays import Array, rms
from planner.evaluation.reproduction import (
    SEGMENTS,
    Clock,
    OverCycles,
    PlannedWalk,
    best_lead,
    plan_walk,
    walk_distance,
)
from planner.exceptions import NoSteadyCycle
from planner.gait.half_ellipse import ReferenceWalk, reference_walk
from planner.identification.excitation import step_test
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import Identification
from planner.learning.refine import refine
from planner.learning.trials import Learning
from planner.planning.plan import Plan
from planner.virtual.robot import CONSTANTS, Constants, VirtualRobot

AMPLITUDES = (20.0, 40.0, 70.0)  # heights of the step tests [degrees], in the range of the walk
STEP_CYCLES = 3  # cycles of each step test, as the paper repeats them
SETTLING = 1.0  # time in which the leg takes up the pose that a test begins with [s]
CYCLES = 20  # cycles of each walk, as in the paper

TRIALS = 10  # trials of learning, each executed until it is steady and then measured for two cycles
MEASURED_CYCLES = 2  # in each trial: the fewest that separate noise from repeatable errors

# Change from cycle to cycle, rms, up to which a walk is steady, over what the errors of a sensor
# make of two equal cycles. The noise of the supply is the rest.
STEADY = 3.0
MOST_DROPPED = 20  # cycles after which a walk that is not steady will not be


@dataclass(frozen=True, eq=False)
class Run:
    """A walk of the robot."""

    requests: Array  # of every cycle [rad], (n, k)
    sensed: Array  # readings of the sensors [rad], (cycles, n, k)
    angles: Array  # true angles of the joints [rad], (cycles, n, k)
    dropped: int  # cycles before these, until the walk was steady


@dataclass(frozen=True, eq=False)
class VirtualOutcome:
    """Results of the experiment on the virtual robot."""

    constants: Constants  # of the robot
    seed: int  # of its noise
    identifications: tuple[Identification, ...]  # of each joint from its step test
    planned: PlannedWalk  # the plans on the identified models
    runs: Mapping[str, Run]  # walks under each method's requests
    trials: tuple[Run, ...]  # walks of the trials of learning, from the foot-optimised plan on
    learning: Learning  # its state after the trials
    shift_samples: int  # lead of the best time shift, found on the robot
    seconds: Mapping[str, float]  # time that each part took [s]

    @property
    def walks(self) -> dict[str, Array]:
        """True angles of the joints by method [rad], shape (cycles, n, k)."""
        return {method: run.angles for method, run in self.runs.items()}

    @property
    def learnt_foot(self) -> list[OverCycles]:
        """Distance of the foot from its desired path in each trial [cm], by the true angles."""
        trials = {f"{number}": run.angles for number, run in enumerate(self.trials)}
        return list(self.planned.foot_table(trials).values())

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
        """How well each model predicts the walk, new to it, under the direct method [rad]."""
        off = self.runs["direct"].angles.mean(axis=0) - self.planned.plans["direct"].predicted
        return dict(zip(self.planned.walk.joint_names, map(rms, off.T), strict=True))


def play_experiment(
    *,
    segments: int = SEGMENTS,
    cycles: int = CYCLES,
    seed: int = 0,
    constants: Constants = CONSTANTS,
    progress: Callable[[str], None] = lambda _: None,
) -> VirtualOutcome:
    """Identify from step tests, plan the walk by every method, and execute every plan."""
    clock = Clock(progress)
    robot = VirtualRobot(constants=constants, seed=seed)
    walk = reference_walk()
    identifications = []
    for j, name in enumerate(walk.joint_names):
        clock.start("step_tests", f"the step tests of the {name}")
        logs = [record_step_test(robot, walk, j, amplitude) for amplitude in AMPLITUDES]
        clock.start("identification", f"the model of the {name}")
        tick = robot.constants.request_period
        result = identify(logs, tick=tick)  # its tick has the rounding of the log's clock
        identifications.append(replace(result, model=replace(result.model, tick=tick)))
    clock.stop()
    planned = plan_walk([each.model for each in identifications], segments=segments, clock=clock)
    runs = {}
    for method, plan in planned.plans.items():
        if method != "shift":  # the best one is found on the robot
            clock.start("execution", f"{cycles} cycles of the walk: {method.replace('_', ' ')}")
            runs[method] = execute(robot, plan.requests, cycles=cycles)
    lead = best_lead(runs["direct"].sensed.mean(axis=0), walk_distance(walk))
    runs["shift"] = execute(robot, np.roll(walk.desired, -lead, axis=0), cycles=cycles)
    clock.start("learning", f"{TRIALS} trials of learning")
    trials, learning = learn(robot, planned.plans["foot_optimal"])
    clock.stop()
    return VirtualOutcome(
        constants=robot.constants,
        seed=seed,
        identifications=tuple(identifications),
        planned=planned,
        runs={method: runs[method] for method in planned.plans},
        trials=trials,
        learning=learning,
        shift_samples=lead,
        seconds=clock.seconds,
    )


def record_step_test(robot: VirtualRobot, walk: ReferenceWalk, joint: int, amplitude: float) -> Log:
    """The sensor's log of Equation 1 [degrees] in the middle of the joint's range in the walk."""
    middle = (walk.desired.min(axis=0) + walk.desired.max(axis=0)) / 2.0
    height = np.radians(amplitude)
    cycles = np.tile(step_test(float(height)), STEP_CYCLES)
    cycles = np.concatenate([np.zeros(16), cycles])  # rest that is longer than any lag
    requests = np.tile(middle, (len(cycles), 1))
    requests[:, joint] += cycles - height / 2.0
    robot.rest(SETTLING, requests[0])
    recording = robot.play(requests)
    return Log(
        times=robot.constants.request_period * np.arange(len(requests), dtype=np.float64),
        requests=requests[:, joint],
        angles=recording.sensed[:, joint],
        name=f"step test of {amplitude:g} degrees",
        joint=walk.joint_names[joint],
    )


def learn(robot: VirtualRobot, plan: Plan) -> tuple[tuple[Run, ...], Learning]:
    """Execute a plan and refine it by the sensors' readings in turn: the runs, and the learning."""
    runs = []
    for _ in range(TRIALS):
        runs.append(execute(robot, plan.requests, cycles=MEASURED_CYCLES))
        plan = refine(plan, runs[-1].sensed, reidentify=False)
    return tuple(runs), plan.learning[0]


def execute(robot: VirtualRobot, requests: Array, *, cycles: int) -> Run:
    """Repeat a cycle of requests until the sensors repeat themselves, and then ``cycles`` times."""
    robot.rest(SETTLING, requests[0])
    last, change = None, np.inf
    for dropped in range(1, MOST_DROPPED + 1):
        sensed = robot.play(requests).sensed
        if last is not None:
            change = max(map(rms, (sensed - last).T))
        if change <= STEADY * math.sqrt(2.0) * robot.constants.sensor_error:
            played = [robot.play(requests) for _ in range(cycles)]
            sensed, angles = (
                np.stack([getattr(each, name) for each in played]) for name in ("sensed", "angles")
            )
            return Run(requests=requests, sensed=sensed, angles=angles, dropped=dropped)
        last = sensed
    raise NoSteadyCycle(change, MOST_DROPPED)
