"""What a path is to a leg: finite rows of angles or of positions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kinematics.chain import Array
from kinematics.exceptions import InvalidPath

FARTHEST = 1e6
"""A position or angle beyond this [m, rad] is a mistake, and its square would lose all digits."""


def as_path(values: npt.ArrayLike, *, name: str, columns: int, unit: str) -> Array:
    """Copy ``values`` into a finite (n, columns) array, or say why they are none."""
    try:
        given = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise InvalidPath(f"{name}: {error}; expected shape (n, {columns}) [{unit}]") from error
    if given.dtype.kind not in "iuf":
        raise InvalidPath(f"{name}: got an array of {given.dtype}, expected real numbers [{unit}]")
    if given.ndim != 2 or given.shape[1] != columns:
        hint = f"; for a single row pass [{name}]" if given.shape == (columns,) else ""
        raise InvalidPath(
            f"{name}: got shape {given.shape}, expected (n, {columns}) [{unit}]{hint}"
        )
    bad = np.flatnonzero(~np.all(np.abs(given) <= FARTHEST, axis=1))
    if bad.size:
        raise InvalidPath(
            f"{name}: {bad.size} of {len(given)} rows are not finite or beyond {FARTHEST:g} "
            f"{unit}: first index {bad[0]} ({given[bad[0]]}); mend or remove them first"
        )
    return np.array(given, dtype=np.float64)
