"""Automated piecewise-linear approximation with bounded slopes: paper, Section 4.1.

The values at the knots are those of least squares, a convex QP ((5) of docs/math.md). The
knots are sought, not proved best (:mod:`planner.approximation.knot_search`): dynamic programming on
grids proposes them, sequential quadratic programming moves knots and values together, and then
single knots are moved across samples. Where the squared error is within 0.2 % of that of the ideal,
which has a knot at every sample and slopes within ±v_max, the search ends. Of over 2000 samples,
means stand for them while knots are sought; beyond 32 segments, knots come from bottom-up merging.
One segment more is hardly ever worse: of 840 pairs at n = 60 and 88 seven were, by 0.2 to 0.4 %,
all of a single impulse. The same samples
shifted, mirrored, reversed or scaled give the same curve.

Time: O(n) up to 32 segments, O(n log n) beyond; memory O(n). At n = 88, 10 to 50 ms for 2 to 12
segments; 50 ms in the median and 100 at most where the number is chosen too, over twelve
trajectories of a robot's legs.

With ``exact`` the answer is proved best of all with knots on samples, up to a part in a million of
its squared error (:mod:`planner.approximation.branch_and_bound`): exponential at worst (many
seconds where all slopes are at the bound and many curves are equally good), 0.06 s in the median
and less than 1.5 s at most over 300 random instances at n = 88 with up to 7 segments. Each step
takes O(segments n²) time and O(n²) memory, of a cycle O(segments n³) and O(n³).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.approximation.arguments import (
    SMALLEST,
    Arguments,
    Required,
    check_feasible,
    checked_all_knots,
    checked_knots,
    checked_segments,
    positive,
)
from planner.approximation.branch_and_bound import BRANCHES, proved_best
from planner.approximation.curve import PiecewiseLinear
from planner.approximation.knot_search import KnotSearch
from planner.approximation.minimum_link.largest_error import within_largest_error
from planner.approximation.problem import (
    BARELY,
    KNOT_UNIT,
    SHORTEST,
    Problem,
    candidate,
    even_knots,
    with_pins,
)
from planner.approximation.qp import values_within, within_slopes
from planner.approximation.segment_count import automatic, within_rms
from planner.approximation.slope_projection import slope_bounded
from planner.exceptions import Infeasible, InvalidInput, SolverFailed, angle_text
from planner.trajectory import Array, as_trajectory
from planner.validation import as_flag

SLOPE_TOLERANCE = 1e-12
"""Relative excess over v_max that rounding may leave on a returned slope."""

STEEPEST = 1e6
"""Largest change per sample in the search, where samples span 2: no line is as steep, and beyond
about 1e12 rounding is all that is left of the samples."""

ERROR_ROUNDING = 1e-14
"""Error, relative to the largest sample, that rounding may leave between a curve and its bound."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinearFit(PiecewiseLinear):
    """A piecewise-linear curve and what it approximates; its errors are computed from the two.

    Attributes:
        desired: The samples that it approximates [rad], shape (n,).
        v_max: The bound that its slopes keep [rad/s].
        fewest_segments: Where a largest error was given, a lower bound on the segments of any curve
            that keeps it: the number of segments itself for a path, unless there are requirements
            that only some knots meet, and that or one less for a cycle; else None.
    """

    desired: Array
    v_max: float
    fewest_segments: int | None = None

    @cached_property
    def residuals(self) -> Array:
        """Curve minus desired at the samples [rad], shape (n,)."""
        residuals = self.angles - self.desired
        residuals.setflags(write=False)
        return residuals

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

    The curve is continuous, closed if ``cyclic``, and every slope is within ±v_max. What it costs
    and how its knots are found stand at the top of the module: O(n log n), unless ``exact``.

    Args:
        desired: Angles [rad], shape (n,), n >= 3.
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments; with ``max_error`` or ``max_rms``, the most.
        max_error: Largest error at any sample [rad], kept up to one part in 1e9: the fewest
            segments that keep it, the true minimum (docs/math.md, section 4), and of curves with so
            many segments one of small squared error. With required knots in a cycle it is one more
            at most; ``fewest_segments`` of the answer is a lower bound. Beside required knots
            between samples segments may be shorter than a sample. O(n).
        max_rms: Largest rms error [rad], likewise. With none of the three, the fewest segments
            whose rms error is within 2 % of the slope-bounded ideal's, 1 % of the range of
            ``desired``, or 1.1 times its noise; an exact curve within the slopes is recovered.
        knots: All knots [samples], in place of ``segments``; a path's ends and ``required`` are
            added. Only the values are sought: one QP, O(n).
        required: Indices, whole or not, where there must be a knot; as a mapping, with the angle
            there [rad], or None where it is free. At the ends of a path, 0 and n - 1, there are
            knots in any case.
        exact: Whether to prove the answer best of all with knots on samples; with ``segments`` or
            ``max_rms``, n <= 400.

    Raises:
        InvalidInput: An argument is out of its range, no trajectory, or excludes another.
        Infeasible: What is required contradicts itself, the slopes or the error; names the pair.
        SolverFailed: A QP was not solved, or nothing proved in reasonable time.

    Example:
        >>> import numpy as np
        >>> desired = np.sin(2 * np.pi * np.arange(100) / 100)  # [rad], every 8 ms
        >>> lines = fit_pwl(desired, v_max=10.0, tick=0.008, segments=6)
        >>> len(lines.slopes), f"{np.degrees(lines.rms):.2f} deg rms"
        (6, '0.93 deg rms')
    """
    samples = as_trajectory(desired, name="desired", minimum=3)
    cyclic, exact = as_flag("cyclic", cyclic), as_flag("exact", exact)
    places, pins = checked_knots(required, samples.size, cyclic=cyclic)
    arguments = Arguments(
        desired=samples,
        v_max=positive("v_max", v_max, "rad/s"),
        tick=positive("tick", tick, "s"),
        cyclic=cyclic,
        segments=checked_segments(segments, samples, cyclic=cyclic),
        max_error=None if max_error is None else positive("max_error", max_error, "rad"),
        max_rms=None if max_rms is None else positive("max_rms", max_rms, "rad"),
        knots=checked_all_knots(knots, samples.size, cyclic=cyclic),
        required=places,
        pins=pins,
        exact=exact,
    )
    return _certified(arguments, *_knots_and_values(arguments))


def _certified(
    arguments: Arguments, knots: Array, values: Array, fewest: int | None
) -> PiecewiseLinearFit:
    """The fit, if the slopes and errors that it reports keep their bounds."""
    fit = PiecewiseLinearFit(
        knots=knots,
        values=values,
        samples=arguments.desired.size,
        tick=arguments.tick,
        cyclic=arguments.cyclic,
        desired=arguments.desired,
        v_max=arguments.v_max,
        fewest_segments=fewest,
    )
    excess = float(np.max(np.abs(fit.slopes))) / fit.v_max - 1.0
    if not excess <= SLOPE_TOLERANCE:
        raise SolverFailed("slopes of the piecewise-linear fit", "repaired", violation=excess)
    rounding = ERROR_ROUNDING * float(np.max(np.abs(fit.desired)))
    for name, error, bound in (
        ("largest", fit.max_error, arguments.max_error),
        ("rms", fit.rms, arguments.max_rms),
    ):
        if bound is not None and error > bound * (1.0 + BARELY) + rounding:
            problem = f"{name} error of the piecewise-linear fit"
            raise SolverFailed(problem, "solved", violation=error - bound)
    return fit


def _knots_and_values(arguments: Arguments) -> tuple[Array, Array, int | None]:
    """The answer: knots [samples] and values [rad], slopes within ±v_max to the last digit.

    With a largest error, the third is a lower bound on the segments of any curve that keeps it.

    Raises:
        Infeasible: There is none; names the pair of requirements that contradict each other.
        SolverFailed: A solver stopped short.
    """
    check_feasible(arguments)
    pins = arguments.pins[np.isfinite(arguments.pins)]
    angles = np.concatenate([arguments.desired, pins])
    middle = 0.5 * (float(angles.max()) + float(angles.min()))
    half_range = float(np.max(np.abs(angles - middle)))
    in_rad = Problem(
        desired=arguments.desired,
        step=arguments.v_max * arguments.tick,
        cyclic=arguments.cyclic,
        required=arguments.required,
        pins=arguments.pins,
    )
    if half_range <= SMALLEST:
        return *_constant(in_rad, arguments, middle), None if arguments.max_error is None else 1
    problem = replace(
        in_rad,
        desired=(in_rad.desired - middle) / half_range,
        step=min(in_rad.step / half_range, STEEPEST),
        pins=(in_rad.pins - middle) / half_range,
    )
    fewest = None
    if arguments.max_error is None or arguments.knots is not None:
        knots, values = _found(problem, arguments, half_range)
    else:
        search = KnotSearch(problem)
        bound = arguments.max_error / half_range
        curve, fewest = within_largest_error(
            search.unrounded, bound, arguments.segments, half_range
        )
        knots, values = search.form.restore(curve)
    knots = _snapped(in_rad, knots)
    straight = None  # from pin to pin
    if pins.size:
        places = in_rad.required[np.isfinite(in_rad.pins)]
        period = in_rad.samples if in_rad.cyclic else None
        straight = np.interp(knots, places, pins, period=period)
    values = within_slopes(
        with_pins(in_rad, knots, middle + half_range * values),
        arguments.v_max * (np.diff(in_rad.ends(knots)) * arguments.tick),
        cyclic=arguments.cyclic,
        towards=straight,
    )
    return knots, values, fewest


def _found(problem: Problem, arguments: Arguments, unit: float) -> tuple[Array, Array]:
    """Knots and values of the curve that is asked for, in the search's unit [rad]."""
    if arguments.knots is not None:
        return _at_given_knots(problem, arguments, unit)
    search = KnotSearch(problem)
    if arguments.exact:
        return _exact(search, arguments, unit)
    if arguments.max_rms is not None:
        curve = within_rms(search, arguments.max_rms / unit, arguments.segments, unit)
    elif arguments.segments is None:
        curve = automatic(search)
    else:
        curve = search.curve(arguments.segments)
    return search.final_curve(curve)


def _exact(search: KnotSearch, arguments: Arguments, unit: float) -> tuple[Array, Array]:
    """The proved best curve of so many segments, or of the fewest that keep the rms error."""
    n = search.problem.samples
    if n > BRANCHES.samples:
        raise InvalidInput(
            f"exact: got {n} samples, expected at most {BRANCHES.samples}; fit without it, or thin "
            "the samples out"
        )
    if arguments.max_rms is None:
        assert arguments.segments is not None, "exact says one of the two"
        best = proved_best(search.problem, search.curve(arguments.segments))
        return search.final_curve(best)
    last = search.most if arguments.segments is None else min(arguments.segments, search.most)
    least = math.inf
    for segments in range(search.fewest, last + 1):
        best = proved_best(search.problem, search.curve(segments))
        least = math.sqrt(best.error / n) * unit
        if least <= arguments.max_rms * (1.0 + BARELY):
            return search.final_curve(best)
    raise Infeasible(
        f"max_rms and the number of segments: got {angle_text(arguments.max_rms)}, but {last} "
        f"segments with knots on samples reach {angle_text(least)} at best; allow more error or "
        "more segments"
    )


def _at_given_knots(problem: Problem, arguments: Arguments, unit: float) -> tuple[Array, Array]:
    knots = _given_knots(problem, arguments)
    bound = None if arguments.max_error is None else arguments.max_error / unit
    values = values_within(problem, knots, bound, unit)
    if arguments.max_rms is not None:
        least = math.sqrt(candidate(problem, knots, values).error / problem.samples) * unit
        if least > arguments.max_rms * (1.0 + BARELY):
            raise Infeasible(
                f"knots and max_rms: got {angle_text(arguments.max_rms)}, but with these knots the "
                f"smallest rms error is {angle_text(least)}; add knots or allow more error"
            )
    return knots, values


def _given_knots(problem: Problem, arguments: Arguments) -> Array:
    """The knots that were given, required ones and a path's ends, if a curve may have all."""
    assert arguments.knots is not None, "asked for given knots"
    knots = np.union1d(arguments.knots, arguments.required)
    if not problem.cyclic:
        knots = np.union1d(knots, [0.0, problem.samples - 1.0])
    ends = problem.ends(knots)
    k = int(np.argmin(np.diff(ends)))
    if ends[k + 1] - ends[k] < SHORTEST:
        raise Infeasible(
            f"knots at samples {ends[k]:g} and {ends[k + 1] % problem.samples:g}: "
            f"{ends[k + 1] - ends[k]:g} samples apart, expected at least 1; leave one out"
        )
    return knots


def _constant(problem: Problem, arguments: Arguments, value: float) -> tuple[Array, Array]:
    """The constant of this value, through samples and pins that are all the same."""
    if arguments.knots is not None:
        knots = _given_knots(problem, arguments)
    else:
        segments = arguments.segments if arguments.max_error is None else None
        knots = even_knots(problem, 1 if segments is None else segments)
    return knots, np.full(knots.size, value)


def _snapped(problem: Problem, knots: Array) -> Array:
    """The knots, required ones to the last digit."""
    snapped = np.array(knots)
    for place in problem.required:
        snapped[np.abs(snapped - place) < 8.0 * KNOT_UNIT] = place
    return snapped


class Choices(NamedTuple):
    """The error for each number of segments, from which a user can choose one.

    Attributes:
        segments: Numbers of segments, shape (m,).
        rms: Rms error of the curve of at most so many [rad], shape (m,).
        floor: Rms error of the slope-bounded ideal [rad]: no number of segments has less.
        automatic: The number that is chosen where none is asked for.
    """

    segments: tuple[int, ...]
    rms: Array
    floor: float
    automatic: int


def choices(fit: PiecewiseLinearFit, *, most: int = 12) -> Choices:
    """The errors of curves through the samples of ``fit``, for up to ``most`` segments or more.

    Required knots are not used. Numbers begin at 1 for a path and at 2 for a cycle, and
    include those of ``fit`` and of the automatic choice up to twice ``most``. Time: that of as many
    fits.
    """
    n = fit.desired.size
    plain = partial(fit_pwl, fit.desired, v_max=fit.v_max, tick=fit.tick, cyclic=fit.cyclic)
    chosen = plain()
    last = min(n if fit.cyclic else n - 1, max(most, chosen.segments, fit.segments))
    counts = tuple(range(2 if fit.cyclic else 1, min(last, 2 * most) + 1))
    # A curve with a segment less is one of so many, if it was found to be better.
    rms = np.minimum.accumulate([plain(segments=count).rms for count in counts])
    rms.setflags(write=False)
    ideal = slope_bounded(fit.desired, fit.v_max * fit.tick, cyclic=fit.cyclic)
    floor = float(np.sqrt(np.mean((ideal - fit.desired) ** 2)))
    return Choices(counts, rms, floor, chosen.segments)
