"""Recordings replayed: requests under which the joints repeat their motion, at any speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from planner.arrays import (
    Array,
    Mask,
    ReadOnly,
    Summarised,
    Summary,
    as_positive,
    freeze,
    most_lost,
    read_only,
    reversals,
    rms,
    stretches,
)
from planner.exceptions import InvalidModel
from planner.identification.grid import measured_speed
from planner.model.evidence import SMALL, WORSE
from planner.model.response import simulate
from planner.planning.inversion import plan
from planner.planning.plan import Inversion, Plan
from planner.planning.search import SHAKING
from planner.planning.task import JointLimits, LoadOfPose
from planner.planning.time_shift import shifted
from planner.recording.recorded_path import Models, Path, RecordedPath, Track, recorded_path

# Requests of a joint: as recorded, the path as it is, that with the best time shift, a plan.
Kind = Literal["resent", "direct", "shifted", "planned"]


def replay(
    recording: Any,
    models: Models,
    *,
    speed: float = 1.0,
    track: Track = "state",
    joints: Sequence[str] = (),
    begin: float | None = None,
    end: float | None = None,
    rate: float | None = None,
    limits: JointLimits | None = None,
    load: LoadOfPose | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Replay:
    """Requests under which the joints repeat a recording, at its own speed or another one.

    The followed signal is read at s(t) = begin + speed t, on straight lines between its rows, and
    planned from rest by :func:`planner.plan`, joint by joint. Joints without a model, and grippers
    unless ``joints`` names them, get their recorded requests at the same moments s(t): a gripper
    holds by the difference between request and angle, which a plan for its angle would take away.

    Args:
        recording: The logs of one recording, one for each joint, as :func:`planner.read_logs`
            reads them; a log of one joint.
        models: One model for all joints, or models by joint; the key "" holds the default model.
            Of a log in shares of a range models are in shares too.
        speed: How many times faster than it was recorded.
        track: "state" to follow the recorded angles, "action" to follow the recorded requests.
        joints: The joints to plan; by default all that have a model and are no grippers.
        begin: Where to begin [s since the first row]; by default at the first row.
        end: Where to end [s since the first row]; by default at the last row.
        rate: Requests per second; by default as many as the recording has rows.
        limits: As of :func:`planner.plan`, in the unit of the log. Joints in shares of a range
            have by default the limits 0 and 1, or those of the recording where it goes beyond.
        load: Torques of a pose, as of :func:`planner.plan`; by default those of the logs, where a
            log has them and the model feels them.
        progress: Called with the name of each joint before it is planned.
        **options: Further options of :func:`planner.plan`, such as ``norm``.

    Returns:
        The requests and their errors.

    Raises:
        InvalidInput: The logs are not one recording, no joint is left to plan, or an argument is
            out of its range.
        Infeasible: The limits exclude an angle of the path.
        SolverFailed: No plan was found.

    Example:
        >>> import numpy as np
        >>> from planner import JointModel, Log, simulate
        >>> servo = JointModel.ers210a()
        >>> times = servo.period * np.arange(400)
        >>> requests = 0.5 - 0.5 * np.cos(np.pi * times)  # rad
        >>> angles = simulate(servo, requests, cyclic=False)
        >>> log = Log(times=times, requests=requests, angles=angles)
        >>> twice = replay(log, servo, speed=2.0)
        >>> (joint,) = twice.joints
        >>> errors = {kind: np.degrees(np.std(error)) for kind, error in joint.errors.items()}
        >>> twice.requests.shape, bool(errors["planned"] < 0.05 * errors["direct"])
        ((200, 1), True)
    """
    factor = as_positive("speed", speed, "a factor above 0, such as 1.5")
    path = recorded_path(recording, models, track, joints, begin, end, rate, limits)
    moments = path.moments(factor)
    return replay_at(path, moments, speed=speed, load=load, progress=progress, **options)


def replay_at(
    path: RecordedPath,
    moments: Array,
    *,
    speed: float | None = None,
    load: LoadOfPose | None = None,
    known: Mapping[str, Inversion | None] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Replay:
    """The replay whose request k belongs to a moment of the recording [s], increasing, shape (n,).

    Plans for these moments that are ``known`` are not used under a load of the pose, which depends
    on all joints; the reported ``speed`` is by default the mean one. See :func:`replay`.
    """
    if load is None and path.load_at is not None:
        load = path.load_at(moments)
    inversions = dict(known or {}) if load is None else {}  # a pose is that of all joints
    planned = [each for each in path.planned if each.name not in inversions]
    names = [each.name for each in planned]
    for option, value in options.items():
        if isinstance(value, Mapping):
            options[option] = {name: value[name] for name in names if name in value}
    loads = {each.name: each.at(moments, each.load) for each in planned if each.load is not None}
    solution = plan(
        [each.model for each in planned if each.model],
        np.column_stack([each.at(moments, each.followed) for each in planned]),
        names=names,
        cyclic=False,
        limits={name: span for name, span in path.limits.items() if name in names},
        load=load if load is not None else loads or None,
        progress=progress,
        **options,
    )
    inversions |= dict(zip(names, solution.inversions, strict=True))
    joints = tuple(JointReplay(each, moments, inversions.get(each.name)) for each in path.joints)
    if speed is None:
        speed = float((moments[-1] - moments[0]) / ((len(moments) - 1) * path.period))
    freeze(moments)
    answer = Replay(path=path, speed=speed, moments=moments, joints=joints)
    losses = [(each.name, each.lost) for each in answer.planned if each.lost]
    if not losses:
        return answer
    name, share = max(losses, key=lambda each: each[1])
    words = (
        f"at this speed a request every {1e3 * path.period:.3g} ms loses {100.0 * share:.0f} % of "
        f"the motion of {name} (rms of what it moves), and the errors are those from the path that "
        "is left: choose a lower speed or a higher rate"
    )
    return replace(answer, path=replace(path, remarks=(*path.remarks, words)))


@dataclass(frozen=True, eq=False)
class JointReplay:
    """One joint of a replay; angles are in the unit of its log, "rad" or "1" (of its range)."""

    path: Path  # the joint as it was recorded
    moments: Array  # the moment of the recording that belongs to each request [s], shape (n,)
    inversion: Inversion | None  # the plan; None where the recorded requests are sent

    @property
    def name(self) -> str:
        """The joint."""
        return self.path.name

    @cached_property
    def requests(self) -> Array:
        """Requests for the joint, shape (n,)."""
        return self.recorded_requests if self.inversion is None else self.inversion.requests

    @cached_property
    def desired(self) -> Array:
        """The angles to follow, shape (n,)."""
        return self.path.at(self.moments, self.path.followed)

    @property
    def lost(self) -> float:
        """Share of the recorded motion that straight lines between the samples lose, rms, or 0."""
        rows, desired = self.path.followed[self._rows, np.newaxis], self.desired[:, np.newaxis]
        lost = most_lost(self.path.times[self._rows], rows, self.moments, desired)
        return lost[1] if lost else 0.0

    @property
    def between(self) -> float:
        """How far lines between the samples are from the recorded path at its rows, at most."""
        lines = np.interp(self.path.times[self._rows], self.moments, self.desired)
        return float(np.max(np.abs(lines - self.path.followed[self._rows])))

    @cached_property
    def _rows(self) -> Mask:
        """Which rows lie between the first and the last sample."""
        times = self.path.times
        return np.asarray((times >= self.moments[0]) & (times <= self.moments[-1]))

    @cached_property
    def recorded_requests(self) -> Array:
        """The recorded requests at the replay's speed, shape (n,)."""
        return self.path.at(self.moments, self.path.requests)

    @cached_property
    def recorded_angles(self) -> Array:
        """The recorded angles at the replay's speed, shape (n,)."""
        return self.path.at(self.moments, self.path.angles)

    @property
    def recorded_errors(self) -> Array:
        """Recorded angles minus requests, of the rows that are replayed, shape (r,)."""
        times, slack = self.path.times, 1e-9  # [s]
        beyond = self.moments[-1] + np.diff(self.moments[-2:])  # of a request that would be next
        rows = (times >= self.moments[0] - slack) & (times < beyond - slack)
        return np.asarray((self.path.angles - self.path.requests)[rows])

    @property
    def predicted(self) -> Array | None:
        """Angles under the requests, by the joint's model, shape (n,); None without one."""
        return None if self.inversion is None else self.inversion.predicted

    @cached_property
    def plan(self) -> Plan:
        """The plan of a planned joint alone."""
        assert self.inversion is not None, "a joint without a model has no plan"
        return self.inversion.plan.joint(self.inversion.column)

    @cached_property
    def by_rms(self) -> Plan:
        """The same plan, judged by the root mean square of the errors."""
        return replace(self.plan, task=replace(self.plan.task, norm="rms"))

    @cached_property
    def shift(self) -> Plan:
        """The best time shift of the desired angles of a planned joint."""
        return shifted(self.by_rms.task)

    @cached_property
    def _sent(self) -> dict[str, Plan]:
        """Other requests of a planned joint; the first holds it, as planned."""
        kinds, first = {"direct": self.desired, "resent": self.recorded_requests}, self.requests[:1]
        sent = {kind: np.append(first, each[1:])[:, np.newaxis] for kind, each in kinds.items()}
        return {kind: replace(self.plan, requests=requests) for kind, requests in sent.items()}

    def angles(self, kind: Kind) -> Array:
        """Angles of a planned joint under one kind of requests, shape (n,)."""
        plan = self.shift if kind == "shifted" else self._sent.get(kind, self.plan)
        return plan.predicted[:, 0]

    def error_of(self, kind: Kind) -> Array:
        """The same minus the desired angles."""
        return self.angles(kind) - self.desired

    @property
    def errors(self) -> dict[str, Array]:
        """Angles minus desired angles of a planned joint, by kind of requests, shape (n,) each."""
        return {kind: self.error_of(kind) for kind in get_args(Kind)}

    @cached_property
    def lower_bound(self) -> float:
        """Lower bound on the rms error of any requests; NaN under a load of the pose."""
        return math.nan if self.plan.task.load_of_pose else float(self.by_rms.lower_bounds[0])

    @cached_property
    def resent_may_serve(self) -> bool:
        """Whether the recorded requests may serve better than the plan, if sent as recorded.

        They moved the joint so once: their error is mostly the model's, which does not show that
        the plan is better unless the error to expect of it is less than half of that.
        """
        driven = bool(np.all(self.path.log.torque_on[self._rows]))  # else something else moved it
        return driven and self.plan.expected[0].error > 0.5 * rms(self.error_of("resent"))

    @cached_property
    def fit(self) -> tuple[float, float] | None:
        """The model's error under the recorded requests, and the largest to expect, both rms.

        They are at the recorded speed and rate. Without a test as much is expected as the requests
        with the best delay are off. None where it is not judged: where the torque was off, the load
        is unknown, the rows are few, or the model cannot have their rate.
        """
        path, own, model = self.path, self.path.log.period, self.plan.models[0]
        times, driven = path.times[self._rows], path.log.torque_on[self._rows]
        if not driven.all() or (model.feels_load and path.load is None) or len(times) < 8:
            return None
        try:
            model = model.requested_every(own)
        except InvalidModel:
            return None
        at = np.arange(times[0], times[-1], own)
        requests, angles = path.at(at, path.requests), path.at(at, path.angles)
        load = None if path.load is None else path.at(at, path.load)
        error = simulate(model, requests, cyclic=False, start=float(angles[0]), load=load) - angles
        if (evidence := model.evidence) is None or math.isnan(evidence.error):
            delays = range(min(len(at) // 2, round(0.5 / own)) + 1)
            most = max(SMALL, min(rms(angles[k:] - requests[: len(at) - k]) for k in delays))
        else:
            within, _, most = evidence.compared(error + angles, period=own)
            error = error[within | ~within.any()]
        return rms(error), most

    @property
    def fits(self) -> bool | None:
        """Whether that error is at most twice the largest to expect; None where not judged."""
        return None if self.fit is None else self.fit[0] <= WORSE * self.fit[1]

    @property
    def rough(self) -> tuple[float, float] | None:
        """Reversals of the requests, if far more than of the recorded ones, and of these [1/s]."""
        turns = (reversals(each, cyclic=False) for each in (self.requests, self.recorded_requests))
        planned, recorded = (each / (len(self.moments) * self.plan.period) for each in turns)
        return (planned, recorded) if planned > recorded + SHAKING else None

    @cached_property
    def too_fast(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the desired angles are faster than the joint can be, from and to [s]."""
        parts, period = stretches(self.plan.speeds[0].too_fast), self.plan.period
        return tuple((part.start * period, part.stop * period) for part in parts)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replay(ReadOnly, Summarised):
    """Requests that repeat a recording, with the errors that the models predict.

    Attributes:
        path: The recording.
        speed: Duration of the recorded part over that of the replay.
        moments: The moment of the recording that belongs to each request [s], shape (n,).
        joints: Every joint.
    """

    path: RecordedPath
    speed: float
    moments: Array
    joints: tuple[JointReplay, ...]

    def _summarised(self) -> Summary:
        """Requests and errors of every planned joint."""
        count = len(self.joints)
        head = (
            f"Replay at {self.speed:.4g} times the speed: {len(self.moments)} requests to {count} "
            f"joint{'s' * (count > 1)}, one every {1e3 * self.period:.4g} ms"
        )
        rows = []
        for each in self.planned:
            unit = "rad" if each.path.unit == "rad" else "of its range"
            errors = (each.plan.rms[0], each.plan.max_error[0])
            rows.append((each.name, *(f"{error:.4g}" for error in errors), unit))
        return Summary(head, ("", "rms", "max", "unit"), rows)

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.path.period

    @property
    def names(self) -> tuple[str, ...]:
        """The joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def planned(self) -> tuple[JointReplay, ...]:
        """The joints whose requests are planned."""
        return tuple(joint for joint in self.joints if joint.inversion is not None)

    @property
    def untested(self) -> str:
        """The joints that move outside the tested range of their models, and how, in words."""
        pairs = [(each.name, each.plan.expected[0].untested) for each in self.planned]
        return ", ".join(f"{name} ({', '.join(words)})" for name, words in pairs if words)

    @property
    def resent_may_serve(self) -> tuple[JointReplay, ...]:
        """The planned joints that the recorded requests, at their speed, may move better."""
        if self.speed != 1.0 or self.path.track != "state":
            return ()  # where their effect was not measured
        return tuple(joint for joint in self.planned if joint.resent_may_serve)

    @property
    def contradicted(self) -> tuple[str, ...]:
        """The joints that moved faster in the replayed part than their models can."""
        names = []
        for each in self.planned:
            part = replace(each.path.log, torque_on=each.path.log.torque_on & each._rows)
            limits = each.plan.models[0].speed_limits(0.0, part.angles)
            # by a load a joint may exceed the top speed of its model a little
            if measured_speed(part) > 1.05 * max(np.max(np.abs(limit)) for limit in limits):
                names.append(each.name)
        return tuple(names)

    @cached_property
    def requests(self) -> Array:
        """Requests for the joints [rad, or shares of a range], shape (n, k)."""
        return read_only(np.column_stack([joint.requests for joint in self.joints]))

    @property
    def max_error(self) -> float:
        """Largest error of any planned joint [rad, or shares of a range]."""
        return max(float(each.plan.max_error[0]) for each in self.planned)
