"""Dry friction, asymmetry and load: parameters that are 0 unless they reduce the loss."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.identification.fit import COMMANDED_SHARE, peak_command
from planner.identification.intervals import (
    Uncertainty,
    correlation_time,
    model_interval,
    rise_allowed,
    uncertainty_of,
)
from planner.identification.least_squares import (
    PROFILE,
    TERM,
    VANISHES,
    Fit,
    huber,
    least_squares,
    rms,
)
from planner.identification.parameters import TERMS, Parameters
from planner.identification.resampling import Grid
from planner.identification.result import Interval, Term


@dataclass(frozen=True, kw_only=True)
class TermOptions:
    """When a further parameter is kept, and where its search begins.

    Attributes:
        saving: Least share by which a term must reduce the loss, besides the information criterion:
            real joints are not the model, and a smaller gain says nothing about a term.
        several_loads: Torques that span less than this share of the largest are one load.
        rounded: Residuals below this, relative to the spread of the angles, are rounding: there
            is nothing to explain.
        test_dead_band: A dead band of so much of the errors between request and angle (rms) that
            fits as well as none is one that the logs do not separate from a sag.
    """

    saving: float = 0.01
    several_loads: float = 0.1
    rounded: float = 1e-9
    test_dead_band: float = 0.5


OPTIONS = TermOptions()

ORDER = ("time_constant", "compliance", "dead_band", "slowing", "asymmetry")
"""In which order the terms are tried, each beside those that were kept before it."""


class Trial(NamedTuple):
    """The fit with the terms that are kept.

    Attributes:
        fit: With all terms that are kept.
        terms: The errors with and without each term that was tried.
        confounded: Parameters that the logs do not separate from a term that was not kept.
    """

    fit: Fit
    terms: tuple[Term, ...]
    confounded: frozenset[str]


def with_terms(fit: Fit) -> Trial:
    """Add one term after another, and keep those that reduce the loss by (16a).

    A term is kept where it lowers the Bayesian information criterion (Schwarz, 1978) of as many
    rows as are independent, ``n_eff log(loss without / loss with) > log(n_eff)`` with
    ``n_eff = n / correlation time of the residuals``, and saves at least 1 % of the loss.
    """
    terms: list[Term] = []
    confounded: set[str] = set()
    for name in ORDER:
        if not _shows(name, fit):
            continue
        trial = _fitted_with(name, fit)
        kept = _pays(fit, trial)
        uncertainty = uncertainty_of(trial)
        interval = model_interval(trial, uncertainty, name)
        if name == "dead_band" and not kept and _any_dead_band_does(fit, trial, uncertainty):
            interval = Interval(0.0, math.inf)
            confounded.add("offset")
        terms.append(
            Term(
                name=TERMS[name],
                kept=kept,
                rms_without=fit.rms,
                rms_with=trial.rms,
                interval=interval,
            )
        )
        fit = trial if kept else fit
    fit = least_squares(fit.grid, fit.parameters, free=fit.free, starts=fit.starts)
    final = _without_vanished_inertia(fit)
    if final is not fit:
        terms = [
            replace(each, kept=False) if each.name == "time_constant" else each for each in terms
        ]
    fit = final
    return Trial(fit, tuple(terms), frozenset(confounded))


def _without_vanished_inertia(fit: Fit) -> Fit:
    """The fit without a time constant so short that it has no effect, if it has one.

    A search that ends there has led to another window, and leaves nothing of the inertia.
    """
    at, place = fit.parameters, Parameters._fields.index("time_constant")
    if not fit.free[place] or fit.grid.tick <= VANISHES * at.time_constant:
        return fit
    free = fit.free.copy()
    free[place] = False
    return least_squares(fit.grid, at._replace(time_constant=0.0), free=free, starts=fit.starts)


def _shows(name: str, fit: Fit) -> bool:
    """Whether the rows can say anything about a term."""
    grid = fit.grid
    if fit.scale <= OPTIONS.rounded * float(np.std(grid.angles)):
        return False
    if name in ("dead_band", "time_constant"):
        return True
    if name == "compliance":
        return _loads_differ(grid)
    errors = fit.response.errors
    saturated = ~fit.parameters.inside(errors, grid.loads[:, np.newaxis])
    if name == "slowing":
        return bool(saturated.any()) and _loads_differ(grid)
    return bool((saturated & (errors > 0.0)).any() and (saturated & (errors < 0.0)).any())


def _loads_differ(grid: Grid) -> bool:
    return bool(np.ptp(grid.loads) > OPTIONS.several_loads * grid.heaviest)


def _fitted_with(name: str, fit: Fit) -> Fit:
    """The best fit with one term more."""
    free = fit.free.copy()
    free[Parameters._fields.index(name)] = True
    at = fit.parameters
    begins = [at]
    if name == "dead_band":
        begins = [at._replace(dead_band=size * fit.scale) for size in (0.5, 2.0)]
    search = partial(least_squares, fit.grid, free=free, scale=fit.scale, effort=TERM)
    if name == "time_constant":
        begins = [  # it takes the place of a part of the window, and of the lag
            at._replace(
                time_constant=share * at.whole_delay,
                acceleration_time=max(window * at.acceleration_time, fit.grid.tick),
                lag=lag * at.lag,
            )
            for share, window, lag in ((0.2, 0.5, 1.0), (0.4, 0.2, 0.5))
        ]
    found = min((search(each, starts=fit.starts) for each in begins), key=lambda each: each.cost)
    at, shown = found.parameters, peak_command(found)
    if name == "dead_band" and at.v_max > shown:
        # Friction hides how fast the joint is called to move: v_max had no slope until here.
        lower = at._replace(v_max=COMMANDED_SHARE * shown)
        found = min(found, search(lower, starts=found.starts), key=lambda each: each.cost)
    return found


def _any_dead_band_does(fit: Fit, trial: Fit, uncertainty: Uncertainty) -> bool:
    """Whether a dead band of half the errors fits as well, with another sag.

    In motion of one direction friction holds the joint back by as much as a sag would.
    """
    at, grid = trial.parameters, fit.grid
    errors = np.mean(fit.response.errors, axis=1)
    size = OPTIONS.test_dead_band * rms(errors)
    moved = math.copysign(size - at.dead_band, float(np.sum(errors)))
    held = least_squares(
        grid,
        at._replace(dead_band=size, offset=at.offset + moved),
        free=fit.free,
        starts=trial.starts,
        scale=trial.scale,
        effort=PROFILE,
    )
    return held.cost <= trial.cost + rise_allowed(trial, uncertainty, "dead_band")


def _pays(without: Fit, with_it: Fit) -> bool:
    """Whether the information criterion, and the least saving, speak for a term."""
    before, after = (huber(fit.residuals, without.scale) for fit in (without, with_it))
    if not after < (1.0 - OPTIONS.saving) * before:
        return False
    alike = correlation_time(with_it.weights * with_it.residuals)
    independent = max(len(with_it.residuals) / alike, 2.0)
    return independent * math.log(before / max(after, 1e-300)) > math.log(independent)
