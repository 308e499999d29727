"""Processor steps: one plans a policy's chunks of actions, one before the policy sees the arm."""

from __future__ import annotations

import copy
import math
import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from lerobot.processor.pipeline import (
    ObservationProcessorStep,
    PolicyActionProcessorStep,
    ProcessorStepRegistry,
)

import planner
from lerobot_robot_planned.arm_stream import UNITS, Array, models_of_arm

CLOCK = time.perf_counter

SEEN: dict[str, tuple[float, Array]] = {}
"""When the state of each arm was seen, and the state, in LeRobot's units."""


@ProcessorStepRegistry.register("request_planner_arm_state")
@dataclass
class ArmState(ObservationProcessorStep):
    """Keeps the arm's state for :class:`PlanChunk`: the first step of ``policy_preprocessor.json``.

    Attributes:
        arm: Any name; the same in both steps.
    """

    arm: str = "arm"

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The observation as it is."""
        state = observation.get("observation.state")
        if state is not None:
            SEEN[self.arm] = CLOCK(), np.asarray(state.detach().cpu(), dtype=float).reshape(-1)
        return observation

    def get_config(self) -> dict[str, Any]:
        """What is written to the file."""
        return {"arm": self.arm}

    def transform_features(self, features: Any) -> Any:
        """The features as they are."""
        return features


@ProcessorStepRegistry.register("request_planner_plan_chunk")
@dataclass
class PlanChunk(PolicyActionProcessorStep):
    """Plans a policy's chunk, (1, T, joints) in the robot's units: the last step after the policy.

    A chunk begins where the last one has brought the arm: its path leads from that one's into its
    own within ``blend``, and its goal positions are planned from the predicted, or seen, state of
    the arm. Single actions, which engines without real-time chunking hand over, stay as they are;
    for these there is the robot ``planned_so101_follower``.

    Attributes:
        models: Model file of the joints.
        joints: The names of the joints, in the order of the actions.
        units: The unit of each joint: "degrees", "range_0_100" or "range_m100_100".
        rate: Actions a second [Hz].
        blend: Time in which the path of a chunk leads from the last one's into its own [s].
        delay: How far ahead each goal position is planned [s].
        arm: The name of the arm in :class:`ArmState`.
    """

    models: str = ""
    joints: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    rate: float = 30.0
    blend: float = 0.2
    delay: float = 0.25
    arm: str = "arm"

    def __post_init__(self) -> None:
        if len(self.units) != len(self.joints) or not self.joints:
            raise ValueError(
                f"units: got {len(self.units)}, expected one for each of the "
                f"{len(self.joints)} joints"
            )
        units = dict(zip(self.joints, self.units, strict=True))
        models = models_of_arm(self.models, self.joints, units, self.rate)
        self._columns = [self.joints.index(joint) for joint in models]
        self._scale = np.array([UNITS[unit] for unit in self.units])
        self._rows = max(round(self.delay * self.rate), 2)
        self._stream = planner.Stream(models, preview=self._rows)
        self._begin = self._stream  # as it was where a chunk began
        acts = max(model.lag + model.acceleration_time / 2.0 for model in models.values())
        self._under_way = math.ceil(
            (acts + max(m.time_constant for m in models.values())) * self.rate
        )
        self.reset()

    def reset(self) -> None:
        """Forget the last chunk: an episode begins."""
        self._last: tuple[float, Array] | None = None

    def action(self, action: torch.Tensor) -> torch.Tensor:
        """The chunk's goal positions, of the same shape and type."""
        if action.ndim != 3 or action.shape[0] != 1 or action.shape[2] != len(self.joints):
            if action.ndim == 3:
                raise ValueError(
                    f"chunk: got shape {tuple(action.shape)}, expected (1, T, {len(self.joints)})"
                )
            warnings.warn("PlanChunk: single actions are not planned", stacklevel=2)
            return action
        chunk = np.asarray(action[0].detach().cpu(), dtype=float)
        chunk = self._scale[:, 0] * chunk + self._scale[:, 1]
        goals = (self._planned(chunk) - self._scale[:, 1]) / self._scale[:, 0]
        return torch.as_tensor(goals[np.newaxis], dtype=action.dtype, device=action.device)

    def _planned(self, chunk: Array) -> Array:
        """Requests for a chunk that begins when the arm was last seen, else now, (T, joints)."""
        now = CLOCK()
        begin, state = SEEN.get(self.arm, (now, None))
        if now - begin > 1.0:
            begin, state = now, None
        path, stream = chunk, self._stream
        if self._last is not None and begin - self._last[0] < len(self._last[1]) / self.rate:
            ago = max(round((begin - self._last[0]) * self.rate), 0)
            last = self._last[1]
            stream = self._stream = copy.copy(self._begin)
            for row in range(ago):
                stream.step(self._ahead(last, row))
            late = round((now - begin) * self.rate)  # sent before these requests are known
            path = self._led_over(last[min(ago, len(last) - 1) :], chunk, late)
        else:
            stream.reset()
        self._last = begin, path
        self._begin = copy.copy(stream)
        requests = path.copy()
        for row in range(len(path)):
            seen = None
            if row == 0 and state is not None:
                seen = (self._scale[:, 0] * state + self._scale[:, 1])[self._columns]
            requests[row, self._columns] = stream.step(self._ahead(path, row), seen)
        return requests

    def _ahead(self, path: Array, row: int) -> Array:
        return path[row : row + self._rows][:, self._columns]

    def _led_over(self, last: Array, chunk: Array, late: int) -> Array:
        """The chunk's path, beginning on the last one's, (T, joints).

        What is under way is not changed: goal positions that are sent before the new ones are
        known, and the motion that those before it have begun.
        """
        rows = np.arange(len(chunk)) - late - self._under_way
        share = np.clip(rows / max(self.blend * self.rate, 1.0), 0.0, 1.0)
        share = share**2 * (3.0 - 2.0 * share)
        before = last[np.minimum(np.arange(len(chunk)), len(last) - 1)]
        return before + share[:, np.newaxis] * (chunk - before)

    def get_config(self) -> dict[str, Any]:
        """What is written to the file."""
        names = ("models", "joints", "units", "rate", "blend", "delay", "arm")
        return {name: getattr(self, name) for name in names}

    def transform_features(self, features: Any) -> Any:
        """The features as they are."""
        return features
