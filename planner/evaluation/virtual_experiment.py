"""The paper's experiment on the virtual robot: step tests, models from them, plans, execution."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planner.evaluation.baselines import best_lead
from planner.evaluation.metrics import angle_distance
from planner.evaluation.outcome import PlannedWalk
from planner.evaluation.paper import SEGMENTS
from planner.evaluation.reproduction import Clock, foot_outcome, plan_walk
from planner.evaluation.virtual_outcome import LearningRun, Run, VirtualOutcome
from planner.exceptions import NoSteadyCycle
from planner.gait.half_ellipse import ReferenceWalk, reference_walk
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.identification.result import Identification
from planner.learning.refine import refine
from planner.model.step_test import step_test
from planner.planning.result import FootInversion, Inversion
from planner.trajectory import Array
from planner.virtual.constants import Constants
from planner.virtual.robot import VirtualRobot

AMPLITUDES = (20.0, 40.0, 70.0)
"""Heights of the step tests [degrees]: small to large within the range that the walk needs."""

STEP_CYCLES = 3
"""Cycles of each step test, as the paper repeats them."""

REST_REQUESTS = 16
"""Requests of rest that a step test's log begins with, longer than any lag."""

SETTLING = 1.0
"""Time in which the leg takes up the pose that a test begins with [s]."""

CYCLES = 20
"""Cycles of each walk, as in the paper."""

STEADY = 3.0
"""Change from cycle to cycle, rms, up to which a walk is steady, over what the errors of a sensor
make of two equal cycles. The noise of the supply is the rest."""

TRIALS = 10
"""Trials of learning, each executed until it is steady and then measured for two cycles."""

MEASURED_CYCLES = 2
"""Cycles that are measured in each trial: the fewest that separate noise from what repeats."""

MOST_DROPPED = 20
"""Cycles after which a walk that is not steady will not be."""


def play_experiment(
    *,
    segments: int = SEGMENTS,
    cycles: int = CYCLES,
    seed: int = 0,
    constants: Constants | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> VirtualOutcome:
    """Play the paper's experiment on a robot whose joints are not the planner's model.

    Step tests of each joint are recorded by its sensor, a model is identified from them, the walk
    is planned on the models by every method, and the robot executes every plan.

    Args:
        segments: Lines of each approximation.
        cycles: Cycles of each walk, once it is steady.
        seed: Of the robot's noise.
        constants: What the robot is made of; its own where not given.
        progress: Called with the name of each part before it begins.

    Raises:
        MissingExtra: MuJoCo is not installed.
        NoSteadyCycle: The robot does not settle into a cycle.
    """
    clock = Clock(progress)
    robot = VirtualRobot(constants=constants, seed=seed)
    walk = reference_walk()
    identifications = []
    for j, name in enumerate(walk.joint_names):
        clock.start("step_tests", f"the step tests of the {name}")
        logs = [record_step_test(robot, walk, j, amplitude) for amplitude in AMPLITUDES]
        clock.start("identification", f"the model of the {name}")
        identifications.append(_identified(logs, tick=robot.constants.request_period))
    clock.stop()
    planned = plan_walk([each.model for each in identifications], segments=segments, clock=clock)
    runs = {}
    for method, requests in planned_requests(planned).items():
        clock.start("execution", f"{cycles} cycles of the walk: {method.replace('_', ' ')}")
        runs[method] = execute(robot, requests, cycles=cycles)
    lead = best_lead(
        runs["direct"].sensed.mean(axis=0), lambda angles: foot_outcome(walk, angles).distance
    )
    runs["shift"] = execute(robot, np.roll(walk.desired, -lead, axis=0), cycles=cycles)
    clock.start("learning", f"{TRIALS} trials of learning")
    learning = learn(robot, planned.foot_plan)
    clock.stop()
    return VirtualOutcome(
        constants=robot.constants,
        seed=seed,
        identifications=tuple(identifications),
        planned=planned,
        runs={method: runs[method] for method in planned.foot},
        learning=learning,
        shift_samples=lead,
        seconds=clock.seconds,
    )


def record_step_test(robot: VirtualRobot, walk: ReferenceWalk, joint: int, amplitude: float) -> Log:
    """The sensor's log of a step test around the middle of the joint's range in the walk.

    That is Equation 1, shifted to where the joint will work; the other joints rest in the middle
    of theirs.

    Args:
        robot: The robot.
        walk: The walk that the joints are tested for.
        joint: Which of them.
        amplitude: Height of the step [degrees].
    """
    middle = (walk.desired.min(axis=0) + walk.desired.max(axis=0)) / 2.0
    height = np.radians(amplitude)
    cycles = np.tile(step_test(float(height)), STEP_CYCLES)
    requests = np.tile(middle, (REST_REQUESTS + len(cycles), 1))
    requests[:, joint] += np.concatenate([np.zeros(REST_REQUESTS), cycles]) - height / 2.0
    robot.rest(SETTLING, requests[0])
    recording = robot.play(requests)
    return Log(
        times=robot.constants.request_period * np.arange(len(requests), dtype=np.float64),
        requests=recording.requests[:, joint],
        angles=recording.sensed[:, joint],
        name=f"step test of {amplitude:g} degrees",
        joint=walk.joint_names[joint],
    )


def _identified(logs: list[Log], *, tick: float) -> Identification:
    """The identification, its tick free of the rounding of the log's clock."""
    found = identify(logs, tick=tick)
    return replace(found, model=replace(found.model, tick=tick))


def planned_requests(planned: PlannedWalk) -> dict[str, Array]:
    """What is sent to the robot, by method [rad], (n, k); the time shift is found on the robot."""
    joints = planned.joints

    def columns(plans: list[Inversion]) -> Array:
        return np.column_stack([plan.requests for plan in plans])

    return {
        "direct": planned.walk.desired,
        "closed_form_plain": columns([joint.closed_form_plain for joint in joints]),
        "closed_form": columns([joint.closed_form for joint in joints]),
        "optimal": columns([joint.optimal for joint in joints]),
        "foot_optimal": planned.foot_plan.requests,
    }


def learn(robot: VirtualRobot, plan: FootInversion, *, trials: int = TRIALS) -> LearningRun:
    """Execute a plan, refine it by what the sensors said, and so on.

    The models are those of the step tests throughout: they are identified already.
    """
    runs, plans = [], [plan]
    for _ in range(trials):
        runs.append(execute(robot, plans[-1].requests, cycles=MEASURED_CYCLES))
        plans.append(refine(plans[-1], runs[-1].sensed, reidentify=False))
    return LearningRun(tuple(runs), tuple(plans))


def execute(robot: VirtualRobot, requests: Array, *, cycles: int) -> Run:
    """Repeat a cycle of requests until it is steady, and then as often as asked.

    A walk is steady when the sensors repeat themselves from cycle to cycle.

    Raises:
        NoSteadyCycle: It still is not after many cycles.
    """
    robot.rest(SETTLING, requests[0])
    last, change = None, np.inf
    for dropped in range(1, MOST_DROPPED + 1):
        sensed = robot.play(requests).sensed
        if last is not None:
            change = max(
                angle_distance(now, before).rms
                for now, before in zip(sensed.T, last.T, strict=True)
            )
        if change <= STEADY * math.sqrt(2.0) * robot.constants.sensor_error:
            played = [robot.play(requests) for _ in range(cycles)]
            return Run(
                requests=requests,
                sensed=np.stack([each.sensed for each in played]),
                angles=np.stack([each.angles for each in played]),
                dropped=dropped,
            )
        last = sensed
    raise NoSteadyCycle(change, MOST_DROPPED)
