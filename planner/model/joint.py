"""The joint: Equations 2 and 3 of the paper, with a window that need not be whole ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from planner.exceptions import InvalidModel
from planner.given import as_number, as_whole, shown
from planner.trajectory import Array

WHOLE_TICKS = 1e-9
"""Times this close to whole ticks [ticks] are taken as whole: 0.032 s / 0.008 s is 4."""

LONGEST_WINDOW = 100_000
"""Most ticks that lag and acceleration time may span: beyond it the unit is surely mistaken."""

MOST_HOLD = 10_000
"""Most ticks that one request may be held for."""


class Window(NamedTuple):
    """The requests that drive the joint at one tick, and how much each of them counts.

    ``M(t) = M(t-1) + sum_j weights[j] * f(R(t - first - j) + offset - M(t-1))``

    Attributes:
        first: Age of the youngest request that counts [ticks], at least 1.
        weights: Weights W_i = w_i / a for the ages ``first, first + 1, ...``; they sum to 1.
    """

    first: int
    weights: Array  # (m,)

    @property
    def last(self) -> int:
        """Age of the oldest request that counts [ticks]."""
        return self.first + len(self.weights) - 1


def saturation(error: Any, *, v_max: Any, theta_0: Any, smoothing: Any = 0.0) -> Any:
    """Speed that an error between request and angle calls for: f of Equation 2.

    Written as ``v_max (|x + theta_0| - |x - theta_0|) / (2 theta_0)``, which is Equation 2 and
    needs nothing but operators, so that one definition serves floats, arrays and CasADi
    expressions. With ``smoothing`` e > 0 each ``|x|`` becomes ``sqrt(x^2 + e^2)``, which rounds
    both corners.

    Args:
        error: Request minus angle [rad], float, array or CasADi expression.
        v_max: Top speed [rad/tick].
        theta_0: Error from which on the joint moves at top speed [rad].
        smoothing: Radius of the rounded corners e [rad]; 0 for Equation 2 itself.

    Returns:
        Speed [rad/tick], like ``error``; within ±v_max.
    """
    above, below = error + theta_0, error - theta_0
    if isinstance(smoothing, float) and smoothing == 0.0:
        return v_max * (abs(above) - abs(below)) / (2.0 * theta_0)
    rounded = smoothing**2
    return v_max * ((above**2 + rounded) ** 0.5 - (below**2 + rounded) ** 0.5) / (2.0 * theta_0)


def advance(
    angle: Any,
    requests: Any,
    *,
    weights: Any,
    v_max: Any,
    theta_0: Any,
    smoothing: Any = 0.0,
) -> Any:
    """Angle one tick later: Equation 3.

    Args:
        angle: M(t-1) [rad], float, array or CasADi expression.
        requests: The requests of the window plus the model's offset [rad], youngest first; a
            sequence of whatever ``angle`` is.
        weights: Weight of each of them, summing to 1.
        v_max: Top speed [rad/tick].
        theta_0: Error from which on the joint moves at top speed [rad].
        smoothing: See :func:`saturation`.

    Returns:
        M(t) [rad], like ``angle``.
    """
    moved = angle
    for j, weight in enumerate(weights):
        moved = moved + weight * saturation(
            requests[j] - angle, v_max=v_max, theta_0=theta_0, smoothing=smoothing
        )
    return moved


@dataclass(frozen=True, kw_only=True)
class JointModel:
    """How a position-controlled joint answers requests (paper, Section 3; ``docs/math.md``).

    Attributes:
        v_max: Top speed [rad/s].
        theta_0: Error between request and angle from which on it moves at top speed [rad].
        lag: Time before a request has any effect [s]; need not be whole ticks.
        acceleration_time: Time over which a request takes effect [s]; need not be whole ticks.
        tick: Time step of the model [s].
        hold: Number of ticks for which one request is held.
        offset: Static sag: the joint comes to rest at request + offset [rad].

    Raises:
        InvalidModel: A parameter is not a finite number or out of its range, or the joint could not
            come to rest because v_max * tick >= 2 theta_0.
    """

    v_max: float = field(metadata={"unit": "rad/s"})
    theta_0: float = field(metadata={"unit": "rad"})
    lag: float = field(metadata={"unit": "s"})
    acceleration_time: float = field(metadata={"unit": "s"})
    tick: float = field(default=0.008, metadata={"unit": "s"})
    hold: int = field(default=1, metadata={"unit": "ticks"})
    offset: float = field(default=0.0, metadata={"unit": "rad"})

    def __post_init__(self) -> None:
        """Check every parameter once; afterwards the model can be trusted."""
        for parameter in fields(self):
            if parameter.name != "hold":
                value = _number(parameter.name, getattr(self, parameter.name))
                object.__setattr__(self, parameter.name, value)
        object.__setattr__(self, "hold", _count("hold", self.hold))
        for name in ("v_max", "theta_0", "acceleration_time", "tick"):
            if getattr(self, name) <= 0.0:
                raise InvalidModel(f"{name}: got {getattr(self, name):g}, expected more than 0")
        if self.lag < 0.0:
            raise InvalidModel(f"lag: got {self.lag:g} s, expected 0 or more")
        if self.lag + self.acceleration_time > LONGEST_WINDOW * self.tick:
            raise InvalidModel(
                f"lag + acceleration_time: got {self.lag + self.acceleration_time:g} s, expected "
                f"at most {LONGEST_WINDOW} ticks of {self.tick:g} s; are the times in seconds?"
            )
        if self.v_max * self.tick >= 2.0 * self.theta_0:
            raise InvalidModel(
                f"v_max * tick: got {self.v_max * self.tick:g} rad, expected less than 2 theta_0 = "
                f"{2.0 * self.theta_0:g} rad; such a joint would overshoot a constant request for "
                "ever: use a shorter tick (with hold > 1), or check the units"
            )

    @classmethod
    def ers210a(cls) -> Self:
        """Any leg joint of the Sony Aibo ERS-210A: Table 1 of the paper."""
        tick = 0.008
        return cls(
            v_max=math.radians(2.5) / tick,
            theta_0=math.radians(7.0),
            lag=4 * tick,
            acceleration_time=6 * tick,
            tick=tick,
        )

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.tick * self.hold

    @property
    def v_max_per_tick(self) -> float:
        """Top speed [rad/tick]."""
        return self.v_max * self.tick

    @property
    def lag_ticks(self) -> float:
        """Lag l [ticks]."""
        return _in_ticks(self.lag, self.tick)

    @property
    def acceleration_ticks(self) -> float:
        """Acceleration time a [ticks]."""
        return _in_ticks(self.acceleration_time, self.tick)

    @property
    def keeps_equation_13(self) -> bool:
        """Whether theta_0 > v_max and 4 theta_0 > v_max a, which the paper's inversion assumes."""
        reached = self.v_max_per_tick * max(1.0, self.acceleration_ticks / 4.0)
        return self.theta_0 > reached

    @cached_property
    def window(self) -> Window:
        """Which requests drive the joint at one tick: w_i = |[i-1, i] ∩ [l, l+a]|, over a."""
        start = self.lag_ticks
        end = _snapped(start + self.acceleration_ticks)
        first = math.floor(start) + 1
        edges = np.arange(first - 1, math.ceil(end) + 1, dtype=np.float64)
        overlap = np.minimum(edges[1:], end) - np.maximum(edges[:-1], start)
        # An acceleration time that vanishes leaves the one request that is just old enough.
        weights = overlap / overlap.sum() if end > start else np.ones(1)
        weights.setflags(write=False)
        return Window(first, weights)


def checked_model(model: object) -> JointModel:
    """The model, or InvalidModel where it is none."""
    if not isinstance(model, JointModel):
        raise InvalidModel(
            f"model: got {type(model).__name__}, expected a planner.JointModel, such as "
            "JointModel.ers210a()"
        )
    return model


def _number(name: str, value: object) -> float:
    number = as_number(value)
    if math.isnan(number):
        raise InvalidModel(f"{name}: got {shown(value)}, expected a finite number in SI units")
    return number


def _count(name: str, value: object) -> int:
    count = as_whole(value) or 0
    if count > MOST_HOLD:
        raise InvalidModel(
            f"{name}: got {shown(value)}, expected at most {MOST_HOLD} ticks between requests"
        )
    if count < 1:
        raise InvalidModel(
            f"{name}: got {shown(value)}, expected a whole number of ticks, 1 or more"
        )
    return count


def _in_ticks(time: float, tick: float) -> float:
    return _snapped(time / tick)


def _snapped(ticks: float) -> float:
    whole = round(ticks)
    return float(whole) if abs(ticks - whole) <= WHOLE_TICKS else ticks
