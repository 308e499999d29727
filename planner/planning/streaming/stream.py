"""Requests while the robot moves: a receding horizon on the exact model.

At every tick the next stretch of the desired path is known, and so are the requests that were
already sent and still act. The plan of the tick before, shifted by one request, is improved by
damped Gauss-Newton steps of the optimised inversion, on the model with rounded corners; the exact
models, run, judge steps of several lengths, so a plan never becomes worse by a step. Then the first
request of the plan is sent (real-time iteration: M. Diehl, H. G. Bock, J. P. Schlöder, *A real-time
iteration scheme for nonlinear optimization in optimal feedback control*, SIAM J. Control Optim. 43,
2005).

Corners are rounded more the later a sample is: as time passes, each sample goes through what the
offline search goes through in stages, from wide corners to sharp ones.

What a joint at top speed should do now depends on the next half second of its path. Where the path
repeats, what follows the known stretch is taken from the cycle before (``repeating_path``).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, angle_text
from planner.model.evidence import warn_of_refused
from planner.model.joint import JointModel
from planner.model.sensitivity import request_ages_of_all
from planner.planning.arguments import checked_limits, range_of_each, steps_of_each
from planner.planning.closed_form import switching_time
from planner.planning.streaming.arguments import (
    StepArguments,
    StepInput,
    checked_cycle,
    checked_preview,
    models_by_name,
    warn_of_short_preview,
)
from planner.planning.streaming.repeating_path import RepeatingPath
from planner.planning.streaming.riccati_step import Plans, Runs, Terms
from planner.trajectory import TURN, Array, Indices, Mask
from planner.validation import is_one_of, shown

OnBad = Literal["hold", "raise"]

Status = Literal["planned", "unreachable", "held"]


@dataclass(frozen=True, kw_only=True)
class StreamOptions:
    """What steers the search and the observer.

    Attributes:
        near, far: Radius of the corners at the first and the last sample [theta_0].
        steps: Gauss-Newton steps of a joint at a tick, at most. With one, errors on recordings of
            an SO-101 are up to four times as large.
        first_steps: The same at the first tick, from requests that hold the desired angles.
        lengths: Shares of a step that are tried [-].
        smoothing: Weight of the squared changes of the requests, relative to that of the errors.
        crossing: What is added to it for each theta_0 of dead band: requests jump by two dead bands
            to turn back. With a fifth of it they travel ten times as far along a held angle with
            noise.
        resting: Weight of the squared distances from the requests that hold the desired angles: it
            brings saturated requests back.
        exceeding: Weight of the squares by which planned changes exceed ``max_step``; what is sent
            keeps it exactly.
        damping: Least and largest weight of the Levenberg-Marquardt term, relative to the errors.
        factor: By this the weight falls after a full step, and grows where no step is better.
        observer_time: Time constant with which the predicted angle approaches the measured one [s].
            On servos that are not the model a shorter one lowers the error, but at 0.02 the
            requests begin to oscillate.
        believed: Top speeds of the model at which a measured angle may have moved since the last
            one that counts ...
        noise: ... and how far beyond it may be [rad]. Half and twice change nothing where encoders
            are sound; a jump below it moves the requests by less than its size.
        most_missed: Missed ticks that are simulated; after more of them the requests before are
            taken to have been the last one.
        worth: Share of a joint's cost by which a step must lower it for another step to follow.
            Along walks it takes 1.2 steps a tick. With half of it they are 1.3 and the errors the
            same, with twice of it 1.15, and the errors are up to a third further from the least.
        horizon: Time ahead that is planned where the path repeats [s]. Over the benchmark's walks
            errors are 1.4 % above those of whole plans, with half of it 4.1 %, with twice of it
            2.2 %, and over those whose speed changes 6.0, 12.0, 7.3 %. Ticks take longer, too.
        varies: Share of a cycle by which the last one may have been shorter or longer [-]. Over
            walks whose speed changes errors are 6.0 % above those of whole plans, with half of it
            9.1 %, with twice of it 5.9 %.
    """

    near: float = 0.02
    far: float = 0.5
    steps: int = 2
    first_steps: int = 12
    lengths: tuple[float, ...] = (1.0, 0.4, 0.15)
    smoothing: float = 1e-3
    crossing: float = 0.03
    resting: float = 1e-7
    exceeding: float = 10.0
    damping: tuple[float, float] = (3e-4, 1.0)
    factor: float = 3.0
    observer_time: float = 0.07
    believed: float = 2.0
    noise: float = 0.1
    most_missed: int = 1000
    worth: float = 0.2
    horizon: float = 0.5
    varies: float = 0.25


OPTIONS = StreamOptions()


LEAST_COST = 1e-12
"""Cost below which nothing is left to gain [rad^2]."""


_STATE = (
    "_angles",
    "_speeds",
    "_sent",
    "_read",
    "_believed",
    "_unread",
    "_plan",
    "_damping",
    "_status",
    "_problem",
)
"""What of a stream changes from tick to tick."""


class Stream:
    """Plans while the robot moves: each tick takes the next stretch of the path, gives requests.

    The joints are planned together, each by itself; they share one period. All memory is allocated
    here, and the work of a tick is bounded. What cannot be used never stops the loop:
    the joints concerned hold their last request, and :attr:`status` and :attr:`problem` say so.

    Args:
        models: One joint, one model for each, or models by joint, as
            :func:`planner.read_models` returns them.
        preview: Rows of the desired path that are known at every tick: more than lag and
            acceleration time take. 200 ms suffice for paths that the joints can follow.
        limits: Smallest and largest request [rad], each a number or one for each joint.
        max_step: Largest change from one request to the next [rad], a number or one for each joint.
        cycle: Rows after which the desired path about repeats, such as a walk; None where it does
            not. What follows the preview is then expected to be what followed a cycle before:
            joints that are kept at top speed need to know. It is expected until 500 ms from now,
            but over three quarters of a cycle at most; a preview of 500 ms leaves nothing to
            expect. The cycle may be up to a quarter shorter or longer, and change. The less of the
            preview the cycle before explains, and the worse earlier expectations were, the less it
            counts; before a whole cycle is known, it does not count.
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
            none, or the models have different periods.
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
        self.names, self.models = models_by_name(models)
        known = [model.evidence for model in self.models]
        warn_of_refused(dict(zip(self.names, known, strict=True)))
        self.period = self.models[0].period
        self.preview = checked_preview(preview, self.period)
        warn_of_short_preview(self.preview, self.names, self.models)
        self.cycle = checked_cycle(cycle)
        if not is_one_of(on_bad, get_args(OnBad)):
            raise InvalidInput(f"on_bad: got {shown(on_bad)}, expected 'hold' or 'raise'")
        self._raises = on_bad == "raise"
        joints = len(self.models)
        pair = (-math.inf, math.inf) if limits is None else limits
        self._lower, self._upper = range_of_each(pair, joints, joints="joints")
        for name, low, high in zip(self.names, self._lower, self._upper, strict=True):
            checked_limits((low, high), of=f"limits of {name}")
        self._step = steps_of_each(max_step, joints, joints="joints")
        limited = self._lower, self._upper
        self._arguments = StepArguments(self.names, self.models, self.preview, limited)
        self._lay_out()
        self.reset()

    def _lay_out(self) -> None:
        """Allocate and compute what every tick uses."""
        models, joints, preview = self.models, len(self.models), self.preview
        ages = request_ages_of_all(models)
        self._repeating, rows = None, preview
        ahead = round(OPTIONS.horizon / self.period) - preview
        if self.cycle is not None and ahead > 0:
            self._repeating = RepeatingPath(
                joints, preview, self.cycle, varies=OPTIONS.varies, ahead=ahead
            )
            rows += self._repeating.ahead
        # What happens before the first request acts is decided; beyond the last row the path stops.
        self._waiting = np.minimum(np.arange(1, ages.youngest), preview - 1)
        n = self._samples = max(rows - ages.youngest, ages.width)
        self._rows = np.minimum(np.arange(ages.youngest, ages.youngest + n), rows - 1)
        self._loaded = np.minimum(self._rows, preview - 1)
        self._sent = np.zeros((joints, ages.oldest))  # the last one at the end
        self._acting = slice(0, ages.width)  # those that act until now
        self._runs = Runs(models, ages)
        radii = tuple(np.geomspace(OPTIONS.near, OPTIONS.far, n).tolist())
        terms = Terms(OPTIONS.exceeding, OPTIONS.resting, radii)
        self._plans = Plans(models, ages, terms, trials=len(OPTIONS.lengths) + 1)
        self._joints = np.arange(joints)
        self._least, self._most = self._lower[:, np.newaxis], self._upper[:, np.newaxis]

        def each(name: str) -> Array:
            return np.array([[getattr(model, name)] for model in models], dtype=np.float64)

        self._band = each("dead_band")
        smoothing = OPTIONS.smoothing + OPTIONS.crossing * self._band / each("theta_0")
        settings = smoothing, self._step[:, np.newaxis], self._least, self._most
        self._plans.settings[:] = np.concatenate(settings, axis=1)
        self._fastest = each("v_max_per_period")
        self._per_slope = each("theta_0") / self._fastest
        self._observer = 1.0 - math.exp(-self.period / OPTIONS.observer_time)
        # Where on the horizon each request takes effect on average, for the inverses of lines.
        effect = [[switching_time(model) / self.period - ages.youngest] for model in models]
        at = np.clip(np.array(effect) + np.arange(n), 0.0, max(n - 1.0, 0.0))
        self._at = self._joints[:, np.newaxis], np.clip(at.astype(np.intp), 0, max(n - 2, 0))
        self._share = at - self._at[1]
        self._all_planned: tuple[Status, ...] = tuple("planned" for _ in models)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle: what it was made from and what it has learnt, not compiled buffers."""
        options = {
            "preview": self.preview,
            "limits": (self._lower, self._upper),
            "max_step": None if np.isinf(self._step).all() else self._step,
            "cycle": self.cycle,
            "on_bad": "raise" if self._raises else "hold",
        }
        known = dict(zip(self.names, self.models, strict=True))
        state = {name: getattr(self, name) for name in _STATE}
        state["memory"] = () if self._repeating is None else self._repeating.memory
        return _made_again, (known, options), state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Take a copy of another stream's state."""
        self.__dict__.update(deepcopy({name: state[name] for name in _STATE}))
        if self._repeating is not None:
            for mine, others in zip(self._repeating.memory, state["memory"], strict=True):
                mine[:] = others

    def reset(self) -> None:
        """Forget everything: the next step is a first one, with the joints at rest."""
        self._angles: Array | None = None  # at the last tick
        self._speeds = np.zeros(len(self.models))  # in the tick before it [rad/tick]
        if self._repeating is not None:
            self._repeating.reset()
        nothing = np.full(len(self.models), math.nan)
        self._read, self._believed = nothing, nothing.copy()  # last measured; those that counted
        self._unread = np.zeros(len(self.models))  # ticks since then
        self._plan = np.zeros((len(self.models), self._samples))
        self._damping = np.full(len(self.models), OPTIONS.damping[0])
        self._status = self._all_planned
        self._problem = ""

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
        """What was wrong at the last tick, on one line; empty where nothing was.

        A measured angle that no joint can have reached is taken as missing, and said here; one that
        is off by whole turns counts without them, as of an encoder that starts again.
        """
        return self._problem

    @property
    def angles(self) -> Array:
        """Angles of the joints at the last tick, predicted and corrected [rad], shape (k,).

        NaN before the first tick.
        """
        return np.full(len(self.models), math.nan) if self._angles is None else self._angles.copy()

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
                for one joint. Row 0 is where the joints should be now, when the requests are sent;
                row j, j periods later. Of a shorter stretch the last row is held; rows beyond the
                preview have no effect.
            measured: Measured angles [rad], shape (k,), NaN where there is none. Their time is that
                of this tick: read right before the requests are sent, in the order of the log from
                which the model was identified. Leave out those that are older than a period.
            load: Torque on the joints [N m]: a number, shape (k,), or rows like those of
                ``desired``; row j acts in the period that ends in row j.
            missed: Ticks without a step since the last one: the robot held its requests.

        Returns:
            Requests [rad], shape (k,), read-only: always within the limits, and within
            ``max_step`` of the last ones. NaN, not to be sent, only where the first step has
            neither measured nor desired angles to begin with.

        Raises:
            InvalidInput, Infeasible: With ``on_bad="raise"``: what cannot be
                used, or a desired angle is beyond what the limits allow.
        """
        given = self._arguments.checked(desired, measured, load, missed, near=self._angles)
        bad, sags = given.bad, given.sags
        if self._raises and given.error:
            raise given.error
        self._problem = str(given.error or "")
        begins = self._angles is None
        angles = given.rows[:, 0] if self._angles is None else self._angles
        start = np.where(np.isnan(given.measured), angles, given.measured) if begins else angles
        if begins and not np.isfinite(start).all():
            self._set_status(np.ones_like(bad), bad)
            requests = np.full(len(self.models), math.nan)
            requests.setflags(write=False)
            return requests
        rows = np.where(bad[:, np.newaxis], start[:, np.newaxis], given.rows)
        if begins:
            held = _clipped(start - sags[:, 0], self._lower, self._upper)
            self._angles, self._sent[:] = start, held[:, np.newaxis]
            self._read, self._believed = given.measured.copy(), given.measured.copy()
            self._speeds[:] = 0.0
        else:
            self._elapse(given)
        goal = self._goal(rows, bad, 1 + given.missed)
        sag = sags[:, self._loaded]
        plan = self._planned(goal, sag, given.torques, begins=begins)
        last = self._sent[:, -1].copy()
        requests = np.where(bad | begins, last, self._within(plan[:, 0], last))
        plan[:, 0] = requests
        self._plan = plan
        self._record(requests)
        self._set_status(bad, given.beyond)
        requests.setflags(write=False)
        return requests

    def _elapse(self, given: StepInput) -> None:
        """Move on by the periods since the last step, and correct the angles by measured ones."""
        angles = self._angles
        assert angles is not None, "a first step has nothing to move on from"
        if given.missed > OPTIONS.most_missed:
            self._sent[:] = self._sent[:, -1:]
        for period in range(min(given.missed, OPTIONS.most_missed) + 1):
            if period:
                self._record(self._sent[:, -1].copy())
            acting, torques = self._sent[:, self._acting], given.torques[:, :1]
            angles = self._runs.run(angles, self._speeds, acting, torques)[:, 0]
            self._plan[:, :-1] = self._plan[:, 1:]
        error, fastest = self._measured(given, angles) - angles, self._fastest[:, 0]
        error[np.isnan(error)] = 0.0
        self._angles = angles + _clipped(self._observer * error, -fastest, fastest)

    def _measured(self, given: StepInput, predicted: Array) -> Array:
        """The measured angles on the turn of the predicted ones, NaN where no joint can be [rad].

        A jump counts once a second angle in a row is there: something has moved the joint.
        """
        measured = given.measured - TURN * np.round((given.measured - predicted) / TURN)
        elapsed = 1 + min(given.missed, OPTIONS.most_missed)
        self._unread += elapsed
        reach = OPTIONS.believed * self._fastest[:, 0]
        off = np.abs(measured - self._believed)
        jumped = off > reach * self._unread + OPTIONS.noise
        jumped &= ~(np.abs(measured - self._read) <= reach * elapsed + OPTIONS.noise)
        self._read = measured
        if jumped.any():
            k = int(np.argmax(jumped))
            self._problem = self._problem or (
                f"measured: {self.names[k]} is {angle_text(float(off[k]))} from where it was "
                f"{1e3 * self.period * self._unread[k]:.3g} ms before, which no joint can be: "
                "taken as missing"
            )
            measured = np.where(jumped, math.nan, measured)
        counts = ~np.isnan(measured)
        self._believed = np.where(counts, measured, self._believed)
        self._unread[counts] = 0.0
        return measured

    def _goal(self, rows: Array, bad: Mask, periods: int) -> Array:
        """Desired angles at the samples [rad], (k, samples), those of the cycle before weighted."""
        if self._repeating is not None:
            self._repeating.move_on(periods)
            follow, weights = self._repeating.continued(rows, bad)
            rows = np.concatenate([rows, follow], axis=1)
            self._plans.weights[:, self._rows >= self.preview] = weights
        return rows[:, self._rows]

    def _planned(self, goal: Array, sag: Array, torques: Array, *, begins: bool) -> Array:
        """The plan for this tick, shape (k, samples)."""
        plans, start = self._plans, self._angles
        assert start is not None, "a step begins with an angle"
        plans.speeds[:] = self._speeds
        if len(self._waiting):
            waiting = torques[:, self._waiting]
            start = self._runs.run(start, plans.speeds, self._sent[:, 1:], waiting)[:, -1]
        plans.starts[:] = start
        plans.loads[:] = torques[:, self._loaded]
        plans.goal[:], plans.resting[:] = goal, goal - sag
        plans.damping[:, 1] = begins
        past = self._sent[:, -plans.past :]
        plans.plan[:, : plans.past], plans.trials[:, :, : plans.past] = past, past[:, np.newaxis]
        if begins:
            plan = self._admissible(plans.resting)
            plan[:, 0] = self._sent[:, -1]
        else:
            plan = self._plan
            plan[:, -1] += goal[:, -1] - goal[:, -2] if goal.shape[1] > 1 else 0.0
            plan = self._admissible(plan)
        lines = self._admissible(self._line_inverses(goal, sag))
        if begins:
            lines[:, 0] = plan[:, 0]
        searched = self._joints
        for _ in range(OPTIONS.first_steps if begins else OPTIONS.steps):
            gains = self._improve(plan, lines, searched)
            if not begins:
                searched = searched[gains >= OPTIONS.worth]
        return plan

    def _improve(self, plan: Array, lines: Array, searched: Indices) -> Array:
        """Put the best of plan, shares of its Gauss-Newton step and inverted lines in its place.

        For the joints that are searched. Returns by which share their costs have fallen.
        """
        plans = self._plans
        plans.plan[:, plans.past :], plans.damping[:, 0] = plan, self._damping
        plans.step(searched)
        trials = plans.trials[:, :, plans.past :]
        trials[:, 0] = lines
        for number, share in enumerate(OPTIONS.lengths, 1):
            trials[:, number] = plan - share * plans.steps
        np.maximum(trials, self._least[:, np.newaxis], out=trials)
        np.minimum(trials, self._most[:, np.newaxis], out=trials)
        plans.judge(searched)
        costs = plans.costs[searched]
        best = costs.argmin(axis=1)
        better = best > 0
        plan[searched[better]] = trials[searched[better], best[better] - 1]
        grown = np.where(best == 0, OPTIONS.factor, np.where(best == 2, 1.0 / OPTIONS.factor, 1.0))
        self._damping[searched] = _clipped(self._damping[searched] * grown, *OPTIONS.damping)
        return np.asarray(1.0 - costs.min(axis=1) / np.maximum(costs[:, 0], LEAST_COST))

    def _line_inverses(self, goal: Array, sag: Array) -> Array:
        """Each sample's line inverted: angle and slope when a request takes effect, raised by C_m.

        C_m as from rest: the error that calls for the slope, and the dead band.
        """
        if goal.shape[1] < 2:
            return goal - sag
        here = goal[self._at]
        slopes = goal[self._at[0], self._at[1] + 1] - here
        slopes = _clipped(slopes, -self._fastest, self._fastest)
        raised = slopes * self._per_slope + np.sign(slopes) * self._band
        lines: Array = here + self._share * slopes + raised - sag
        return lines

    def _within(self, planned: Array, last: Array) -> Array:
        """The nearest requests within the limits and ``max_step`` of the last ones, exactly."""
        admissible = self._admissible(planned[:, np.newaxis])[:, 0]
        change = _clipped(admissible - last, -self._step, self._step)
        requests = last + change
        rounded = np.abs(requests - last) > self._step  # by the last bit
        requests = np.where(rounded, np.nextafter(requests, last), requests)
        return _clipped(requests, self._lower, self._upper)

    def _admissible(self, plan: Array) -> Array:
        return _clipped(plan, self._least, self._most)

    def _record(self, requests: Array) -> None:
        self._sent[:, :-1] = self._sent[:, 1:]
        self._sent[:, -1] = requests

    def _set_status(self, bad: Mask, beyond: Mask) -> None:
        if bad.any() or beyond.any():
            words: list[Status] = [
                "held" if held else "unreachable" if far else "planned"
                for held, far in zip(bad.tolist(), beyond.tolist(), strict=True)
            ]
            self._status = tuple(words)
        else:
            self._status = self._all_planned


def _clipped(values: Array, least: npt.ArrayLike, most: npt.ArrayLike) -> Array:
    """np.clip, whose checks take longer than the work at this size."""
    clipped: Array = np.minimum(np.maximum(values, least), most)
    return clipped


def _made_again(models: Mapping[str, JointModel], options: Mapping[str, Any]) -> Stream:
    """The stream of a copy, without the warnings that the first one had."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return Stream(models, **options)
