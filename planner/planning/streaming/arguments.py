"""Arguments of a stream: checked loudly where it is made, and without errors at every tick."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from planner.exceptions import Infeasible, InvalidInput, angle_text
from planner.model.joint import JointModel, checked_model
from planner.planning.arguments import NEGLIGIBLE_SAG, ON_THE_LIMIT
from planner.trajectory import (
    LARGEST,
    MOST_TURNS,
    TURN,
    Array,
    Mask,
    not_radians,
    turns_words,
)
from planner.validation import as_reals, as_whole, shown

MOST_PREVIEW = 1000
"""Longest preview [rows]: the time of a tick grows with it."""

SAME_PERIOD = 1e-3
"""Relative difference of two periods that are one: logs of one robot differ by so much."""


class StepInput(NamedTuple):
    """What a step was given, as far as it can be used."""

    rows: Array  # desired angles [rad], (k, preview)
    torques: Array  # [N m], (k, preview)
    sags: Array  # where the joints rest beside their requests [rad], (k, preview)
    measured: Array  # [rad], (k,), NaN where there is none
    missed: int
    bad: Mask  # joints whose desired angles or load cannot be used, (k,)
    beyond: Mask  # joints with a desired angle where no request within the limits lets them rest
    error: InvalidInput | None  # what is wrong with the first that cannot be used


class StepArguments:
    """The arguments of every step: what can be used of them, and what is wrong with the rest."""

    def __init__(
        self,
        names: Sequence[str],
        models: Sequence[JointModel],
        preview: int,
        limits: tuple[Array, Array],
    ) -> None:
        """Take the joints, the rows of a stretch, and the limits on the requests [rad], (k,)."""
        self._names, self._joints, self._preview = names, len(models), preview
        self._feels_load = any(model.feels_load for model in models)
        speeds = [(model.v_max, model.v_offset, model.speed_per_torque) for model in models]
        self._v_max, self._v_offset, self._per_torque = np.array(speeds).T[:, :, np.newaxis]
        rests = [(model.offset, model.compliance, model.dead_band) for model in models]
        self._offset, self._compliance, self._band = np.array(rests).T[:, :, np.newaxis]
        self._lower, self._upper = (limit[:, np.newaxis] for limit in limits)

    def checked(
        self, desired: Any, measured: Any, load: Any, missed: Any, *, near: Array | None
    ) -> StepInput:
        """What can be used of a step's arguments, and what is wrong with the first that cannot.

        ``near`` is where the joints are [rad], shape (k,); None at the first step.
        """
        joints = self._joints
        problems: list[str] = []
        rows = self._stretch(desired)
        if rows is None:
            problems.append(
                f"desired: got {shown(desired)}, expected angles [rad] of shape "
                f"({self._preview}, {joints})"
            )
            rows = np.full((joints, self._preview), math.nan)
        bad: Mask = np.asarray(~(np.abs(rows) <= LARGEST).all(axis=1))
        rows[bad] = math.nan
        if bad.any() and not problems:
            problems.append(
                f"desired: {self._names[int(np.argmax(bad))]} has angles that are not finite"
            )
        torques = np.zeros((joints, self._preview))
        if load is not None and self._feels_load:
            torques, blocked = self._torques(load, problems)
            bad |= blocked
        angles = np.full(joints, math.nan)
        if measured is not None:
            try:
                angles[:] = as_reals(measured)
            except (TypeError, ValueError, OverflowError):
                problems.append(
                    f"measured: got {shown(measured)}, expected {joints} angles [rad], or NaN"
                )
            angles[~(np.abs(angles) <= LARGEST)] = math.nan
        here = np.where(np.isnan(angles), 0.0, angles) if near is None else near
        away = rows - here[:, np.newaxis]
        for j in np.flatnonzero((np.abs(away) > MOST_TURNS * TURN).any(axis=1)).tolist():
            if not_radians(away[j]):
                k = int(np.argmax(np.abs(away[j])))
                problems.append(
                    f"desired: {self._names[j]} {turns_words(rows[j, k])}, where it is at "
                    f"{here[j]:.3g} rad; if these are degrees, convert them with numpy.radians"
                )
                bad[j], rows[j] = True, math.nan
        periods = as_whole(missed)
        if periods is None or periods < 0:
            problems.append(f"missed: got {shown(missed)}, expected a number of ticks")
            periods = 0
        sags = self._offset + self._compliance * torques
        room = self._band + ON_THE_LIMIT + np.minimum(np.abs(sags), NEGLIGIBLE_SAG)
        above, below = rows - sags - room - self._upper, self._lower - (rows - sags) - room
        far = np.maximum(above, below).max(axis=1)
        beyond: Mask = far > 0.0
        error = InvalidInput(problems[0]) if problems else None
        if beyond.any() and not error:
            worst = int(np.argmax(far))
            error = Infeasible(
                f"desired: {self._names[worst]} should go {angle_text(float(far[worst]))} "
                "beyond the angles where the limits on its requests let it rest"
            )
        return StepInput(rows, torques, sags, angles, periods, bad, beyond, error)

    def _torques(self, load: Any, problems: list[str]) -> tuple[Array, Mask]:
        """Torques [N m], shape (k, preview), and the joints that cannot move against theirs."""
        joints, given = self._joints, load
        try:
            if np.shape(load) in ((), (joints,)):  # that does not change
                given = np.broadcast_to(np.asarray(load), (1, joints))
        except (ValueError, OverflowError):
            given = None
        torques = self._stretch(given)
        if torques is None:
            problems.append(f"load: got {shown(load)}, expected torques [N m], {joints} or rows")
            return np.zeros((joints, self._preview)), np.ones(joints, dtype=np.bool_)
        fastest = self._v_max - np.abs(self._v_offset + self._per_torque * torques)
        blocked: Mask = np.min(fastest, axis=1) <= 0.0
        if blocked.any():
            name = self._names[int(np.argmax(blocked))]
            problems.append(f"load: {name} cannot move against it; is it in N m?")
            torques[blocked] = 0.0
        return torques, blocked

    def _stretch(self, values: Any) -> Array | None:
        """Values of every joint over the preview, (k, preview), the last row held; None if none."""
        joints = self._joints
        try:
            given: Any = np.asarray(values)
        except (ValueError, OverflowError):  # such as rows of different lengths
            return None
        if given.dtype.kind not in "iuf" or given.size == 0:
            return None
        if given.ndim == 1 and joints == 1:
            given = given[:, np.newaxis]
        if given.ndim != 2 or given.shape[1] != joints:
            return None
        rows = np.empty((joints, self._preview))
        count = min(len(given), self._preview)
        rows[:, :count] = given[:count].T
        rows[:, count:] = rows[:, count - 1 : count]
        return rows


def models_by_name(
    models: JointModel | Sequence[JointModel] | Mapping[str, JointModel],
) -> tuple[tuple[str, ...], tuple[JointModel, ...]]:
    """Names and models of the joints."""
    names: list[str] = []
    each: Any = models
    if isinstance(models, Mapping):
        names = [name for name in models if name]
        each = [models[name] for name in names]
    elif isinstance(models, JointModel):
        each = [models]
    try:
        count = len(each)
    except TypeError:
        count = 0
    if not count:
        raise InvalidInput(
            f"models: got {shown(models)}, expected a JointModel, several, or a dict by joint"
        )
    for each_model in each:
        checked_model(each_model)
    periods = [model.period for model in each]
    if max(periods) > (1.0 + SAME_PERIOD) * min(periods):
        raise InvalidInput(
            f"models: their periods are from {min(periods):g} to {max(periods):g} s, expected one "
            "period: JointModel.requested_every gives a model another one"
        )
    return tuple(names) or tuple(f"joint_{j + 1}" for j in range(count)), tuple(each)


def checked_preview(preview: object, period: float) -> int:
    """The rows of a stretch; the period [s] is for the message."""
    rows = as_whole(preview)
    if rows is None or not 1 <= rows <= MOST_PREVIEW:
        raise InvalidInput(
            f"preview: got {shown(preview)}, expected a number of rows from 1 to {MOST_PREVIEW}; "
            f"200 ms are {max(round(0.2 / period), 1)} rows of {1e3 * period:g} ms"
        )
    return rows


def warn_of_short_preview(preview: int, names: Sequence[str], models: Sequence[JointModel]) -> None:
    """Warn where a request acts on rows beyond the preview, so that it is planned for none."""
    times = [model.lag + model.acceleration_time for model in models]
    j = int(np.argmax(times))
    needed = times[j] / models[j].period
    if preview <= needed:
        warnings.warn(
            f"preview: got {preview} rows, but lag and acceleration time of {names[j]} take "
            f"{needed:.3g} rows of {1e3 * models[j].period:g} ms: the errors may be several times "
            f"as large; expected more rows, 200 ms are {max(round(0.2 / models[j].period), 1)}",
            UserWarning,
            stacklevel=3,
        )


def checked_cycle(cycle: object) -> int | None:
    """The rows after which a path repeats, or None."""
    rows = as_whole(cycle)
    if cycle is not None and (rows is None or not 2 <= rows <= MOST_PREVIEW):
        raise InvalidInput(
            f"cycle: got {shown(cycle)}, expected the number of rows after which the path repeats, "
            f"from 2 to {MOST_PREVIEW}, or None"
        )
    return rows
