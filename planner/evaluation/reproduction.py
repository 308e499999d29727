"""The paper's experiment, end to end: the walk, the baselines, the plans, every distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from planner.evaluation.clock import Clock
from planner.evaluation.outcome import PlannedWalk, Reproduction
from planner.evaluation.paper import JOINTS, SEGMENTS, STEP_AMPLITUDES
from planner.evaluation.planned_walk import plan_walk
from planner.evaluation.step_response import measure_step_response
from planner.model.joint import JointModel


def reproduce(
    model: JointModel | None = None,
    *,
    segments: int = SEGMENTS,
    progress: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Run the paper's experiment on its own model.

    Args:
        model: The model of every joint; Table 1 where not given.
        segments: Lines of each approximation.
        progress: Told what is being computed.
    """
    model = JointModel.ers210a() if model is None else model
    clock = Clock(progress)
    planned = plan_walk((model,) * len(JOINTS), segments=segments, clock=clock)
    clock.start("step_tests", "the step tests")
    steps = {
        amplitude: measure_step_response(model, float(np.radians(amplitude)))
        for amplitude in STEP_AMPLITUDES
    }
    clock.stop()
    return Reproduction(
        **{each.name: getattr(planned, each.name) for each in fields(PlannedWalk)},
        steps=steps,
        seconds=clock.seconds,
    )
