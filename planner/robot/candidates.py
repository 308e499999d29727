"""The ways to make a joint follow a path, compared by the errors that are measured on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from planner.identification.excitation import excite
from planner.identification.result import Identification
from planner.model.evidence import Evidence
from planner.model.joint import JointModel
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from planner.planning.result import Inversion
from planner.planning.time_shift import invert_shift
from planner.trajectory import Array, rms

Way = Literal["direct", "shift", "closed_form", "optimal", "optimal_friction"]

WORDS: dict[Way, str] = {
    "direct": "direct",
    "shift": "best shift",
    "closed_form": "closed form",
    "optimal": "optimised",
    "optimal_friction": "optimised with friction and load",
}
"""Labels of the ways."""

FRICTION_AND_LOAD: dict[str, Any] = dict.fromkeys(
    ("dead_band", "v_offset", "compliance", "speed_per_torque", "sag_sin", "sag_cos"), 0.0
)
"""Parameters that the plain optimised plan does without."""

RUN_IN = 0.5
"""Beginning of the test motion whose errors do not count [s]: until the first motion frees it,
friction leaves a joint up to its dead band off the first request, by chance."""

AS_GOOD = 1.02
"""A simpler way is preferred to one that is better by less than this factor."""


class Candidate(NamedTuple):
    """A way to make the joint follow the test motion."""

    way: Way
    error: float  # root mean square of the measured errors after the run-in [rad]
    max_error: float  # the largest of them [rad]
    largest_step: float  # largest change between requests [rad]
    expected: float  # the error that the model led one to expect [rad]; NaN without one
    angles: Array  # the measured angles [rad], NaN where none was read, shape (n,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """A calibrated joint."""

    identification: Identification
    candidates: tuple[Candidate, ...]  # every way, the simplest first
    recommended: Candidate
    model: JointModel  # of the recommended way, with its verdict
    desired: Array  # the test motion [rad], shape (n,)

    def named(self, way: Way) -> Candidate:
        """The candidate of this way."""
        return next(each for each in self.candidates if each.way == way)


def compare(
    identification: Identification,
    limits: tuple[float, float],
    measure: Callable[[str, Array], Array],
) -> Compared:
    """Play the test motion in every way, and recommend the one with the least measured error.

    ``limits`` are the least and largest request [rad]; ``measure`` plays requests [rad] under a
    name and returns the measured angles, NaN where none was read, (n,).
    """
    model = identification.model
    desired = test_motion(model, limits)
    plain = replace(model, **FRICTION_AND_LOAD)
    plans: dict[Way, Inversion] = {
        "shift": invert_shift(model, desired, cyclic=False),
        "closed_form": invert_closed_form(model, desired, cyclic=False),
        "optimal": invert_optimal(plain, desired, cyclic=False, limits=limits),
    }
    if plain != model:
        plans["optimal_friction"] = invert_optimal(model, desired, cyclic=False, limits=limits)
    ways: tuple[Way, ...] = ("direct", *plans)
    candidates = []
    for name in ways:
        allowed = np.clip(desired if name == "direct" else plans[name].requests, *limits)
        expected = np.nan if name in ("direct", "shift") else plans[name].expected.error
        angles = measure(name, allowed)
        errors = (angles - desired)[round(RUN_IN / model.period) :]
        errors = errors[np.isfinite(errors)]
        step = float(np.max(np.abs(np.diff(allowed))))
        largest = float(np.max(np.abs(errors)))
        candidates.append(Candidate(name, rms(errors), largest, step, expected, angles))
    least = min(each.error for each in candidates)
    recommended = next(each for each in candidates if each.error <= AS_GOOD * least)
    used, evidence = model, model.evidence or Evidence()
    if recommended.way == "optimal":  # without friction and load: its error on the test motion
        known = {k: ends for k, ends in evidence.intervals.items() if k not in FRICTION_AND_LOAD}
        used, evidence = (
            plain,
            evidence._replace(
                error=recommended.error,
                by_acceleration=(),
                spread=Evidence().spread,
                intervals=known,
                correlations=(),
            ),
        )
    if recommended.way in ("direct", "shift"):
        words = f"on the test motion of its calibration '{WORDS[recommended.way]}' was closer"
        evidence = evidence._replace(verdict="worse than a delay", reason=words)
    return Compared(
        identification=identification,
        candidates=tuple(candidates),
        recommended=recommended,
        model=used.with_evidence(evidence),
        desired=desired,
    )


def test_motion(model: JointModel, limits: tuple[float, float]) -> Array:
    """Sines, then moves to and fro with rests between them, for 5 s in all [rad], shape (n,).

    They are at the model's rate of requests, as fast as the joint can follow, and begin and end at
    rest in the middle of the limits.
    """
    period = model.period
    half = 2.5
    middle = 0.5 * (limits[0] + limits[1])
    reach = 0.8 * 0.5 * (limits[1] - limits[0])
    sines = excite(
        "multisine",
        limits=(middle - reach, middle + reach),
        period=period,
        duration=half,
        highest=min(1.5, 0.4 / period),
        seed=7,
    ).requests
    levels = middle + reach * np.array([0.0, 0.9, 0.3, -0.8, -0.5, 0.0])
    # from level to level along minimum-jerk curves in two thirds of the time, then at rest
    samples = round(half / period)
    each = samples // (len(levels) - 1)
    shares = np.clip(1.5 * np.arange(1, each + 1) / each, 0.0, 1.0)
    rise = shares**3 * (10.0 - 15.0 * shares + 6.0 * shares**2)
    moves = [low + (high - low) * rise for low, high in pairwise(levels)]
    rest = np.full(samples - each * len(moves), levels[-1])
    angles = np.concatenate([sines, *moves, rest])
    fastest = float(np.max(np.abs(np.diff(angles)))) / period
    share = min(1.0, 0.6 * model.v_max / fastest)
    scaled: Array = middle + share * (angles - middle)
    return scaled
