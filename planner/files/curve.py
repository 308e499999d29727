"""Piecewise-linear curves: JSON for all of a curve, CSV for its knots."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from planner.approximation.curve import PiecewiseLinear
from planner.exceptions import InvalidFile, InvalidInput
from planner.files.table import read_table, write_table
from planner.files.text import read_text, write_text

KNOT, VALUE = "knot_s", "value_deg"
"""Columns of the CSV: time of a knot [s] and the angle there [degrees]."""


def write_curve(path: Path | str, curve: PiecewiseLinear) -> None:
    """Write a curve: CSV with :data:`KNOT` and :data:`VALUE` columns, or JSON for ``*.json``.

    JSON keeps every digit and says what a CSV does not: samples, tick, and whether it is a cycle.
    """
    if _is_json(path):
        write_text(path, json.dumps(curve.to_dict(), indent=2, allow_nan=False) + "\n")
        return
    columns = np.column_stack([curve.knots * curve.tick, np.degrees(curve.values)])
    write_table(path, [KNOT, VALUE], columns)


def read_curve(
    path: Path | str,
    *,
    tick: float | None = None,
    samples: int | None = None,
    cyclic: bool = True,
) -> PiecewiseLinear:
    """Read a curve that :func:`write_curve` wrote.

    Args:
        path: The file; JSON where its name ends so, else CSV, also from ``-``.
        tick: Time between samples [s]; a CSV does not say.
        samples: Number of samples; a CSV does not say.
        cyclic: Whether the curve of a CSV repeats.

    Raises:
        InvalidFile: The file holds no curve; the message says where and why.
        InvalidInput: A CSV without ``tick`` and ``samples``.
    """
    if _is_json(path):
        return _from_json(path)
    table = read_table(path)
    columns = table.numbers([KNOT, VALUE])
    if tick is None or samples is None:
        raise InvalidInput(
            f"{path}: a CSV of knots does not say the time between samples and their number; give "
            "tick and samples, or use JSON"
        )
    try:
        return PiecewiseLinear(
            knots=columns[:, 0] / tick,
            values=np.radians(columns[:, 1]),
            samples=samples,
            tick=tick,
            cyclic=cyclic,
        )
    except InvalidInput as error:
        raise InvalidFile(path, str(error)) from error


def _from_json(path: Path | str) -> PiecewiseLinear:
    try:
        data = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InvalidFile(path, f"not JSON ({error.msg})", line=error.lineno) from error
    except RecursionError as error:
        raise InvalidFile(path, "not JSON of a curve: nested too deeply") from error
    except ValueError as error:  # Python reads no number of that many digits
        raise InvalidFile(path, "not JSON of a curve: a number has too many digits") from error
    if not isinstance(data, dict):
        raise InvalidFile(path, f"got {type(data).__name__}, expected an object with knots")
    try:
        return PiecewiseLinear.from_dict(data)
    except InvalidInput as error:
        raise InvalidFile(path, str(error)) from error


def _is_json(path: Path | str) -> bool:
    return str(path).lower().endswith(".json")
