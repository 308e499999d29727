"""Candidate models of a joint, drawn from the intervals of an identified one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.exceptions import InvalidInput, InvalidModel
from planner.model.evidence import GAIN
from planner.model.joint import JointModel

PAIRS = 4
"""Pairs of models beside the nominal one, either side of it."""

QUANTILE = 1.96
"""Half the width of a 95 % interval [standard deviations]."""

DELAYS = {"lag": 1.0, "acceleration_time": 0.5, "time_constant": 1.0}
"""Share of each part of the switching time, l + a/2 + T."""


def drawn_models(model: JointModel, *, pairs: int = PAIRS, seed: int = 0) -> tuple[JointModel, ...]:
    """The model, and pairs of further models within its intervals, always the same ones.

    They are drawn from a normal distribution with the intervals' widths, either side by itself, and
    their correlations. An interval that ends at 0 is taken as wide on that side as on the other,
    and draws below 0 are rejected. A parameter does not move towards an unknown end; but where logs
    give no upper bound on the top speed, its reciprocal is drawn, down to 0, and theta_0 follows
    from the gain. A time constant or an integral rate of 0 stays 0.

    Logs with moving requests determine the switching time far better than its parts, which
    correlations do not show for an interval that ends at 0: the lag makes up for such a part, and
    then for the acceleration time, but for ``delay_error`` of the evidence.
    """
    if not has_intervals(model):
        raise InvalidInput(
            "model: got one without intervals of its parameters, from which other models are "
            "drawn; expected one that planner.identify found or planner.read_models read from its "
            "file, or several models"
        )
    evidence = model.evidence
    assert evidence is not None, "a model without intervals was refused"
    intervals = _drawn_from(model)
    names, ends = list(intervals), np.array(list(intervals.values()))
    values = np.array([getattr(model, name) for name in names])
    down, up = np.where(np.isfinite(ends), np.abs(ends - values[:, np.newaxis]), 0.0).T / QUANTILE
    ends_at_zero = (ends[:, 0] == 0.0) & (values >= 0.0)
    down = np.where(ends_at_zero, np.maximum(down, up), down)
    open_above = np.array([name == "v_max" and GAIN in names for name in names])
    open_above &= np.isfinite(ends[:, 0]) & np.isinf(ends[:, 1])

    def moves_of(z: Array) -> Array:
        linear = np.where(z < 0.0, down, up) * z
        return np.where(open_above & (z > 0.0), values * z / (QUANTILE - z), linear)

    matrix, shares, delay_error = np.eye(len(names)), np.zeros(len(names)), 0.0
    if evidence.correlations:
        rows = [[*evidence.intervals].index(name) for name in names]
        matrix = np.array(evidence.correlations)[np.ix_(rows, rows)]
        shares = np.where(ends_at_zero, [DELAYS.get(name, 0.0) for name in names], 0.0)
        if np.any(shares) and "acceleration_time" in names:  # the lag no longer moves against it
            shares[names.index("acceleration_time")] = DELAYS["acceleration_time"]
        delay_error = evidence.delay_error
    eigenvalues, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0)) @ vectors.T  # unique: symmetric
    rng, moves, draws = np.random.default_rng(seed), list[Array](), 0
    count = 2 * pairs
    while len(moves) < count:
        draw, draws = root @ rng.standard_normal(len(names)), draws + 1
        for move in map(moves_of, (draw, -draw) if np.all(np.abs(draw) < QUANTILE) else ()):
            below = ends_at_zero & (values + move < 0.0)
            if draws > 100 * count:  # hardly any draw is above 0; of five parameters one in 32
                move = np.where(below, -values, move)
            elif np.any(below):
                continue
            moves.append(_delay_kept(names, values, move, shares, delay_error))
    return (model, *(_moved(model, names, move) for move in moves[:count]))


def has_intervals(model: JointModel) -> bool:
    """Whether other models can be drawn from this model's intervals."""
    return any(math.isfinite(end) for ends in _drawn_from(model).values() for end in ends)


def _drawn_from(model: JointModel) -> dict[str, tuple[float, float]]:
    """The intervals from which parameters are drawn, with -inf or inf at unknown ends."""
    intervals = dict(model.evidence.intervals) if model.evidence else {}
    for name in ("time_constant", "integral_rate", "position_integral_rate"):
        if getattr(model, name) == 0.0:
            intervals.pop(name, None)
    least, most = intervals.get("max_acceleration", (math.inf, math.inf))
    if least <= 0.0:  # a joint that hardly accelerates explains no log
        intervals["max_acceleration"] = -math.inf, most
    return intervals


def _delay_kept(
    names: Sequence[str], values: Array, move: Array, shares: Array, delay_error: float
) -> Array:
    """The move of parameters with a delay that changes by at most an error [s].

    The lag is earlier or later; the parts of the delay, by their shares in it, move less where it
    would be below 0.
    """
    if "lag" not in names or not np.any(shares):
        return move
    lag, kept = names.index("lag"), move.copy()
    shares = np.where(np.arange(len(names)) == lag, 1.0, shares)
    change = float(shares @ move)
    excess = change - min(max(change, -delay_error), delay_error)
    for part in (lag, *np.flatnonzero(shares)):
        less = min(excess / shares[part], values[part] + kept[part])
        kept[part] -= less
        excess -= shares[part] * less
    return kept


def _moved(model: JointModel, names: Sequence[str], move: Array) -> JointModel:
    """The model with its parameters moved, half as far while they would be invalid."""
    moved = {name: getattr(model, name) + by for name, by in zip(names, move.tolist(), strict=True)}
    gain = moved.pop(GAIN, None)
    if gain is not None and gain > 0.0:
        moved["theta_0"] = moved.get("v_max", model.v_max) / gain
    try:
        if gain is not None and gain <= 0.0:
            raise InvalidModel(f"v_max / theta_0: got {gain:g}, expected more than 0")
        return replace(model, **moved)
    except InvalidModel:
        return _moved(model, names, move / 2.0)
