"""Requests while the robot moves: a receding horizon on the exact model, computed by ``tick``.

Where the path repeats, rows after the known ones are those of the cycle before.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from planner.arrays import (
    LARGEST,
    MOST_TURNS,
    TURN,
    Array,
    Summarised,
    Summary,
    as_count,
    as_reals,
    as_whole,
    check_choice,
    not_radians,
    shown,
    turns_words,
)
from planner.exceptions import Infeasible, InvalidInput, angle_text
from planner.model.evidence import warn_of_refused
from planner.model.joint import JointModel, acting_requests, checked_model
from planner.planning.task import joint_names, limits_of_each, steps_of_each

OnBad = Literal["hold", "raise"]

Status = Literal["planned", "unreachable", "held"]

STATUS: tuple[Status, ...] = ("planned", "held", "held", "unreachable", "planned")
"""Status of a joint with each of the faults of a tick."""

MOST_PREVIEW = 1000
"""Longest preview [rows]: the time of a tick grows with it."""


class Stream(Summarised):
    """Plans while the robot moves: each tick takes the next stretch of the path, returns requests.

    The joints are planned together, each by itself; they share one period. All memory is allocated
    here, and the work of a tick is bounded. Invalid arguments never stop the loop: the joints
    concerned hold their last request, and :attr:`status` and :attr:`problem` report it.

    Args:
        models: One joint, one model for each, or models by joint, as
            :func:`planner.read_models` returns them.
        preview: Rows of the desired path that are known at every tick: more than lag plus
            acceleration time. 200 ms suffice for paths that the joints can follow.
        limits: Smallest and largest request [rad], each a number or one for each joint.
        max_step: Largest change from one request to the next [rad], a number or one for each joint.
        cycle: Rows after which the desired path about repeats, such as a walk; None where it does
            not. The rows after the preview are then predicted from the cycle before, which joints
            at top speed need. The prediction ends 500 ms from now, and after three quarters of a
            cycle at most; with a preview of 500 ms there is none. The cycle may be up to a quarter
            shorter or longer, and change. The less of the preview the cycle before explains, and
            the worse earlier predictions were, the smaller is the weight of the prediction; before
            a whole cycle is known it is 0.
        on_bad: "hold", or "raise" to raise an error instead, before anything changes; the next step
            then has ``missed=1``.

    Attributes:
        models: The joints.
        names: Their names: the keys of ``models``, or joint_1 and so on.
        period: Time between two ticks [s].
        preview: Rows of the desired path that are used.
        cycle: Rows after which it about repeats, or None.

    Warns:
        UserWarning: A model is not to be planned with, by its ``evidence``; or the preview is no
            longer than the lag and acceleration time of a joint.

    Raises:
        InvalidInput: A model, ``preview``, ``limits``, ``max_step``, ``cycle`` or ``on_bad`` is
            invalid, or the models have different periods.
        Infeasible: A lower limit is above the upper one.

    Example:
        >>> import numpy as np
        >>> from planner import JointModel, simulate
        >>> joint = JointModel.ers210a()
        >>> path = 0.3 - 0.3 * np.cos(2 * np.pi * np.arange(200) / 100)[:, np.newaxis]  # [rad]
        >>> stream = Stream(joint, preview=25, limits=(-1.0, 1.0), max_step=0.2)
        >>> sent = [stream.step(path[k : k + 25])[0] for k in range(len(path))]
        >>> angles = simulate(joint, sent, cyclic=False)
        >>> bool(np.sqrt(np.mean((angles - path[:, 0]) ** 2)) < 0.01)
        True
        >>> stream.status
        ('planned',)
    """

    def __init__(
        self,
        models: JointModel | Sequence[JointModel] | Mapping[str, JointModel],
        *,
        preview: int,
        limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        max_step: npt.ArrayLike | None = None,
        cycle: int | None = None,
        on_bad: OnBad = "hold",
    ) -> None:
        self.names, self.models = _models_by_name(models)
        evidence = [model.evidence for model in self.models]
        warn_of_refused(dict(zip(self.names, evidence, strict=True)))
        self.period = self.models[0].period
        usual = max(round(0.2 / self.period), 1)
        expected = f"a number of rows from 1 to {MOST_PREVIEW}; 200 ms are {usual} rows of "
        expected += f"{1e3 * self.period:g} ms"
        self.preview = as_count("preview", preview, expected, most=MOST_PREVIEW)
        times = [model.lag + model.acceleration_time for model in self.models]
        longest = int(np.argmax(times))
        if self.preview <= (needed := times[longest] / self.period):
            warnings.warn(
                f"preview: got {self.preview} rows, but lag and acceleration time of "
                f"{self.names[longest]} take {needed:.3g} rows of {1e3 * self.period:g} ms: the "
                "errors may be several times as large; expected more rows, 200 ms are "
                f"{usual}",
                UserWarning,
                stacklevel=2,
            )
        expected = "the number of rows after which the path repeats, from 2 to"
        self.cycle = cycle
        if cycle is not None:
            expected += f" {MOST_PREVIEW}, or None"
            self.cycle = as_count("cycle", cycle, expected, least=2, most=MOST_PREVIEW)
        check_choice("on_bad", on_bad, get_args(OnBad))
        self._raises = on_bad == "raise"
        self._limits = limits_of_each(limits, self.names)
        self._max_step = steps_of_each(max_step, self.names)
        self.reset()
        self._plan(0)  # loads or compiles the functions of a tick, so that the first is as fast
        self.reset()

    def _summarised(self) -> Summary:
        """What it plans, and how the joints are."""
        count = len(self.names)
        return Summary(
            f"Stream of {count} joint{'s' * (count > 1)}, {self.preview} rows of preview, "
            f"one every {1e3 * self.period:.4g} ms",
            ("", "status"),
            [*zip(self.names, self.status, strict=True)],
        )

    def __copy__(self) -> Stream:
        """A stream that goes on alike, and on its own."""
        return copy.deepcopy(self)

    def reset(self) -> None:
        """Return to the initial state: the next step is a first one, with the joints at rest."""
        from planner.planning import tick
        from planner.planning.repeating_path import repeating_path

        models, count, preview = self.models, len(self.models), self.preview
        acting = acting_requests(*models)
        # Over the benchmark's walks errors are 1.4 % above those of whole plans, with half of this
        # horizon 4.1 %, with twice of it 2.2 %; over walks whose speed changes 6.0, 12.0, 7.3 %.
        ahead = 0 if self.cycle is None else round(0.5 / self.period) - preview
        self._path = repeating_path(count, preview, self.cycle or 2, ahead=ahead)
        samples = max(preview + self._path.ahead - acting.youngest, acting.width)
        joints = np.zeros(count, dtype=tick.JOINT)
        for name in ("compliance", "theta_0", "dead_band", "hold"):
            joints[name] = [getattr(model.steady, name) for model in models]
        ticks = np.array([model.tick for model in models])
        joints["faster"] = ticks * [model.v_offset for model in models]
        joints["faster_by_load"] = ticks * [model.speed_per_torque for model in models]
        joints["steady_by_load"] = ticks * [model.top_speed_per_torque for model in models]
        joints["v_max"] = [model.v_max_per_tick for model in models]
        joints["travel"] = [model.v_max * model.period for model in models]
        joints["lower"], joints["upper"], joints["max_step"] = *self._limits, self._max_step
        # To turn back, requests jump by two dead bands. With a fifth of this share they travel ten
        # times as far along a held angle with noise.
        joints["smoothing"] = 1e-3 + 0.03 * joints["dead_band"] / joints["theta_0"]
        effects = np.array([model.switching_time for model in models]) / self.period
        joints["effect"] = effects - acting.youngest
        # On servos that are not the model a shorter time constant of the correction lowers the
        # error, but at 20 ms requests begin to oscillate.
        joints["observer"] = 1.0 - math.exp(-self.period / 0.07)
        states = np.zeros(count, dtype=tick.STATE)
        states["angle"] = states["read"] = states["believed"] = math.nan
        states["damping"] = 3e-4
        self._data = tick.Data(
            joints=joints,
            laws=np.array([model.law for model in models]),
            states=states,
            weights=acting.weights,
            radii=np.geomspace(0.02, 0.5, samples),
            sent=np.zeros((count, acting.oldest)),
            plan=np.zeros((count, samples)),
            desired=np.zeros((preview, count)),
            load=np.zeros((preview, count)),
        )
        self._all_planned: tuple[Status, ...] = tuple("planned" for _ in models)
        self._status, self._problem = self._all_planned, ""

    @property
    def status(self) -> tuple[Status, ...]:
        """Of each joint at the last tick: "planned", "unreachable" or "held".

        "unreachable": a desired angle of the stretch is one where the limits do not let the joint
        rest; the plan comes as close as they allow. "held": the last request was repeated, because
        the desired angles or the load could not be used.
        """
        return self._status

    @property
    def problem(self) -> str:
        """The problem at the last tick, on one line; empty for none.

        A measured angle that no joint can have reached counts as missing, and is reported here; an
        angle off by whole turns counts without them, as of an encoder that starts again.
        """
        return self._problem

    @property
    def angles(self) -> Array:
        """Angles of the joints at the last tick, predicted and corrected [rad], shape (k,).

        NaN before the first tick.
        """
        return np.array(self._data.states["angle"])

    def step(
        self,
        desired: npt.ArrayLike,
        measured: npt.ArrayLike | None = None,
        *,
        load: npt.ArrayLike | None = None,
        missed: int = 0,
    ) -> Array:
        """The requests to send now.

        The first one holds the joints where they are: at the measured angles, else at row 0.

        Args:
            desired: The next stretch of the desired path [rad], shape (preview, k), or (preview,)
                for one joint. Row 0 is for now, when the requests are sent; row j, for j periods
                later. Of a shorter stretch the last row is held; rows beyond the
                preview have no effect.
            measured: Measured angles [rad], shape (k,), NaN where there is none, at the time of
                this tick: read right before the requests are sent, in the order of the log from
                which the model was identified. Omit angles older than a period.
            load: Torque on the joints [N m]: a number, shape (k,), or rows like those of
                ``desired``, row 0 for now; between two rows their mean acts.
            missed: Ticks without a step since the last one: the robot held its requests.

        Returns:
            Requests [rad], shape (k,), read-only: always within the limits, and within
            ``max_step`` of the last ones. NaN, not to be sent, only where the first step has
            neither measured nor desired angles to begin with.

        Raises:
            InvalidInput, Infeasible: With ``on_bad="raise"``: an invalid argument, or a desired
                angle beyond the limits.
        """
        problems = self._take(desired, measured, load)
        periods = as_whole(missed)
        if periods is None or periods < 0:
            problems.append(f"missed: got {shown(missed)}, expected a number of ticks")
            periods = 0
        if self._raises and problems:
            raise InvalidInput(problems[0])
        planned = self._plan(periods)
        states = self._data.states
        faults: list[int] = states["fault"].tolist()
        error = self._error(faults) if any(faults) else None
        if self._raises and error and not planned:
            raise error
        self._problem = problems[0] if problems else str(error or "")
        self._status = self._all_planned
        if error or not planned:
            self._status = tuple(STATUS[fault] if planned else "held" for fault in faults)
        requests = np.array(states["request"])
        requests.setflags(write=False)
        return requests

    def _plan(self, missed: int) -> bool:
        """Whether the tick has planned; it has not where arguments are invalid."""
        from planner.planning.tick import tick

        return tick(self._data, self._path, min(missed, 10_000), self._raises)

    def _take(self, desired: Any, measured: Any, load: Any) -> list[str]:
        """Lay the arguments of a step out for the tick; return their problems."""
        data, states, problems = self._data, self._data.states, list[str]()
        preview, joints = data.desired.shape
        if not _fill(data.desired, desired):
            problems.append(
                f"desired: got {shown(desired)}, expected angles [rad] of shape "
                f"({preview}, {joints})"
            )
        data.load[:] = 0.0
        felt = load is not None and any(model.feels_load for model in self.models)
        if felt and not _fill(data.load, load, constant=True):
            problems.append(f"load: got {shown(load)}, expected torques [N m], {joints} or rows")
        states["measured"] = math.nan
        if measured is not None:
            try:
                states["measured"] = as_reals(measured).reshape(joints)
            except (TypeError, ValueError, OverflowError):
                problems.append(
                    f"measured: got {shown(measured)}, expected {joints} angles [rad], or NaN"
                )
        return problems + self._degrees()

    def _degrees(self) -> list[str]:
        """Mark first measured angles, and desired ones, in degrees as missing; their problems."""
        states, rows, problems = self._data.states, self._data.desired, list[str]()
        measured, begins, first = states["measured"], rows[0], np.isnan(states["angle"])
        here = np.nan_to_num(np.where(first, measured, states["angle"]))
        if not (np.abs(rows - here) > MOST_TURNS * TURN).any():
            return []
        far = first & (np.abs(measured - begins) > MOST_TURNS * TURN)
        for j in np.flatnonzero(far & (np.abs(measured) > np.abs(begins))).tolist():
            problems.append(
                f"measured: {self.names[j]} {turns_words(measured[j])}, where it should be at "
                f"{begins[j]:.3g} rad; if these are degrees, convert them with numpy.radians"
            )
            measured[j], here[j] = math.nan, 0.0
        for j, name in enumerate(self.names):
            way = np.append(0.0, rows[:, j] - here[j])  # including the first move
            if np.all(np.abs(rows[:, j]) <= LARGEST) and not_radians(way):
                k = int(np.argmax(np.abs(way[1:])))
                problems.append(
                    f"desired: {name} {turns_words(rows[k, j])}, where it is at {here[j]:.3g} rad; "
                    "if these are degrees, convert them with numpy.radians"
                )
                rows[:, j] = math.nan
        return problems

    def _error(self, faults: Sequence[int]) -> InvalidInput:
        """The problem of a joint's arguments; a desired angle comes before a measured one."""
        from planner.planning import tick

        fault = min(each for each in faults if each)
        amounts = np.where(np.equal(faults, fault), self._data.states["amount"], -1.0)
        j = int(np.argmax(amounts))
        name, amount = self.names[j], angle_text(float(amounts[j]))
        before = 1e3 * self.period * self._data.states["unread"][j]
        words = {
            tick.NOT_FINITE: f"desired: {name} has angles that are not finite",
            tick.BLOCKED: f"load: {name} cannot move against it; is it in N m?",
            tick.BEYOND: f"desired: {name} should go {amount} beyond the angles where the limits "
            "on its requests let it rest",
            tick.JUMPED: f"measured: {name} is {amount} from where it was {before:.3g} ms before, "
            "which no joint can be: taken as missing",
        }
        return (Infeasible if fault == tick.BEYOND else InvalidInput)(words[fault])


def _fill(rows: Array, values: Any, *, constant: bool = False) -> bool:
    """Lay values of every joint out over the preview, the last row held; NaN where invalid.

    With ``constant`` a number, or one for each joint, holds for all rows.
    """
    rows[:] = math.nan
    count = rows.shape[1]
    try:
        array: Any = np.asarray(values)
    except (ValueError, OverflowError):  # such as rows of different lengths
        return False
    if array.dtype.kind not in "iuf" or array.size == 0:
        return False
    if constant and array.shape in ((), (count,)):
        rows[:] = array
        return True
    if array.ndim == 1 and count == 1:
        array = array[:, np.newaxis]
    if array.ndim != 2 or array.shape[1] != count:
        return False
    end = min(len(array), len(rows))
    rows[:end] = array[:end]
    rows[end:] = rows[end - 1]
    return True


def _models_by_name(
    models: JointModel | Sequence[JointModel] | Mapping[str, JointModel],
) -> tuple[tuple[str, ...], tuple[JointModel, ...]]:
    """Names and models of the joints."""
    each: Any = [models] if isinstance(models, JointModel) else models
    if isinstance(models, Mapping):
        each = [model for name, model in models.items() if name]
    try:
        joints = tuple(map(checked_model, each))
    except TypeError:  # not several
        joints = ()
    if not joints:
        raise InvalidInput(
            f"models: got {shown(models)}, expected a JointModel, several, or a dict by joint"
        )
    periods = [model.period for model in joints]
    if max(periods) > 1.001 * min(periods):  # logs of one robot differ a little
        raise InvalidInput(
            f"models: their periods are from {min(periods):g} to {max(periods):g} s, expected one "
            "period: JointModel.requested_every gives a model another one"
        )
    return joint_names(None, models, len(joints)), joints
