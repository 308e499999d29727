"""Test signals for a joint: inside its limits, gentle at both ends, the same at every call."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.exceptions import InvalidInput
from planner.identification import signals
from planner.trajectory import Array

SHARES = (0.125, 0.5, 1.0)
"""Step tests that are made by default, as shares of the range: well inside theta_0 of most joints,
and far beyond it."""

REST = 0.5
"""Longest rest at the centre before and after the signal [s]; it shows the offset."""

LEAST_SAMPLES = 40
"""Samples below which no signal deserves its name."""

MOST_SAMPLES = 1_000_000

MEANING: Mapping[str, str] = {
    "steps": "Step tests (Equation 1). Each edge shows lag and acceleration time, the straight "
    "line of a large step the top speed, the rounded end of every step v_max/theta_0, the rests "
    "the offset. theta_0 and v_max come apart where the larger steps exceed theta_0.",
    "multisine": "Many sines at once. The phases show lag, acceleration time and v_max/theta_0, "
    "the mean the offset. The top speed shows only where the joint falls behind by more than "
    "theta_0: widen the limits or raise the highest frequency.",
    "chirp": "A sine that quickens. Its slow part shows the offset, its middle lag and "
    "v_max/theta_0, its fast part, where the joint falls behind, the top speed.",
    "random_steps": "Random levels for random times. All edges, heights and rests at once: every "
    "parameter, where the levels are further apart than theta_0.",
    "triangle": "To and fro at constant speeds. At each speed the joint trails by a constant "
    "error, so that f can be read backwards, from speed to error; lag and acceleration time show "
    "at the corners only. The top speed shows where a part is faster than the joint.",
}
"""The kinds of signals, and what each makes identifiable."""


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Requests to play on a joint, which must be at ``centre`` before the first.

    Attributes:
        kind: One of :data:`MEANING`.
        times: Times of the requests [s], shape (n,), from 0, read-only.
        requests: Requests [rad], shape (n,), read-only; the first and the last are the centre.
        period: Time between requests [s].
        centre: Where the signal begins and ends [rad].
        reach: Farthest that a request may be from the centre [rad].
        amplitudes: Heights of the step tests [rad]; empty for other kinds.
    """

    kind: str
    times: Array  # (n,)
    requests: Array  # (n,)
    period: float
    centre: float
    reach: float
    amplitudes: tuple[float, ...] = ()

    @property
    def meaning(self) -> str:
        """What the signal makes identifiable, in words."""
        return MEANING[self.kind]

    @property
    def largest_jump(self) -> float:
        """Largest change from one request to the next [rad]."""
        return float(np.max(np.abs(np.diff(self.requests))))


def excite(
    kind: str,
    *,
    limits: tuple[float, float],
    period: float,
    duration: float,
    centre: float | None = None,
    amplitudes: Sequence[float] | None = None,
    cycles: int = 3,
    highest: float | None = None,
    seed: int = 0,
) -> Excitation:
    """Make a test signal that never leaves the limits and rests at the centre at both ends.

    Args:
        kind: ``steps`` (Equation 1, about the centre), ``multisine``, ``chirp``, ``random_steps``
            or ``triangle``.
        limits: Least and largest request [rad].
        period: Time between requests [s].
        duration: Length of the whole signal [s].
        centre: Where it begins and ends [rad]; by default the middle of the limits. It deflects
            as far to one side as to the other.
        amplitudes: For ``steps``: height theta_test of each test [rad]; by default an eighth, half
            and the whole of what the limits allow.
        cycles: For ``steps``: cycles of each test.
        highest: For ``multisine`` and ``chirp``: highest frequency [Hz]; by default a tenth of the
            rate of the requests, at most 5.
        seed: For ``multisine`` and ``random_steps``.

    Raises:
        InvalidInput: Limits, centre or amplitudes contradict each other, or nothing fits into the
            duration.
    """
    if kind not in MEANING:
        raise InvalidInput(f"kind: got '{kind}', expected one of {', '.join(MEANING)}")
    middle, reach = _deflection(limits, centre)
    samples, rest = _lengths(period, duration)
    moving = samples - 2 * rest
    fastest = min(5.0, 0.1 / period) if highest is None else highest
    if not 0.0 < fastest <= 0.5 / period:
        raise InvalidInput(
            f"highest: got {fastest:g} Hz, expected more than 0 and at most {0.5 / period:g}, half "
            "the rate of the requests"
        )
    if cycles < 1:
        raise InvalidInput(f"cycles: got {cycles}, expected 1 or more")
    heights = _heights(amplitudes, reach) if kind == "steps" else ()
    make: Mapping[str, Callable[[], Array]] = {
        "steps": lambda: signals.steps(
            moving, shares=[height / (2.0 * reach) for height in heights], cycles=cycles
        ),
        "multisine": lambda: signals.multisine(moving, period=period, highest=fastest, seed=seed),
        "chirp": lambda: signals.chirp(moving, period=period, highest=fastest),
        "random_steps": lambda: signals.random_steps(moving, period=period, seed=seed),
        "triangle": lambda: signals.triangle(moving),
    }
    deflection = np.pad(make[kind](), rest)
    requests = np.clip(middle + reach * deflection, *limits)  # rounding may not leave the limits
    times = np.arange(samples, dtype=np.float64) * period
    for array in (times, requests):
        array.setflags(write=False)
    return Excitation(
        kind=kind,
        times=times,
        requests=requests,
        period=period,
        centre=middle,
        reach=reach,
        amplitudes=heights,
    )


def _deflection(limits: tuple[float, float], centre: float | None) -> tuple[float, float]:
    low, high = limits
    if not -math.inf < low < high < math.inf:
        raise InvalidInput(f"limits: got {low:g} to {high:g} rad, expected the lower one first")
    middle = 0.5 * (low + high) if centre is None else centre
    if not low < middle < high:
        raise InvalidInput(
            f"centre: got {middle:g} rad, expected between the limits {low:g} and {high:g}"
        )
    return middle, min(middle - low, high - middle)


def _lengths(period: float, duration: float) -> tuple[int, int]:
    """Samples of the whole signal, and of the rest at either end."""
    if not 0.0 < period < math.inf:
        raise InvalidInput(f"period: got {period:g} s, expected more than 0")
    if not LEAST_SAMPLES * period <= duration <= MOST_SAMPLES * period:
        raise InvalidInput(
            f"duration: got {duration:g} s, expected {LEAST_SAMPLES} to {MOST_SAMPLES} requests of "
            f"{period:g} s, so {LEAST_SAMPLES * period:g} to {MOST_SAMPLES * period:g} s"
        )
    samples = round(duration / period)
    return samples, max(1, round(min(REST, 0.1 * duration) / period))


def _heights(amplitudes: Sequence[float] | None, reach: float) -> tuple[float, ...]:
    if amplitudes is None:
        return tuple(2.0 * reach * share for share in SHARES)
    for amplitude in amplitudes:
        if not 0.0 < amplitude <= 2.0 * reach * (1.0 + 1e-12):
            raise InvalidInput(
                f"amplitudes: got a step of {amplitude:g} rad, expected more than 0 and at most "
                f"{2.0 * reach:g}, what the limits allow about the centre"
            )
    if not amplitudes:
        raise InvalidInput("amplitudes: got none, expected at least one [rad]")
    return tuple(float(amplitude) for amplitude in amplitudes)
