"""How fast a recording can be replayed within a tolerance: constant factors, and varying ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import filterfalse, islice
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from planner.arrays import Array, Summarised, Summary, as_number, check_choice, shown
from planner.exceptions import Infeasible, InvalidInput, PlannerError
from planner.planning.bounds.certify import lower_bound
from planner.planning.bounds.reachable_set import distance_from_rest
from planner.planning.task import JointLimits
from planner.recording.recorded_path import Models, Path, RecordedPath, Track, recorded_path
from planner.recording.replaying import JointReplay, Kind, Replay, replay_at

if TYPE_CHECKING:
    from kinematics import Leg

Retime = Literal["constant", "varying"]  # one factor for the whole recording, or one along it
Progress = Callable[[str], None]

SLOWEST = 1.0 / 16.0  # least factor that is tried
GRID = 0.05  # distance of the moments at which a varying factor is set [s of the recording]
ROUNDS = 14  # rounds in which a varying factor is changed, each a plan


class SpeedErrors(NamedTuple):
    """Largest errors at a speed, of the joint farthest from its tolerance, in multiples of it."""

    speed: float  # the factor
    direct: float  # with the path as it is as requests
    shifted: float  # with the best time shift of it
    planned: float  # of the plan
    bound: float  # lower bound for any requests; NaN where none is known


class Impossible(NamedTuple):
    """The proof that a speed is too high."""

    speed: float  # the lowest factor that is proved too high, to the resolution of the search
    joint: str  # the joint that no requests bring within the tolerance
    bound: float  # the lower bound on its largest error, in multiples of the tolerance
    # whether it holds for the joint's model only: its logs leave open how fast the joint can be,
    # and ``v_max`` is the least top speed that fits them
    of_model_only: bool = False


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fastest(Summarised):
    """The fastest replay found within a tolerance.

    Attributes:
        replay: Its requests, which keep the tolerance.
        constant: The largest constant factor found.
        tolerance: Largest error allowed: of joints [rad; of shares of a range as many percent as
            it has degrees], or of the foot [m].
        foot: Whether it is about the foot.
        retime: Whether the factor varies.
        largest: Largest error of the replay, in multiples of the tolerance.
        impossible: A speed that is proved too high; None where none is.
        contradicted: Joints whose motion at the recorded speed no requests reach by their models,
            from rest: no speed is proved too high then.
        curve: Errors over speed, in multiples of the tolerance.
    """

    replay: Replay
    constant: float
    tolerance: float
    foot: bool
    retime: Retime
    largest: float
    impossible: Impossible | None
    curve: tuple[SpeedErrors, ...]
    contradicted: tuple[str, ...] = ()

    def _summarised(self) -> Summary:
        """The replay, and the speed that is proved too high."""
        replay = self.replay._summarised()
        proved = "no speed is proved too high"
        if self.impossible is not None:
            proved = f"{self.impossible.speed:.4g} times is proved too high"
        allowed = f"{self.tolerance:.4g} {'m of the foot' if self.foot else 'rad'}"
        return replay._replace(head=f"{replay.head}, within {allowed}; {proved}")

    @property
    def speed(self) -> float:
        """Recorded duration over that of the replay."""
        return self.replay.speed

    @cached_property
    def factors(self) -> Array:
        """The speed from each request to the next, shape (n - 1,)."""
        return np.asarray(np.diff(self.replay.moments) / self.replay.period)


def fastest(
    recording: Any,
    models: Models,
    *,
    tolerance: float | None = None,
    foot_tolerance: float | None = None,
    leg: Leg | None = None,
    retime: Retime = "constant",
    track: Track = "state",
    joints: Sequence[str] = (),
    begin: float | None = None,
    end: float | None = None,
    rate: float | None = None,
    limits: JointLimits | None = None,
    progress: Progress = lambda _: None,
    **options: Any,
) -> Fastest:
    """The fastest replay of a recording at which the plan stays within a tolerance.

    The largest constant factor is found by bisection, each trial a plan, whose largest error by the
    exact model decides, and how far straight lines between its samples cut the path; a lower bound
    above the tolerance proves a speed too high for any requests. With ``retime="varying"`` the
    factor then changes along the recording, slower where errors are large and faster where they are
    small, with a bounded acceleration of time.

    Args:
        recording: As of :func:`planner.replay`.
        models: As of :func:`planner.replay`.
        tolerance: Largest error of any planned joint [rad]; of a joint in shares of its range as
            many percent as this has degrees.
        foot_tolerance: In its place the largest distance of the foot from its path [m]; there is no
            lower bound for it.
        leg: With it, the leg or arm, whose joints are all planned.
        retime: "constant" or "varying".
        track: As of :func:`planner.replay`, and so are the next five.
        joints: The joints to plan.
        begin: Where to begin [s].
        end: Where to end [s].
        rate: Requests per second.
        limits: Smallest and largest request.
        progress: Called with the name of each trial.
        **options: Further options of :func:`planner.plan`.

    Returns:
        The replay, and a proof that it could not be much faster.

    Raises:
        Infeasible: The tolerance is missed at every speed; the message says by how much.
        InvalidInput: An argument is out of its range; see :func:`planner.replay`.

    Example:
        >>> import numpy as np
        >>> from planner import JointModel, Log, simulate
        >>> servo = JointModel.ers210a()
        >>> times = servo.period * np.arange(250)
        >>> requests = 0.5 - 0.5 * np.cos(np.pi * times)  # rad
        >>> angles = simulate(servo, requests, cyclic=False)
        >>> log = Log(times=times, requests=requests, angles=angles)
        >>> result = fastest(log, servo, tolerance=np.radians(2.0))
        >>> bool(2.5 < result.speed <= result.impossible.speed < 4.5)
        True
    """
    check_choice("retime", retime, get_args(Retime))
    path = recorded_path(recording, models, track, joints, begin, end, rate, limits)
    search = Search(path, tolerance, foot_tolerance, leg, progress=progress, **options)
    return search.fastest(retime)


class Search:
    """Plans at several speeds, each computed once; errors in multiples of the tolerance.

    A tolerance [rad], or one for the foot of a leg [m]; see :func:`fastest`.
    """

    def __init__(
        self,
        path: RecordedPath,
        tolerance: float | None = None,
        foot_tolerance: float | None = None,
        leg: Leg | None = None,
        *,
        progress: Progress = lambda _: None,
        **options: Any,
    ) -> None:
        if (tolerance is None) == (foot_tolerance is None):
            raise InvalidInput("tolerance: got none, or two; expected that of joints, or of a foot")
        value = tolerance if foot_tolerance is None else foot_tolerance
        self.tolerance = as_number(value)
        if not self.tolerance >= 1e-9:  # below, nothing but rounding is left
            raise InvalidInput(
                f"tolerance: got {shown(value)}, expected more than 0: 1e-09 or more"
            )
        if foot_tolerance is not None and leg is None:
            raise InvalidInput("foot_tolerance: needs the leg whose foot is meant; give leg=")
        self.leg, names = None if foot_tolerance is None else leg, [p.name for p in path.planned]
        joints = () if self.leg is None else self.leg.joint_names
        if missing := [name for name in joints if name not in names]:
            words = f"is not planned; planned joints: {', '.join(names)}"
            raise InvalidInput(f"leg: its joint '{missing[0]}' {words}")
        self.places = tuple(map(names.index, joints))  # of the leg's joints among the planned ones
        self.path, self.progress = path, progress
        self.options = {key: value for key, value in options.items() if key != "norm"}
        self.replays: dict[float, Replay] = {}
        self.refuted = cache(self._refuted)
        self.of_pose = path.load_at is not None or options.get("load") is not None
        self.bounded = self.leg is None and not self.of_pose

    def fastest(self, retime: Retime = "constant") -> Fastest:
        """The fastest replay, and the proof; see :func:`fastest`."""
        contradicted = self.contradicted()
        (low, high), impossible = self.bracket(), None
        if self.bounded and not contradicted:
            below, refuted = self.doubled(low, self.refuted)
            if below < refuted:
                impossible = self.refuted(narrowed(below, refuted, self.refuted)[1])
        high = min(high, impossible.speed) if impossible else high
        constant = self.replays[narrowed(low, high, self.misses)[0]]
        replay = constant if retime == "constant" else self.varying(constant)
        return Fastest(
            replay=replay,
            constant=constant.speed,
            tolerance=self.tolerance,
            foot=self.leg is not None,
            retime=retime,
            largest=self.largest(replay),
            impossible=impossible,
            curve=self.curve(constant.speed, impossible),
            contradicted=contradicted,
        )

    def of_path(self, path: Path) -> float:
        """Tolerance of a joint [rad, or shares of its range]."""
        return math.degrees(self.tolerance) / 100.0 if path.unit == "1" else self.tolerance

    def errors(self, replay: Replay, kind: Kind) -> Array:
        """Largest error of each sample over the tolerance, shape (n,), by kind of requests."""
        off = np.column_stack([each.error_of(kind) for each in replay.planned])
        if self.leg is None:
            allowed = [self.of_path(each.path) for each in replay.planned]
            return np.asarray(np.max(np.abs(off) / allowed, axis=1))
        desired = np.column_stack([each.desired for each in replay.planned])[:, self.places]
        feet = self.leg.foot_positions(desired + off[:, self.places])
        apart = np.linalg.norm(feet - self.leg.foot_positions(desired), axis=1)
        return np.asarray(apart / self.tolerance)

    def largest(self, replay: Replay) -> float:
        """Largest error of a plan over the tolerance; of joints also on lines between samples."""
        at_samples = float(np.max(self.errors(replay, "planned")))
        if self.leg is not None:
            return at_samples
        between = (each.between / self.of_path(each.path) for each in replay.planned)
        return max(at_samples, *between)

    def late(self, replay: Replay) -> list[JointReplay]:
        """The joints that a plan for the largest error may bring within the tolerance."""
        return [
            each
            for each in replay.planned
            if self.leg is not None
            or (each.inversion and each.inversion.max_error > self.of_path(each.path))
        ]

    def bracket(self) -> tuple[float, float]:
        """A constant factor that keeps the tolerance, and the largest that may: up to twice it."""
        low = 1.0
        if not self.misses(low):
            return self.doubled(low, self.misses)
        self.check_slowest()
        while self.misses(low := low / 2.0):
            if low / 2.0 < SLOWEST:
                least = self.largest(self.replays[min(self.replays)])
                words = f"the plan still is {least:.3g} times as far off as allowed"
                advice = "allow more, or choose a part that begins at rest"
                raise Infeasible(f"tolerance: at {low:g} times the speed {words}; {advice}")
        return low, 2.0 * low

    def check_slowest(self) -> None:
        """Raise Infeasible where the hardest second is far beyond the tolerance even if slow."""
        path, replay = self.path, self.replays[1.0]
        worst = replay.moments[np.argmax(self.errors(replay, "planned"))]
        first, last = max(path.first, worst - 0.75), min(path.last, worst + 0.25)
        part, settled = replace(path, first=first, last=last), 0.5 * (worst - first)
        self.progress(f"{SLOWEST:.3g} times the speed near {worst:.4g} s")
        try:
            slow = replay_at(part, part.moments(SLOWEST), speed=SLOWEST, **self.options)
        except PlannerError:
            return  # the search meets it where it matters
        late = slow.moments >= first + settled  # the part begins at rest, in motion
        least = float(np.max(self.errors(slow, "planned")[late]))
        if least > 5.0:  # the plan for the largest error gains less
            raise Infeasible(
                f"tolerance: at {SLOWEST:g} times the speed the plan near {worst:.4g} s still is "
                f"{least:.3g} times as far off as allowed; allow more"
            )

    def doubled(self, low: float, too_fast: Callable[[float], Any]) -> tuple[float, float]:
        """A factor, doubled until twice it is ``too_fast``, and twice it; itself if none is."""
        while 2.0 * low <= 64.0 and self.has_rows(2.0 * low):
            if too_fast(2.0 * low):
                return low, 2.0 * low
            low *= 2.0
        return low, low

    def contradicted(self) -> tuple[str, ...]:
        """Joints whose motion no requests reach at its speed; Infeasible if from a later row on."""
        path = self.path
        if not self.bounded or path.track != "state" or not self.misses(1.0):
            return ()
        late = tuple(name for name, ratio in self.bounds(1.0, path.first) if ratio > 1.0)
        # at most a hundred moments, of which two dozen may be proved; the first seconds come first
        step = max(path.period, path.duration / 200.0)
        step = path.period * math.ceil(step / path.period - 1e-6)
        every = np.arange(path.first + step, path.first + path.duration / 2.0, step)
        for moment in islice(filterfalse(self.leaves_at_once, every), 24):
            ends = (min(moment + 2.0, path.last), path.last)
            if late and all(r <= 1.0 for end in ends for _, r in self.bounds(1.0, moment, end)):
                raise Infeasible(
                    f"begin: got {path.first:.4g} s, where the recording is in motion: from rest "
                    f"no requests keep {', '.join(late)} within the tolerance at its own speed, "
                    f"though the robot did; expected a moment without such motion, as {moment:.4g} "
                    "s"
                )
        return late

    def leaves_at_once(self, moment: float) -> bool:
        """Whether a joint is off before requests from rest at a moment can move it: (3) alone."""
        for path in self.path.planned:
            assert path.model is not None, "planned joints have models"
            if path.load is None and not path.model.exceeds_v_max:
                window, hold = path.model.window, path.model.hold
                unloaded = np.zeros(hold + window.first + len(window.weights))
                near = distance_from_rest(path.model, unloaded, "envelope")[::hold]
                moments = np.asarray(moment + self.path.period * np.arange(len(near)))
                angles = path.at(moments, path.followed)
                if np.any(np.abs(angles - angles[0]) - near > self.of_path(path)):
                    return True
        return False

    def curve(self, speed: float, impossible: Impossible | None) -> tuple[SpeedErrors, ...]:
        """Errors from well below the factor found to beyond the one that is impossible."""
        last = 1.15 * (impossible.speed if impossible else 1.5 * speed)
        speeds = np.geomspace(0.5 * speed, last, 7)
        speeds[np.argmin(np.abs(np.log(speeds / speed)))] = speed
        errors = []
        for factor in map(float, speeds):
            replay = self.at(factor) if self.has_rows(factor) else None
            if replay is None:
                break
            kinds: tuple[Kind, ...] = ("direct", "shifted", "planned")
            direct, shifted, planned = (float(np.max(self.errors(replay, kind))) for kind in kinds)
            bound = math.nan
            if self.bounded:
                bound = max(ratio for _, ratio in self.bounds(factor, self.path.first))
            errors.append(SpeedErrors(factor, direct, shifted, planned, bound))
        return tuple(errors)

    def varying(self, constant: Replay) -> Replay:
        """A replay whose factor changes along the recording, at least as fast as the constant one.

        Every round multiplies the factor at each moment by (0.97 tolerance / error)^0.4, by 1.25 at
        most, and limits its acceleration to that from standstill to the constant factor in half a
        second.
        """
        path = self.path
        at = np.arange(path.first, path.last + GRID, GRID)
        factors = np.full(len(at), constant.speed)
        best = replay = constant
        for number in range(ROUNDS):
            self.progress(f"varying speed, round {number + 1} of {ROUNDS}")
            errors, near = self.errors(replay, "planned"), 0.15 * replay.speed
            first, last = (np.searchsorted(replay.moments, at + far) for far in (-near, near))
            # a joint answers over its lag and acceleration time; ratios stay finite
            local = [np.max(errors[a:b], initial=1e-3) for a, b in zip(first, last, strict=True)]
            factors *= np.clip((0.97 / np.array(local)) ** 0.4, 1.0 / 1.25, 1.25)
            squares = np.minimum(factors, 6.0 * constant.speed) ** 2
            for along in (squares, squares[::-1]):  # d(r^2)/ds = 2 dr/dt along the recording
                for k in range(1, len(along)):
                    along[k] = min(along[k], along[k - 1] + 4.0 * constant.speed * GRID)
            factors = np.sqrt(squares)
            changed = self.attempt(_moments(path, at, factors))
            if changed is None:
                break
            replay = changed
            if len(replay.moments) < len(best.moments) and self.largest(replay) <= 1.0:
                best = replay
        return best

    def at(self, speed: float) -> Replay | None:
        """The replay at a constant factor; see :meth:`attempt`."""
        if speed not in self.replays:
            self.progress(f"{speed:.3g} times the speed")
            if replay := self.attempt(self.path.moments(speed), speed):
                self.replays[speed] = replay
        return self.replays.get(speed)

    def attempt(self, moments: Array, speed: float | None = None) -> Replay | None:
        """A replay near the tolerance, late joints by largest error; None if no load settles."""
        try:
            replay = replay_at(self.path, moments, speed=speed, **self.options)
            if self.largest(replay) <= 1.0 or not (late := self.late(replay)):
                return replay
            plans = {each.name: each.inversion for each in replay.planned if each not in late}
            again = replay_at(
                self.path, moments, speed=speed, known=plans, norm="max", **self.options
            )
        except PlannerError:
            if self.of_pose and self.replays:
                return None
            raise
        errors = [np.max(self.errors(each, "planned")) for each in (replay, again)]
        return again if errors[1] < errors[0] else replay

    def misses(self, speed: float) -> bool:
        """Whether no replay at a constant factor keeps the tolerance."""
        replay = self.at(speed)
        return replay is None or not self.largest(replay) <= 1.0

    def has_rows(self, speed: float) -> bool:
        """Whether enough requests remain to speak of a motion."""
        return self.path.duration / (speed * self.path.period) >= 8

    def _refuted(self, speed: float) -> Impossible | None:
        """The proof that a factor is too high, where there is one."""
        open_speeds = self.path.open_top_speeds
        late = (each for each in self.bounds(speed, self.path.first) if each[1] > 1.0)
        return next((Impossible(speed, *each, each[0] in open_speeds) for each in late), None)

    def bounds(
        self, speed: float, first: float, last: float = math.inf
    ) -> Iterator[tuple[str, float]]:
        """By joint the bound on its largest error over the tolerance, known top speeds first."""
        part = replace(self.path, first=first, last=min(last, self.path.last))
        moments, unknown = part.moments(speed), self.path.open_top_speeds
        for path in sorted(self.path.planned, key=lambda each: each.name in unknown):
            assert path.model is not None, "planned joints have models"
            desired = path.at(moments, path.followed)
            begins = "" if first == self.path.first else f" from {first:.4g} s"
            self.progress(f"{path.name}: the lower bound at {speed:.3g} times the speed{begins}")
            bound = lower_bound(
                path.model,
                desired,
                cyclic=False,
                norm="max",
                start=float(desired[0]),
                load=None if path.load is None else path.at(moments, path.load),
            )
            yield path.name, bound / self.of_path(path)


def narrowed(low: float, high: float, too_fast: Callable[[float], Any]) -> tuple[float, float]:
    """Two factors, close to each other, of which the higher one alone is ``too_fast``."""
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if too_fast(middle) else (middle, high)
    return low, high


def _moments(path: RecordedPath, at: Array, factors: Array) -> Array:
    """The moment of each request [s], with ds/dt = factors at ``at``, and linear in t between."""
    first, last, steps = factors[:-1], factors[1:], np.diff(at)
    spent = 2.0 * steps / (first + last)
    bends = (last**2 - first**2) / (2.0 * steps)
    time = np.concatenate([[0.0], np.cumsum(spent)])
    now = path.period * np.arange(math.floor(time[-1] / path.period + 1e-6) + 1)
    piece = np.clip(np.searchsorted(time, now, side="right") - 1, 0, len(steps) - 1)
    since = now - time[piece]
    moments = at[piece] + first[piece] * since + bends[piece] * since**2 / 2.0
    return np.asarray(np.minimum(moments[moments <= path.last + 1e-9], path.last))
