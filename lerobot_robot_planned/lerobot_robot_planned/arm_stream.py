"""Goal positions for the joints of an arm, from its actions: units, what is known ahead, a stream.

This module does not import LeRobot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

import planner

Array = npt.NDArray[np.float64]

Ahead = Literal["held back", "extrapolated"]
"""Where the stretch of the path that a plan needs comes from: from actions that are held back, or
from actions as they would go on."""

FADING = 0.1
"""Time constant with which the speed of extrapolated actions fades [s]."""

SPEED_FROM = 2
"""Periods over which that speed is taken: one is as noisy as the hand that teleoperates."""


class Unit(NamedTuple):
    """How a number of LeRobot becomes a model's angle: ``factor * number + shift``.

    Angles of a joint in degrees are in radians for its model; shares of its range, 0 to 1.
    """

    factor: float
    shift: float


UNITS: Mapping[str, Unit] = {
    "degrees": Unit(np.pi / 180.0, 0.0),
    "range_0_100": Unit(1e-2, 0.0),
    "range_m100_100": Unit(5e-3, 0.5),
}
"""LeRobot's units, named as its ``MotorNormMode`` names them."""


def models_of_arm(
    path: str, joints: Sequence[str], units: Mapping[str, str], rate: float
) -> dict[str, planner.JointModel]:
    """The models of an arm's joints, with a request every ``1 / rate`` s, of those that have one.

    Args:
        path: A model file, as ``request-planner identify`` and ``calibrate`` write it.
        joints: The names of the joints in LeRobot.
        units: The unit of each.
        rate: Actions a second [Hz].

    Raises:
        ValueError: No joint has a model, or a unit is unknown.
        planner.InvalidInput: The file cannot be read, or a model does not allow this rate.
    """
    for joint in joints:
        if units[joint] not in UNITS:
            raise ValueError(
                f"unit of {joint}: got {units[joint]!r}, expected one of {', '.join(UNITS)}"
            )
    known = planner.read_models(path)
    default = known.get("")
    found = {joint: known.get(joint, default) for joint in joints}
    models = {joint: model for joint, model in found.items() if model is not None}
    if not models:
        named = ", ".join(name for name in known if name)
        raise ValueError(
            f"{path}: has models of {named}, of none of the arm's joints {', '.join(joints)}; "
            "name the joints as LeRobot does"
        )
    return {joint: model.requested_every(1.0 / rate) for joint, model in models.items()}


class ArmStream:
    """Goal positions for actions, one call each period.

    Joints without a model get their actions as they are, as late as the others.

    Args:
        models: The models of the joints, with a request each period.
        units: The unit of each of the arm's joints, by name; all joints of the arm, in order.
        delay: How much of the path a plan looks ahead [s]: held back actions come so much later.
        ahead: "held back", or "extrapolated": no delay, and less accurate where actions turn.
        limits: Least and greatest goal position of joints, in LeRobot's units.
        max_step: Largest change of a goal position in a period, in LeRobot's units.
    """

    def __init__(
        self,
        models: Mapping[str, planner.JointModel],
        units: Mapping[str, str],
        *,
        delay: float = 0.2,
        ahead: Ahead = "held back",
        limits: Mapping[str, tuple[float, float]] | None = None,
        max_step: Mapping[str, float] | None = None,
    ) -> None:
        if ahead not in get_args(Ahead):
            raise ValueError(f"ahead: got {ahead!r}, expected 'held back' or 'extrapolated'")
        if not 0.0 < delay <= 2.0:
            raise ValueError(f"delay: got {delay!r}, expected more than 0 s and at most 2 s")
        self.joints = tuple(units)
        self.planned = tuple(joint for joint in units if joint in models)
        self.ahead = ahead
        self.period = models[self.planned[0]].period
        self.rows = max(round(delay / self.period), 1) + 1
        self._scale = np.array([UNITS[units[joint]] for joint in self.joints])
        self._columns = [self.joints.index(joint) for joint in self.planned]
        lower, upper = np.full(len(self.planned), -np.inf), np.full(len(self.planned), np.inf)
        steps = np.full(len(self.planned), np.inf)
        for j, joint in enumerate(self.planned):
            unit = UNITS[units[joint]]
            if limits and joint in limits:
                lower[j], upper[j] = (unit.factor * end + unit.shift for end in limits[joint])
            if max_step and joint in max_step:
                steps[j] = unit.factor * max_step[joint]
        self.stream = planner.Stream(
            {joint: models[joint] for joint in self.planned},
            preview=self.rows,
            limits=(lower, upper) if np.isfinite([lower, upper]).any() else None,
            max_step=None if np.isinf(steps).all() else steps,
        )
        self._actions: deque[Array] = deque(maxlen=self.rows)

    def reset(self) -> None:
        """Forget the actions: the next one is a first one."""
        self.stream.reset()
        self._actions.clear()

    def step(
        self,
        action: Mapping[str, float],
        measured: Mapping[str, float] | None = None,
        *,
        missed: int = 0,
    ) -> dict[str, float]:
        """The goal positions to send now, of the joints that the action has, in LeRobot's units.

        Args:
            action: The desired positions. A joint that is not in it stays at its last one.
            measured: The positions that were just read.
            missed: Periods without a call since the last one.
        """
        row = self._row(action)
        if not self._actions:
            self._actions.extend([row] * self.rows)
        last = self._actions[-1]
        for k in range(1, missed + 2):  # a straight line through the periods that were missed
            self._actions.append(last + (row - last) * k / (missed + 1))
        path = self._path()
        read = None
        if measured is not None:
            read = self._in_model_units(measured, np.full(len(self.joints), np.nan))[self._columns]
        requests = path[0].copy()
        planned = self.stream.step(path[:, self._columns], read, missed=missed)
        known = np.isfinite(planned)
        requests[np.array(self._columns)[known]] = planned[known]
        goals = (requests - self._scale[:, 1]) / self._scale[:, 0]
        return {joint: float(goals[j]) for j, joint in enumerate(self.joints) if joint in action}

    def _row(self, action: Mapping[str, float]) -> Array:
        if not self._actions:
            absent = [joint for joint in self.joints if joint not in action]
            if absent:
                raise ValueError(f"action: the first one lacks {', '.join(absent)}")
        elif not any(joint in action for joint in self.joints):
            raise ValueError(f"action: got none of the joints {', '.join(self.joints)}")
        return self._in_model_units(action, self._actions[-1] if self._actions else None)

    def _in_model_units(self, numbers: Mapping[str, float], otherwise: Array | None) -> Array:
        row = np.empty(len(self.joints)) if otherwise is None else otherwise.copy()
        for j, joint in enumerate(self.joints):
            if joint in numbers:
                row[j] = self._scale[j, 0] * float(numbers[joint]) + self._scale[j, 1]
        return row

    def _path(self) -> Array:
        """Desired positions from now on, (rows, joints)."""
        actions = np.array(self._actions)
        if self.ahead == "held back":
            return actions
        span = min(SPEED_FROM, self.rows - 1)
        speed = (actions[-1] - actions[-1 - span]) / span  # in a period
        fading = FADING / self.period
        far = fading * -np.expm1(-np.arange(self.rows) / fading)
        return np.asarray(actions[-1] + far[:, np.newaxis] * speed)
