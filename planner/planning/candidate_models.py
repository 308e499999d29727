"""The models that joints may have: given ones, or drawn from the intervals of an identified one."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from planner.exceptions import InvalidInput, InvalidModel
from planner.model.evidence import GAIN
from planner.model.joint import JointModel, checked_model
from planner.trajectory import Array
from planner.validation import check_choice

if TYPE_CHECKING:
    from planner.identification.result import Identification

Robust = Literal["mean", "worst"]
"""The error over several models that is minimised."""

ModelOrModels: TypeAlias = "JointModel | Sequence[JointModel] | Identification"
"""A joint: its model, candidate models, or an identification, whose intervals give candidates."""

Models: TypeAlias = "ModelOrModels | Sequence[ModelOrModels] | Mapping[str, ModelOrModels]"
"""One model for all joints, one for each, or models by joint; the key "" holds the default one.

Instead of one model: a sequence of candidate models, nominal first, or an identification.
"""


def models_of_joints(
    # see :data:`Models`. For one joint a flat sequence of more than one has its models.
    models: Models,
    names: Sequence[str],
    robust: Robust | None = None,  # whether candidates are drawn for single models
    *,
    # whether the models of different joints are drawn independently of one another. Joints with the
    # same model share the draws.
    independent: bool = False,
) -> list[tuple[JointModel, ...]]:
    """The candidate models of each joint, checked, the nominal one first.

    A single model is the only candidate, unless ``robust`` asks for models drawn from its
    intervals. A sequence lists all candidates, even if it has one alone. The candidates of an
    identification are always drawn from its intervals.
    """
    if robust is not None:
        check_choice("robust", robust, get_args(Robust))
    # An identification exists only where its module is loaded, which takes SciPy.
    module = sys.modules.get("planner.identification.result")
    identification: Any = getattr(module, "Identification", ())
    entries: list[Any]
    if isinstance(models, Mapping):
        if missing := [name for name in names if name not in models and "" not in models]:
            raise InvalidInput(
                f"models: none for joint '{missing[0]}'; got "
                f"{', '.join(map(str, models)) or 'none'}"
            )
        entries = [models[name] if name in models else models[""] for name in names]
    elif isinstance(models, (JointModel, identification)):
        entries = [models] * len(names)
    else:
        try:
            entries = list(models)  # type: ignore[arg-type]  # other types are rejected below
        except TypeError:
            entries = []
        if len(names) == 1 and len(entries) > 1:
            entries = [entries]
        fit = names == ("",) or all(
            isinstance(each, (JointModel, Sequence, identification)) and not isinstance(each, str)
            for each in entries
        )
        if len(entries) != len(names) or not fit:
            raise InvalidInput(
                f"models: got {len(entries)} of them for {len(names)} joints ({', '.join(names)}), "
                "expected one JointModel, or one for each"
            )
    several, sources = list[tuple[JointModel, ...]](), list[Any]()  # sources of draws
    for entry in entries:
        identified = isinstance(entry, identification)
        model = entry.model if identified else entry
        sources.append((model, getattr(model, "evidence", None)))
        if isinstance(model, Sequence) and not isinstance(model, str):
            several.append(tuple(map(checked_model, model)))
            own = [each.period for each in several[-1]]
            if not own or len(set(own)) > 1:
                raise InvalidInput(
                    f"model: got {len(own)} models with periods of "
                    f"{', '.join(f'{period:g}' for period in own) or 'nothing'} s, expected at "
                    "least one, all of one joint with one request period"
                )
        elif robust is None and not identified:
            several.append((checked_model(model),))
        else:
            seed = sources.index(sources[-1]) if independent else 0
            several.append(drawn_models(checked_model(model), seed=seed))
    if robust is not None and all(len(each) == 1 for each in several):
        raise InvalidInput(
            f"robust: got {robust!r} for a sequence of one model, which the joint has in any case; "
            "expected several models, or the model by itself, from whose intervals others are drawn"
        )
    if len(periods := sorted({each[0].period for each in several})) > 1:
        raise InvalidInput(
            f"models: their periods are {', '.join(f'{p:g}' for p in periods)} s, expected one "
            "period: joints that are requested at different rates are not planned together"
        )
    return several


PAIRS = 4
"""Pairs of models beside the nominal one, either side of it."""

QUANTILE = 1.96
"""Half the width of a 95 % interval [standard deviations]."""

DELAYS = {"lag": 1.0, "acceleration_time": 0.5, "time_constant": 1.0}
"""Share of each part of the switching time, l + a/2 + T."""

MOST_REJECTED = 100
"""Most draws per model: with five parameters near 0 one draw in 32 has no negative parameter."""


def drawn_models(model: JointModel, *, pairs: int = PAIRS, seed: int = 0) -> tuple[JointModel, ...]:
    """The model, and pairs of further models within its intervals.

    They are drawn from a normal distribution with the intervals' widths, either side by itself, and
    their correlations, but none outside of the intervals, except for the lag (below); in pairs on
    either side of the model, always the same ones. An interval that ends at 0, where lags, times
    and dead bands end, is taken as wide on that side as on the other, and draws below 0 are
    rejected: with 0 in place of such a parameter the other parameters would not fit. A parameter
    does not move towards an unknown end, which for the largest acceleration is 0 as well. But where
    logs give no upper bound on the top speed, its reciprocal is drawn, down to 0, and theta_0
    follows from the gain. A time constant or an integral rate of 0 stays 0: the log did not call
    for one.

    Logs with moving requests determine the switching time far better than its parts. Correlations
    do not show this for an interval that ends at 0: in models drawn from an identified one the lag
    makes up for such a part, and then for the acceleration time, but for ``delay_error`` of its
    evidence.
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
            if draws > MOST_REJECTED * count:  # hardly any draw is above 0
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
