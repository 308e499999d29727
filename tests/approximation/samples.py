"""Random samples of every kind that a fit may meet."""

from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st

KINDS = ("sines", "noise", "steps", "ramp", "noisy sine", "walk", "impulse")
EXACT_KNOTS = np.array([3.0, 20.5, 41.25, 70.0])
EXACT_VALUES = np.array([0.1, 0.8, -0.3, 0.4])  # corners on samples and between them


def samples_of(kind, n, rng):
    """Samples [rad], shape (n,), of about unit size."""
    t = np.arange(n) / n
    if kind == "sines":
        waves = rng.integers(1, 5, size=3)[:, None]
        return rng.normal(size=3) @ np.sin(2 * np.pi * (waves * t + rng.uniform(size=(3, 1))))
    if kind == "noise":
        return rng.normal(size=n)
    if kind == "steps":
        return rng.normal(size=5)[np.searchsorted(np.sort(rng.uniform(size=4)), t)]
    if kind == "ramp":
        return rng.normal() * t
    if kind == "noisy sine":
        return np.sin(2 * np.pi * (t + rng.uniform())) + 0.1 * rng.normal(size=n)
    if kind == "walk":
        walk = np.cumsum(rng.normal(size=n)) / np.sqrt(n)
        return walk - walk[-1] * t
    return (np.arange(n) == rng.integers(n)).astype(float)


def closed(fit):
    """Knots and values of a fit with the end of the cycle, from its public fields."""
    if not fit.cyclic:
        return fit.knots, fit.values
    return np.append(fit.knots, fit.knots[0] + fit.samples), np.append(fit.values, fit.values[0])


@st.composite
def problems(draw, least=3, most=60):
    """Samples [rad], the largest rise per sample [rad], and whether they are a cycle."""
    n = draw(st.integers(least, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    desired = samples_of(draw(st.sampled_from(KINDS)), n, rng)
    desired = desired * 10.0 ** draw(st.integers(-6, 3)) + draw(st.sampled_from([0.0, 1.0, -30.0]))
    steepness = 10.0 ** draw(st.floats(-3.0, 3.0))  # of the bound, over the range in one cycle
    return desired, steepness * max(np.ptp(desired), 1e-9) / n, draw(st.booleans())


def on_a_cycle(n=88):
    """Samples of the cycle with those corners."""
    return np.interp(np.arange(n), EXACT_KNOTS, EXACT_VALUES, period=n)


def on_a_path(n=88):
    """Samples of the path with those corners and two ends."""
    knots, values = np.r_[0.0, EXACT_KNOTS, n - 1.0], np.r_[0.0, EXACT_VALUES, -0.2]
    return np.interp(np.arange(n), knots, values)


class Instance(NamedTuple):
    """A fit whose proved optimum is stored."""

    seed: int
    desired: np.ndarray
    settings: dict
    segments: int


def oracle_instance(seed, n=88):
    """The instance of this number: every kind, cyclic or not, bounds tight and loose."""
    rng = np.random.default_rng(seed)
    desired = samples_of(KINDS[seed % len(KINDS)], n, rng)
    step = rng.choice([1.5, 3.0, 6.0, 50.0]) * np.ptp(desired) / n
    settings = {"v_max": float(step), "tick": 1.0, "cyclic": bool(rng.integers(2))}
    return Instance(seed, desired, settings, int(rng.integers(2, 8)))


def oracle_instances(count=63):
    """Those of the stored table."""
    return [oracle_instance(seed) for seed in range(count)]
