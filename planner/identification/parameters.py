"""The parameters of a joint that a log can show, in one table: units, bounds, logarithms.

A further parameter is a field of :class:`Parameters`, a row of :data:`COORDINATES` and a column of
(16) of ``docs/math.md`` in ``least_squares.py``.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, Mask
from planner.identification.grid import Grid
from planner.model.joint import JointModel, slowed_by_friction
from planner.model.law import fastest_integral, motor_share

Free = Mask
"""Which parameters a fit may change, in the order of the fields of :class:`Parameters`."""

MOST_SAG = 0.63
"""Largest sag by sine and cosine of the angle [rad]: 36 degrees, a motor far too weak for its load;
both together are within what a model may have."""


class Parameters(NamedTuple):
    """A joint by what its motion shows; v_max may be infinite: then it never saturates.

    ``v_offset`` and ``speed_per_torque`` are shares of v_max here, so that their bounds do not
    depend on it, and ``max_acceleration`` is counted from what dry friction takes, so that every
    joint moves and ticks change it little.
    """

    gain: float  # v_max / theta_0 [1/s]
    v_max: float  # [rad/s]
    lag: float  # [s]
    acceleration_time: float  # [s]
    offset: float  # [rad]
    dead_band: float = 0.0  # [rad]
    asymmetry: float = 0.0  # v_offset / v_max [-]
    compliance: float = 0.0  # [rad/(N m)]
    slowing: float = 0.0  # speed_per_torque / v_max [1/(N m)]
    sag_sin: float = 0.0  # by the sine of the angle [rad]
    sag_cos: float = 0.0  # by its cosine [rad]
    time_constant: float = 0.0  # [s]
    integral_rate: float = 0.0  # of a speed loop, 1 / T_i [1/s]
    position_integral_rate: float = 0.0  # of a position controller, k_I / k_P [1/s]
    acceleration: float = math.inf  # most from rest, beyond friction [rad/s^2]: see ``terms.py``
    play: float = 0.0  # backlash between motor and angle [rad], which no model has

    @classmethod
    def of(cls, model: JointModel) -> Self:
        """The parameters of a model."""
        taken = slowed_by_friction(model.gain, model.dead_band, model.time_constant, model.tick)
        return cls(
            gain=model.gain,
            asymmetry=model.v_offset / model.v_max,
            slowing=model.speed_per_torque / model.v_max,
            acceleration=model.max_acceleration - taken,
            **{name: getattr(model, name) for name in ALIKE},
        )

    def inside(self, errors: Array, load: Array) -> Mask:
        """Whether Equation 2 has the slope ``gain`` at each error: where it does not saturate."""
        v_max = 0.0 if math.isinf(self.v_max) else self.v_max
        called, faster = self.gain * errors, v_max * (self.asymmetry + self.slowing * load)
        top = self.v_max + (0.0 if self.integral_rate > 0.0 else self.gain * self.dead_band)
        return np.asarray((called < top + faster) & (called > faster - top))

    @property
    def integral(self) -> float:
        """Rate of the one integral, or 0 [1/s]."""
        return self.integral_rate + self.position_integral_rate

    @property
    def whole_delay(self) -> float:
        """Time in which the joint takes most of a step [s]: all its times, one after the other."""
        return self.lag + self.acceleration_time / 2.0 + 1.0 / self.gain + self.time_constant

    def max_acceleration(self, tick: float) -> float:
        """Acceleration limit with these ticks [rad/s^2]."""
        taken = slowed_by_friction(self.gain, self.dead_band, self.time_constant, tick)
        return self.acceleration + taken

    def fastest_integral(self, tick: float) -> float:
        """Rate of an integral from which on the joint oscillates for ever [1/s]; 0 for none."""
        if self.time_constant <= 0.0:
            return 0.0
        share, inside = motor_share(self.time_constant, tick), self.position_integral_rate > 0.0
        slope = math.hypot(self.sag_sin, self.sag_cos)
        return fastest_integral(self.gain * tick, share, inside=inside, slope=slope) / tick

    def motor_by_time_constant(self, tick: float) -> float:
        """Derivative of a motor's share of each tick, 1 - exp(-tick / time constant) [1/s]."""
        if tick > 40.0 * self.time_constant:  # exp(-40) is 4e-18: rounding
            return 0.0
        return -tick / self.time_constant**2 * math.exp(-tick / self.time_constant)

    def model(self, *, tick: float, hold: int) -> JointModel:
        """The model with these parameters; one that comes to rest."""
        same, most = {name: getattr(self, name) for name in ALIKE}, self.fastest_integral(tick)
        for name in ("integral_rate", "position_integral_rate"):
            same[name] = min(same[name], 0.99 * most)
        return JointModel(
            theta_0=self.v_max / self.gain,
            tick=tick,
            hold=hold,
            v_offset=self.asymmetry * self.v_max,
            speed_per_torque=self.slowing * self.v_max,
            max_acceleration=self.max_acceleration(tick),
            **same,
        )


ALIKE = [name for name in Parameters._fields if name in JointModel.__dataclass_fields__]
"""Parameters that a model has by the same name, in the same unit."""


class Box(NamedTuple):
    """How the search counts each of :class:`Parameters`, and where it looks for it, (p,) each."""

    unit: Array  # what its coordinate counts it in; 0 where that is its logarithm
    lower: Array  # least value
    upper: Array  # largest value

    @property
    def open_ends(self) -> Array:
        """Lower ends of intervals that the data does not bound; the upper ones are infinite."""
        return np.where(self.lower < 0.0, -math.inf, 0.0)


@lru_cache(maxsize=4)
def box_of(grid: Grid) -> Box:
    """The box of a search on a grid."""
    tick, reach, span, per_load = grid.tick, grid.reach, grid.span, 1.0 / grid.heaviest
    # A joint is not slower than it was seen to be, but for noise, and from 2 / tick on it would not
    # come to rest. Any weights on two neighbouring requests are those of a window of one tick. Top
    # speeds differ by 3 to 1 at most without a load, and any load leaves both directions possible.
    rows: dict[str, tuple[float, float, float]] = {
        "gain": (0.0, 1e-3 / reach, 1.9 / tick),
        "v_max": (0.0, max(0.3 * grid.fastest, 1e-6 * span / reach), 1e3 * span / tick),
        "lag": (tick, 0.0, reach - tick),
        "acceleration_time": (tick, tick, reach),
        "offset": (span, -10.0 * span, 10.0 * span),
        "dead_band": (span, 0.0, 0.5 * span),
        "asymmetry": (1.0, -0.5, 0.5),
        "compliance": (span * per_load, 0.0, 10.0 * span * per_load),
        "slowing": (per_load, 0.0, 0.45 * per_load),
        "sag_sin": (span, -MOST_SAG, MOST_SAG),
        "sag_cos": (span, -MOST_SAG, MOST_SAG),
        "time_constant": (tick, 0.0, reach),
        "integral_rate": (1.0 / reach, 0.0, 0.5 / tick),
        "position_integral_rate": (1.0 / reach, 0.0, 0.5 / tick),
        "acceleration": (0.0, 1e-3 * span / reach**2, 1e3 * span / tick**2),
        "play": (0.0, 1e-6 * span, span),
    }
    return Box(*np.array([rows[name] for name in Parameters._fields]).T)


COUNT = len(Parameters._fields)

TERMS = {
    "dead_band": "dead_band",
    "asymmetry": "v_offset",
    "compliance": "compliance",
    "slowing": "speed_per_torque",
    "sag_sin": "sag_sin",
    "sag_cos": "sag_cos",
    "time_constant": "time_constant",
    "integral_rate": "integral_rate",
    "position_integral_rate": "position_integral_rate",
    "acceleration": "max_acceleration",
}
"""Parameters that are 0 unless they reduce the loss, with their names in a JointModel."""

BASE = Parameters._fields[:5]  # the parameters of the paper, and the offset: every fit has them

PARAMETERS = ("v_max", "theta_0", *BASE[2:], *TERMS.values())
"""The same as attributes of a :class:`planner.JointModel`, in the order of a covariance."""


def only(*names: str) -> Free:
    """Flags of the parameters of these names."""
    return np.array([name in names for name in Parameters._fields])


def coordinates_of(grid: Grid, parameters: Parameters) -> Array:
    """Parameters as the search counts them, shape (p,)."""
    unit, values = box_of(grid).unit, np.array(parameters)
    logarithms = np.log(values, out=np.full(COUNT, -math.inf), where=(unit == 0.0) & (values > 0.0))
    return np.asarray(np.divide(values, unit, out=logarithms, where=unit > 0.0))


def parameters_at(grid: Grid, coordinates: Array) -> Parameters:
    """The inverse of :func:`coordinates_of`."""
    unit = box_of(grid).unit
    found = np.exp(coordinates, out=np.zeros(COUNT), where=unit == 0.0)
    return Parameters(*np.multiply(coordinates, unit, out=found, where=unit > 0.0).tolist())


def units(grid: Grid, parameters: Parameters) -> Array:
    """Derivative of each parameter by its coordinate, shape (p,); 0 where it is infinite."""
    unit = box_of(grid).unit
    values = np.where(unit > 0.0, unit, parameters)
    return np.where(np.isfinite(values), values, 0.0)


def model_derivatives(grid: Grid, parameters: Parameters) -> Array:
    """Derivatives of :data:`PARAMETERS`, the play and the gain by the coordinates, (p + 1, p)."""
    v_max, theta_0 = parameters.v_max, parameters.v_max / parameters.gain
    change = np.diag(units(grid, parameters))
    change[:2, :2] = [[0.0, v_max], [-theta_0, theta_0]]
    for name in ("asymmetry", "slowing"):
        row = Parameters._fields.index(name)
        change[row] *= v_max
        change[row, 1] = v_max * getattr(parameters, name)
    if math.isfinite(parameters.acceleration):
        row, by = Parameters._fields.index("acceleration"), units(grid, parameters)
        for name, value in by_friction(parameters, grid.tick).items():
            index = Parameters._fields.index(name)
            change[row, index] = value * by[index]
    return np.vstack([change, parameters.gain * np.eye(1, COUNT)])


def by_friction(at: Parameters, tick: float) -> dict[str, float]:
    """Derivatives of what dry friction takes of the acceleration, by the parameters in it."""
    share = motor_share(at.time_constant, tick)
    share = share if share < 1.0 else 0.0  # a dead zone takes nothing
    return {
        "gain": share * at.dead_band / tick,
        "dead_band": share * at.gain / tick,
        "time_constant": at.motor_by_time_constant(tick) * at.gain * at.dead_band / tick,
    }
