"""Whether a model may be used, and what its user has to know first, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.identification.adjust import Adjusted
from planner.identification.clock import Clock
from planner.identification.intervals import Bounds, peak_call
from planner.identification.log import Log
from planner.identification.validation import HeldOut

REFUSED = 0.25
"""A model whose error exceeds this share of the motion's standard deviation is refused. Recordings
of joints that the model is meant for leave 0.03 to 0.23, an overloaded one 0.3 and more."""

SUSPECT = 0.1
"""From this share on the user is told what may be the reason."""

NO_BETTER = 1.25
"""A model that predicts worse by this factor than a simpler description, and that is suspect, is
refused."""

LOOSE = 0.5
"""An interval wider than this share of its value is pointed out."""

UNEQUAL = 0.05
"""Logs whose periods differ by more than this share are pointed out."""


class Verdict(NamedTuple):
    """The word on a model."""

    accepted: bool
    warnings: tuple[str, ...]


def verdict_on(
    fit: Adjusted, bounds: Bounds, held: HeldOut | None, simple: dict[str, float], signal: float
) -> Verdict:
    """Judge a fit.

    Args:
        fit: The model fitted to all rows.
        bounds: Its intervals.
        held: What held-out rows say, if any were.
        simple: Error of the simpler descriptions on the same rows [rad].
        signal: Standard deviation of the motion [rad].
    """
    warnings = []
    error, others, where = (
        (fit.rms, simple, "")
        if held is None
        else (max(held.rms, fit.rms), held.alternatives, " of rows that were held out")
    )
    missed = error / signal
    accepted = missed <= REFUSED
    if not accepted:
        warnings.append(
            f"the model does not fit: it misses {missed:.0%} of the motion's standard deviation"
            f"{where}, more than {REFUSED:.0%} (rms {error:.3g}); {_reasons()}"
        )
    elif missed > SUSPECT:
        warnings.append(
            f"the model misses {missed:.0%} of the motion's standard deviation{where} "
            f"(rms {error:.3g}); {_reasons()}"
        )
    name = min(others, key=lambda other: others[other])
    if error > 1.02 * others[name]:
        if missed > SUSPECT and error > NO_BETTER * others[name]:
            accepted = False
        warnings.append(
            f"the model predicts no better than {_WORDS[name]} (rms {error:.3g} against "
            f"{others[name]:.3g}): richer motion would tell more"
        )
    return Verdict(accepted, (*warnings, *_undetermined(fit, bounds)))


_WORDS = {
    "raw": "the requests themselves",
    "delay": "delayed requests",
    "first_order": "a delay with a first-order lag",
}


def _reasons() -> str:
    return (
        "is the joint overloaded, sticking, limited by something else, or is this another joint's "
        "column?"
    )


def _undetermined(fit: Adjusted, bounds: Bounds) -> list[str]:
    """A sentence for each parameter that the log leaves open."""
    found = []
    at = fit.parameters
    if math.isinf(bounds.v_max.upper):
        errors = peak_call(fit) / at.gain
        hardly = "never" if at.v_max >= peak_call(fit) * (1.0 - 1e-9) else "hardly"
        found.append(
            f"the joint {hardly} saturates in this log: only v_max/theta_0 = {at.gain:.3g} per "
            f"second is known, and that v_max is at least {bounds.v_max.lower:.3g} per second; the "
            f"model takes {at.v_max:.3g}, no more than this log called for; record steps larger "
            f"than about {_rounded(2.0 * errors):g}"
        )
    if math.isinf(bounds.gain.upper):
        found.append(
            f"theta_0 is only known to be less than {bounds.v_max.upper / bounds.gain.lower:.3g}: "
            "record small steps, or motion that changes slowly"
        )
    for name, value, interval in (
        ("lag", at.lag, bounds.lag),
        ("acceleration_time", at.acceleration_time, bounds.acceleration_time),
    ):
        width = interval.upper - interval.lower
        if width > max(2.0 * fit.grid.tick, LOOSE * value):
            found.append(
                f"{name} lies between {1e3 * interval.lower:.0f} and {1e3 * interval.upper:.0f} ms: "
                "record sudden steps to tell it from the other delays"
            )
    return found


def notes_on(logs: Sequence[Log], clock: Clock) -> list[str]:
    """What is odd about the logs themselves."""
    found = []
    periods = [log.period for log in logs]
    if max(periods) > (1.0 + UNEQUAL) * min(periods):
        found.append(
            f"the logs have periods from {1e3 * min(periods):.3g} to {1e3 * max(periods):.3g} ms; "
            f"the model's is their median, {1e3 * clock.period:.3g} ms"
        )
    for log in logs:
        if not log.torque_on.all():
            off = 1.0 - float(np.mean(log.torque_on))
            found.append(f"{log.name}: torque is off in {off:.0%} of the rows, which are left out")
    return found


def _rounded(value: float) -> float:
    """One significant digit."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** math.floor(math.log10(value))
    return round(value / digit) * digit
