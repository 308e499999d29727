"""Automated piecewise-linear approximation with bounded slopes: paper, Section 4.1.

The values are those of least squares at the knots, a convex QP
(:mod:`planner.approximation.values`). The knots are sought, not proved best: shortest paths over
grids of knots and of knots with values propose them, Newton's method moves both, and then single
knots are moved across samples; of up to 200 samples, two or three segments are sought among every
set of knots on a grid. On a path whose slopes are free, knots of six segments or more are exchanged
one by one. Where the ideal of slopes within ±v_max is 0.5 % better at most, the search ends. Up to
15 segments a curve of one less is sought too where it could be better, and then begun from, so more
are not worse; of over 2000 samples, means stand for them there. Beyond 32, knots come from merging.
Time: O(n) for every number up to 16, O(n log n) beyond; memory O(n). At n = 88, 3 to 50 ms. The
same samples shifted, mirrored, reversed or scaled give the same curve.

With ``exact`` the answer is proved best of all with knots on samples, up to a part in a million of
its squared error (:mod:`planner.approximation.exact`). That is branch and bound: exponential at
worst (many seconds where all slopes are at the bound and nothing tells curves apart), but 0.06 s in
the median and less than 1.5 s at most over 300 random instances at n = 88 with up to 7 segments.
Each of its steps takes O(segments n²) time and O(n²) memory, of a cycle O(segments n³) and O(n³).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from planner.approximation.arguments import Ends, Question, Required, question_of
from planner.approximation.curve import PiecewiseLinear
from planner.approximation.largest_error import BARELY
from planner.approximation.solve import knots_and_values
from planner.exceptions import SolverFailed
from planner.trajectory import Array, as_trajectory

SLOPE_TOLERANCE = 1e-12
"""Relative excess over v_max that rounding may leave on a returned slope."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PiecewiseLinearFit(PiecewiseLinear):
    """A piecewise-linear curve and what it approximates; its errors are computed from the two.

    Attributes:
        desired: The samples that it approximates [rad], shape (n,).
        v_max: The bound that its slopes keep [rad/s].
        weights: Weights of the squared errors, mean 1, shape (n,); None where all are the same.
        fewest_segments: Where a largest error was given, a lower bound on the segments of any curve
            that keeps it: the number of segments itself for a path, unless there are requirements
            that only some knots meet, and that or one less for a cycle; else None.
    """

    desired: Array
    v_max: float
    weights: Array | None = None
    fewest_segments: int | None = None

    @cached_property
    def residuals(self) -> Array:
        """Curve minus desired at the samples [rad], shape (n,)."""
        residuals = self.angles - self.desired
        residuals.setflags(write=False)
        return residuals

    @property
    def rms(self) -> float:
        """Root mean square error over the samples, by weight where there are weights [rad]."""
        return float(np.sqrt(np.average(self.residuals**2, weights=self.weights)))

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
    shortest: float = 1.0,
    weights: npt.ArrayLike | None = None,
    ends: Ends = (None, None),
    on_samples: bool = False,
    exact: bool = False,
) -> PiecewiseLinearFit:
    """Approximate ``desired`` by few straight lines that a joint of speed ``v_max`` can follow.

    The curve is continuous, closed if ``cyclic``, and every slope is within ±v_max. What it costs
    and how its knots are found is told above, in the module: O(n log n) at most, unless ``exact``.

    Args:
        desired: Angles [rad], shape (n,), n >= 3.
        v_max: Largest slope [rad/s].
        tick: Time between samples [s].
        cyclic: Whether the first sample follows the last.
        segments: Number of segments; with ``max_error`` or ``max_rms``, the most.
        max_error: Largest error at any sample [rad]: the fewest segments found that keep it.
        max_rms: Largest rms error [rad], likewise. With none of the three, the fewest segments
            whose rms error is within 2 % of the slope-bounded ideal's, 1 % of the range of
            ``desired``, or 1.1 times its noise; an exact curve within the slopes is recovered.
        knots: All knots [samples], in place of ``segments``; a path's ends and ``required`` are
            added. Only the values are sought: one QP, O(n).
        required: Indices, whole or not, where there must be a knot; as a mapping, with the angle
            there [rad], or None where it is free.
        shortest: Length of the shortest segment [samples], 1 or more.
        weights: Weights of the squared errors, all above 0, shape (n,).
        ends: Angles at the ends of a path [rad], each None where it is free.
        on_samples: Whether knots must lie on samples.
        exact: Whether to prove the answer best; with ``segments`` or ``max_rms``, n <= 400.

    Raises:
        InvalidInput: An argument is out of its range, no trajectory, or excludes another.
        Infeasible: What is required contradicts itself, the slopes or the error; names the pair.
        SolverFailed: A QP was not solved, or nothing proved in reasonable time.
    """
    question = question_of(
        as_trajectory(desired, name="desired", minimum=3),
        v_max=v_max,
        tick=tick,
        cyclic=cyclic,
        segments=segments,
        max_error=max_error,
        max_rms=max_rms,
        knots=knots,
        required=required,
        shortest=shortest,
        weights=weights,
        ends=ends,
        on_samples=on_samples,
        exact=exact,
    )
    return _certified(question, *knots_and_values(question))


def _certified(
    question: Question, knots: Array, values: Array, fewest: int | None
) -> PiecewiseLinearFit:
    """The fit, if the slopes and errors that it reports keep their bounds."""
    fit = PiecewiseLinearFit(
        knots=knots,
        values=values,
        samples=question.desired.size,
        tick=question.tick,
        cyclic=question.cyclic,
        desired=question.desired,
        v_max=question.v_max,
        weights=question.weights,
        fewest_segments=fewest,
    )
    excess = float(np.max(np.abs(fit.slopes))) / fit.v_max - 1.0
    if not excess <= SLOPE_TOLERANCE:
        raise SolverFailed("slopes of the piecewise-linear fit", "repaired", violation=excess)
    for name, error, bound in (
        ("largest", fit.max_error, question.max_error),
        ("rms", fit.rms, question.max_rms),
    ):
        if bound is not None and error > bound * (1.0 + BARELY):
            problem = f"{name} error of the piecewise-linear fit"
            raise SolverFailed(problem, "solved", violation=error - bound)
    return fit
