"""Reference fits: many seeds, the proved optima, and every question that ``fit_pwl`` answers."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import planner
from benchmark.instances import Array, random_attainable, random_saturating, reference
from benchmark.reference.record import Case, Numbers
from tests.approximation.samples import oracle_instance, oracle_instances

SEEDS = 40
UNSEEN = 1000  # first seed of samples that are in no stored table of the tests
SEGMENTS = (2, 3, 4, 5, 6, 7, 8, 12)

OPTIMA = Path(__file__).resolve().parents[3] / "tests/approximation/oracle.json"

NEGLIGIBLE = 1e-6  # errors below this share of the samples' range are compared as if they were it


def series_of(seed: int) -> tuple[Array, dict[str, Any]]:
    """Samples, ``v_max`` and ``tick``: joints at odd seeds, of all kinds at even ones."""
    if seed % 4 == 1:
        instance = random_saturating(UNSEEN + seed)
    elif seed % 4 == 3:
        instance = random_attainable(UNSEEN + seed)
    else:
        drawn = oracle_instance(UNSEEN + seed // 2)
        return drawn.desired, {name: drawn.settings[name] for name in ("v_max", "tick")}
    return instance.desired, {"v_max": instance.model.v_max, "tick": instance.model.period}


def fits() -> Iterator[Case]:
    """All counts of segments over the seeds, as cycles and as open paths."""
    for seed in range(SEEDS):
        desired, settings = series_of(seed)
        for cyclic in (True, False):
            for segments in SEGMENTS:
                name = f"{seed} {'cycle' if cyclic else 'path'} {segments}"
                yield name, partial(fit, desired, **settings, cyclic=cyclic, segments=segments)


def optima() -> Iterator[Case]:
    """The fits whose optimum among knots on samples is proved."""
    table = json.loads(OPTIMA.read_text())
    for each, stored in zip(oracle_instances(), table, strict=True):
        settings = each.settings | {"segments": each.segments}
        yield f"{each.seed}", partial(fit, each.desired, **settings, optimum=stored["rms"])


def questions() -> Iterator[Case]:
    """Every question on several series."""
    joint = reference()[0]
    walk = joint.desired, {"v_max": joint.model.v_max, "tick": joint.model.period}
    named = {f"{seed}": series_of(seed) for seed in range(0, 16, 2)} | {"rotator": walk}
    for series, (desired, settings) in named.items():
        for cyclic in (True, False):
            for question, arguments in asked_of(desired, **settings, cyclic=cyclic).items():
                name = f"{question}: {series} {'cycle' if cyclic else 'path'}"
                yield name, partial(fit, desired, **settings, cyclic=cyclic, **arguments)
    for seed, n in enumerate((300, 1000, 3000)):
        long = oracle_instance(UNSEEN + 8 * seed + 1, n=n)  # sines, noise and steps
        arguments = asked_of(long.desired, **long.settings)
        for question in ("automatic", "within 1 %", "segments 8"):
            call = partial(fit, long.desired, **long.settings, **arguments[question])
            yield f"{question}: {n} samples", call


def asked_of(desired: Array, **settings: Any) -> dict[str, dict[str, Any]]:
    """The questions by name: keywords of ``fit_pwl``.

    Errors are allowed above those of the curve with a knot at every sample, so that some fit.
    """
    n, extent = len(desired), float(np.ptp(desired))
    ideal = planner.fit_pwl(desired, **settings, knots=np.arange(n))
    largest, rms = (round(error / extent, 4) for error in (ideal.max_error, ideal.rms))
    return {
        "automatic": {},
        "segments 8": {"segments": 8},
        "within 1 %": {"max_error": (largest + 0.01) * extent},
        "within 5 %": {"max_error": (largest + 0.05) * extent},
        "rms 2 %": {"max_rms": (rms + 0.02) * extent},
        "required": {"segments": 6, "required": (0, n // 3, n / 2 + 0.5)},
        "required angles": {"segments": 6, "required": {n // 4: float(desired[n // 4])}},
        "given knots": {"knots": np.linspace(0.0, n - 1.0, 9)[1:-1] + 0.25},
        "exact": {"segments": 4, "exact": True},
    }


def fit(desired: Array, *, optimum: float | None = None, **arguments: Any) -> Numbers:
    """The fit's numbers."""
    result = planner.fit_pwl(desired, **arguments)
    floor = NEGLIGIBLE * float(np.ptp(desired))
    numbers: Numbers = {
        "error": result.rms,
        "floor": floor,
        "max_error": result.max_error,
        "segments": result.segments,
        "steepest": float(np.max(np.abs(result.slopes))) / result.v_max - 1.0,
        "knots": result.knots.tolist(),
        "values": result.values.tolist(),
    }
    if optimum is not None:
        numbers["over optimum"] = max(result.rms, floor) / max(optimum, floor) - 1.0
    if arguments.get("segments") is None:
        numbers["counted"] = math.inf if "knots" in arguments else result.segments
    return numbers
