"""The optimum with knots on samples by trying every set of knots, found once for all tests."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from tests.approximation.samples import KINDS, samples_of

CLOSED = 1e3
"""Weight of the condition that a cycle closes, in units of the samples' own."""


def least_error(desired, segments, step, cyclic):
    """Smallest squared error with all knots on samples: every set of knots, best first.

    The unknowns are one value and the slopes, so that bounds on slopes are bounds on unknowns. The
    error without bounds is a lower bound that ends the enumeration early.
    """
    n = desired.size
    index = np.arange(n, dtype=float)
    inner = combinations(range(n) if cyclic else range(1, n - 1), segments - (not cyclic))
    sets = np.array(list(inner), dtype=float).reshape(-1, segments - (not cyclic))
    if not cyclic:
        sets = np.column_stack([np.zeros(len(sets)), sets])
    starts = sets - sets[:, :1]
    ends = np.column_stack([starts[:, 1:], np.full(len(sets), n if cyclic else n - 1.0)])
    since = np.mod(index - sets[:, :1], n)
    runs = np.clip(since[:, :, None] - starts[:, None, :], 0.0, (ends - starts)[:, None, :])
    bases = np.concatenate([np.ones((len(sets), n, 1)), runs], axis=2)  # (sets, n, S + 1)
    targets = np.tile(desired, (len(sets), 1))
    if cyclic:
        closing = np.concatenate([np.zeros((len(sets), 1)), ends - starts], axis=1)
        bases = np.concatenate([bases, CLOSED * closing[:, None, :]], axis=1)
        targets = np.column_stack([targets, np.zeros(len(sets))])
    q, _ = np.linalg.qr(bases)
    free = np.sum(targets**2, axis=1) - np.sum(np.einsum("snk,sn->sk", q, targets) ** 2, axis=1)
    bounds = np.r_[-np.inf, np.full(segments, -step)], np.r_[np.inf, np.full(segments, step)]
    least = np.inf
    for number in np.argsort(free):
        if free[number] >= least:
            break
        least = min(least, 2.0 * lsq_linear(bases[number], targets[number], bounds).cost)
    return least


class Enumerated(NamedTuple):
    """An instance, and the least rms error with its knots on samples."""

    desired: np.ndarray
    settings: dict
    segments: int
    rms: float


@cache
def enumerated(seed):
    """The small instance of this number: every kind, cycles and paths, bounds tight and loose."""
    rng = np.random.default_rng(seed)
    cyclic, kind = bool(seed % 2), KINDS[seed % len(KINDS)]
    segments, n = (3, 22) if cyclic else (4, 20)
    desired = samples_of(kind, n, rng)
    step = float(rng.choice([1.0, 2.0, 4.0, 50.0]) * np.ptp(desired) / n)
    rms = float(np.sqrt(least_error(desired, segments, step, cyclic) / n))
    return Enumerated(desired, {"v_max": step, "tick": 1.0, "cyclic": cyclic}, segments, rms)
