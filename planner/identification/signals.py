"""Shapes of test signals: deflections between -1 and 1 that begin and end at rest at 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.exceptions import InvalidInput
from planner.model.step_test import step_test
from planner.trajectory import Array

TONES = 12
"""Sines in a multisine: about five to a factor of ten in frequency."""

DRAWS = 64
"""Random phases that are tried for a multisine; the one with the lowest peak is kept."""

SHORTEST_DWELL = 0.12
LONGEST_DWELL = 0.9
"""A random step lasts between these [s]: from about a hobby servo's lag and acceleration time to
what it takes to arrive."""

TRIANGLE_CYCLES = (1, 2, 4, 8)
"""Cycles of a triangle in each of its equally long parts: speeds that double from part to part."""

TAPER = 0.08
"""Part of the signal over which a sine swells at the start, and dies down at the end."""


def steps(samples: int, *, shares: Sequence[float], cycles: int) -> Array:
    """Step tests of Equation 1 about 0, one height after the other.

    Args:
        samples: Length of the signal.
        shares: Height of each test, as a share of the whole range from -1 to 1.
        cycles: Cycles of each test; whole, and as long as the samples allow.

    Raises:
        InvalidInput: A half cycle would be shorter than two samples.
    """
    half = samples // (2 * cycles * len(shares))
    if half < 2:
        raise InvalidInput(
            f"{samples} samples for {len(shares)} step tests of {cycles} cycles leave {half} for "
            "a half cycle, expected at least 2: ask for a longer duration or for fewer tests"
        )
    tests = [np.tile(step_test(2.0 * share, samples=2 * half) - share, cycles) for share in shares]
    made = np.concatenate(tests)
    return np.append(made, np.zeros(samples - len(made)))


def multisine(samples: int, *, period: float, highest: float, seed: int) -> Array:
    """A sum of sines of random phase, low ones larger, that swells and dies down.

    Args:
        samples: Length of the signal.
        period: Time between samples [s].
        highest: Highest frequency [Hz].
        seed: Of the phases; of several draws the one with the lowest peak is kept.
    """
    most = max(1, int(highest * samples * period))
    waves = np.unique(np.round(np.geomspace(min(2, most), most, TONES)))  # in the whole signal
    amplitudes = waves**-0.5
    angles = 2.0 * np.pi * np.outer(waves, np.arange(samples) / samples)
    swell = _swell(samples)
    drawn = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (DRAWS, len(waves)))
    made = [swell * (amplitudes @ np.sin(angles + phases[:, None])) for phases in drawn]
    flattest = min(made, key=lambda signal: float(np.max(np.abs(signal)) / np.std(signal)))
    scaled: Array = flattest / np.max(np.abs(flattest))
    return scaled


def chirp(samples: int, *, period: float, highest: float) -> Array:
    """A sine whose frequency grows by equal factors in equal times, up to ``highest`` [Hz]."""
    duration = samples * period
    lowest = min(1.0 / duration, highest / 2.0)
    rate = np.log(highest / lowest) / duration
    times = np.arange(samples) * period
    made: Array = _swell(samples) * np.sin(2.0 * np.pi * lowest * np.expm1(rate * times) / rate)
    return made


def random_steps(samples: int, *, period: float, seed: int) -> Array:
    """Levels drawn evenly between -1 and 1, each held for a random while."""
    draw = np.random.default_rng(seed)
    made = np.zeros(samples)
    start = 0
    while start < samples:
        dwell = np.exp(draw.uniform(np.log(SHORTEST_DWELL), np.log(LONGEST_DWELL)))
        end = start + max(2, round(dwell / period))
        made[start:end] = draw.uniform(-1.0, 1.0)
        start = end
    return made


def triangle(samples: int) -> Array:
    """To and fro between -1 and 1 at constant speeds, each part twice as fast as the last."""
    parts = []
    for cycles, rows in zip(
        TRIANGLE_CYCLES, np.array_split(np.empty(samples), len(TRIANGLE_CYCLES)), strict=True
    ):
        phase = np.mod(cycles * np.arange(len(rows)) / len(rows) + 0.75, 1.0)
        parts.append(1.0 - 4.0 * np.abs(phase - 0.5))
    made: Array = -np.concatenate(parts)
    return made


def _swell(samples: int) -> Array:
    """From 0 to 1 along half a cosine, and back at the end."""
    share = np.arange(samples) / samples
    nearest_end = np.minimum(share, 1.0 - share)
    risen: Array = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, nearest_end / TAPER))
    return risen
