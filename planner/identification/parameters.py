"""The parameters of a joint that a log can show, in one table: units, bounds, logarithms.

A further parameter is a field of :class:`Parameters`, a row of :data:`COORDINATES` and a column of
(16) of ``docs/math.md`` in ``sensitivities.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from planner.identification.resampling import Grid
from planner.model.joint import JointModel
from planner.trajectory import Array

Free = npt.NDArray[np.bool_]
"""Which parameters a fit may change, in the order of the fields of :class:`Parameters`."""


class Parameters(NamedTuple):
    """A joint by what its motion shows; v_max may be infinite: then it never saturates."""

    gain: float  # v_max / theta_0 [1/s]
    v_max: float  # [rad/s]
    lag: float  # [s]
    acceleration_time: float  # [s]
    offset: float  # [rad]

    @classmethod
    def of(cls, model: JointModel) -> Self:
        """The parameters of a model."""
        return cls(
            gain=model.v_max / model.theta_0,
            v_max=model.v_max,
            lag=model.lag,
            acceleration_time=model.acceleration_time,
            offset=model.offset,
        )

    @property
    def whole_delay(self) -> float:
        """Time by which the joint trails slow requests [s]."""
        return self.lag + self.acceleration_time / 2.0 + 1.0 / self.gain

    def model(self, *, tick: float, hold: int) -> JointModel:
        """The model with these parameters."""
        return JointModel(
            v_max=self.v_max,
            theta_0=self.v_max / self.gain,
            lag=self.lag,
            acceleration_time=self.acceleration_time,
            tick=tick,
            hold=hold,
            offset=self.offset,
        )


class Coordinate(NamedTuple):
    """How the search counts a parameter, and between which bounds it looks.

    Attributes:
        unit: What the coordinate counts the parameter in; None for its logarithm.
        lower: Least value.
        upper: Largest value.
        scale: Size beside which an interval is narrow, in the unit of the parameter; 1 for
            logarithms.
        open_end: Lower end of an interval that the data leaves open; the upper one is infinite.
    """

    unit: Callable[[Grid], float] | None
    lower: Callable[[Grid], float]
    upper: Callable[[Grid], float]
    scale: Callable[[Grid, Parameters], float] = lambda *_: 1.0
    open_end: float = 0.0


LARGEST_GAIN = 1.9
"""Largest gain times tick; from 2 on the joint would not come to rest."""

COORDINATES: dict[str, Coordinate] = {
    "gain": Coordinate(
        unit=None,
        lower=lambda grid: 1e-3 / grid.reach,
        upper=lambda grid: LARGEST_GAIN / grid.tick,
    ),
    "v_max": Coordinate(  # no log tells a speed below or beyond these
        unit=None,
        lower=lambda grid: 1e-6 * grid.span / grid.reach,
        upper=lambda grid: 1e3 * grid.span / grid.tick,
    ),
    "lag": Coordinate(
        unit=lambda grid: grid.tick,
        lower=lambda _: 0.0,
        upper=lambda grid: grid.reach - grid.tick,
        scale=lambda _, at: at.whole_delay,
    ),
    # Any weights on two neighbouring requests are those of some lag with a window of one tick.
    "acceleration_time": Coordinate(
        unit=lambda grid: grid.tick,
        lower=lambda grid: grid.tick,
        upper=lambda grid: grid.reach,
        scale=lambda _, at: at.whole_delay,
    ),
    "offset": Coordinate(
        unit=lambda grid: grid.span,
        lower=lambda grid: -10.0 * grid.span,
        upper=lambda grid: 10.0 * grid.span,
        scale=lambda grid, _: grid.span,
        open_end=-math.inf,
    ),
}
"""One row for each field of :class:`Parameters`, in the same order."""

COUNT = len(COORDINATES)

PARAMETERS = ("v_max", "theta_0", *Parameters._fields[2:])
"""The same as attributes of a :class:`planner.JointModel`, in the order of a covariance."""


def only(*names: str) -> Free:
    """Flags of the parameters of these names."""
    return np.array([name in names for name in Parameters._fields])


def coordinates_of(grid: Grid, parameters: Parameters) -> Array:
    """Parameters as the search counts them, shape (p,)."""
    pairs = zip(COORDINATES.values(), parameters, strict=True)
    return np.array([_log(value) if c.unit is None else value / c.unit(grid) for c, value in pairs])


def parameters_at(grid: Grid, coordinates: Array) -> Parameters:
    """The inverse of :func:`coordinates_of`."""
    pairs = zip(COORDINATES.values(), coordinates.tolist(), strict=True)
    return Parameters(*(math.exp(at) if c.unit is None else at * c.unit(grid) for c, at in pairs))


def units(grid: Grid, parameters: Parameters) -> Array:
    """Derivative of each parameter by its coordinate, shape (p,); 0 where it is infinite."""
    pairs = zip(COORDINATES.values(), parameters, strict=True)
    values = [value if c.unit is None else c.unit(grid) for c, value in pairs]
    return np.where(np.isfinite(values), values, 0.0)


def model_derivatives(grid: Grid, parameters: Parameters) -> Array:
    """Derivatives of :data:`PARAMETERS` by the coordinates, shape (p, p)."""
    theta_0 = parameters.v_max / parameters.gain
    change = np.diag(units(grid, parameters))
    change[:2, :2] = [[0.0, parameters.v_max], [-theta_0, theta_0]]
    return change


def bounds_of(grid: Grid) -> tuple[Parameters, Parameters]:
    """Least and largest parameters that are looked for."""
    table = COORDINATES.values()
    return Parameters(*(c.lower(grid) for c in table)), Parameters(*(c.upper(grid) for c in table))


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else -math.inf
