"""Automated piecewise-linear approximation with bounded slopes: paper, Section 4.1.

The values at the knots are those of least squares, a convex QP ((5) of docs/math.md). The knots are
sought, not proved best (:mod:`planner.approximation.knot_search`); at n = 88, in 5 to 25 ms for 2
to 12 segments. One segment more is hardly ever worse: of 840 pairs seven were, by 0.2 to 0.4 %, all
of a single impulse. The same samples shifted, mirrored, reversed or scaled give the same curve.
With ``exact`` the answer is proved best of all with knots on samples, by ``exact_fit.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.curve import PiecewiseLinear
from planner.approximation.exact_fit import MOST_SAMPLES, proved_best
from planner.approximation.fit_problem import (
    BARELY,
    SAME_PLACE,
    SMALLEST,
    Candidate,
    Problem,
    Question,
    Required,
    check_feasible,
    checked_knots,
    checked_segments,
    even_knots,
    positive,
    with_pins,
)
from planner.approximation.knot_search import KnotSearch
from planner.approximation.largest_error import within_largest_error
from planner.approximation.values import best_values, slope_bounded, within_slopes
from planner.arrays import Array, Summarised, Summary, as_flag, as_trajectory, read_only
from planner.exceptions import Infeasible, InvalidInput, SolverFailed, angle_text

CLOSE_TO_IDEAL = 1.02
"""Rms error over the ideal's that is not worth the corners of more segments."""

ONE_BY_ONE = 16
"""Segments up to which every number is tried; beyond, a bracket grows and is halved. 8: more
segments in 5 of 99 answers; 32: no change."""

HOPELESS = 1.75
"""Squared error of a rough curve over the sufficient one from which on that number of segments is
not searched. Of 364 curves the full search lowered it by 1.04 in one of ten, by 1.4 in one of a
hundred, by 2.4 at most."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PiecewiseLinearFit(Summarised, PiecewiseLinear):
    """A piecewise-linear curve and its samples; its errors are computed from the two.

    Attributes:
        desired: The samples that it approximates [rad], shape (n,).
        v_max: The bound that its slopes keep [rad/s].
        fewest_segments: Where a largest error was given, the fewest segments of any curve that
            keeps it, its own number; of a cycle with required knots a lower bound, its own number
            or one less. With ``exact`` and a largest rms error the number of segments itself, of
            all curves with knots on samples; else None.
        proved: Whether it is proved, by ``exact``, that no other curve of as many segments and with
            knots on samples has a smaller rms error.
    """

    desired: Array
    v_max: float
    fewest_segments: int | None = None
    proved: bool = False

    def _summarised(self) -> Summary:
        """Segments and errors."""
        return Summary(
            f"Fit of {self.segments} segments to {self.samples} samples, one every "
            f"{1e3 * self.tick:.4g} ms, {'cyclic' if self.cyclic else 'with two ends'}: "
            f"{self.rms:.4g} rad rms, {self.max_error:.4g} rad at most"
            f"{'; proved best of knots on samples' if self.proved else ''}"
        )

    @cached_property
    def residuals(self) -> Array:
        """Curve minus desired at the samples [rad], shape (n,)."""
        return read_only(self.angles - self.desired)

    @property
    def rms(self) -> float:
        """Root mean square error over the samples [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def max_error(self) -> float:
        """Largest error at a sample [rad]."""
        return float(np.max(np.abs(self.residuals)))


def fit_pwl(
    desired: npt.ArrayLike,
    *,
    v_max: float,
    tick: float,
    cyclic: bool = True,
    segments: int | None = None,
    max_error: float | None = None,
    max_rms: float | None = None,
    knots: npt.ArrayLike | None = None,
    required: Required = (),
    exact: bool = False,
) -> PiecewiseLinearFit:
    """Approximate ``desired`` by few straight lines that a joint of speed ``v_max`` can follow.

    The curve is continuous, closed if ``cyclic``, and every slope is within ±v_max. The module's
    docstring describes the search of the knots. Cost O(n log n), unless ``exact``.

    Args:
        desired: Angles [rad], shape (n,), n >= 3.
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments; with ``max_error`` or ``max_rms``, the most.
        max_error: Largest error at any sample [rad], kept up to one part in 1e9: the fewest
            segments that keep it, the true minimum (docs/math.md, section 4), and of curves with so
            many segments one of small squared error. With required knots a cycle has one more at
            most, and ``fewest_segments`` of the answer is a lower bound. Beside required knots
            between samples segments may be shorter than a sample. O(n).
        max_rms: Largest rms error [rad], likewise. With none of the three, the fewest segments
            whose rms error is within 2 % of the slope-bounded ideal's, 1 % of the range of
            ``desired``, or 1.1 times its noise; an exact curve within the slopes is recovered.
        knots: All knots [samples], each once, instead of ``segments`` and errors; a path's ends and
            ``required`` are added. Only the values are sought: one QP, O(n).
        required: Indices, whole or not, where there must be a knot; as a mapping, with the angle
            there [rad], or None where it is free. At the ends of a path, 0 and n - 1, there are
            knots in any case.
        exact: Whether to prove the answer best of all with knots on samples; with ``segments`` or
            ``max_rms`` and without ``knots``, n <= 400.

    Raises:
        InvalidInput: An argument is out of its range, no trajectory, or excludes another.
        Infeasible: Requirements contradict each other, the slopes or the error; names the pair.
        SolverFailed: A QP was not solved, or nothing proved in reasonable time.

    Example:
        >>> import numpy as np
        >>> desired = np.sin(2 * np.pi * np.arange(100) / 100)  # [rad], every 8 ms
        >>> lines = fit_pwl(desired, v_max=10.0, tick=0.008, segments=6)
        >>> len(lines.slopes), f"{np.degrees(lines.rms):.2f} deg rms"
        (6, '0.93 deg rms')
    """
    samples = as_trajectory(desired, name="desired", minimum=3)
    cyclic, n = as_flag("cyclic", cyclic), samples.size
    exact = as_flag("exact", exact)
    places, pins = checked_knots(required, n, cyclic=cyclic)
    v_max, tick = positive("v_max", v_max, "rad/s"), positive("tick", tick, "s")
    problem = Problem(desired=samples, step=v_max * tick, cyclic=cyclic, required=places, pins=pins)
    if knots is not None:
        values = as_trajectory(knots, name="knots", minimum=1)
        fixed = checked_knots(values.tolist(), n, cyclic=cyclic, name="knots")[0]
        knots = np.unique([*fixed, *places, *([] if cyclic else [0.0, n - 1.0])])
    question = Question(
        segments=checked_segments(segments, samples, cyclic=cyclic),
        max_error=None if max_error is None else positive("max_error", max_error, "rad"),
        max_rms=None if max_rms is None else positive("max_rms", max_rms, "rad"),
        knots=knots,
        exact=exact,
    )
    _check(problem, question, tick)
    curve, fewest = _curve(problem, question)
    fit = PiecewiseLinearFit(
        knots=curve.knots,
        values=within_slopes(problem, curve.knots, curve.values),
        samples=n,
        tick=tick,
        cyclic=cyclic,
        desired=samples,
        v_max=v_max,
        fewest_segments=fewest,
        proved=exact,
    )
    _certify(fit, question)
    return fit


def _check(problem: Problem, question: Question, tick: float) -> None:
    """Raise an error where arguments exclude each other, or no curve meets them all."""
    segments, _, max_rms, _, exact = question
    named = question._asdict() | {"exact": exact or None}
    excluding = "max_error max_rms exact", "knots segments max_error max_rms exact"
    for first, *others in map(str.split, excluding):
        both = [name for name in others if named[first] is not None and named[name] is not None]
        if both:
            raise InvalidInput(f"{first}, {both[0]}: got both, expected one; leave one out")
    if exact:
        if segments is None and max_rms is None:
            raise InvalidInput(
                "exact, segments, max_rms: got neither of the last two, expected one; add it"
            )
        between = problem.required[problem.required != np.floor(problem.required)]
        if between.size:
            raise InvalidInput(
                f"required, exact: got a knot at sample {between[0]:g}, between samples, but an "
                "optimum is proved for knots on samples; move it to one, or leave out the proof"
            )
        if problem.samples > MOST_SAMPLES:
            raise InvalidInput(
                f"exact: got {problem.samples} samples, expected at most {MOST_SAMPLES}; fit "
                "without it, or thin the samples out"
            )
    check_feasible(problem, question, tick)


def _curve(problem: Problem, question: Question) -> tuple[Candidate, int | None]:
    """The curve, its slopes within ±v_max but for rounding, and with a largest error the fewest."""
    angles = np.append(problem.desired, problem.pins[np.isfinite(problem.pins)])
    middle = 0.5 * (float(angles.max()) + float(angles.min()))
    unit = float(np.max(np.abs(angles - middle)))
    bounded = question.max_error is not None or question.max_rms is not None
    counted = bounded and (question.max_error is not None or question.exact)
    if unit <= SMALLEST:
        segments = 1 if bounded else question.segments or 1
        knots = even_knots(problem, segments) if question.knots is None else question.knots
        fewest = problem.segments(knots) if counted else None
        return Candidate(knots, np.full(knots.size, middle), 0.0), fewest
    scaled = problem._replace(
        desired=(problem.desired - middle) / unit,
        # Where samples span 2 no line is as steep; beyond, rounding is all that is left of them.
        step=min(problem.step / unit, 1e6),
        pins=(problem.pins - middle) / unit,
    )
    fewest = None
    if question.knots is not None:
        curve = best_values(scaled, question.knots)
    else:
        search = KnotSearch(scaled)
        if question.max_error is None:
            curve = _search_curve(search, question, unit)
            fewest = problem.segments(curve.knots) if counted else None
        else:
            bound = question.max_error / unit
            curve, fewest = within_largest_error(search.unrounded, bound, question.segments, unit)
        curve = search.restored(curve)
    knots = np.array(curve.knots)
    for place in problem.required:
        knots[np.abs(knots - place) < SAME_PLACE] = place
    values = with_pins(problem, knots, middle + unit * curve.values)
    return Candidate(knots, values, curve.error), fewest


def _search_curve(search: KnotSearch, question: Question, unit: float) -> Candidate:
    """The curve for the question, by the search, in its unit [rad]."""
    segments, _, max_rms, _, exact = question
    n = search.problem.samples

    def curve_of(count: int) -> Candidate:
        curve = search.curve(count)
        return proved_best(search.problem, curve) if exact else curve

    if max_rms is None and segments is not None:
        return curve_of(segments)
    last = search.most if segments is None else min(segments, search.most)
    if max_rms is None:
        bend = np.abs(np.diff(search.problem.desired, n=2))
        # of white noise on smooth samples; of a normal variable: median, Δ²
        noise = float(np.median(bend)) / (0.6745 * math.sqrt(6.0))
        # worth no further corners: 1 % of the range, which is 2 units, or 1.1 times the noise
        negligible = max(0.02, 1.1 * noise)
        enough = max(CLOSE_TO_IDEAL**2 * search.ideal_error, n * negligible**2)
    else:
        ideal, bound = math.sqrt(search.ideal_error / n), max_rms / unit
        if bound < ideal * (1.0 - BARELY):
            raise Infeasible(
                f"max_rms and v_max: got {angle_text(max_rms)}, but with slopes within ±v_max no "
                f"curve comes closer than {angle_text(ideal * unit)} rms; allow that much or a "
                "larger v_max"
            )
        enough = n * (bound * (1.0 + BARELY)) ** 2 + 1e-24 * n
    if segments is None and not exact and search.exact and search.exact.error <= enough:
        return search.exact
    curve = _fewest(search, curve_of, enough, last, exact) or curve_of(last)
    if max_rms is not None and curve.error > enough:
        raise Infeasible(
            f"max_rms and the number of segments: got {angle_text(max_rms)}, but with at most "
            f"{last} segments{' and knots on samples' if exact else ''} the smallest found is "
            f"{angle_text(math.sqrt(curve.error / n) * unit)}; allow more error or more segments"
        )
    return curve


def _fewest(
    search: KnotSearch, curve_of: Callable[[int], Candidate], enough: float, most: int, every: bool
) -> Candidate | None:
    """The curve of fewest segments whose squared error is ``enough``, if there is one.

    Unless ``every`` number is tried, beyond :data:`ONE_BY_ONE` they grow until one suffices, and
    are bisected: fewer are assumed to be no better.
    """
    failed = max(search.fewest, most if every else min(most, ONE_BY_ONE))
    for few in range(search.fewest, failed + 1):
        hopeful = every or few == most or search.starts(few)[0].error <= HOPELESS * enough
        if hopeful and (curve := curve_of(few)).error <= enough:
            return curve
    best, count = None, failed
    while failed < most if best is None else count - failed > 1 + math.floor(0.004 * count):
        trial = (failed + count) // 2 if best else min(most, math.ceil(1.3 * failed))
        curve = curve_of(trial)
        if curve.error <= enough:
            best, count = curve, trial
        else:
            failed = trial
    return best


def _certify(fit: PiecewiseLinearFit, question: Question) -> None:
    """Raise SolverFailed unless the slopes and errors that are reported keep their bounds."""
    excess = float(np.max(np.abs(fit.slopes))) / fit.v_max - 1.0
    if not excess <= 1e-12:
        raise SolverFailed("slopes of the piecewise-linear fit", "repaired", violation=excess)
    rounding = 1e-14 * float(np.max(np.abs(fit.desired)))
    for name, error, bound in (
        ("largest", fit.max_error, question.max_error),
        ("rms", fit.rms, question.max_rms),
    ):
        if bound is not None and error > bound * (1.0 + BARELY) + rounding:
            problem = f"{name} error of the piecewise-linear fit"
            raise SolverFailed(problem, "solved", violation=error - bound)


class Choices(NamedTuple):
    """The error for each number of segments, from which a user can choose one."""

    segments: tuple[int, ...]  # numbers of segments, (m,)
    rms: Array  # rms error of the curve of at most so many [rad], (m,)
    floor: float  # rms error of the slope-bounded ideal [rad]: no number of segments has less
    automatic: int  # the number that is chosen by default


def choices(fit: PiecewiseLinearFit, *, most: int = 12) -> Choices:
    """The errors of curves through the samples of ``fit``, for up to ``most`` segments or more.

    Required knots are not used. Numbers begin at 1 for a path and at 2 for a cycle, and include
    those of ``fit`` and of the automatic choice up to twice ``most``. Time: that of as many fits.
    """
    room = fit.desired.size if fit.cyclic else fit.desired.size - 1
    plain = partial(fit_pwl, fit.desired, v_max=fit.v_max, tick=fit.tick, cyclic=fit.cyclic)
    chosen = plain()
    last = min(room, 2 * most, max(most, chosen.segments, fit.segments))
    counts = tuple(range(2 if fit.cyclic else 1, last + 1))
    # A curve with a segment less is one of so many, if it was found to be better.
    rms = read_only(np.minimum.accumulate([plain(segments=count).rms for count in counts]))
    ideal = slope_bounded(fit.desired, fit.v_max * fit.tick, cyclic=fit.cyclic)
    floor = float(np.sqrt(np.mean((ideal - fit.desired) ** 2)))
    return Choices(counts, rms, floor, chosen.segments)
