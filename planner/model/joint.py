"""The joint: Equations 2 and 3 of the paper, with a window that need not be whole ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, as_number, as_whole, shown
from planner.exceptions import InvalidInput, InvalidModel
from planner.model.evidence import GAIN, Evidence, check_correlations, warn_of_refused
from planner.model.law import REST_STEPS, Law, fastest_integral, motor_share

WHOLE_TICKS = 1e-9
"""Times this close to whole ticks count as whole [ticks]."""

LONGEST_WINDOW = 100_000
"""Most ticks that lag and acceleration time may span: beyond it the unit is surely mistaken."""

MOST_HOLD = 1000
"""Most ticks that one request may be held for: bounds have an unknown for each of them."""

MOST_TERMS = 5000
"""Most terms of Equation 3 between two requests, ``hold`` times the ticks of the acceleration time:
a simulation's time grows with them. Models identified by default have half as many."""

MOST_POSE_SAG = 0.9
"""Largest sag by the angle [rad]; from 1 on a joint may rest at several angles."""

LEAST, MOST = 1e-15, 1e9
"""Least positive and largest parameter, in its SI unit: products and ratios of them stay finite."""


class Window(NamedTuple):
    """Requests and weights: ``M(t) - M(t-1) = sum_j weights[j] f(R(t-first-j) + sag - M(t-1))``."""

    first: int  # age of the youngest request that counts [ticks], at least 1
    weights: Array  # W_i = w_i / a for the ages first, first + 1, ..., (m,); they sum to 1

    @property
    def last(self) -> int:
        """Age of the oldest request that counts [ticks]."""
        return self.first + len(self.weights) - 1


@dataclass(frozen=True, kw_only=True)
class JointModel:
    """A position-controlled joint and its parameters (paper, Section 3; ``docs/math.md``).

    Attributes:
        v_max: Top speed [rad/s].
        theta_0: Error between request and angle from which on it moves at top speed [rad].
        lag: Time before a request has any effect [s]; need not be whole ticks.
        acceleration_time: Time over which a request takes effect [s]; need not be whole ticks.
        tick: Time step of the model [s].
        hold: Number of ticks for which one request is held.
        offset: Static sag: the joint comes to rest at request + offset [rad].
        dead_band: Dry friction: error between request and angle that does not move it [rad].
            Friction slows the joint, too, but not below v_max. With a max_acceleration and no
            time_constant it is a dead zone of the drive, before that limit.
        v_offset: How much faster it is in the positive direction than v_max, and slower in the
            other [rad/s].
        compliance: Sag by a torque on the joint [rad/(N m)], beside ``offset``.
        speed_per_torque: Change of its top speeds by that torque [rad/(s N m)], beside
            ``v_offset``.
        time_constant: Time constant with which its speed follows the demanded speed, a motor's
            inertia [s]; 0 for the paper's joint.
        max_acceleration: Largest change of its speed [rad/s^2]; infinite for the paper's joint.
        sag_sin: Sag by gravity where no torque is known [rad]: at the angle q the joint rests
            sag_sin sin(q) + sag_cos cos(q) beside its request, and by ``offset``. Its
            least and largest speed increase by v_max / theta_0 times this sag: it is faster
            downhill. A sag of theta_0 + 2 dead_band or more exceeds its torque and its friction:
            there no request holds it.
        sag_cos: The same by the cosine [rad].
        integral_rate: Rate of the integral term of a speed loop, 1 / T_i for its integral time T_i
            [1/s]; 0 for none. It acts through the time_constant, overcomes friction at a steady
            speed and at rest, makes up for gravity and torque, so that the joint rests at request +
            offset, and is held while ``max_acceleration`` is active. Such a joint overshoots, and
            no lower bound holds for it.
        position_integral_rate: Rate of the integral term of a position controller, k_I / k_P
            [1/s]; 0 for none, and beside an ``integral_rate``. It acts likewise, but within the
            limits of the drive; in a steady motion it makes up for theta_0, too.

    Raises:
        InvalidModel: A parameter is not a finite number or out of its range, or the joint could not
            come to rest because v_max * tick >= 2 theta_0, or by its integral terms.
    """

    # A parameter is above 0 (+), of any sign (±), or else 0 or more; files leave optional ones out
    v_max: float = field(metadata={"unit": "rad/s", "sign": "+"})
    theta_0: float = field(metadata={"unit": "rad", "sign": "+"})
    lag: float = field(metadata={"unit": "s"})
    acceleration_time: float = field(metadata={"unit": "s", "sign": "+"})
    tick: float = field(default=0.008, metadata={"unit": "s", "sign": "+"})
    hold: int = field(default=1, metadata={"unit": "ticks"})
    offset: float = field(default=0.0, metadata={"unit": "rad", "sign": "±"})
    dead_band: float = field(default=0.0, metadata={"unit": "rad"})
    v_offset: float = field(default=0.0, metadata={"unit": "rad/s", "sign": "±"})
    compliance: float = field(default=0.0, metadata={"unit": "rad/(N m)"})
    speed_per_torque: float = field(default=0.0, metadata={"unit": "rad/(s N m)"})
    time_constant: float = field(default=0.0, metadata={"unit": "s", "optional": True})
    max_acceleration: float = field(
        default=math.inf, metadata={"unit": "rad/s^2", "sign": "+", "optional": True}
    )
    sag_sin: float = field(default=0.0, metadata={"unit": "rad", "sign": "±", "optional": True})
    sag_cos: float = field(default=0.0, metadata={"unit": "rad", "sign": "±", "optional": True})
    integral_rate: float = field(default=0.0, metadata={"unit": "1/s", "optional": True})
    position_integral_rate: float = field(default=0.0, metadata={"unit": "1/s", "optional": True})

    def __repr__(self) -> str:
        """The constructor call without default parameters, and the units."""
        parameters = [each for each in fields(self) if getattr(self, each.name) != each.default]
        call = ", ".join(f"{each.name}={getattr(self, each.name)!r}" for each in parameters)
        units = ", ".join(f"{each.metadata['unit']}" for each in parameters)
        return f"JointModel({call})  # {units}"

    def __post_init__(self) -> None:
        """Check every parameter once; afterwards the model is valid."""
        for parameter in fields(self):
            name, unit, sign = parameter.name, *map(parameter.metadata.get, ("unit", "sign"))
            given = getattr(self, name)
            if name == "hold":
                ticks = as_whole(given) or 0
                if not 1 <= ticks <= MOST_HOLD:
                    raise InvalidModel(
                        f"hold: got {shown(given)}, expected a whole number of ticks, 1 to "
                        f"{MOST_HOLD}"
                    )
                object.__setattr__(self, name, ticks)
                continue
            value, expected = as_number(given, infinite=name == "max_acceleration"), ""
            if math.isnan(value):
                expected = "a finite number in SI units"
            elif MOST < abs(value) < math.inf:
                expected = f"at most {MOST:g} in SI units"
            elif sign == "+" and value <= 0.0:
                expected = "more than 0"
            elif sign == "+" and value < LEAST:
                expected = f"at least {LEAST:g} {unit}; is it in SI units?"
            elif sign != "±" and value < 0.0:
                expected = "0 or more"
            if expected:
                got = shown(given) if math.isnan(value) else f"{value:g} {unit}"
                raise InvalidModel(f"{name}: got {got}, expected {expected}")
            object.__setattr__(self, name, value)
        if abs(self.v_offset) >= self.v_max:
            raise InvalidModel(
                f"v_offset: got {self.v_offset:g} rad/s, expected within ±v_max = "
                f"±{self.v_max:g} rad/s; beyond it the joint could move in one direction only"
            )
        integral = self.integral_rate + self.position_integral_rate
        if self.integral_rate > 0.0 and self.position_integral_rate > 0.0:
            raise InvalidModel(
                f"integral_rate, position_integral_rate: got {self.integral_rate:g} and "
                f"{self.position_integral_rate:g} 1/s, expected one of them to be 0; give the one "
                "whose loop is the slower"
            )
        integral_name = "position_integral_rate" if self.position_integral_rate else "integral_rate"
        if integral > 0.0 and self.time_constant == 0.0:
            raise InvalidModel(
                f"{integral_name}: got {integral:g} 1/s without a time_constant, through "
                "which it acts; expected 0, or a time_constant above 0 s"
            )
        if self.most_pose_sag > MOST_POSE_SAG:
            raise InvalidModel(
                f"sag_sin, sag_cos: got {self.sag_sin:g} and {self.sag_cos:g} rad, expected a root "
                f"of the sum of their squares of at most {MOST_POSE_SAG:g} rad; beyond 1 rad "
                "gravity would pull the joint away from its request: are they in radians?"
            )
        if self.lag + self.acceleration_time > LONGEST_WINDOW * self.tick:
            raise InvalidModel(
                f"lag + acceleration_time: got {self.lag + self.acceleration_time:g} s, expected "
                f"at most {LONGEST_WINDOW} ticks of {self.tick:g} s; are the times in seconds?"
            )
        gain = self.gain
        slowed = slowed_by_friction(gain, self.dead_band, self.time_constant, self.tick)
        if self.max_acceleration <= slowed:
            raise InvalidModel(
                f"max_acceleration: got {self.max_acceleration:g} rad/s^2, expected more than "
                f"{slowed:g} rad/s^2, by which the dry friction of the dead_band "
                f"{self.dead_band:g} rad slows it in a tick of {self.tick:g} s; such a joint would "
                "never move: check the units, or leave out the time_constant"
            )
        window = math.ceil(self.acceleration_ticks)
        if window * self.hold > MOST_TERMS:
            raise InvalidModel(
                f"acceleration_time / tick * hold: got {window} ticks times {self.hold} ticks, "
                f"expected a product of at most {MOST_TERMS}, as simulations would take too long; "
                f"use a longer tick than {self.tick:g} s, with a shorter hold"
            )
        if self.v_max * self.tick >= 2.0 * self.theta_0:
            raise InvalidModel(
                f"v_max * tick: got {self.v_max * self.tick:g} rad, expected less than 2 theta_0 = "
                f"{2.0 * self.theta_0:g} rad; such a joint would overshoot a constant request for "
                "ever: use a shorter tick (with hold > 1), or check the units"
            )

        inside, slope = self.position_integral_rate > 0.0, self.most_pose_sag
        share = fastest_integral(self.law.gain, self.law.share, inside=inside, slope=slope)
        if integral >= (most := share / self.tick):
            raise InvalidModel(
                f"{integral_name}: got {integral:g} 1/s, expected less than {most:g} 1/s "
                f"with a time_constant of {self.time_constant:g} s, v_max / theta_0 = {gain:g} 1/s "
                f"and a sag that changes by up to {slope:g} of the angle; such a joint would "
                "oscillate about a constant request for ever"
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

    def requested_every(self, period: float) -> Self:
        """The same joint, with a request every ``period`` [s].

        The tick becomes the longest one that divides the period and is no longer than it was. Where
        it becomes shorter, lag, v_max / theta_0 and, with inertia and friction, max_acceleration
        change so that the response stays the same: see ``with_ticks`` and ``slowed_by_friction``.
        With an integral term it changes a little.

        Raises:
            InvalidModel: The period is not a finite time above 0.
        """
        if not as_number(period) > 0.0:
            raise InvalidModel(f"period: got {shown(period)}, expected more than 0 s")
        window = self.lag + self.acceleration_time
        least = max(window / LONGEST_WINDOW, self.acceleration_time / MOST_TERMS)
        most = MOST_HOLD * self.tick
        if not least <= period <= most:
            raise InvalidModel(
                f"period: got a request every {period:g} s, expected one every {least:g} to "
                f"{most:g} s ({1.0 / most:.4g} to {1.0 / least:.4g} Hz)"
            )
        hold = max(math.ceil(period / self.tick - WHOLE_TICKS), 1)
        tick = period / hold
        if math.isclose(tick, self.tick, rel_tol=1e-9):
            return replace(self, tick=tick, hold=hold).with_evidence(self.evidence)
        gain = self.gain
        inertia = self.time_constant > 0.0
        other, lag = with_ticks(gain, self.lag, self.tick, tick, inertia=inertia)
        before, after = (
            slowed_by_friction(each, self.dead_band, self.time_constant, of)
            for each, of in ((gain, self.tick), (other, tick))
        )
        model = replace(
            self,
            theta_0=self.v_max / other,
            lag=lag,
            tick=tick,
            hold=hold,
            max_acceleration=self.max_acceleration + after - before,
        )
        if self.evidence is None:
            return model
        factors = {GAIN: other / gain, "theta_0": gain / other}
        shifts = {"lag": lag - self.lag, "max_acceleration": after - before}
        intervals = dict(self.evidence.intervals)
        for name in {*factors, *shifts} & {*intervals}:
            factor, shift = factors.get(name, 1.0), shifts.get(name, 0.0)
            low, high = (factor * end + shift for end in intervals[name])
            intervals[name] = max(low, 0.0), high
        return model.with_evidence(self.evidence._replace(intervals=intervals))

    @property
    def evidence(self) -> Evidence | None:
        """Test error of the model, the range of the test, and its intervals; None where unknown.

        It is no parameter: equal models may have different evidence, and a copy with other
        parameters (``dataclasses.replace``) has none.
        """
        evidence: Evidence | None = self.__dict__.get("_evidence")
        return evidence

    @property
    def unit(self) -> Literal["rad", "1"]:
        """The unit of its angles, as of a Log: "1" where they are known to be shares of a range."""
        return "1" if self.evidence is not None and self.evidence.unit == "range" else "rad"

    def with_evidence(self, evidence: Evidence | None) -> Self:
        """The same joint, with this evidence, or InvalidInput where its correlations do not fit."""
        if evidence is not None:
            if not isinstance(evidence, Evidence):
                raise InvalidInput(f"evidence: got {shown(evidence)}, expected an Evidence or None")
            check_correlations(evidence)
        model = replace(self)
        object.__setattr__(model, "_evidence", evidence)
        return model

    @classmethod
    def from_toml(cls, path: Path | str, joint: str | None = None) -> JointModel:
        """Read a model from TOML, as :meth:`to_toml` and ``request-planner identify`` write it.

        Args:
            path: The file, or ``-`` for standard input.
            joint: The joint, in a file with a table for each; without it, the model above all
                tables, or the only one.

        Raises:
            InvalidFile: The file holds no model, none of this joint, or several and no joint is
                named.

        Warns:
            UserWarning: The model is not to be planned with, by the ``verdict`` of the file.

        Example:
            >>> from pathlib import Path
            >>> from tempfile import TemporaryDirectory
            >>> with TemporaryDirectory() as folder:
            ...     JointModel.ers210a().to_toml(Path(folder, "knee.toml"))
            ...     model = JointModel.from_toml(Path(folder, "knee.toml"))
            >>> model == JointModel.ers210a()
            True
        """
        from planner.files.joint_model import read_model_file  # files know models, not vice versa

        file = read_model_file(path)
        model = file.one() if joint is None else file.for_joints([joint])[0]
        warn_of_refused({joint or "": model.evidence})
        return model

    def to_toml(self, path: Path | str) -> None:
        """Write the model as TOML, each key with its unit.

        Args:
            path: The file, or ``-`` for standard output.

        Raises:
            InvalidFile: The file cannot be written.
        """
        from planner.files.joint_model import models_text  # files know models, not vice versa
        from planner.files.text import write_text

        write_text(path, models_text({"": self}))

    def parameters(self) -> dict[str, Any]:
        """The parameters by name, as in files: optional ones only if not the default."""
        return {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if not each.metadata.get("optional") or getattr(self, each.name) != each.default
        }

    @cached_property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.tick * self.hold

    @cached_property
    def switching_time(self) -> float:
        """Time by which requests change to the next line before the angles: l + a/2 + T [s].

        A held request acts (hold - 1) / 2 ticks later on average than its line. An integral term
        makes up for T.
        """
        hold_delay = (self.hold - 1) / 2.0 * self.tick
        inertia = 0.0 if self.has_integral else self.time_constant
        return self.lag + self.acceleration_time / 2.0 + inertia + hold_delay

    @cached_property
    def steady(self) -> JointModel:
        """The joint at a steady speed or at rest, where an integral overcomes friction."""
        return replace(self, dead_band=0.0) if self.has_integral else self

    @property
    def latency(self) -> float:
        """How late it follows slow motion of its requests, unheld [s]: l + a/2 + theta_0/v_max."""
        return self.lag + self.acceleration_time / 2.0 + self.theta_0 / self.v_max

    @cached_property
    def v_max_per_tick(self) -> float:
        """Top speed [rad/tick]."""
        return self.v_max * self.tick

    @property
    def gain(self) -> float:
        """Slope of Equation 2 where it does not saturate, v_max / theta_0 [1/s]."""
        return self.v_max / self.theta_0

    @property
    def lag_ticks(self) -> float:
        """Lag l [ticks]."""
        return _snapped(self.lag / self.tick)

    @property
    def acceleration_ticks(self) -> float:
        """Acceleration time a [ticks]."""
        return _snapped(self.acceleration_time / self.tick)

    @property
    def keeps_equation_13(self) -> bool:
        """Whether theta_0 > v_max and 4 theta_0 > v_max a, which the paper's inversion assumes."""
        return self.theta_0 > self.v_max_per_tick * max(1.0, self.acceleration_ticks / 4.0)

    @cached_property
    def most_pose_sag(self) -> float:
        """The largest sag by gravity at any angle, and its largest slope by the angle [rad]."""
        return math.hypot(self.sag_sin, self.sag_cos)

    def gravity(self, angle: npt.ArrayLike) -> Array:
        """By which error gravity shifts the drive at an angle [rad]: g(q) of (2a)."""
        if self.most_pose_sag == 0.0:
            return np.zeros(np.shape(angle))
        return np.asarray(self.sag_sin * np.sin(angle) + self.sag_cos * np.cos(angle))

    def pose_sag(self, angle: npt.ArrayLike) -> Array:
        """The sag by gravity at an angle [rad], beside :meth:`sag`; none with an integral term."""
        return np.zeros(np.shape(angle)) if self.has_integral else self.gravity(angle)

    def at_rest(self, angle: float, load: float = 0.0) -> Array:
        """The state at rest at an angle [rad], (3,): an integral makes up for load and gravity."""
        sag = self.compliance * load + float(self.gravity(angle))
        return np.array([angle, 0.0, -self.law.gain * sag if self.has_integral else 0.0])

    def rest(self, request: npt.ArrayLike, load: npt.ArrayLike = 0.0) -> Array:
        """Angle q at which a request holds the joint [rad]: q = R + c + kappa tau + g(q).

        With an integral term it is R + c.
        It is held there where the sag by the pose is below theta_0 + 2 dead_band, without v_offset.
        """
        level = np.asarray(np.asarray(request, dtype=np.float64) + self.sag(load))
        if self.most_pose_sag == 0.0 or self.has_integral:
            return level
        finite = np.isfinite(level)
        known = np.where(finite, level, 0.0)
        angle = known.copy()
        for _ in range(REST_STEPS):  # Newton's method
            slope = 1.0 - self.sag_sin * np.cos(angle) + self.sag_cos * np.sin(angle)
            angle -= (angle - self.pose_sag(angle) - known) / slope
        return np.where(finite, angle, level)

    def request_at(self, angle: npt.ArrayLike, load: npt.ArrayLike = 0.0) -> Array:
        """Request that holds the joint at an angle, in the middle of the dead band [rad]."""
        return np.asarray(np.asarray(angle) - self.sag(load) - self.pose_sag(angle))

    @property
    def feels_load(self) -> bool:
        """Whether a torque on the joint changes its answer."""
        return self.compliance != 0.0 or self.speed_per_torque != 0.0

    def sag(self, load: npt.ArrayLike = 0.0) -> Array:
        """Angle at rest under a load [N m], less the request [rad]: c + kappa tau of (2).

        The sag by the angle is :meth:`pose_sag`. An integral term makes up for both: c.
        """
        compliance = 0.0 if self.has_integral else self.compliance
        return np.asarray(self.offset + compliance * np.asarray(load, dtype=np.float64))

    def speed_limits(
        self, load: npt.ArrayLike = 0.0, angle: npt.ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Least and largest speed under a load [rad/s]: -v^- and v^+ of (1a).

        Those of a speed loop with an integral, which makes up for its sags, are the demanded ones.

        Args:
            load: Torque on the joint in the direction of positive angles [N m].
            angle: Angle at which gravity acts, by :meth:`gravity` [rad]; None for no gravity.
        """
        faster = self.v_offset + self.top_speed_per_torque * np.asarray(load, dtype=np.float64)
        if angle is not None and self.most_pose_sag > 0.0 and not self.exceeds_v_max:
            faster = faster + self.gain * self.gravity(angle)
        return np.asarray(-(self.v_max - faster)), np.asarray(self.v_max + faster)

    @cached_property
    def top_speed_per_torque(self) -> float:
        """Change of the steady top speeds by a torque [rad/(s N m)]: see :meth:`speed_limits`."""
        made_up = self.gain * self.compliance if self.exceeds_v_max else 0.0
        return self.speed_per_torque - made_up

    def corners(self, load: npt.ArrayLike = 0.0, angle: npt.ArrayLike | None = None) -> Array:
        """Errors at which the slope of f changes, increasing [rad], shape (4, ...).

        Between the first two and the last two f has the slope v_max / theta_0, elsewhere 0.
        Arguments are those of :meth:`speed_limits`.
        """
        limits = self.speed_limits(load, angle)
        low, high = (self.theta_0 * (limit / self.v_max) for limit in limits)
        band = np.broadcast_to(self.steady.dead_band, low.shape)
        return np.stack([low - band, -band, band, high + band])

    def speed(
        self, error: npt.ArrayLike, load: npt.ArrayLike = 0.0, angle: npt.ArrayLike | None = None
    ) -> Array:
        """Speed that errors demand [rad/s]: f of Equation 2 and of (1a).

        An error is request plus :meth:`sag` and :meth:`pose_sag` minus angle [rad]; the further
        arguments are those of :meth:`speed_limits`.
        """
        band = self.steady.dead_band
        beyond = np.asarray(error, dtype=np.float64) - np.clip(error, -band, band)
        low, high = self.speed_limits(load, angle)
        return np.asarray(np.minimum(np.maximum(self.gain * beyond, low), high))

    @cached_property
    def law(self) -> Law:
        """The numbers of the law, by ticks."""
        return Law.of(self, tick=self.tick, acceleration=self.max_acceleration)

    @property
    def has_inertia(self) -> bool:
        """Whether the speed before a tick counts, a part of the joint's state."""
        return self.time_constant > 0.0 or math.isfinite(self.max_acceleration)

    @cached_property
    def states(self) -> int:
        """Numbers in its state: the angle, with inertia the speed, then the integral."""
        return 3 if self.has_integral else 2 if self.has_inertia else 1

    @cached_property
    def exceeds_v_max(self) -> bool:
        """Whether a speed loop's integral may take it beyond v_max, so that no bound holds."""
        return self.integral_rate > 0.0

    @cached_property
    def has_integral(self) -> bool:
        """Whether its servo has an integral term, which overcomes friction."""
        return self.integral_rate > 0.0 or self.position_integral_rate > 0.0

    def faster_per_tick(self, load: npt.ArrayLike = 0.0) -> Array:
        """Excess of the top speed upwards under a load, without gravity [rad/tick]."""
        torque = np.asarray(load, dtype=np.float64)
        return np.asarray((self.v_offset + self.speed_per_torque * torque) * self.tick)

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


class Acting(NamedTuple):
    """The requests that act between samples k-1 and k, on any of some joints."""

    youngest: int  # age of the youngest one, counted back from sample k [requests]
    weights: Array  # of each one at each tick, youngest first, (joints, hold, width)

    @property
    def width(self) -> int:
        """Number of requests that act."""
        return int(self.weights.shape[2])

    @property
    def oldest(self) -> int:
        """Age of the oldest one [requests]."""
        return self.youngest + self.width - 1

    def numbers(self, samples: int, *, cyclic: bool) -> npt.NDArray[np.int_]:
        """Number of the request that acts before sample k, the j-th youngest: (samples, width).

        From rest the index is -1 for requests before the first; they equal the first one.
        """
        numbers = np.arange(samples)[:, np.newaxis] - self.youngest - np.arange(self.width)
        return numbers % samples if cyclic else np.maximum(numbers, -1)


@lru_cache(maxsize=128)
def acting_requests(*models: JointModel) -> Acting:
    """The requests that act on joints, with their weights for the longest hold."""
    youngest = min((each.window.first + each.hold - 1) // each.hold for each in models)
    oldest = max(-((1 - each.hold - each.window.last) // each.hold) for each in models)
    hold = max(model.hold for model in models)
    weights = np.zeros((len(models), hold, oldest - youngest + 1))
    for own, model in zip(weights, models, strict=True):
        for number, tick in enumerate(range(1 - model.hold, 1)):
            for j, weight in enumerate(model.window.weights):
                age = -((tick - model.window.first - j) // model.hold)
                own[number, age - youngest] += weight
    return Acting(youngest, weights)


def with_ticks(
    gain: float, lag: float, tick: float, other: float, *, inertia: bool
) -> tuple[float, float]:
    """v_max / theta_0 [1/s] and lag [s] for the same response with other ticks.

    Without ``inertia`` a tick's share of an error is 1 - exp(-gain * tick). The lag keeps the delay
    of slow motion, as a request during a tick acts at its end.
    """
    if inertia:
        return gain, max(lag - (tick - other), 0.0)
    at_once = -math.log1p(-min(gain * tick, 0.9)) / tick
    return -math.expm1(-at_once * other) / other, max(lag - 0.5 * (tick - other), 0.0)


def slowed_by_friction(gain: float, dead_band: float, time_constant: float, tick: float) -> float:
    """Deceleration by dry friction [rad/s^2]: k gain dead_band / tick, without inertia 0."""
    share = motor_share(time_constant, tick)
    return share * gain * dead_band / tick if share < 1.0 else 0.0


def checked_model(model: object) -> JointModel:
    """The model; raise InvalidModel where it is no JointModel."""
    if not isinstance(model, JointModel):
        raise InvalidModel(
            f"model: got {type(model).__name__}, expected a planner.JointModel, such as "
            "JointModel.ers210a()"
        )
    return model


def _snapped(ticks: float) -> float:
    """Whole ticks where times are so close to them: 0.032 s / 0.008 s is 4."""
    whole = round(ticks)
    return float(whole) if abs(ticks - whole) <= WHOLE_TICKS else ticks
