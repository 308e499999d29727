"""Other ways to a continuous piecewise-linear curve with so many segments.

Each takes one cycle of samples, the number of segments and v_max [rad per sample], and gives back
the knots, at samples or between, and the values there. The first sample is repeated at the end, so
that all of them see the whole cycle.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .problem import Array

Knots = tuple[Array, Array]
Method = Callable[[Array, int, float], Knots]

ROUNDS = 20  # bisections of the trend filter's weight
KINK = 1e-3  # change of slope that counts as a kink [v_max]


def pwlf(fast: bool, desired: Array, segments: int, v_max: float) -> Knots:
    """pwlf's own search, by differential evolution or by many starts."""
    del v_max
    import pwlf as package

    closed = np.append(desired, desired[0])
    fit = package.PiecewiseLinFit(np.arange(len(closed)), closed, seed=0)
    knots = fit.fitfast(segments) if fast else fit.fit(segments)
    return knots, fit.predict(knots)


def ruptures(desired: Array, segments: int, v_max: float) -> Knots:
    """Dynamic programming over lines that join samples."""
    del v_max
    import ruptures as package

    closed = np.append(desired, desired[0])
    ends = package.Dynp(model="clinear", min_size=2, jump=1).fit_predict(closed, segments - 1)
    knots = np.array([0, *(end - 1 for end in ends)])
    return knots.astype(float), closed[knots]


def trend_filter(desired: Array, segments: int, v_max: float) -> Knots:
    """l1 trend filter with bounded slopes and closed ends, its kinks then fitted once more."""
    import cvxpy

    closed = np.append(desired, desired[0]) / v_max
    curve, weight = cvxpy.Variable(len(closed)), cvxpy.Parameter(nonneg=True)
    bends = cvxpy.diff(cvxpy.hstack([curve, curve[1]]), 2)
    conditions = [cvxpy.abs(cvxpy.diff(curve)) <= 1.0, curve[0] == curve[-1]]
    objective = cvxpy.sum_squares(curve - closed) + weight * cvxpy.norm1(bends)
    filtered = cvxpy.Problem(cvxpy.Minimize(objective), conditions)
    low, high = -3.0, 6.0  # powers of ten
    kinks = np.zeros(1, dtype=int)
    for _ in range(ROUNDS):
        weight.value = 10.0 ** ((low + high) / 2.0)
        filtered.solve(solver=cvxpy.CLARABEL)
        bent = 1 + np.flatnonzero(np.abs(bends.value) > KINK)
        if len(bent) > segments:
            low = (low + high) / 2.0
        else:
            high, kinks = (low + high) / 2.0, bent
    knots = np.unique([0, *(kinks % (len(closed) - 1)), len(closed) - 1])
    values = cvxpy.Variable(len(knots))
    lines = np.array([np.interp(np.arange(len(closed)), knots, row) for row in np.eye(len(knots))])
    conditions = [cvxpy.abs(cvxpy.diff(values)) <= np.diff(knots), values[0] == values[-1]]
    error = cvxpy.sum_squares(lines.T @ values - closed)
    cvxpy.Problem(cvxpy.Minimize(error), conditions).solve(solver=cvxpy.CLARABEL)
    return knots.astype(float), v_max * np.asarray(values.value)


METHODS: dict[str, tuple[str, Any]] = {
    "pwlf fit": ("pwlf", partial(pwlf, False)),
    "pwlf fitfast": ("pwlf", partial(pwlf, True)),
    "ruptures clinear": ("ruptures", ruptures),
    "trend filter": ("cvxpy", trend_filter),
}


def available() -> dict[str, Method]:
    """The methods whose packages are installed."""
    gone = missing()
    return {name: method for name, (package, method) in METHODS.items() if package not in gone}


def missing() -> list[str]:
    """The packages that are not installed."""
    packages = {package for package, _ in METHODS.values()}
    return sorted(name for name in packages if importlib.util.find_spec(name) is None)
