"""The joint: Equations 2 and 3 of the paper, with a window that need not be whole ticks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidModel
from planner.trajectory import Array
from planner.validation import as_number, as_whole, shown

WHOLE_TICKS = 1e-9
"""Times this close to whole ticks [ticks] are taken as whole: 0.032 s / 0.008 s is 4."""

LONGEST_WINDOW = 100_000
"""Most ticks that lag and acceleration time may span: beyond it the unit is surely mistaken."""

MOST_HOLD = 10_000
"""Most ticks that one request may be held for."""


Clip = Callable[[Any, Any, Any], Any]
"""Brings a value between two limits."""


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


def clip(value: Any, low: Any, high: Any) -> Any:
    """The value within [low, high]: arrays, and whatever NumPy takes."""
    return np.minimum(np.maximum(value, low), high)


def rounded_clip(radius: Any) -> Clip:
    """A clip with corners of this radius: each ``|x|`` of it becomes sqrt(x^2 + radius^2).

    Nothing but operators: for floats, arrays and CasADi expressions.
    """

    def rounded(value: Any, low: Any, high: Any) -> Any:
        above, below = value - low, value - high
        lengths = (above**2 + radius**2) ** 0.5 - (below**2 + radius**2) ** 0.5
        return (low + high + lengths) / 2.0

    return rounded


def saturation(error: Any, *, gain: Any, v_max: Any, clip: Clip = clip) -> Any:
    """Speed that an error between request and angle calls for: f of Equation 2.

    ``f(x) = clip(gain x, -v_max, v_max)``, with gain = v_max / theta_0. All simulations use this
    function; floats, arrays, CasADi expressions and rounded corners differ by the function that
    clips. Where f stands in another form, that form has to change with it: its derivatives in
    ``model/sensitivity.py``, ``identification/simulation.py`` and ``sensitivities.py``, its extreme
    values in ``inversion/line_inverse.py`` and ``inversion/smoothing.py``, and the conditions of
    ``inversion/bounds``.

    Args:
        error: Request plus offset minus angle [rad].
        gain: v_max / theta_0 [1/s], or [1/tick].
        v_max: Top speed in the unit of time of ``gain``; may be infinite.
        clip: Called with a value, its lower and its upper limit.

    Returns:
        Speed in the unit of time of ``gain``, like ``error``; within ±v_max.
    """
    return clip(gain * error, -v_max, v_max)


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
    def gain_per_tick(self) -> float:
        """Slope of Equation 2 where it does not saturate, v_max / theta_0 [1/tick]."""
        return self.v_max_per_tick / self.theta_0

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

    def speed(self, error: npt.ArrayLike) -> Array:
        """Speed [rad/s] that errors between request and angle [rad] call for: Equation 2."""
        errors = np.asarray(error, dtype=np.float64)
        return np.asarray(saturation(errors, gain=self.v_max / self.theta_0, v_max=self.v_max))

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


class RequestAges(NamedTuple):
    """Ages of the requests that act between two samples: ``youngest`` to ``oldest`` [requests]."""

    youngest: int
    oldest: int

    @property
    def width(self) -> int:
        """Number of requests that act."""
        return self.oldest - self.youngest + 1


def request_ages(model: JointModel) -> RequestAges:
    """The ages, counted back from sample k, of the requests that act between samples k-1 and k."""
    ticks = np.arange(1 - model.hold, 1)  # relative to the tick of sample k
    youngest = (int(ticks[-1]) - model.window.first) // model.hold
    oldest = (int(ticks[0]) - model.window.last) // model.hold
    return RequestAges(-youngest, -oldest)


def acting(ages: RequestAges, samples: int, *, cyclic: bool) -> npt.NDArray[np.int_]:
    """Number of the request that acts before sample k, the j-th youngest: shape (samples, count).

    From rest -1 stands for the requests before the first, which the first one stands in for.
    """
    each = ages.youngest + np.arange(ages.width)
    numbers = np.arange(samples)[:, np.newaxis] - each
    return numbers % samples if cyclic else np.maximum(numbers, -1)


def weights_by_tick(model: JointModel) -> Array:
    """How much each request that acts counts at each tick of a period: (hold, width)."""
    at = request_ages(model)
    weights = np.zeros((model.hold, at.width))
    for number, tick in enumerate(range(1 - model.hold, 1)):
        for j, weight in enumerate(model.window.weights):
            age = -((tick - model.window.first - j) // model.hold)
            weights[number, age - at.youngest] += weight
    return weights


def joint_of_top_speed(v_max: float) -> JointModel:
    """The paper's joint with another top speed: a model to begin with where only that is known.

    Lag, acceleration time and tick are those of Table 1, and so is the time v_max takes to cover
    theta_0. A robot's description tells none of them, and the effort that it tells says little
    about a servo's own controller.

    Args:
        v_max: Top speed [rad/s].

    Returns:
        The model.

    Raises:
        InvalidModel: The speed is not a number above 0.
    """
    paper = JointModel.ers210a()
    return replace(paper, v_max=v_max, theta_0=v_max * (paper.theta_0 / paper.v_max))


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
