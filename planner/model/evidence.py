"""Evidence of a model: its test, the error to expect on the robot, and parameter intervals."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, Mask, as_reals, rms, shown
from planner.exceptions import InvalidInput

WINDOW = 2.0
"""Part of a log whose error and acceleration are one point of the fit [s]: several times the lag
and the window of a joint. (Half and twice: as good.)"""

SPARE = 1.1
"""A motion is outside the tested range where it exceeds it by this factor."""

OTHER = 1.8
"""Factor by which the errors of other motions scatter beside those of the parts of one log, in 90 %
of cases. (Of 31 servos, 93 motions that were planned.)"""

GAIN = "gain"
"""v_max / theta_0 [1/s], which logs determine better than theta_0."""

OPEN_TOP_SPEED = "the logs do not determine the top speed; v_max is a lower bound"
"""Of a joint with :attr:`Evidence.leaves_top_speed_open`."""

WORSE = 2.0
"""Factor over the expected error up to which a model holds whose test says nothing about the range
of its errors, over the largest expected one of a recording up to which a model fits it, and over
the error of another model up to which it is no worse."""

SMALL = math.radians(0.3)
"""Error that is never worth a new model [rad]: three counts of a sensor of 12 bits."""

UNFORESEEN = 0.2
"""Expected error of a change of the angles by the model, as a share of the change [-]. (Of 33 first
trials on servos from their physics the middle half missed 0.13 to 0.28 of it; by the model alone
their errors were up to five times the predicted ones.)"""

ENCODER_STEP = 2.0 * math.pi / 4096.0
"""Step of an encoder of 12 bits for a turn [rad]: the unit of requests and measured angles."""

TRACKING = "moving requests"
"""In :meth:`Evidence.exceeded`: a motion that logs of steps do not contain."""

PROVEN = 0.8
"""Share of the error of a pure delay up to which a model is clearly better than a delay. With other
models a robot need not show the predicted gain over a time shift."""

Verdict = Literal["holds", "usable", "worse than a delay", "refused"]
"""Whether a model may be planned with, see section 8 of ``docs/math.md``."""

ACCEPTED: tuple[Verdict, ...] = ("holds", "usable")
"""Verdicts on models that may be planned with."""

AngleUnit = Literal["rad", "range"]
"""What the angles of a model are: angles, or shares of the joint's range."""

ALIKE = 0.7
"""Correlation up to which a plan's own error and that of its model may add up or cancel: on eleven
servos from their physics it was -0.70 to 0.64."""


class Evidence(NamedTuple):
    """Test error of a model, the range of the tests, and the intervals of its parameters.

    What is not known is NaN, empty, or a range without ends, unless it says otherwise.
    """

    error: float = math.nan  # root mean square error on rows that were not fitted [rad]
    speed: float = math.inf  # fastest tested motion [rad/s]; infinite where it is not known
    load: float = 0.0  # largest tested torque [N m]; 0 where none is known
    angles: tuple[float, float] = (-math.inf, math.inf)  # least and largest tested angle [rad]
    # pairs of a root mean square acceleration [rad/s^2], increasing, and the root mean square error
    # of such motion [rad]; the last acceleration is the largest of a part of the logs
    by_acceleration: tuple[tuple[float, float], ...] = ()
    # where the logs hold steps only, half the width of the 95 % interval of the time by which the
    # joint trails requests that move [s]; 0 where such requests were tested
    delay_error: float = 0.0
    # least and largest error of a motion in 90 % of cases, as shares of the expected one
    spread: tuple[float, float] = (0.0, math.inf)
    over_delay: float = math.nan  # the error over that of the best pure delay [-]
    # least and largest value of parameters with 95 % confidence, SI units, by their names in a
    # JointModel; "gain", v_max / theta_0 [1/s], replaces theta_0
    intervals: Mapping[str, tuple[float, float]] = {}
    # of the parameters in the order of the intervals, (p, p); empty where they are independent
    correlations: tuple[tuple[float, ...], ...] = ()
    verdict: Verdict | None = None  # whether the model may be planned with
    reason: str = ""  # why, in words
    unit: AngleUnit | None = None  # what the angles are; None where it is not known

    @property
    def refused(self) -> bool:
        """Whether the model is not to be planned with."""
        return self.verdict is not None and self.verdict not in ACCEPTED

    @property
    def leaves_top_speed_open(self) -> bool:
        """Whether v_max is only a lower bound: the logs do not show how fast the joint can be."""
        return not math.isfinite(self.intervals.get("v_max", (0.0, math.inf))[1])

    @property
    def depends_on_motion(self) -> bool:
        """Whether the error to expect differs from motion to motion."""
        return bool(self.by_acceleration) or self.delay_error > 0.0

    def error_of(self, angles: Array, *, period: float, cyclic: bool) -> float:
        """Error of the model to expect of a motion [rad], rms: (19) and (19a) of ``docs/math.md``.

        The ``angles`` are those by the model [rad], (n,), with a ``period`` between them [s].
        """
        return math.hypot(*self._errors_of(_motion(angles, period, cyclic=cyclic)))

    def _errors_of(self, motion: tuple[Array, Array]) -> tuple[float, float]:
        """Error by the test, and error by the interval of the delay [rad], rms."""
        speeds, accelerations = motion
        by_delay, size = self.delay_error * rms(speeds), rms(accelerations)
        if not self.by_acceleration:
            return self.error, by_delay
        sizes, errors = np.transpose(self.by_acceleration)
        beyond = max(size / sizes[-1], 1.0) if sizes[-1] > 0.0 else 1.0
        return float(np.interp(size, sizes, errors)) * beyond, by_delay

    def exceeded(
        self, angles: Array, *, period: float, cyclic: bool, load: Array | float = 0.0
    ) -> tuple[str, ...]:
        """Quantities by which a motion is outside the tested range, of the model's angles (n,).

        They are "speed", "acceleration", "angle", "load" and, where after a log of steps the
        interval of the delay adds more than the tested error and an encoder's step, "moving
        requests".
        """
        speeds, accelerations = motion = _motion(angles, period, cyclic=cyclic)
        tested, by_delay = self._errors_of(motion)
        # The part, as long as those of the tests, that accelerates most
        length = max(min(round(WINDOW / period), len(accelerations)), 1)
        closed = np.append(accelerations, accelerations[: length - 1] if cyclic else [])
        sums = np.cumsum(np.append(0.0, closed) ** 2)
        hardest = math.sqrt(float(np.max(sums[length:] - sums[:-length], initial=0.0)) / length)
        most = self.by_acceleration[-1][0] if self.by_acceleration else math.inf
        low, high = self.angles
        spare = 0.1 * (high - low) if math.isfinite(high - low) else 0.0
        checks = {
            "speed": np.max(np.abs(speeds), initial=0.0) > SPARE * self.speed,
            "acceleration": hardest > SPARE * most,
            "angle": bool(np.any((angles < low - spare) | (angles > high + spare))),
            "load": np.max(np.abs(load), initial=0.0) > SPARE * self.load,
            TRACKING: by_delay > max(tested, ENCODER_STEP),
        }
        return tuple(name for name, outside in checks.items() if outside)

    def compared(self, angles: Array, *, period: float) -> tuple[Mask, float, float]:
        """Which angles by the model, (n,), are inside the tested range, and their error to expect.

        That is rms [rad], and of the whole motion where none is inside. The last is the error that
        19 of 20 such motions stay below, or :data:`SMALL`.
        """
        length = max(min(round(WINDOW / period), len(angles)), 1)
        within = np.zeros(len(angles), dtype=bool)
        begins = {*range(0, len(angles) - length, max(length // 2, 1)), len(angles) - length}
        parts, tested = [slice(k, k + length) for k in begins], list[slice]()
        for part in parts:
            if not {*self.exceeded(angles[part], period=period, cyclic=False)} - {TRACKING}:
                within[part] = True
                tested.append(part)
        errors = (self.error_of(angles[k], period=period, cyclic=False) for k in tested or parts)
        expected, largest = rms(np.array([*errors])), self.spread[1]
        return within, expected, max(SMALL, expected * (largest if largest < math.inf else WORSE))

    def scaled(self, factor: float, names: Sequence[str]) -> Evidence:
        """The same evidence in a unit of angles so many times as small, that of ``names``."""
        low, high = self.angles
        pairs = tuple((factor * size, factor * error) for size, error in self.by_acceleration)
        intervals = {
            name: (factor * least, factor * most) if name in names else (least, most)
            for name, (least, most) in self.intervals.items()
        }
        return self._replace(
            error=factor * self.error,
            speed=factor * self.speed,
            angles=(factor * low, factor * high),
            by_acceleration=pairs,
            intervals=intervals,
        )


def check_unit(joint: str, evidence: Evidence | None, *, shares: bool) -> None:
    """Raise InvalidInput where angles, or ``shares`` of a range, meet a model known of the other.

    Example:
        >>> check_unit("jaw", Evidence(unit="range"), shares=True)
    """
    if evidence is None or evidence.unit is None or (evidence.unit == "range") == shares:
        return
    name, of = joint or "joint", f"the model of {joint}" if joint else "the model"
    got, known, expected = (
        ("shares of its range", "in radians", f"angles: columns {name}_deg or {name}_rad")
        if shares
        else ("angles", "in shares of its range", f"{name}_percent or {name}_range (0 to 1)")
    )
    raise InvalidInput(
        f"{of} is {known}, but the joint's positions are {got}; expected {expected}, or a model "
        f"that was identified from logs in {got}"
    )


def refusal(evidence: Mapping[str, Evidence | None]) -> str:
    """Which models are not to be planned with, and why, in a line; empty for none.

    The key "" is every other joint.

    Example:
        >>> refusal({"knee": Evidence(verdict="refused", reason="it misses 41 % of the motion")})
        'do not plan with the model of knee (it misses 41 % of the motion): identify it anew'
    """
    default = "every other joint" if len(evidence) > 1 else ""
    refused = {
        joint or default: each.reason or str(each.verdict)
        for joint, each in evidence.items()
        if each is not None and each.refused
    }
    if not refused:
        return ""
    if "" in refused:
        which, them = f"model ({' '.join(refused[''].split())})", "it"
    else:
        which, them = ("model", "it") if len(refused) == 1 else ("models", "them")
        which += f" of {with_reasons(refused)}"
    verdicts = {each.verdict for each in evidence.values() if each is not None and each.refused}
    instead = "" if "refused" in verdicts else "use --method shift, or "
    return f"do not plan with the {which}: {instead}identify {them} anew"


def unproven_gains(names: Sequence[str], evidence: Sequence[Evidence | None]) -> str:
    """Joints whose models are hardly better than a pure delay, in a line; empty for none.

    Example:
        >>> unproven_gains(["hip", "knee"], [Evidence(over_delay=0.93), Evidence(over_delay=0.2)])
        'on rows held out the error of the model is near that of a pure delay: hip (93 %)'
    """
    shares = [
        f"{name} ({100.0 * each.over_delay:.0f} %)"
        for name, each in zip(names, evidence, strict=True)
        if each is not None and each.over_delay > PROVEN
    ]
    words = "on rows held out the error of the model is near that of a pure delay"
    return f"{words}: {', '.join(shares)}" if shares else ""


def with_reasons(reasons: Mapping[str, str]) -> str:
    """Joints with their reasons in brackets, grouped by reason, in a line.

    Example:
        >>> with_reasons({"hip": "shaken", "knee": "shaken", "ankle": "overloaded"})
        'hip, knee (shaken), ankle (overloaded)'
    """
    joints: dict[str, list[str]] = {}
    for joint, reason in reasons.items():
        joints.setdefault(" ".join(reason.split()), []).append(joint)
    groups = list(joints.items())[:3]  # the rest is in the file
    listed = ", ".join(f"{', '.join(names)} ({reason})" for reason, names in groups)
    more = len(reasons) - sum(len(names) for _, names in groups)
    return f"{listed} and {more} more" if more else listed


def warn_of_refused(evidence: Mapping[str, Evidence | None]) -> None:
    """Warn of models that are not to be planned with; see :func:`refusal`."""
    if words := refusal(evidence):
        warnings.warn(words, UserWarning, stacklevel=3)


def check_correlations(evidence: Evidence) -> None:
    """Raise InvalidInput unless the correlations fit the intervals, or there are none."""
    correlations, names = evidence.correlations, evidence.intervals
    try:
        matrix = as_reals(correlations)
    except (TypeError, ValueError):
        matrix = np.array(math.nan)
    if (
        matrix.shape not in ((0,), (len(names), len(names)))
        or not np.all(np.abs(matrix) <= 1.0)
        or not np.array_equal(matrix, matrix.T)
        or not np.all(np.diagonal(np.atleast_2d(matrix)) == 1.0)
    ):
        raise InvalidInput(
            f"correlations: got {shown(correlations)}, expected a symmetric matrix of numbers from "
            f"-1 to 1, with 1 on its diagonal and a row for each interval: "
            f"{', '.join(names) or 'none'}"
        )


class Expectation(NamedTuple):
    """What to expect of a plan on the robot; NaN where that is not known."""

    error: float  # root mean square error to expect [rad]
    # quantities by which the motion is outside the model's tested range, see
    # :meth:`Evidence.exceeded`; the error may then be larger
    untested: tuple[str, ...]
    low: float = math.nan  # error that 5 % of such motions stay below [rad]
    high: float = math.nan  # error that 5 % of such motions exceed [rad]


def expectation(
    evidence: Evidence | None,
    desired: Array,
    predicted: Array,
    *,
    period: float,
    cyclic: bool,
    load: Array | None = None,
) -> Expectation:
    """The error to expect: the errors of plan and model, taken as independent.

    For the range, of the model's error in 90 % of motions like this one, the two may also add up,
    or cancel, by a correlation of ``ALIKE``.
    """
    if evidence is None or math.isnan(evidence.error):
        return Expectation(math.nan, ())
    torque = 0.0 if load is None else load
    untested = evidence.exceeded(predicted, period=period, cyclic=cyclic, load=torque)
    tested, by_delay = evidence._errors_of(_motion(predicted, period, cyclic=cyclic))
    own, low, high = rms(predicted - desired), math.nan, math.nan
    if math.isfinite(evidence.spread[1]):
        least, most = (share * tested for share in evidence.spread)
        most = math.hypot(most, by_delay) if tested else by_delay
        cancels = min(max(ALIKE * own, least), most)  # the error that cancels most of the plan's
        low = math.sqrt(own**2 + cancels**2 - 2.0 * ALIKE * own * cancels)
        high = math.sqrt(own**2 + most**2 + 2.0 * ALIKE * own * most)
    return Expectation(math.hypot(own, math.hypot(tested, by_delay)), untested, low, high)


def untested_words(names: Sequence[str], expected: Sequence[Expectation]) -> str:
    """Joints that move outside the tested range of their models; empty for none."""
    words = {TRACKING: "moving requests: the logs hold steps only"}
    joints = [
        f"{name} ({', '.join(words.get(way, way) for way in each.untested)})"
        for name, each in zip(names, expected, strict=True)
        if each.untested
    ]
    if not joints:
        return ""
    listed = ", ".join(joints)
    return f"outside what the models were tested on, so that errors may be larger: {listed}"


class Run(NamedTuple):
    """Responses of models over consecutive rows of a log."""

    angles: Array  # by a model [rad], (n,)
    errors: Array  # actual angles minus those of each model [rad], (m, n)
    period: float  # [s]


def errors_of_motion(
    runs: Sequence[Run], *, noise: float = 0.0
) -> tuple[tuple[tuple[float, float], ...], tuple[float, float]]:
    """How the error depends on the motion: ``by_acceleration`` and ``spread`` of an Evidence.

    Each run is cut into parts; those in which the joint moves, sorted by their accelerations, make
    six groups, whose errors are those that never fall and are nearest to the means of the
    logarithms: isotonic regression, (19) of ``docs/math.md``. (69 % of 96 plans met 0.7 to 1.4
    times what is told; with three groups 63 %, with twelve 67 %.) The error of a part is the
    geometric mean over the models, less the sensor's ``noise`` [rad], but for a tenth of its
    square. The spread is that of these errors, further apart by what other motions scatter.
    """
    every = np.reshape([part for run in runs for part in _parts(run)], (-1, 3))
    sizes, errors = every[every[:, 0] >= 0.01 * np.max(every[:, 0], initial=0.0), 1:].T
    if len(sizes) < 2 or not np.any(sizes) or not np.any(errors):
        return (), (0.0, math.inf)
    from scipy.optimize import isotonic_regression

    hidden = noise**2 >= 0.9 * errors**2
    errors = np.sqrt(np.maximum(errors**2 - noise**2, 0.1 * errors**2))
    logarithms = np.log(np.maximum(errors, 1e-6 * np.max(errors)))  # less is rounding
    order = np.lexsort((errors, [*map(_rounded, sizes)]))  # whatever order the parts are in
    groups = np.array_split(order, min(6, len(order)))
    knots, number = np.unique(
        [_rounded(np.mean(sizes[group])) for group in groups], return_inverse=True
    )
    counts = np.bincount(number, [len(group) for group in groups])
    means = np.bincount(number, [np.sum(logarithms[group]) for group in groups]) / counts
    told = np.exp(isotonic_regression(means, weights=counts).x)
    largest = _rounded(np.max(sizes))
    if largest > knots[-1]:
        knots, told = np.append(knots, largest), np.append(told, told[-1])
    shares = errors / np.interp(sizes, knots, told)
    low = float(np.quantile(np.where(hidden, 0.0, shares), 0.05))
    high = float(np.quantile(shares, 0.95))
    other = math.log(OTHER)
    if low > 0.0:
        low = math.exp(-math.hypot(min(math.log(low), 0.0), other))
    high = math.exp(math.hypot(max(math.log(high), 0.0), other))
    level = np.diff(told) == 0.0
    bends = ~np.append(False, level) | ~np.append(level, False)  # inside a level nothing bends
    bends[[0, -1]] = True
    pairs = zip(knots[bends].tolist(), map(_rounded, told[bends]), strict=True)
    return tuple(pairs), (_rounded(low), _rounded(high))


def under_moving_requests(requests: Array, period: float) -> npt.NDArray[np.bool_]:
    """Around which rows of a log the requests move, rather than jump and rest, (n,).

    They change in three of four slots of 0.1 s of the second around a row, by more than a hundredth
    of the largest change there; random steps of 0.12 to 0.9 s change in a quarter.
    """
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    rows = max(1, round(0.1 / period))
    around = max(1, round(1.0 / (rows * period)))
    steps = np.abs(np.diff(requests, prepend=requests[:1]))
    ways = np.add.reduceat(steps, np.arange(0, len(steps), rows))
    changed = ways > 0.01 * maximum_filter1d(ways, around, mode="nearest")
    shares = uniform_filter1d(changed.astype(np.float64), around, mode="nearest")
    return np.repeat(shares >= 0.75, rows)[: len(requests)]


def _motion(angles: Array, period: float, *, cyclic: bool) -> tuple[Array, Array]:
    """Speeds and accelerations from one angle to the next [rad/s, rad/s^2]."""
    ends = [angles[-1:], angles, angles[:1]] if cyclic else [angles]
    speeds = np.diff(np.concatenate(ends)) / period
    return speeds, np.diff(speeds) / period


def _parts(run: Run) -> list[tuple[float, float, float]]:
    """Travel, acceleration and error, both rms, of parts of a run, eight or more, half apart."""
    count = len(run.angles) - 2
    length = min(round(WINDOW / run.period), count // 8)
    if length < 2:
        return []
    _, accelerations = _motion(run.angles, run.period, cyclic=False)
    parts = (slice(k, k + length) for k in range(0, count - length + 1, max(length // 2, 1)))
    inner = run.errors[:, 1:-1]
    return [
        (
            float(np.ptp(run.angles[part])),
            rms(accelerations[part]),
            float(np.prod(np.mean(inner[:, part] ** 2, axis=1)) ** (0.5 / len(inner))),
        )
        for part in parts
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
