"""A recording as a path: the signal to follow, the models of its joints, times of the requests.

The models are given, or identified from the recordings themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from planner.arrays import MOST_SAMPLES, Array, as_number, as_positive, check_choice, freeze, shown
from planner.exceptions import InvalidInput, InvalidModel, PlannerError, nearest
from planner.identification.grid import sound_rows, timing_of
from planner.identification.log import Doubt, Log, as_logs, check_periods, pieces_of, unwrapped
from planner.model.evidence import check_unit, with_reasons
from planner.model.joint import JointModel
from planner.planning.task import JointLimits, LoadOfPose, limits_in_shares, limits_of_each

if TYPE_CHECKING:
    from planner.files.logs import Recording

Track = Literal["state", "action"]  # the recorded signal to follow: the angles, or the requests
Models = JointModel | Mapping[str, JointModel]  # of all joints, or by joint; "" is the default

# Which signal is followed, and the reason.
WHY: Mapping[Track, str] = {
    "state": "the state, the measured angles, with the errors that the robot made",
    "action": "the action, what the robot was asked to do, as chosen: its errors are not repeated",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """One joint of a recording as a path over the recording's time."""

    name: str  # the joint
    unit: str  # "rad", or "1" for shares of its range
    times: Array  # times of the rows since the recording began [s], shape (n,)
    followed: Array  # the signal to follow, shape (n,), in the unit
    requests: Array  # the recorded requests, shape (n,), in the unit
    angles: Array  # the recorded angles, shape (n,), in the unit
    # torque on the joint [N m], shape (n,); None where it is not known, or not felt
    load: Array | None
    # the joint's model, one request a period; None where requests are sent as recorded
    model: JointModel | None
    reason: str  # why they are; "" where the joint is planned
    log: Log  # the log itself

    def at(self, moments: Array, values: Array) -> Array:
        """A signal at moments of the recording [s], shape (n,), on straight lines between rows."""
        return np.asarray(np.interp(moments, self.times, values))


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPath:
    """A recording, ready to be replayed at any speed."""

    name: str  # the recording, for messages
    track: Track  # the signal that is followed
    joints: tuple[Path, ...]  # every joint
    period: float  # time between requests [s]
    first: float  # where the replay begins [s of the recording]
    last: float  # where it ends [s of the recording]
    # smallest and largest request by joint [unit], of those that have limits
    limits: Mapping[str, tuple[float, float]]
    remarks: tuple[str, ...]  # remarks on the recording for the user
    # the load of a pose, as of :func:`planner.plan`, at moments of the recording; None where the
    # load is that of the logs, or none
    load_at: Callable[[Array], LoadOfPose] | None = None

    @property
    def planned(self) -> tuple[Path, ...]:
        """The joints whose requests are planned."""
        return tuple(joint for joint in self.joints if joint.model is not None)

    @property
    def open_top_speeds(self) -> frozenset[str]:
        """The planned joints whose logs leave open how fast they can be."""
        evidence = [(each.name, each.model and each.model.evidence) for each in self.planned]
        return frozenset(name for name, seen in evidence if seen and seen.leaves_top_speed_open)

    @property
    def duration(self) -> float:
        """How long the recorded part lasts [s]."""
        return self.last - self.first

    def moments(self, speed: float) -> Array:
        """The moment of the recording [s] that belongs to each request at a constant speed."""
        rows = _rows(self.name, self.duration, self.period, speed)
        moments = self.first + speed * self.period * np.arange(rows)
        return np.asarray(np.minimum(moments, self.last))


def _rows(name: str, duration: float, period: float, speed: float) -> int:
    """How many requests a replay has; too many or too few are refused."""
    count = duration / speed / period
    rows, problem = math.floor(min(count, 2.0 * MOST_SAMPLES) + 1e-6) + 1, ""
    if count > MOST_SAMPLES:
        problem = (
            f"the replay has {count:.3g} requests, expected at most {MOST_SAMPLES}; choose a "
            "shorter part, a higher speed or a lower rate"
        )
    elif rows < 3:
        remain = f"{rows} request remains" if rows == 1 else f"{rows} requests remain"
        problem = (
            f"{remain} of {duration:.4g} s, expected 3 or more; choose a longer part, a lower "
            "speed or a higher rate"
        )
    if problem:
        where = f"{name}: at {speed:g} times the speed and {1.0 / period:.6g} requests a second"
        raise InvalidInput(f"{where} {problem}")
    return rows


def recorded_path(
    recording: Any,
    models: Models,
    track: Track = "state",
    joints: Sequence[str] = (),
    begin: float | None = None,
    end: float | None = None,
    rate: float | None = None,
    limits: JointLimits | None = None,
) -> RecordedPath:
    """A recording with the models of its joints, ready for any speed; see :func:`replay`."""
    check_choice("track", track, get_args(Track))
    logs = as_logs(recording)
    check_periods(logs)
    names = tuple(log.joint or "joint" for log in logs)
    chosen = _models_of(names, models, joints)
    origin, first, last = _part(logs, begin, end)
    period = _period(logs, rate)
    remarks, paths = list[str](), []
    for name, recorded in zip(names, logs, strict=True):
        log, jumps = unwrapped(recorded)
        if jumps:
            words = f"its encoder, or its requests, started again {jumps} times; the angles go on"
            remarks.append(f"{name}: {words}")
        times, angles = log.times - origin, log.angles
        sound = sound_rows(log)
        if not sound.all() and sound.any():
            words = "angles that are missing, or that no joint takes, are bridged"
            remarks.append(f"{name}: {int((~sound).sum())} {words}")
            angles = np.interp(times, times[sound], angles[sound])
        freeze(times, angles)
        model, reason = chosen[name]
        check_unit(name, model.evidence if model else None, shares=log.unit == "1")
        paths.append(
            Path(
                name=name,
                unit=log.unit,
                times=times,
                followed=angles if track == "state" else log.requests,
                requests=log.requests,
                angles=angles,
                load=log.load if model is not None and model.feels_load else None,
                model=None if model is None else _requested_every(model, period, name),
                reason=reason,
                log=log,
            )
        )
    remarks += _remarks(logs, origin, first, last)
    return RecordedPath(
        name=logs[0].name,
        track=track,
        joints=tuple(paths),
        period=period,
        first=first,
        last=last,
        limits=_limits(paths, limits, names),
        remarks=tuple(dict.fromkeys(remarks)),
    )


def _models_of(
    names: Sequence[str], models: Any, joints: Any
) -> dict[str, tuple[JointModel | None, str]]:
    """By joint its model, or None and why its recorded requests are sent."""
    by_joint = {"": models} if isinstance(models, JointModel) else models
    if not isinstance(by_joint, Mapping) or not all(
        isinstance(name, str) and isinstance(model, JointModel) for name, model in by_joint.items()
    ):
        expected = "expected a JointModel, or a dict of them by joint"
        raise InvalidInput(f"models: got {shown(models)}, {expected}")
    if not isinstance(joints, list | tuple) or not all(isinstance(name, str) for name in joints):
        raise InvalidInput(f"joints: got {shown(joints)}, expected a list of names")
    if double := next((name for name in names if names.count(name) > 1), ""):
        raise InvalidInput(
            f"recording: got {names.count(double)} logs of joint '{double}', expected the logs of "
            "one recording, one for each joint; replay recordings one by one"
        )
    with_model = [name for name in names if name in by_joint or "" in by_joint]
    for name in joints:
        _check_named("joints", "joint", name, names)
        if name not in with_model:
            _check_named("models", "model of", name, by_joint)
    planned = joints or without_grippers(with_model)
    if not planned:
        raise InvalidInput(
            f"models: of {', '.join(by_joint) or 'no joint'}, but the joints of the recording are "
            f"{', '.join(names)}; rename the tables of the model file to them"
        )

    chosen = dict[str, tuple[JointModel | None, str]]()
    for name in names:
        reason = "a gripper" if is_gripper(name) else "not chosen"
        reason = reason if joints or name in with_model else "no model"
        own = by_joint.get(name, by_joint.get("")), ""
        chosen[name] = own if name in planned else (None, reason)
    return chosen


def _check_named(kind: str, what: str, name: str, names: Iterable[str]) -> None:
    """Raise InvalidInput for a chosen joint that is not among these."""
    if name not in (known := list(names)):
        words = f"no {what} '{name}'{nearest(name, known)}; {kind}: {', '.join(known)}"
        raise InvalidInput(f"joints: {words}")


def is_gripper(name: str) -> bool:
    """Whether a joint is a gripper by its name."""
    words = ("gripper", "jaw", "claw", "finger", "thumb", "hand")
    return any(word in name.lower() for word in words)


def without_grippers(names: Iterable[str]) -> list[str]:
    """The joints but for grippers, or all where all are."""
    every = list(names)
    return [name for name in every if not is_gripper(name)] or every


def _part(
    logs: Sequence[Log], begin: float | None, end: float | None
) -> tuple[float, float, float]:
    """Time of the first row [s]; first and last moment since then, which all logs have."""
    firsts, lasts = zip(*((float(log.times[0]), float(log.times[-1])) for log in logs), strict=True)
    origin = min(firsts)
    first, last = max(firsts) - origin, min(lasts) - origin
    ends = []
    for name, value, default in (("begin", begin, first), ("end", end, last)):
        moment = default if value is None else as_number(value)
        if not first - 1e-9 <= moment <= last + 1e-9:
            expected = f"expected a moment of the recording, {first:g} to {last:g} s"
            raise InvalidInput(f"{name}: got {shown(value)} s, {expected}")
        ends.append(moment)
    begin, end = ends
    if not begin < end:
        words = f"got {begin:g} and {end:g} s, expected an end after the begin"
        raise InvalidInput(f"begin, end: {words}")
    return origin, begin, end


def _period(logs: Sequence[Log], rate: float | None) -> float:
    """Time between requests [s]."""
    if rate is not None:
        return 1.0 / as_positive("rate", rate, "more than 0 requests a second")
    period = timing_of(logs, tick=None, hold=None).period
    whole = round(1.0 / period)
    # LeRobot writes times in 32 bits, from which 30 Hz is read as 29.99999.
    return 1.0 / whole if whole >= 1 and abs(period * whole - 1.0) <= 1e-4 else period


def _requested_every(model: JointModel, period: float, joint: str) -> JointModel:
    """The model with a request every period, in as many ticks where the period is about its own."""
    if abs(model.period - period) <= 0.01 * period:  # identified clocks differ by 1e-4
        return replace(model, tick=period / model.hold).with_evidence(model.evidence)
    try:
        return model.requested_every(period)
    except InvalidModel as error:
        words = f"{1.0 / period:.6g} requests a second are none for the model of {joint}"
        raise InvalidInput(f"rate: {words}: {error}") from error


def _remarks(logs: Sequence[Log], origin: float, first: float, last: float) -> list[str]:
    """Doubts about the unit, gaps in the part that is replayed, and rows without torque."""
    notes = [(log.joint or "joint", log.notes) for log in logs if log.unit == "rad"]
    doubts = [[f"{of}: {each}" for each in said if isinstance(each, Doubt)] for of, said in notes]
    whose = "all joints, such as " * (len(doubts) > 1)
    # one that moves far has the right unit
    remarks = [whose + each for each in doubts[0]] if doubts and all(doubts) else []
    others = (note for _, said in notes for note in said if not isinstance(note, Doubt))
    remarks += dict.fromkeys(note for note in others if note.endswith("?"))
    for log in logs:
        for before, after in pairwise(pieces_of(log)):
            start, stop = log.times[before.stop - 1] - origin, log.times[after.start] - origin
            if start < last and stop > first:
                gap = f"a gap of {stop - start:.3g} s after {start:.3g} s"
                remarks.append(f"{gap} is bridged by a straight line")
    if off := sum(int(np.count_nonzero(~log.torque_on)) for log in logs):
        rows, did = sum(len(log.times) for log in logs), "the state is what a hand or gravity did"
        remarks.append(f"the torque is off in {off} of {rows} rows: {did}")
    return remarks


def _limits(
    paths: Sequence[Path], limits: JointLimits | None, names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Limits by joint: the arguments, or of a share of a range the range itself."""
    lower, upper = limits_of_each(limits, names)
    spans = dict(zip(names, zip(lower.tolist(), upper.tolist(), strict=True), strict=True))
    if limits is None or isinstance(limits, Mapping):
        spans = {name: span for name, span in spans.items() if limits and name in limits}
    for each in paths:
        if each.unit == "1":
            values = np.concatenate([each.angles, each.requests])
            spans.setdefault(each.name, limits_in_shares(each.model, values))
    return spans


# Models of recordings.


@dataclass(frozen=True, kw_only=True)
class JointModels:
    """The models of a replay, the default under the key ""; their origin in words, and remarks."""

    by_joint: Mapping[str, JointModel]
    words: str = ""
    remarks: tuple[str, ...] = ()
    of_recording: bool = False  # whether they were identified from what is replayed


def readable_logs(recordings: Sequence[Recording]) -> Iterator[Sequence[Log]]:
    """The logs of each recording that can be read."""
    for recording in recordings:
        with suppress(PlannerError):  # reported when it is planned
            yield recording.read()


def models_from(
    recordings: Sequence[Recording], joints: Sequence[str], progress: Callable[[str], None]
) -> JointModels:
    """Models of these joints, or of all but grippers, identified from the recordings themselves."""
    from planner.identification.identify import identify  # slow to import

    used = recordings[:10]  # more of the same robot add little, and time grows with each
    by_joint = dict[str, list[Log]]()
    for log in chain.from_iterable(readable_logs(used)):
        by_joint.setdefault(log.joint or "joint", []).append(log)
    if not by_joint:
        used[-1].read()  # raises what is wrong with it
    for name in joints:
        _check_named("joints", "joint", name, by_joint)
    models, remarks, refused = dict[str, JointModel](), list[str](), dict[str, str]()
    words = "no model of any joint fits the recording; identify the joints from better logs"
    failure: PlannerError = InvalidInput(words)
    for name in joints or without_grippers(by_joint):
        progress(f"identifying {name}")
        try:
            identification = identify(by_joint[name])
        except PlannerError as error:
            remarks.append(f"{name}: no model: {error}")
            failure = error
            continue
        if identification.accepted:
            models[name] = identification.model
        else:
            refused[name] = identification.reason
    if not models:
        raise failure
    if refused:
        of = "its model describes" if len(refused) == 1 else "their models describe"
        words = f"left at the recorded requests, {of} the recording too badly"
        remarks.append(f"{with_reasons(refused)}: {words}")
    first = f"first {len(used)} of " if len(used) < len(recordings) else ""
    words = f"the {first}{len(recordings)} recordings" if recordings[1:] else "the recording"
    return JointModels(
        by_joint=models,
        words=f"models: identified from {words}",
        remarks=tuple(remarks),
        of_recording=True,
    )
